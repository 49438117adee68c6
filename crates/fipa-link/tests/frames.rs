//! Frames: every one comes back as it was, however the octets are cut.

use bytes::{BufMut, Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{Entry, InstanceId, Location, Now, Source, State};
use fipa_link::{
    AskCallBack, CallBack, CallBackResult, CalledBack, DirectoryFrame, DirectoryItem, Event, Facts,
    Frame, Hello, Inside, KnownPlatform, LetterFrame, Link, LinkConfig, LinkError, Outcome,
    PREAMBLE, Passed, PeerFacts, ReceiverOutcome, Role, Sniffed,
};
use proptest::prelude::*;

fn text() -> impl Strategy<Value = Text> {
    ".{0,12}".prop_map(Text::from)
}

fn instance() -> impl Strategy<Value = InstanceId> {
    any::<[u8; 16]>().prop_map(InstanceId::from_bytes)
}

fn hello() -> impl Strategy<Value = Hello> {
    let role = prop_oneof![Just(Role::Daemon), Just(Role::Program)];
    let endpoints = prop::collection::vec(text(), 0..4);
    let numbers = (any::<u16>(), any::<u64>(), any::<i64>(), any::<bool>());
    (numbers, role, instance(), text(), text(), endpoints).prop_map(
        |((version, max_letter, unix_millis, checks), role, instance, name, scope, endpoints)| {
            Hello {
                version,
                role,
                instance,
                name,
                scope,
                endpoints,
                max_letter,
                unix_millis,
                checks,
            }
        },
    )
}

fn outcome() -> impl Strategy<Value = ReceiverOutcome> {
    let outcome = prop::sample::select(vec![
        Outcome::Delivered,
        Outcome::Sent,
        Outcome::Unknown,
        Outcome::Refused,
        Outcome::Timeout,
        Outcome::Expired,
    ]);
    // An empty address is none.
    let via = prop::option::of(".{1,12}".prop_map(Text::from));
    (text(), outcome, via, text()).prop_map(|(to, outcome, via, reason)| ReceiverOutcome {
        to,
        outcome,
        via,
        reason,
    })
}

fn entry() -> impl Strategy<Value = Entry> {
    let location =
        (text(), text()).prop_map(|(address, signature)| Location { address, signature });
    let locations = prop::collection::vec(location, 0..3);
    (text(), text(), locations, text(), any::<i64>()).prop_map(
        |(name, kind, locations, description, timestamp)| Entry {
            name,
            kind,
            locations,
            description,
            timestamp,
        },
    )
}

fn item() -> impl Strategy<Value = DirectoryItem> {
    let sources = vec![Source::Local, Source::Mdns, Source::Peer, Source::Ams];
    let states = vec![State::Alive, State::Suspect, State::Gone];
    let how = (prop::sample::select(sources), prop::sample::select(states));
    prop_oneof![
        (instance(), how, any::<u64>(), entry()).prop_map(
            |(owner, (source, state), age_millis, entry)| DirectoryItem::Put {
                owner,
                source,
                state,
                age_millis,
                entry,
            }
        ),
        (instance(), text()).prop_map(|(owner, name)| DirectoryItem::Remove { owner, name }),
    ]
}

fn platform() -> impl Strategy<Value = KnownPlatform> {
    let addresses = prop::collection::vec(text(), 0..4);
    (instance(), text(), text(), addresses, any::<u64>()).prop_map(
        |(instance, name, scope, addresses, age_millis)| KnownPlatform {
            instance,
            name,
            scope,
            addresses,
            age_millis,
        },
    )
}

fn facts() -> impl Strategy<Value = Facts> {
    let peer = (
        prop::option::of(any::<[u8; 16]>()),
        text(),
        prop::collection::vec(text(), 0..3),
        any::<bool>(),
        prop::option::of(any::<u64>()),
        text(),
    );
    let peer = peer.prop_map(
        |(instance, name, addresses, announced, heard_millis, error)| PeerFacts {
            instance: instance.map(InstanceId::from_bytes),
            name,
            addresses,
            announced,
            heard_millis,
            error,
        },
    );
    let left_out = prop::collection::vec((text(), text()), 0..3);
    let endpoints = prop::collection::vec(text(), 0..3);
    let peers = prop::collection::vec(peer, 0..3);
    let port = prop::option::of(1..=u16::MAX);
    (instance(), text(), text(), endpoints, port, left_out, peers).prop_map(
        |(instance, name, scope, endpoints, mdns_port, left_out, peers)| Facts {
            instance,
            name,
            scope,
            endpoints,
            mdns_port,
            left_out,
            peers,
        },
    )
}

fn sniffed() -> impl Strategy<Value = Sniffed> {
    let outcomes = prop::collection::vec(outcome(), 0..3);
    let octets = prop::collection::vec(any::<u8>(), 0..200);
    let passed = prop_oneof![
        Just(Passed::Begin),
        Just(Passed::End),
        (text(), text(), outcomes, octets).prop_map(|(from, via, outcomes, octets)| {
            Passed::Letter {
                from,
                via,
                outcomes,
                parts: Bytes::from(octets).into(),
            }
        }),
        (text(), any::<bool>(), text(), text()).prop_map(|(protocol, incoming, place, form)| {
            Passed::Inside(Inside {
                protocol,
                incoming,
                place,
                form,
            })
        }),
    ];
    let numbers = (any::<u64>(), any::<i64>(), any::<u64>());
    (numbers, passed).prop_map(|((number, unix_millis, lost), passed)| Sniffed {
        number,
        unix_millis,
        lost,
        passed,
    })
}

fn call_backs() -> impl Strategy<Value = Frame> {
    let result = prop::sample::select(vec![
        CallBackResult::Answered,
        CallBackResult::Refused,
        CallBackResult::NotReached,
        CallBackResult::Stranger,
        CallBackResult::Untried,
    ]);
    let call = (text(), result, text()).prop_map(|(address, result, reason)| CallBack {
        address,
        result,
        reason,
    });
    let calls = prop::collection::vec(call, 0..4);
    let addresses = prop::collection::vec(text(), 0..4);
    prop_oneof![
        (any::<u64>(), instance(), addresses).prop_map(|(request, whom, addresses)| {
            Frame::AskCallBack(AskCallBack {
                request,
                whom,
                addresses,
            })
        }),
        (any::<u64>(), text(), calls).prop_map(|(request, refusal, calls)| {
            Frame::CalledBack(CalledBack {
                request,
                refusal,
                calls,
            })
        }),
    ]
}

/// Any frame but those that a link answers by itself.
fn frame() -> impl Strategy<Value = Frame> {
    let items = prop::collection::vec(item(), 0..5);
    prop_oneof![
        (
            any::<u64>(),
            any::<u32>(),
            prop::collection::vec(any::<u8>(), 0..200)
        )
            .prop_map(|(id, ttl_millis, octets)| Frame::Letter(LetterFrame {
                id,
                ttl_millis,
                parts: Bytes::from(octets).into(),
            })),
        (any::<u64>(), prop::collection::vec(outcome(), 0..5)).prop_map(|(id, outcomes)| {
            Frame::Receipt {
                id,
                outcomes: outcomes.into_iter().collect(),
            }
        }),
        (any::<u64>(), text(), text(), text()).prop_map(|(request, name, kind, description)| {
            Frame::Attach {
                request,
                name,
                kind,
                description,
            }
        }),
        (any::<u64>(), text()).prop_map(|(request, name)| Frame::Detach { request, name }),
        (any::<u64>(), text()).prop_map(|(request, refusal)| Frame::Answer { request, refusal }),
        Just(Frame::Watch),
        (any::<u64>(), any::<bool>(), any::<bool>(), items).prop_map(
            |(version, snapshot, more, items)| Frame::Directory(DirectoryFrame {
                version,
                snapshot,
                more,
                items,
            })
        ),
        text().prop_map(Frame::Goodbye),
        prop::collection::vec(platform(), 0..5).prop_map(Frame::Platforms),
        prop::collection::vec(any::<u8>(), 0..50).prop_map(|list| Frame::Revoked(list.into())),
        Just(Frame::AskFacts),
        facts().prop_map(Frame::Facts),
        any::<bool>().prop_map(Frame::Sniff),
        sniffed().prop_map(|sniffed| Frame::Sniffed(Box::new(sniffed))),
        call_backs(),
    ]
}

/// Whether the frame ends with the octets of a letter, however many there are.
fn ends_with_letter(frame: &Frame) -> bool {
    match frame {
        Frame::Letter(_) => true,
        Frame::Sniffed(sniffed) => matches!(sniffed.passed, Passed::Letter { .. }),
        _ => false,
    }
}

fn any_frame() -> impl Strategy<Value = Frame> {
    prop_oneof![
        5 => frame(),
        1 => hello().prop_map(Frame::Hello),
        1 => any::<u64>().prop_map(Frame::Ping),
        1 => any::<u64>().prop_map(Frame::Pong),
        1 => any::<u64>().prop_map(Frame::After),
    ]
}

fn octets(frame: Frame) -> BytesMut {
    let mut octets = BytesMut::new();
    let letter = frame.encode(&mut octets);
    letter
        .iter()
        .for_each(|part| octets.extend_from_slice(part));
    octets
}

fn greeting() -> Hello {
    Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([1; 16]),
        name: Text::from("one"),
        scope: Text::default(),
        endpoints: Vec::new(),
        max_letter: 1 << 20,
        unix_millis: 0,
        checks: false,
    }
}

