//! One code table over all bit-efficient messages of an input or output.

use clap::Parser;
use fipa_cli::Cli;
use serde_json::{Value, json};

use crate::recordings::read;
use crate::{NOW, decode, decoded, encode, encoded, failure, without_payload_slots};

fn message(content: &str) -> Value {
    json!({
        "performative": "inform",
        "sender": {"name": "a@h", "addresses": ["http://127.0.0.1:1/acc"]},
        "receiver": [{"name": "b@h"}],
        "content": content,
        "ontology": "two words",
        "conversation-id": format!("c-{content}"),
    })
}

fn lines(values: &[Value]) -> String {
    values.iter().map(|value| format!("{value}\n")).collect()
}

#[test]
fn what_was_written_once_is_a_number_from_then_on() {
    let messages = ["1", "2", "1"].map(message);
    let plain = encoded("bit-efficient", &[], &messages[0]);
    for entries in ["256", "257", "65536"] {
        let options = ["--code-table", entries];
        let (octets, result) = encode(&options, &lines(&messages));
        assert_eq!(result, Ok(()));
        assert!(octets.len() < 2 * plain.len(), "{} octets", octets.len());
        assert_eq!(decoded(&options, &octets), messages);

        let (lines, result) = decode(&[], &octets);
        assert_eq!(lines.lines().count(), 1);
        assert_eq!(failure(result).0, 2);
    }
}

#[test]
fn payloads_and_bare_messages_have_one_table() {
    let options = ["--code-table", "256"];
    let letter = |content: &str| json!({"envelope": {"date": NOW}, "message": message(content)});
    for envelope in ["xml", "bit-efficient"] {
        let letters = [letter("1"), letter("2")];
        let (octets, result) = encode(
            &["--envelope", envelope, "--code-table", "256"],
            &lines(&letters),
        );
        assert_eq!(result, Ok(()));
        let shown = decoded(&options, &octets);
        let shown: Vec<_> = shown.iter().map(without_payload_slots).collect();
        assert_eq!(shown, letters);
    }
}

#[test]
fn unopened_payloads_are_learnt_as_well() {
    let options = ["--code-table", "256"];
    let (all, result) = encode(&options, &lines(&[message("1"), message("2")]));
    assert_eq!(result, Ok(()));
    let (first, _) = encode(&options, &lines(&[message("1")]));
    let second = &all[first.len()..];
    let envelope = format!(
        "<envelope><params index=\"1\"><payload-length>{}</payload-length></params></envelope>",
        first.len()
    );
    let input = [envelope.as_bytes(), &first, second].concat();
    let shown = decoded(&["--raw", "--code-table", "256"], &input);
    assert!(shown[0].get("payload").is_some());
    assert_eq!(shown[1], message("2"));
}

#[test]
fn other_forms_are_none_of_its_business() {
    let messages = ["1", "2"].map(message);
    for rep in ["xml", "string"] {
        let options = ["--code-table", "256"];
        let octets: Vec<u8> = messages
            .iter()
            .flat_map(|message| encoded(rep, &options, message))
            .collect();
        assert_eq!(octets[..octets.len() / 2], encoded(rep, &[], &messages[0]));
        assert_eq!(decoded(&options, &octets), messages);
    }
}

#[test]
fn a_number_that_means_nothing_is_malformed_and_says_where() {
    let input = b"\xfa\x10\x08\x01\xfc\x10\x08\x09\x11\x05\x01";
    let (lines, result) = decode(&["--code-table", "256"], input);
    assert_eq!(lines, "{\"performative\":\"inform\"}\n");
    let (code, line) = failure(result);
    assert_eq!(code, 2);
    assert!(line.starts_with("octet "), "{line}");
}

/// Its third messages take the content from the table, into which no content may be put.
#[test]
fn recorded_tables_of_jade_are_followed_up_to_its_contents() {
    for (bits, entries) in [("8", "256"), ("9", "512"), ("16", "65536")] {
        let message = |number| read(&format!("jade/be_codetable{bits}_seq{number}.acl"));
        let options = ["--code-table", entries];
        let shown = decoded(&options, &[message(1), message(2)].concat());
        assert_eq!(shown[0]["content"], "hello 1");
        assert_eq!(shown[1]["content"], "hello 2");
        for same in ["sender", "receiver", "language", "ontology", "protocol"] {
            assert_eq!(shown[1][same], shown[0][same]);
        }
        let (lines, result) = decode(&options, &[message(1), message(2), message(3)].concat());
        assert_eq!((lines.lines().count(), failure(result).0), (2, 2));
    }
}

#[test]
fn a_table_has_256_to_65536_entries() {
    for command in [&["fipa", "decode"][..], &["fipa", "encode", "--as", "xml"]] {
        for (entries, is_one) in [
            ("255", false),
            ("256", true),
            ("65536", true),
            ("65537", false),
        ] {
            let line = [command, &["--code-table", entries]].concat();
            assert_eq!(Cli::try_parse_from(line).is_ok(), is_one, "{entries}");
        }
    }
}
