//! What holds for all messages, letters and inputs.

mod input_support;

use bytes::Bytes;
use fipa_acl::{Letter, Message};
use fipa_codec::bit_efficient::{
    decode_envelope, decode_letter, decode_letter_prefix, decode_message, decode_message_prefix,
    encode_letter, encode_message, encode_overlay,
};
use fipa_codec::{Fault, Limits, Output, arbitrary, detect};
use input_support::{limits, mutated};
use proptest::prelude::*;

fn message_octets(message: &Message) -> Bytes {
    let mut out = Output::new();
    encode_message(message, &mut out).unwrap();
    out.take_bytes()
}

fn letter_octets(letter: &Letter) -> Bytes {
    let mut out = Output::new();
    encode_letter(letter, &mut out).unwrap();
    out.take_bytes()
}

/// Octets that have a meaning in the form.
const MEANING: &[u8] = b"\x00\x01\x02\x10\x12\x14\x16";

/// Calls everything that reads.
fn read_all(octets: &[u8]) {
    let octets = Bytes::copy_from_slice(octets);
    for limits in limits() {
        let _ = decode_message(&octets, &limits);
        let _ = decode_message_prefix(&octets, &limits);
        let _ = decode_envelope(&octets, &limits);
        let _ = decode_letter(&octets, &limits);
        let _ = decode_letter_prefix(&octets, &limits);
    }
    detect(&octets);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn messages_come_back_as_they_were(message in arbitrary::message()) {
        let octets = message_octets(&message);
        let decoded = decode_message(&octets, &Limits::default());
        prop_assert_eq!(decoded.as_ref(), Ok(&message));
        prop_assert_eq!(message_octets(&message), octets);
    }

    #[test]
    fn letters_come_back_as_they_were(letter in arbitrary::letter()) {
        let octets = letter_octets(&letter);
        let decoded = decode_letter(&octets, &Limits::default());
        prop_assert_eq!(decoded.as_ref(), Ok(&letter));
        prop_assert_eq!(letter_octets(&letter), octets);
    }

    #[test]
    fn several_messages_in_a_row_are_read_one_by_one(
        messages in prop::collection::vec(arbitrary::message(), 1..4),
    ) {
        let mut out = Output::new();
        for message in &messages {
            encode_message(message, &mut out).unwrap();
        }
        let mut octets = out.take_bytes();
        for message in messages {
            let (decoded, used) = decode_message_prefix(&octets, &Limits::default()).unwrap();
            prop_assert_eq!(decoded, message);
            octets = octets.slice(used..);
        }
        prop_assert!(octets.is_empty());
    }

    #[test]
    fn an_overlay_put_in_front_of_a_letter_is_its_newest(
        mut letter in arbitrary::letter(),
        overlay in arbitrary::overlay(),
    ) {
        let mut out = Output::new();
        encode_overlay(&overlay, &mut out).unwrap();
        out.put_slice(&letter_octets(&letter));
        letter.envelope.overlays.push(overlay);
        prop_assert_eq!(decode_letter(&out.take_bytes(), &Limits::default()), Ok(letter));
    }

    #[test]
    fn truncated_messages_are_refused(message in arbitrary::message()) {
        let octets = message_octets(&message);
        // All lengths of short messages, some of long ones.
        for len in (0..octets.len()).step_by(octets.len() / 200 + 1) {
            let error = decode_message(&octets.slice(..len), &Limits::default()).unwrap_err();
            prop_assert_eq!(error.fault, Fault::Malformed);
            prop_assert!(error.offset <= len);
        }
    }

    #[test]
    fn truncated_envelopes_are_refused(envelope in arbitrary::envelope()) {
        let octets = letter_octets(&Letter { envelope, payload: Bytes::new() });
        for len in (0..octets.len()).step_by(octets.len() / 200 + 1) {
            prop_assert!(decode_letter(&octets.slice(..len), &Limits::default()).is_err());
        }
    }

    #[test]
    fn mutated_messages_do_no_harm(
        octets in mutated(arbitrary::message().prop_map(|message| message_octets(&message)), MEANING),
    ) {
        read_all(&octets);
    }

    #[test]
    fn mutated_letters_do_no_harm(
        octets in mutated(arbitrary::letter().prop_map(|letter| letter_octets(&letter)), MEANING),
    ) {
        read_all(&octets);
    }

    #[test]
    fn what_was_read_and_can_be_written_stays_the_same(
        octets in mutated(arbitrary::message().prop_map(|message| message_octets(&message)), MEANING),
    ) {
        if let Ok(message) = decode_message(&octets.into(), &Limits::default()) {
            let mut out = Output::new();
            if encode_message(&message, &mut out).is_ok() {
                let octets = out.take_bytes();
                let again = decode_message(&octets, &Limits::default()).unwrap();
                prop_assert_eq!(message_octets(&again), octets);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_octets_do_no_harm(
        first in prop::sample::select(vec![0xfa_u8, 0xfd, 0xfe, 0x28]),
        rest in prop::collection::vec(prop_oneof![any::<u8>(), 0_u8..0x20], 0..60),
    ) {
        read_all(&rest);
        read_all(&[&[first], &rest[..]].concat());
        read_all(&[b"\xfa\x10\x08", &rest[..]].concat());
        read_all(&[b"\xfe\x00\x00\x10\x20\x31\x25\x16\x18\x24\x56\x1a\x12\x34", &rest[..]].concat());
    }
}
