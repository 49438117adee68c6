//! What is written to fipa_services, beside what it writes itself.

mod support;

use bytes::{Bytes, BytesMut};
use fipa_acl::{
    AgentId, Envelope, FipaTime, Message, Performative, Received, Representation, Slots,
};
use fipa_codec::bit_efficient::{
    InsertError, encode_envelope_as, encode_message_as, insert_overlay_as,
};
use fipa_codec::{Dialect, Limits, Output};
use support::{letter, message, recording};

fn insert(dialect: Dialect, parts: &[Bytes], overlay: &Slots) -> Vec<Bytes> {
    insert_overlay_as(dialect, parts, overlay, &Limits::default()).unwrap()
}

fn joined(parts: &[Bytes]) -> Bytes {
    Bytes::from(parts.concat())
}

fn stamp(by: &str, unix_millis: i64, id: &str) -> Slots {
    let received = Received {
        by: by.into(),
        from: None,
        date: FipaTime::from_unix_millis(unix_millis),
        id: Some(id.into()),
        via: None,
        user_defined: vec![("left".into(), "out".into())],
    };
    Slots {
        received: Some(received),
        ..Slots::default()
    }
}

fn dedicated(receiver: &str) -> Slots {
    Slots {
        intended_receiver: vec![receiver.into()],
        ..Slots::default()
    }
}

/// The octets of an overlay without its code, its length and its end.
fn inner(overlay: &[u8]) -> &[u8] {
    let [0xfd, _, _, inner @ .., 0x01] = overlay else {
        panic!("no overlay: {overlay:?}");
    };
    inner
}

/// What the length of an overlay counts for fipa_acl: four octets, the parameters, and their end.
fn announced(parameters: &[u8]) -> [u8; 2] {
    u16::try_from(5 + parameters.len()).unwrap().to_be_bytes()
}

/// Recorded letters of one stamp, and of a stamp, a dedicated overlay and another stamp; where
/// their layers begin.
fn stamped_once() -> (Bytes, usize) {
    (
        recording("fipa_acl/env_stamped1_msg_bitefficient.bitefficient.bin"),
        0x6d,
    )
}

fn stamped_twice() -> (Bytes, [usize; 4]) {
    let octets = recording("fipa_acl/env_stamped2_msg_string.bitefficient.bin");
    (octets, [0, 0x6d, 0x90, 0xfd])
}

/// The peer repeats the stamp as a parameter and leaves the payload-length out; both are as good
/// for it, but for the length of a layer that it would take for that of the payload.
#[test]
fn a_stamp_is_that_of_the_recording_with_a_payload_length_instead_of_its_repetition() {
    let (octets, base) = stamped_once();
    let recorded = inner(&octets[..base]);
    let received = &recorded[..recorded.len() / 2];
    assert_eq!(recorded, [received, b"\x0a", received].concat());
    let overlay = stamp("mts-0", 1_399_470_310_456, "1:20140507-13:45:10:456789");
    let parts = insert(Dialect::Cpp, &[octets.slice(base..)], &overlay);
    let parameters = b"\x06\x12\x63\x00";
    let written = &joined(&parts)[..];
    let (written, behind) = written.split_at(written.len() - (octets.len() - base));
    assert_eq!(inner(written), [received, parameters].concat());
    assert_eq!(written[1..3], announced(parameters));
    assert_eq!(behind, &octets[base..]);
}

#[test]
fn a_dedicated_overlay_is_that_of_the_recording_and_a_payload_length() {
    let (octets, [_, begin, end, base]) = stamped_twice();
    let recorded = inner(&octets[begin..end]);
    let no_stamp = b"#0\"\x00\x20\x2a\x81\x12\x12\x11\x11\x11\x11\x11\x01";
    let receivers = recorded.strip_prefix(no_stamp).unwrap();
    assert_eq!(octets[begin + 1..begin + 3], announced(receivers));
    let parts = insert(
        Dialect::Cpp,
        &[octets.slice(base..)],
        &dedicated("receiver"),
    );
    // 117 octets of payload.
    let parameters = [b"\x06\x12\x22\x80", receivers].concat();
    assert_eq!(inner(&parts[0]), [no_stamp, &parameters[..]].concat());
    assert_eq!(parts[0][1..3], announced(&parameters));
}

#[test]
fn overlays_that_are_added_one_by_one_are_read_in_the_order_of_travel() {
    let (recorded, [_, _, _, base]) = stamped_twice();
    let mut parts = vec![recorded.slice(base..)];
    for overlay in [
        stamp("mts-0", 1_399_470_310_456, "1:20140507-13:45:10:456789"),
        dedicated("receiver"),
        stamp("mts-1", 1_399_470_310_789, "1:20140507-13:45:10:789000"),
    ] {
        // Some letters come in one piece.
        parts = insert(Dialect::Cpp, &[joined(&parts)], &overlay);
    }
    let expected = letter(recorded);
    let mut written = letter(joined(&parts));
    for overlay in &mut written.envelope.overlays {
        assert_eq!(overlay.payload_length.take(), Some(117));
    }
    assert_eq!(written, expected);
}

