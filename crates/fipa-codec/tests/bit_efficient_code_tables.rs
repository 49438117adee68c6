//! Code tables: recordings, what goes wrong, and what a table may hold.

mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, Message, Performative};
use fipa_codec::bit_efficient::{
    CodeTable, decode_message_prefix_with, decode_message_with, encode_message_with,
};
use fipa_codec::{DecodeError, Fault, Limits, Output};
use support::{hex, recording};

fn table(size: usize) -> CodeTable {
    CodeTable::new(size).unwrap()
}

fn read(octets: &Bytes, table: &mut CodeTable) -> Result<Message, DecodeError> {
    decode_message_with(octets, &Limits::default(), table)
}

fn write(message: &Message, table: &mut CodeTable) -> Bytes {
    let mut out = Output::new();
    encode_message_with(message, table, &mut out).unwrap();
    out.take_bytes()
}

fn inform(to: &str) -> Message {
    Message::new(Performative::Inform).to(to)
}

fn asks_for_reset(error: &DecodeError) -> bool {
    error.what.contains("must be reset")
}

#[test]
fn a_table_has_256_to_65536_entries() {
    for size in [0, 255, 65_537] {
        assert!(CodeTable::new(size).is_err(), "{size}");
    }
    assert_eq!(write(&inform("a"), &mut table(256))[..3], [0xfb, 0x10, 8]);
    for (size, index) in [(256, "11 00"), (257, "11 00 00"), (65_536, "11 00 00")] {
        let mut table = table(size);
        write(&inform("a"), &mut table);
        let expected = hex(&format!("fc 10 08 03 02 {index} 01 01 01"));
        assert_eq!(write(&inform("a"), &mut table), expected, "{size}");
    }
}

/// The add-on enters whole contents into its table. Its numbers are the same as ours as long as
/// they are those of texts from before the first content (the recorded second message); one for
/// something later means another text here, and one for a content cannot be known at all.
#[test]
fn recordings_of_jade_are_read_up_to_an_index_for_a_content() {
    for (name, size) in [("8", 256), ("9", 512), ("16", 65_536)] {
        let sequence = [1, 2, 3].map(|n| recording(&format!("jade/be_codetable{name}_seq{n}.acl")));
        let mut table = table(size);
        for (n, octets) in sequence.iter().take(2).enumerate() {
            let expected = Message::new(Performative::Request)
                .from_agent(AgentId::new("a@platX").address("http://127.0.0.1:1/acc"))
                .to(AgentId::new("b@platY").address("http://127.0.0.1:2/acc"))
                .ontology("onto")
                .language("fipa-sl")
                .protocol("fipa-request")
                .conversation_id(format!("conv-{}", n + 1))
                .content(format!("hello {}", n + 1));
            assert_eq!(read(octets, &mut table), Ok(expected), "{name}");
        }
        let error = read(&sequence[2], &mut table).unwrap_err();
        assert!(asks_for_reset(&error), "{name}: {error}");
        assert_eq!(read(&sequence[0], &mut table), Err(error));
        table.reset();
        assert!(read(&sequence[0], &mut table).is_ok(), "{name}");
    }
}

#[test]
fn contents_numbers_and_dates_do_not_enter() {
    let list = Expression::List(vec![
        Expression::Number("42".into()),
        Expression::Word("word".into()),
    ]);
    let message = inform("b")
        .reply_with(list)
        .reply_by(fipa_acl::FipaTime::from_unix_millis(0))
        .content("content");
    let mut table = table(256);
    write(&message, &mut table);
    // The name and the word.
    assert_eq!(table.len(), 2);
    let again = write(&message, &mut table);
    assert!(again.ends_with(b"\x04\x16\x07content\x01"));
}

#[test]
fn equal_octets_of_another_kind_are_another_text() {
    let octets = hex("fb 10 08 09 10 61 00 0a 14 22 61 22 00 0b 16 01 61 01");
    let mut table = table(256);
    read(&octets, &mut table).unwrap();
    assert_eq!(table.len(), 3);
    let indexes = hex("fc 10 08 09 11 00 0a 15 01 0b 18 02 01");
    let message = read(&indexes, &mut table).unwrap();
    assert!(matches!(message.language, Some(Expression::Word(_))));
    assert!(matches!(message.encoding, Some(Expression::String(_))));
    assert_eq!(message.ontology, message.language);
}

#[test]
fn fused_tokens_enter_and_are_looked_up() {
    let octets = hex("fb 10 08 05 70 61 00 76 01 62 50 63 00 40 01");
    let mut table = table(256);
    let message = read(&octets, &mut table).unwrap();
    assert_eq!(message.reply_with.unwrap().to_string(), "(a (\"b\") c)");
    let octets = hex("fc 10 08 05 71 00 79 01 51 02 40 01");
    let message = read(&octets, &mut table).unwrap();
    assert_eq!(message.reply_with.unwrap().to_string(), "(a (\"b\") c)");
}

#[test]
fn a_text_that_is_met_again_keeps_its_number() {
    let mut table = table(256);
    let twice = hex("fb 10 08 03 02 10 61 00 01 02 10 61 00 01 02 11 00 01 01 01");
    let message = read(&twice, &mut table).unwrap();
    assert_eq!(message.receiver, ["a", "a", "a"].map(AgentId::from));
    assert_eq!(table.len(), 1);
}

