//! What is changed on its way is noticed, wherever that happens; older partners are understood.

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::{Event, Frame, Hello, LetterFrame, Link, LinkConfig, LinkError, Role};
use proptest::prelude::*;

fn hello(checks: bool) -> Hello {
    Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([1; 16]),
        name: Text::from("one"),
        scope: Text::default(),
        endpoints: vec![Text::from("tcp://robot:4100")],
        max_letter: 1 << 20,
        unix_millis: 0,
        checks,
    }
}

fn link(checks: bool) -> Link {
    Link::new(LinkConfig::new(hello(checks)), Now::default())
}

fn written(link: &mut Link) -> BytesMut {
    let mut octets = BytesMut::new();
    while let Some(part) = link.poll_transmit() {
        octets.extend_from_slice(&part);
    }
    octets
}

/// What a link makes of octets that come in pieces of this size.
fn read(link: &mut Link, octets: &[u8], piece: usize) -> Result<Vec<Event>, LinkError> {
    let mut received = BytesMut::new();
    let mut events = Vec::new();
    for piece in octets.chunks(piece) {
        received.extend_from_slice(piece);
        while let Some(event) = link.receive(Now::default(), &mut received)? {
            events.push(event);
        }
    }
    Ok(events)
}

/// Two ends that have greeted each other.
fn greeted(checks: [bool; 2]) -> [Link; 2] {
    let [mut one, mut two] = checks.map(link);
    let (from_one, from_two) = (written(&mut one), written(&mut two));
    read(&mut one, &from_two, 1000).unwrap();
    read(&mut two, &from_one, 1000).unwrap();
    [one, two]
}

fn letter(octets: usize) -> Frame {
    let parts = [Bytes::from_static(b"an overlay"), vec![7; octets].into()];
    Frame::Letter(LetterFrame {
        id: 1,
        ttl_millis: 1000,
        parts: parts.into_iter().collect(),
    })
}

fn payload(event: &Event) -> Vec<u8> {
    match event {
        Event::Frame(Frame::Letter(letter)) => letter.parts.iter().flatten().copied().collect(),
        other => panic!("{other:?}"),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_bit_that_is_turned_over_ends_the_link(
        octets in prop_oneof![0..100_usize, 20_000..60_000_usize],
        at: prop::sample::Index,
        bit in 0..8_u8,
        piece in prop_oneof![Just(1_000_000_usize), 100..20_000_usize],
    ) {
        let [mut one, mut two] = greeted([true, true]);
        one.send(Now::default(), letter(octets));
        one.send(Now::default(), Frame::Watch);
        let mut said = written(&mut one);
        let whole = read(&mut greeted([true, true])[1], &said, piece).unwrap();
        prop_assert_eq!(whole.len(), 2);
        let head = said.len() - 13;
        let at = at.index(head);
        said[at] ^= 1 << bit;
        // What was said next may be lost with it, and is not taken for another thing.
        prop_assert_eq!(read(&mut two, &said, piece), Err(LinkError::Corrupt));
    }

    #[test]
    fn a_greeting_that_was_changed_opens_no_link(at: prop::sample::Index, bit in 0..8_u8) {
        let mut said = written(&mut link(true));
        let at = at.index(said.len());
        said[at] ^= 1 << bit;
        let heard = read(&mut link(true), &said, 1000);
        let opened = heard.is_ok_and(|events| !events.is_empty());
        prop_assert!(!opened);
    }
}

#[test]
fn who_wants_no_checksums_gets_none() {
    for checks in [[true, true], [true, false], [false, true], [false, false]] {
        let [mut one, mut two] = greeted(checks);
        one.send(Now::default(), letter(50_000));
        let said = written(&mut one);
        let plain = 4 + 1 + 12 + 10 + 50_000;
        let sums = if checks == [true, true] { 8 } else { 0 };
        assert_eq!(said.len(), plain + sums);
        let heard = read(&mut two, &said, 1000).unwrap();
        assert_eq!(payload(&heard[0]).len(), 50_010);
    }
}

#[test]
fn the_greeting_of_an_older_version_opens_the_link_without_checksums() {
    let mut older = BytesMut::new();
    let _ = Frame::Hello(hello(true)).encode(&mut older);
    older.truncate(older.len() - 5);
    let length = u32::try_from(older.len() - 4).unwrap();
    older[..4].copy_from_slice(&length.to_be_bytes());
    let said = [&fipa_link::PREAMBLE[..], &older].concat();
    let mut link = link(true);
    let heard = read(&mut link, &said, 1000);
    assert_eq!(heard, Ok(vec![Event::Opened(hello(false))]));
    let _ = written(&mut link);
    link.send(Now::default(), Frame::Watch);
    assert_eq!(written(&mut link).len(), 5);
}

#[test]
fn a_frame_without_checksum_is_refused_where_they_were_agreed_save_for_a_goodbye() {
    for (frame, fits) in [(Frame::Watch, false), (Frame::Goodbye("end".into()), true)] {
        let [_, mut two] = greeted([true, true]);
        let mut said = BytesMut::new();
        let _ = frame.clone().encode(&mut said);
        let heard = read(&mut two, &said, 1000);
        let expected = match fits {
            true => Ok(vec![Event::Frame(frame)]),
            false => Err(LinkError::Corrupt),
        };
        assert_eq!(heard, expected);
    }
}
