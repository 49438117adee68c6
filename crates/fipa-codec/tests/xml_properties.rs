//! What holds for all messages, letters and inputs in XML.

mod input_support;
mod xml_support;

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message};
use fipa_codec::xml::{
    decode_envelope, decode_letter, decode_letter_prefix, decode_message, decode_message_prefix,
    encode_letter, is_envelope,
};
use fipa_codec::{Form, Limits, Output, arbitrary, detect};
use input_support::{limits, mutated};
use proptest::prelude::*;
use xml_support::{envelope_in_xml, message_in_xml, written, written_envelope};

fn messages() -> impl Strategy<Value = Message> {
    arbitrary::message().prop_map(message_in_xml)
}

fn envelopes() -> impl Strategy<Value = Envelope> {
    arbitrary::envelope().prop_map(envelope_in_xml)
}

/// Octets that have a meaning in the form.
const MEANING: &[u8] = b"<>&/\"'![]-=? ;x";

/// Calls everything that reads.
fn read_all(octets: &[u8]) {
    let octets = Bytes::copy_from_slice(octets);
    for limits in limits() {
        let _ = decode_message(&octets, &limits);
        let _ = decode_message_prefix(&octets, &limits);
        let _ = decode_letter(&octets, &limits);
        let _ = decode_letter_prefix(&octets, &limits);
    }
    is_envelope(&octets);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn messages_come_back_as_they_were(message in messages()) {
        let octets = written(&message);
        prop_assert_eq!(detect(&octets), Form::Xml);
        prop_assert!(!is_envelope(&octets));
        let decoded = decode_message(&octets, &Limits::default());
        prop_assert_eq!(decoded.as_ref(), Ok(&message));
    }

    #[test]
    fn letters_come_back_as_they_were(envelope in envelopes(), payload in arbitrary::octets()) {
        let letter = Letter { envelope, payload };
        let mut out = Output::new();
        encode_letter(&letter, &mut out).unwrap();
        let octets = out.take_bytes();
        prop_assert!(is_envelope(&octets));
        prop_assert_eq!(decode_letter(&octets, &Limits::default()), Ok(letter));
    }

    #[test]
    fn envelopes_end_where_their_payload_begins(
        envelope in envelopes(),
        payload in arbitrary::octets(),
    ) {
        let octets = written_envelope(&envelope);
        let with_payload = Bytes::from([&octets[..], &payload[..]].concat());
        let decoded = decode_envelope(&with_payload, &Limits::default());
        prop_assert_eq!(decoded, Ok((envelope, octets.len())));
    }

    #[test]
    fn several_messages_in_a_row_are_read_one_by_one(
        messages in prop::collection::vec(messages(), 1..4),
    ) {
        let parts: Vec<_> = messages.iter().map(written).collect();
        let mut octets = Bytes::from(parts.concat());
        for (message, part) in messages.iter().zip(&parts) {
            let (decoded, used) = decode_message_prefix(&octets, &Limits::default()).unwrap();
            prop_assert_eq!((&decoded, used), (message, part.len()));
            octets = octets.slice(used..);
        }
    }

    #[test]
    fn messages_in_utf_16_are_those_in_utf_8(message in messages(), big_endian in any::<bool>()) {
        let text = String::from_utf8(written(&message).to_vec()).unwrap();
        let unit = if big_endian { u16::to_be_bytes } else { u16::to_le_bytes };
        let utf_16: Vec<u8> = text.encode_utf16().flat_map(unit).collect();
        let mark = unit(0xfeff).to_vec();
        for octets in [utf_16.clone(), [mark, utf_16].concat()] {
            let octets = Bytes::from(octets);
            let (decoded, used) = decode_message_prefix(&octets, &Limits::default()).unwrap();
            prop_assert_eq!((&decoded, used), (&message, octets.len()));
        }
    }

    #[test]
    fn truncated_messages_are_refused(message in messages()) {
        let octets = written(&message);
        // All lengths of short messages, some of long ones.
        for len in (0..octets.len()).step_by(octets.len() / 200 + 1) {
            let error = decode_message(&octets.slice(..len), &Limits::default()).unwrap_err();
            prop_assert!(error.offset <= len);
        }
    }

    #[test]
    fn truncated_envelopes_are_refused(envelope in envelopes()) {
        let octets = written_envelope(&envelope);
        for len in (0..octets.len()).step_by(octets.len() / 200 + 1) {
            prop_assert!(decode_letter(&octets.slice(..len), &Limits::default()).is_err());
        }
    }

    #[test]
    fn mutated_messages_do_no_harm(octets in mutated(messages().prop_map(|m| written(&m)), MEANING)) {
        read_all(&octets);
    }

    #[test]
    fn mutated_envelopes_do_no_harm(
        octets in mutated(envelopes().prop_map(|envelope| written_envelope(&envelope)), MEANING),
    ) {
        read_all(&octets);
    }

    #[test]
    fn what_was_read_and_can_be_written_stays_the_same(
        octets in mutated(messages().prop_map(|message| written(&message)), MEANING),
    ) {
        if let Ok(message) = decode_message(&octets.into(), &Limits::default()) {
            let mut out = Output::new();
            if fipa_codec::xml::encode_message(&message, &mut out).is_ok() {
                let again = decode_message(&out.take_bytes(), &Limits::default());
                let mut message = message_in_xml(message);
                if let Some(time) = &mut message.reply_by {
                    in_utc(time);
                }
                prop_assert_eq!(again, Ok(message));
            }
        }
    }
}

fn in_utc(time: &mut fipa_acl::FipaTime) {
    if let fipa_acl::FipaTime::Absolute { zone, .. } = time {
        *zone = fipa_acl::Zone::Utc;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_octets_do_no_harm(
        octets in prop::collection::vec(any::<u8>(), 0..60),
        marks in "[<>&/\"'!\\[\\]\\-=?;# axcontent]{0,40}",
    ) {
        read_all(&octets);
        for head in [
            "", "<", "<!", "<?", "<!--", "<!DOCTYPE", "<fipa-message act='inform'>",
            "<fipa-message act='inform'><content>", "<fipa-message act='inform'><content><![CDATA[",
            "<fipa-message act='inform'><receiver><agent-identifier><name ",
            "<envelope><params index='1'><comments>", "<envelope><params index='1'><date>",
        ] {
            read_all(&[head.as_bytes(), &octets].concat());
            read_all(&[head.as_bytes(), marks.as_bytes()].concat());
            let tail = "</content></fipa-message></envelope>";
            read_all(&[head.as_bytes(), marks.as_bytes(), tail.as_bytes()].concat());
        }
    }
}