fn link() -> Link {
    Link::new(LinkConfig::new(greeting()), Now::default())
}

/// What a link makes of octets that arrive in these pieces.
fn events(pieces: &[&[u8]]) -> Result<Vec<Event>, LinkError> {
    let mut link = link();
    let mut received = BytesMut::new();
    let mut events = Vec::new();
    for piece in pieces {
        received.extend_from_slice(piece);
        while let Some(event) = link.receive(Now::default(), &mut received)? {
            events.push(event);
        }
    }
    Ok(events)
}

proptest! {
    #[test]
    fn a_frame_comes_back_as_it_was(frame in any_frame()) {
        let octets = octets(frame.clone()).freeze();
        let (length, body) = octets.split_at(4);
        prop_assert_eq!(u32::from_be_bytes(length.try_into().unwrap()) as usize, body.len());
        let read = Frame::decode(body[0], octets.slice(5..));
        prop_assert_eq!(read, Ok(frame));
    }

    #[test]
    fn what_a_later_version_adds_to_a_frame_is_passed_over(frame in any_frame(), more: [u8; 3]) {
        prop_assume!(!ends_with_letter(&frame));
        let mut octets = octets(frame.clone());
        octets.put_slice(&more);
        let octets = octets.freeze();
        prop_assert_eq!(Frame::decode(octets[4], octets.slice(5..)), Ok(frame));
    }

    #[test]
    fn a_frame_that_ends_too_soon_is_an_error(frame in any_frame(), keep: prop::sample::Index) {
        prop_assume!(!ends_with_letter(&frame));
        prop_assume!(!matches!(frame, Frame::Watch | Frame::AskFacts));
        let is_hello = matches!(frame, Frame::Hello(_));
        let octets = octets(frame).freeze();
        let end = 5 + keep.index(octets.len() - 5);
        // There a hello of an older version ends.
        prop_assume!(!is_hello || end != octets.len() - 5);
        prop_assert!(Frame::decode(octets[4], octets.slice(5..end)).is_err());
    }

    #[test]
    fn however_octets_are_cut_the_events_are_the_same(
        frames in prop::collection::vec(frame(), 0..6),
        mut cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..20),
    ) {
        let mut all = BytesMut::from(&PREAMBLE[..]);
        all.extend_from_slice(&octets(Frame::Hello(greeting())));
        for frame in &frames {
            all.extend_from_slice(&octets(frame.clone()));
            all.extend_from_slice(&octets(Frame::Unknown(100)));
        }
        let mut at: Vec<usize> = cuts.drain(..).map(|cut| cut.index(all.len())).collect();
        at.extend([0, all.len()]);
        at.sort_unstable();
        let pieces: Vec<&[u8]> = at.windows(2).map(|w| &all[w[0]..w[1]]).collect();
        let mut expected = vec![Event::Opened(greeting())];
        expected.extend(frames.into_iter().map(Event::Frame));
        prop_assert_eq!(events(&[&all]), Ok(expected.clone()));
        prop_assert_eq!(events(&pieces), Ok(expected.clone()));
        let single: Vec<&[u8]> = all.chunks(1).collect();
        prop_assert_eq!(events(&single), Ok(expected));
    }

    #[test]
    fn arbitrary_octets_never_panic(octets in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = events(&[&octets]);
        let mut greeted = PREAMBLE.to_vec();
        greeted.extend_from_slice(&octets);
        let _ = events(&[&greeted]);
    }

    #[test]
    fn arbitrary_bodies_never_panic(
        kind in 0_u8..14,
        octets in prop::collection::vec(any::<u8>(), 0..300),
        open: bool,
    ) {
        let _ = Frame::decode(kind, Bytes::from(octets.clone()));
        let mut all = BytesMut::from(&PREAMBLE[..]);
        if open {
            all.extend_from_slice(&self::octets(Frame::Hello(greeting())));
        }
        all.put_u32(octets.len() as u32 + 1);
        all.put_u8(kind);
        all.put_slice(&octets);
        let _ = events(&[&all]);
    }

    #[test]
    fn a_frame_with_one_octet_changed_never_panics(
        frame in any_frame(),
        at: prop::sample::Index,
        to: u8,
    ) {
        let mut all = BytesMut::from(&PREAMBLE[..]);
        all.extend_from_slice(&octets(Frame::Hello(greeting())));
        let begin = all.len();
        all.extend_from_slice(&octets(frame));
        let at = begin + at.index(all.len() - begin);
        all[at] = to;
        let _ = events(&[&all]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_large_letter_is_taken_in_large_pieces_however_it_is_cut(
        octets in 0_usize..200_000,
        mut cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..40),
    ) {
        let content: Vec<u8> = (0..octets).map(|at| (at ^ (at >> 8)) as u8).collect();
        let letter = Frame::Letter(LetterFrame {
            id: 7,
            ttl_millis: 8,
            parts: Bytes::from(content.clone()).into(),
        });
        let mut all = BytesMut::from(&PREAMBLE[..]);
        all.extend_from_slice(&self::octets(Frame::Hello(greeting())));
        all.extend_from_slice(&self::octets(letter));
        all.extend_from_slice(&self::octets(Frame::Watch));
        let mut at: Vec<usize> = cuts.drain(..).map(|cut| cut.index(all.len())).collect();
        at.extend([0, all.len()]);
        at.sort_unstable();
        let pieces: Vec<&[u8]> = at.windows(2).map(|w| &all[w[0]..w[1]]).collect();
        let mut events = events(&pieces).unwrap();
        prop_assert_eq!(events.pop(), Some(Event::Frame(Frame::Watch)));
        let Some(Event::Frame(Frame::Letter(read))) = events.pop() else {
            panic!("no letter");
        };
        prop_assert_eq!((read.id, read.ttl_millis), (7, 8));
        let parts: Vec<Bytes> = read.parts.into_iter().collect();
        prop_assert!(parts.concat() == content);
        let but_the_last = &parts[..parts.len() - 1];
        // The head of the frame came with the first.
        prop_assert!(but_the_last.iter().all(|part| part.len() >= (16 << 10) - 17));
    }
}

