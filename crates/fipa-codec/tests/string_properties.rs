//! What holds for all messages and inputs, in string form.

mod input_support;
mod string_support;

use bytes::Bytes;
use fipa_codec::string::{decode_message, decode_message_prefix, encode_message};
use fipa_codec::{Fault, Form, Limits, Output, detect};
use input_support::{limits, mutated};
use proptest::prelude::*;
use string_support::{messages, octets_of};

/// A literal can end in a backslash if no other quote follows, so what is cut off behind a quote
/// inside a literal can be a message.
fn ends_in_an_inner_quote(text: &[u8]) -> bool {
    let quote = text.iter().rposition(|octet| *octet == b'"');
    quote.is_some_and(|quote| text[..quote].ends_with(b"\\"))
}

/// Octets that have a meaning in the form.
const MEANING: &[u8] = b" \"\\#():0123456789X-";

fn mutated_messages() -> impl Strategy<Value = Vec<u8>> {
    mutated(messages().prop_map(|message| octets_of(&message)), MEANING)
}

/// Calls everything that reads.
fn read_all(octets: &[u8]) {
    let octets = Bytes::copy_from_slice(octets);
    for limits in limits() {
        for result in [
            decode_message(&octets, &limits).map(|_| octets.len()),
            decode_message_prefix(&octets, &limits).map(|(_, used)| used),
        ] {
            assert!(result.unwrap_or_else(|error| error.offset) <= octets.len());
        }
    }
    detect(&octets);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn messages_come_back_as_they_were(message in messages()) {
        let octets = octets_of(&message);
        prop_assert_eq!(detect(&octets), Form::String);
        let decoded = decode_message(&octets, &Limits::default());
        prop_assert_eq!(decoded.as_ref(), Ok(&message));
        prop_assert_eq!(octets_of(&message), octets);
    }

    #[test]
    fn several_messages_in_a_row_are_read_one_by_one(
        messages in prop::collection::vec(messages(), 1..4),
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
    fn truncated_messages_are_refused(message in messages()) {
        let octets = octets_of(&message);
        // All lengths of short messages, some of long ones.
        for len in (0..octets.len()).step_by(octets.len() / 200 + 1) {
            let cut = octets.slice(..len);
            match decode_message(&cut, &Limits::default()) {
                Err(error) => {
                    prop_assert_eq!(error.fault, Fault::Malformed);
                    prop_assert!(error.offset <= len);
                }
                Ok(_) => prop_assert!(ends_in_an_inner_quote(&cut), "{:?}", cut),
            }
        }
    }

    #[test]
    fn mutated_messages_do_no_harm(octets in mutated_messages()) {
        read_all(&octets);
    }

    #[test]
    fn what_was_read_and_can_be_written_stays_the_same(octets in mutated_messages()) {
        if let Ok(message) = decode_message(&octets.into(), &Limits::default()) {
            let mut out = Output::new();
            if encode_message(&message, &mut out).is_ok() {
                let octets = out.take_bytes();
                let again = decode_message(&octets, &Limits::default()).unwrap();
                prop_assert_eq!(octets_of(&again), octets);
            }
        }
    }
}

/// Pieces of messages, in any order.
fn pieces() -> impl Strategy<Value = Vec<u8>> {
    let known = prop::sample::select(vec![
        "(inform",
        ":sender",
        ":receiver",
        ":content",
        ":reply-by",
        ":protocol",
        ":language",
        ":X-a",
        ":foo",
        "(agent-identifier",
        ":name",
        ":addresses",
        "(sequence",
        "(set",
        ":resolvers",
        "(",
        ")",
        " ",
        " ",
        " ",
        "\"",
        "\\\"",
        "#3\"",
        "#",
        "#99999999999999999999\"",
        "20260102T030405678Z",
        "+00000000T000500000",
        "a@b",
        "12",
        "-1.5e3",
        ":",
        "X-",
        ":X-JADE-Encoding Base64",
        "AAEC",
        "\u{fffd}",
        "\0",
    ]);
    let piece = prop_oneof![
        8 => known.prop_map(|piece| piece.as_bytes().to_vec()),
        1 => prop::collection::vec(any::<u8>(), 0..5),
    ];
    prop::collection::vec(piece, 0..40).prop_map(|pieces| pieces.concat())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_pieces_do_no_harm(octets in pieces()) {
        read_all(&octets);
        read_all(&[b"(inform ", &octets[..], b")"].concat());
        read_all(&[b"(inform:content", &octets[..], b")"].concat());
        read_all(&[b"(inform :sender (agent-identifier :name a", &octets[..], b"))"].concat());
    }
}