#[test]
fn an_overlay_added_to_a_letter_of_the_peer_is_its_newest() {
    let (octets, base) = stamped_once();
    for dialect in [Dialect::Cpp, Dialect::Standard] {
        let parts = insert(dialect, std::slice::from_ref(&octets), &dedicated("b"));
        let envelope = letter(joined(&parts)).envelope;
        assert_eq!(envelope.intended_receiver(), [AgentId::new("b")]);
        assert!(envelope.overlays[0].received.is_some(), "{dialect:?}");
        assert_eq!(envelope.overlays.len(), 2);
        // Nothing of the letter was copied.
        let at = if dialect == Dialect::Cpp { base } else { 0 };
        let last = parts.last().unwrap();
        assert_eq!(last.as_ptr(), octets[at..].as_ptr());
    }
}

#[test]
fn letters_may_come_in_parts() {
    let (octets, base) = stamped_once();
    let whole = insert(Dialect::Cpp, std::slice::from_ref(&octets), &dedicated("b"));
    for at in [0, 1, base, base + 20, octets.len() - 52, octets.len() - 1] {
        let parts = [octets.slice(..at), octets.slice(at..)];
        for dialect in [Dialect::Cpp, Dialect::Standard] {
            let inserted = insert(dialect, &parts, &dedicated("b"));
            let expected = insert(dialect, std::slice::from_ref(&octets), &dedicated("b"));
            assert_eq!(joined(&inserted), joined(&expected), "{at}");
        }
    }
    assert_eq!(whole.len(), 3);
}

#[test]
fn where_there_is_no_letter_no_overlay_is_added() {
    let limits = Limits::default();
    for octets in [&b""[..], b"\xfa\x10\x08\x01", b"\xfe\x00"] {
        let parts = [Bytes::from_static(octets)];
        let error = insert_overlay_as(Dialect::Cpp, &parts, &dedicated("b"), &limits);
        assert!(matches!(error, Err(InsertError::Letter(_))), "{octets:?}");
    }
    assert!(insert_overlay_as(Dialect::Cpp, &[], &dedicated("b"), &limits).is_err());
    let (octets, _) = stamped_once();
    let unwritable = Slots {
        comments: Some("\0".into()),
        ..Slots::default()
    };
    for dialect in [Dialect::Cpp, Dialect::Standard] {
        let parts = std::slice::from_ref(&octets);
        let error = insert_overlay_as(dialect, parts, &unwritable, &limits);
        assert!(matches!(error, Err(InsertError::Overlay(_))));
    }
}

#[test]
fn a_date_of_a_message_is_that_of_the_recording() {
    let octets = recording("fipa_acl/bench_1024.bitefficient.bin");
    let date = b"\x06\x20\x31\x21\x23\x34\x23\x11\x48\x1a\x91";
    let holds = |octets: &[u8], part: &[u8]| octets.windows(part.len()).any(|w| w == part);
    assert!(holds(&octets, date));
    let decoded = message(octets);
    let mut out = Output::new();
    encode_message_as(Dialect::Cpp, &decoded, &mut out).unwrap();
    let written = out.take_bytes();
    assert!(holds(&written, date));
    assert_eq!(message(written), decoded);
}

#[test]
fn layers_that_the_peer_cannot_read_are_refused() {
    let base = Slots {
        acl_representation: Some(Representation::BitEfficient),
        date: Some(FipaTime::from_unix_millis(0)),
        ..Slots::default()
    };
    let long = Slots {
        comments: Some("x".repeat(70_000).into()),
        ..base.clone()
    };
    let mut overlaid = Envelope::new(base);
    overlaid.overlays.push(Slots {
        comments: long.comments.clone(),
        ..Slots::default()
    });
    for envelope in [Envelope::new(long), overlaid] {
        let mut out = Output::new();
        assert!(encode_envelope_as(Dialect::Cpp, &envelope, 0, &mut out).is_err());
        assert!(out.is_empty());
        encode_envelope_as(Dialect::Standard, &envelope, 0, &mut out).unwrap();
    }
}

#[test]
fn the_parts_of_a_letter_are_passed_on_as_they_are() {
    let message = Message::new(Performative::Inform).content(vec![7; 1 << 20]);
    let mut out = Output::new();
    encode_message_as(Dialect::Cpp, &message, &mut out).unwrap();
    let slots = Slots {
        acl_representation: Some(Representation::BitEfficient),
        date: Some(FipaTime::from_unix_millis(0)),
        ..Slots::default()
    };
    let mut parts = out.take().into_parts();
    let payload = parts.iter().map(Bytes::len).sum();
    encode_envelope_as(Dialect::Cpp, &Envelope::new(slots), payload, &mut out).unwrap();
    parts.insert(0, out.take_bytes());
    let inserted = insert(Dialect::Cpp, &parts, &dedicated("b"));
    let pointers = |parts: &[Bytes]| parts.iter().map(|part| part.as_ptr()).collect::<Vec<_>>();
    assert_eq!(pointers(&inserted[1..]), pointers(&parts));
    let whole: BytesMut = inserted.iter().flatten().copied().collect();
    assert_eq!(
        letter(whole).envelope.payload_length(),
        Some(payload as u64)
    );
}
