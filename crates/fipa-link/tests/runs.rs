//! What is read in runs is what is read frame by frame, and what is written ready is what is written
//! piece by piece.

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::{
    Event, Frame, Hello, LetterFrame, Link, LinkConfig, LinkError, Outcome, Piece, ReceiverOutcome,
    Role, WrittenOutcomes,
};
use proptest::prelude::*;

fn link(checks: bool) -> Link {
    let hello = Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([1; 16]),
        name: Text::from("one"),
        scope: Text::default(),
        endpoints: Vec::new(),
        max_letter: 1 << 17,
        unix_millis: 0,
        checks,
    };
    Link::new(LinkConfig::new(hello), Now::default())
}

fn written(link: &mut Link) -> BytesMut {
    let parts = std::iter::from_fn(|| link.poll_transmit());
    parts.fold(BytesMut::new(), |mut all, part| {
        all.extend_from_slice(&part);
        all
    })
}

/// Two ends that have greeted each other.
fn greeted(checks: bool) -> [Link; 2] {
    let [mut one, mut two] = [link(checks), link(checks)];
    let (mut from_one, mut from_two) = (written(&mut one), written(&mut two));
    one.receive(Now::default(), &mut from_two).unwrap();
    two.receive(Now::default(), &mut from_one).unwrap();
    [one, two]
}

fn frame() -> impl Strategy<Value = Frame> {
    let octets = prop_oneof![8 => 0..300_usize, 1 => 4000..5000_usize, 1 => 17_000..90_000_usize];
    let letter = (any::<u64>(), any::<u32>(), octets).prop_map(|(id, ttl_millis, octets)| {
        Frame::Letter(LetterFrame {
            id,
            ttl_millis,
            parts: Bytes::from(vec![id as u8; octets]).into(),
        })
    });
    let outcome = prop::sample::select(vec![Outcome::Delivered, Outcome::Sent, Outcome::Refused]);
    let via = prop::option::of("[a-zé:/]{1,12}".prop_map(Text::from));
    let told = ("[a-z@]{0,12}", outcome, via, "[a-z ]{0,3}");
    let told = told.prop_map(|(to, outcome, via, reason)| ReceiverOutcome {
        to: Text::from(to),
        outcome,
        via,
        reason: Text::from(reason),
    });
    let receipt = (any::<u64>(), prop::collection::vec(told, 0..3)).prop_map(|(id, told)| {
        let outcomes = told.into_iter().collect();
        Frame::Receipt { id, outcomes }
    });
    prop_oneof![5 => letter, 5 => receipt, 1 => Just(Frame::Watch)]
}

/// What a link makes of octets that come in pieces of this size, in runs or frame by frame.
fn read(link: &mut Link, octets: &[u8], piece: usize, runs: bool) -> Result<Vec<Frame>, LinkError> {
    let now = Now::default();
    let mut received = BytesMut::new();
    let mut frames = Vec::new();
    for piece in octets.chunks(piece) {
        received.extend_from_slice(piece);
        loop {
            if runs && let Some(mut run) = link.receive_run(now, &mut received) {
                while let Some(piece) = run.next_piece()? {
                    frames.push(frame_of(piece));
                }
            }
            match link.receive(now, &mut received)? {
                Some(Event::Frame(frame)) => frames.push(plain(frame)),
                Some(_) => {}
                None => break,
            }
        }
    }
    Ok(frames)
}

/// A frame whose letter is in one part, and whose receipt tells nothing but that all went well if it
/// did.
fn plain(frame: Frame) -> Frame {
    match frame {
        Frame::Letter(letter) => {
            let parts: Vec<u8> = letter.parts.iter().flatten().copied().collect();
            Frame::Letter(LetterFrame {
                parts: Bytes::from(parts).into(),
                ..letter
            })
        }
        Frame::Receipt { id, outcomes } => match &outcomes[..] {
            [only] if only.outcome == Outcome::Delivered && only.reason.is_empty() => delivered(id),
            _ => Frame::Receipt { id, outcomes },
        },
        other => other,
    }
}

fn delivered(id: u64) -> Frame {
    let outcomes = told().into();
    Frame::Receipt { id, outcomes }
}

fn told() -> ReceiverOutcome {
    ReceiverOutcome {
        to: Text::from("b"),
        outcome: Outcome::Delivered,
        via: Some(Text::from("tcp://there:1")),
        reason: Text::default(),
    }
}

fn frame_of(piece: Piece) -> Frame {
    match piece {
        Piece::Letter {
            id,
            ttl_millis,
            octets,
        } => Frame::Letter(LetterFrame {
            id,
            ttl_millis,
            parts: octets.into(),
        }),
        Piece::Delivered(id) => delivered(id),
        Piece::Frame(frame) => plain(frame),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn runs_hold_what_frames_hold_however_they_are_cut_or_changed(
        frames in prop::collection::vec(frame(), 1..12),
        checks: bool,
        piece in 1..40_000_usize,
        change in prop::option::weighted(0.5, (any::<prop::sample::Index>(), 1..=255_u8)),
    ) {
        let [mut from, mut by_frames] = greeted(checks);
        let [_, mut by_runs] = greeted(checks);
        frames.into_iter().for_each(|frame| from.send(Now::default(), frame));
        let mut octets = written(&mut from);
        if let Some((at, flip)) = change {
            let at = at.index(octets.len());
            octets[at] ^= flip;
        }
        let frames = read(&mut by_frames, &octets, piece, false);
        prop_assert!(frames == read(&mut by_runs, &octets, piece, true));
        if frames.is_ok() {
            prop_assert_eq!(by_runs.poll_timeout(), by_frames.poll_timeout());
        }
    }

    #[test]
    fn a_letter_with_something_in_front_and_a_written_receipt_are_frames_like_others(
        octets in prop_oneof![0..5000_usize, 60_000..70_000_usize],
        checks: bool,
        id: u64,
        ttl_millis: u32,
    ) {
        let [mut one, mut two] = greeted(checks);
        let (front, letter) = (Bytes::from("a stamp"), Bytes::from(vec![7; octets]));
        one.pass_letter(Now::default(), (id, ttl_millis), &front, &letter);
        one.send_written_receipt(Now::default(), id, &WrittenOutcomes::new(&[told()]));
        let queued = one.queued();
        let octets = written(&mut one);
        prop_assert_eq!((octets.len(), one.queued()), (queued, 0));
        let parts = Bytes::from([front, letter].concat()).into();
        let letter = Frame::Letter(LetterFrame { id, ttl_millis, parts });
        let read = read(&mut two, &octets, usize::MAX, false);
        prop_assert!(read == Ok(vec![letter, delivered(id)]));
    }
}
