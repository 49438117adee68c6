//! Envelopes that differ in nothing but dates, lengths and the numbers of stamps are recognised.

use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Slots, Text};
use fipa_codec::bit_efficient::{EnvelopeShape, decode_envelope, encode_envelope};
use fipa_codec::{Limits, Output, arbitrary};
use proptest::prelude::*;

fn octets(envelope: &Envelope) -> Vec<u8> {
    let mut out = Output::new();
    encode_envelope(envelope, &mut out).unwrap();
    out.take_bytes().into()
}

fn shape(octets: &[u8]) -> Option<EnvelopeShape> {
    let octets = Bytes::copy_from_slice(octets);
    EnvelopeShape::of(&octets, &Limits::default()).unwrap()
}

/// The envelope with all that may differ set to this.
fn with(envelope: &Envelope, unix_millis: i64, length: u64, number: &str) -> Envelope {
    let mut other = envelope.clone();
    let date = FipaTime::from_unix_millis(unix_millis);
    other.base.date = Some(date);
    for slots in std::iter::once(&mut other.base).chain(&mut other.overlays) {
        slots.payload_length = slots.payload_length.map(|_| length);
        if let Some(stamp) = &mut slots.received {
            stamp.date = date;
            stamp.id = stamp.id.as_ref().map(|_| Text::from(number));
        }
    }
    other
}

/// The numbers of the stamps, that of the newest first.
fn numbers(envelope: &Envelope) -> Vec<Text> {
    let ids = envelope.stamps().filter_map(|stamp| stamp.id.clone());
    let mut ids: Vec<Text> = ids.collect();
    ids.reverse();
    ids
}

/// What a shape says to these octets: where the payload begins, and the numbers of the stamps.
fn fits(shape: &EnvelopeShape, octets: &[u8]) -> Option<(usize, Vec<Text>)> {
    let mut numbers = Vec::new();
    let stamp = |number: &[u8]| {
        numbers.push(Text::from_utf8_lossy(Bytes::copy_from_slice(number)));
        true
    };
    let begin = shape.fits(&Bytes::copy_from_slice(octets), stamp)?;
    Some((begin, numbers))
}

/// As services write them: without a stamp within the base.
fn envelopes() -> impl Strategy<Value = Envelope> {
    arbitrary::envelope().prop_map(|mut envelope| {
        envelope.base.received = None;
        envelope
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn what_differs_only_in_dates_lengths_and_numbers_fits(
        envelope in envelopes(),
        now in 0..4_000_000_000_000_i64,
        length: u64,
        number in "[0-9a-f:-]{1,40}",
        payload: Vec<u8>,
    ) {
        let Some(shape) = shape(&octets(&with(&envelope, 0, 0, "x"))) else {
            // An overlay that is no stamp, or has a stamp of nobody; a layer that is very long.
            let unusual = |slots: &Slots| slots.received.as_ref().is_none_or(|r| r.by.is_empty());
            let long = octets(&envelope).len() > usize::from(u16::MAX);
            prop_assert!(long || envelope.overlays.iter().any(unusual));
            return Ok(());
        };
        let other = with(&envelope, now, length, &number);
        let head = octets(&other);
        let letter = [&head[..], &payload].concat();
        prop_assert_eq!(fits(&shape, &letter), Some((head.len(), numbers(&other))));
    }

    #[test]
    fn what_fits_can_be_read_and_differs_in_nothing_else(
        envelope in envelopes(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3), 0..3),
    ) {
        let known = octets(&envelope);
        let Some(shape) = shape(&known) else {
            return Ok(());
        };
        let mut letter = known.clone();
        for (at, octet, kind) in changes {
            let at = at.index(letter.len());
            match kind {
                0 => letter[at] = octet,
                1 => letter.insert(at, octet),
                _ => drop(letter.remove(at)),
            }
        }
        if let Some((begin, told)) = fits(&shape, &letter) {
            let letter = Bytes::from(letter);
            let (read, payload) = decode_envelope(&letter, &Limits::default()).unwrap();
            prop_assert_eq!((begin, told), (payload, numbers(&read)));
            prop_assert_eq!(with(&read, 0, 0, "x"), with(&envelope, 0, 0, "x"));
        }
    }

    #[test]
    fn another_receiver_sender_or_stamp_does_not_fit(
        one in envelopes(),
        other in envelopes(),
    ) {
        let (first, second) = (with(&one, 0, 0, "x"), with(&other, 0, 0, "x"));
        if let Some(shape) = shape(&octets(&first)) {
            let fits = fits(&shape, &octets(&second)).is_some();
            prop_assert_eq!(fits, first == second);
        }
    }
}

#[test]
fn a_letter_of_which_the_end_is_missing_does_not_fit_and_who_says_no_is_heeded() {
    let stamped = b"\xfd\x00\x2d#1\"a\0$17\"3!\x11\x11\x11\x10Z\x02#2\"xy\0\x03#4\"i:12\0\x04#3\"tcp\0\x01\x01";
    let base = b"\xfe\x00\x20\x10$17\"3!\x11\x11\x11\x10Z\x02\x02#6\"b@home\0\x01\x01\x01";
    let mut base = base.to_vec();
    base[2] = base.len() as u8;
    let letter = [&stamped[..], &base].concat();
    let shape = shape(&letter).unwrap();
    assert_eq!(fits(&shape, &letter).unwrap().1, ["i:12"]);
    for end in 0..letter.len() {
        assert_eq!(fits(&shape, &letter[..end]), None);
    }
    assert_eq!(
        shape.fits(&Bytes::from(letter), |number| number != b"i:12"),
        None
    );
}