#[test]
fn a_free_number_is_an_error_until_the_table_is_reset() {
    let mut table = table(256);
    let octets = hex("fc 10 08 03 02 11 00 01 01 01");
    let error = read(&octets, &mut table).unwrap_err();
    assert_eq!((error.fault, error.offset), (Fault::Malformed, 6));
    assert!(asks_for_reset(&error));
    assert_eq!(table.broken(), Some(&error));
    // Even for what uses no table, and for writing.
    let plain = hex("fa 10 08 01");
    assert_eq!(read(&plain, &mut table), Err(error));
    let mut out = Output::new();
    assert!(encode_message_with(&inform("a"), &mut table, &mut out).is_err());
    table.reset();
    assert!(read(&plain, &mut table).is_ok());
}

#[test]
fn whatever_ends_the_reading_of_a_message_with_a_table_breaks_the_table() {
    for octets in [
        "fb 10 08 03 02 10 61 00",
        "fc 10 08",
        "fb 20 08 01",
        "fb 10 08 01 2a",
        "fb 10 08 0f 01",
    ] {
        let mut table = table(256);
        let error = read(&hex(octets), &mut table).unwrap_err();
        assert!(asks_for_reset(&error), "{octets}: {error}");
    }
}

#[test]
fn errors_in_messages_that_use_no_table_leave_it_alone() {
    let mut table = table(256);
    for octets in ["fa 10 08 03 02 11 00 01 01 01", "fa 10 08", "28", ""] {
        let error = read(&hex(octets), &mut table).unwrap_err();
        assert!(!asks_for_reset(&error), "{octets}: {error}");
        assert_eq!(table.broken(), None);
    }
}

#[test]
fn several_messages_in_one_input_share_a_table() {
    let (mut there, mut here) = (table(256), table(256));
    let messages = ["a", "b", "a"].map(|name| inform(name).content("x"));
    let mut out = Output::new();
    for message in &messages {
        encode_message_with(message, &mut there, &mut out).unwrap();
    }
    let mut octets = out.take_bytes();
    for message in messages {
        let (decoded, used) =
            decode_message_prefix_with(&octets, &Limits::default(), &mut here).unwrap();
        assert_eq!(decoded, message);
        octets = octets.slice(used..);
    }
    assert!(octets.is_empty());
}

#[test]
fn a_message_that_cannot_be_written_leaves_output_and_table_as_they_were() {
    let (mut there, mut here) = (table(256), table(256));
    let mut out = Output::new();
    let bad = inform("new").protocol("two words");
    assert!(encode_message_with(&bad, &mut there, &mut out).is_err());
    assert!(out.is_empty() && there.is_empty());
    for message in [inform("a"), inform("b"), inform("a")] {
        let octets = write(&message, &mut there);
        assert_eq!(read(&octets, &mut here), Ok(message));
    }
}

#[test]
fn what_is_used_stays_and_what_is_not_goes() {
    let (mut there, mut here) = (table(256), table(256));
    for n in 0..1000 {
        let message = inform("always").to(format!("agent{n}"));
        let octets = write(&message, &mut there);
        assert_eq!(read(&octets, &mut here), Ok(message));
        if n > 0 {
            assert_eq!(octets[..7], hex("fb 10 08 03 02 11 00"), "{n}");
        }
        assert!(there.len() <= 256);
    }
    let old = write(&inform("agent1"), &mut there);
    assert_eq!(old[0], 0xfb, "it had to be added again");
}

#[test]
fn a_lost_message_that_added_nothing_does_no_harm() {
    let (mut there, mut here) = (table(256), table(256));
    read(&write(&inform("a"), &mut there), &mut here).unwrap();
    let lost = write(&inform("a"), &mut there);
    assert_eq!(lost[0], 0xfc);
    for message in [inform("b"), inform("a").to("b")] {
        let octets = write(&message, &mut there);
        assert_eq!(read(&octets, &mut here), Ok(message));
    }
}

#[test]
fn a_lost_message_that_added_something_is_noticed_by_the_number_of_the_newest_text() {
    let (mut there, mut here) = (table(256), table(256));
    read(&write(&inform("a"), &mut there), &mut here).unwrap();
    let _lost = write(&inform("b"), &mut there);
    read(&write(&inform("c"), &mut there), &mut here).unwrap();
    let error = read(&write(&inform("c"), &mut there), &mut here).unwrap_err();
    assert!(asks_for_reset(&error));
}

#[test]
fn texts_that_are_too_long_together_do_not_enter() {
    let long = |letter: &str| Message::new(Performative::Inform).language(letter.repeat(9 << 20));
    let (mut there, mut here) = (table(256), table(256));
    for (letter, first) in [("a", 0xfb), ("b", 0xfc), ("a", 0xfc)] {
        let octets = write(&long(letter), &mut there);
        assert_eq!(octets[0], first);
        assert!(read(&octets, &mut here) == Ok(long(letter)));
    }
    let octets = write(&long("b"), &mut table(256));
    let error = read(&octets, &mut here).unwrap_err();
    assert_eq!(error.fault, Fault::Limit);
    assert!(asks_for_reset(&error));
}
