//! What holds for all letters that are written to a peer.

mod support;

use bytes::Bytes;
use fipa_acl::{Envelope, FipaTime, Letter, Zone};
use fipa_codec::bit_efficient::{encode_letter_as, insert_overlay_as};
use fipa_codec::{Dialect, Limits, Output, arbitrary};
use proptest::prelude::*;
use support::letter;

const OTHERS: [Dialect; 3] = [Dialect::Standard, Dialect::Jade, Dialect::JadeBridge];

/// The date as one that was written without a zone.
fn zoneless(date: &mut FipaTime) {
    if let FipaTime::Absolute { zone, .. } = date {
        *zone = Zone::Unspecified;
    }
}

/// What remains of a letter for fipa_services.
fn for_cpp(mut letter: Letter) -> Letter {
    let mut length = letter.payload.len() as u64;
    let Envelope { base, overlays } = &mut letter.envelope;
    for slots in std::iter::once(base).chain(overlays) {
        length = *slots.payload_length.get_or_insert(length);
        slots.user_defined.clear();
        if let Some(date) = &mut slots.date {
            zoneless(date);
        }
        if let Some(received) = &mut slots.received {
            received.user_defined.clear();
            zoneless(&mut received.date);
        }
    }
    letter
}

fn octets_as(dialect: Dialect, letter: &Letter) -> Bytes {
    let mut out = Output::new();
    encode_letter_as(dialect, letter, &mut out).unwrap();
    out.take_bytes()
}

/// Whether the peer could read all layers.
fn is_short(letter: &Letter) -> bool {
    let mut out = Output::new();
    encode_letter_as(Dialect::Standard, letter, &mut out).unwrap();
    out.len() - letter.payload.len() < 60_000
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn letters_for_the_peer_are_read_back(original in arbitrary::letter()) {
        prop_assume!(is_short(&original));
        let octets = octets_as(Dialect::Cpp, &original);
        prop_assert_eq!(letter(octets), for_cpp(original));
    }

    #[test]
    fn an_overlay_added_to_a_letter_for_the_peer_is_its_newest(
        original in arbitrary::letter(),
        overlay in arbitrary::overlay(),
    ) {
        let mut expected = original.clone();
        expected.envelope.overlays.push(overlay.clone());
        prop_assume!(is_short(&expected));
        let octets = octets_as(Dialect::Cpp, &original);
        let parts = insert_overlay_as(Dialect::Cpp, &[octets], &overlay, &Limits::default()).unwrap();
        let mut expected = for_cpp(expected);
        let read = letter(parts.concat());
        if let [.., newest] = &mut expected.envelope.overlays[..] {
            // Where it does not say it, the length is the true one.
            newest.payload_length = read.envelope.overlays.last().unwrap().payload_length;
        }
        prop_assert_eq!(read, expected);
    }

    #[test]
    fn the_others_are_written_to_by_the_standard(original in arbitrary::letter()) {
        let standard = octets_as(Dialect::default(), &original);
        for dialect in OTHERS {
            prop_assert_eq!(octets_as(dialect, &original), standard.clone());
        }
    }
}