#[test]
fn a_letter_is_written_without_being_copied() {
    let payload = Bytes::from(vec![7; 100]);
    let large_overlay = Bytes::from(vec![8; 1000]);
    let written = |overlay: Bytes| {
        let mut head = BytesMut::new();
        let letter = LetterFrame {
            id: 1,
            ttl_millis: 2,
            parts: [overlay, payload.clone()].into_iter().collect(),
        };
        let parts = Frame::Letter(letter).encode(&mut head);
        (head.freeze(), parts.into_iter().collect::<Vec<_>>())
    };
    let (head, parts) = written(Bytes::from_static(b"overlay"));
    assert!(head.ends_with(b"overlay"));
    assert_eq!(parts.len(), 1);
    assert_eq!(parts[0].as_ptr(), payload.as_ptr());
    let (head, parts) = written(large_overlay.clone());
    assert_eq!(head.len(), 17);
    assert_eq!(parts[0].as_ptr(), large_overlay.as_ptr());
    assert_eq!(parts[1].as_ptr(), payload.as_ptr());
}

#[test]
fn a_letter_shares_the_buffer_in_which_it_arrived() {
    let letter = LetterFrame {
        id: 1,
        ttl_millis: 2,
        parts: Bytes::from(vec![7; 1000]).into(),
    };
    let octets = octets(Frame::Letter(letter)).freeze();
    match Frame::decode(2, octets.slice(5..)) {
        Ok(Frame::Letter(read)) => {
            assert_eq!(
                read.parts.iter().next().unwrap().as_ptr(),
                octets.slice(17..).as_ptr()
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_count_larger_than_the_frame_is_refused_before_anything_is_reserved() {
    let mut receipt = BytesMut::new();
    receipt.put_u64(1);
    receipt.put_u32(u32::MAX);
    assert!(Frame::decode(3, receipt.freeze()).is_err());
}

#[test]
fn what_a_later_version_adds_to_a_platform_is_passed_over() {
    let mut body = BytesMut::new();
    body.put_u32(2);
    for n in [1, 2] {
        let mut platform = BytesMut::new();
        platform.put_slice(&[n; 16]);
        // Name, scope and addresses are empty.
        platform.put_bytes(0, 12);
        platform.put_u64(7);
        platform.put_slice(b"something new");
        body.put_u32(u32::try_from(platform.len()).unwrap());
        body.put_slice(&platform);
    }
    let Ok(Frame::Platforms(platforms)) = Frame::decode(12, body.freeze()) else {
        panic!("not read");
    };
    let read: Vec<_> = platforms
        .iter()
        .map(|p| (p.instance, p.age_millis))
        .collect();
    let expected = [1, 2].map(|n| (InstanceId::from_bytes([n; 16]), 7));
    assert_eq!(read, expected);
}
