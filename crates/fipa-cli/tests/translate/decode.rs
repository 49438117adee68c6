use fipa_cli::{Command, commands};
use serde_json::{Value, json};

use crate::{MESSAGE, MESSAGE_JSON, NOW, decode, encode, failure, parse};

/// The letter with that message.
fn letter() -> Vec<u8> {
    let (letter, result) = encode(&["--envelope", "bit-efficient"], MESSAGE_JSON);
    assert_eq!(result, Ok(()));
    letter
}

/// A letter whose envelope names this representation.
fn letter_of(representation: &str, payload: &str) -> Vec<u8> {
    let json = json!({"envelope": {"acl-representation": representation, "date": NOW},
        "payload": payload});
    let (letter, result) = encode(&["--envelope", "bit-efficient"], &json.to_string());
    assert_eq!(result, Ok(()));
    letter
}

fn parsed(line: &str) -> Value {
    serde_json::from_str(line).unwrap()
}

#[test]
fn a_message_is_one_line() {
    for options in [&[][..], &["--as", "bit-efficient"], &["--raw"]] {
        let (lines, result) = decode(options, MESSAGE);
        assert_eq!(result, Ok(()));
        assert_eq!(lines, format!("{MESSAGE_JSON}\n"));
    }
}

#[test]
fn messages_and_letters_may_follow_each_other() {
    let input = [b"\n", MESSAGE, b"\r\n", MESSAGE, &letter(), MESSAGE, b"\n"].concat();
    let (lines, result) = decode(&[], &input);
    assert_eq!(result, Ok(()));
    let lines: Vec<&str> = lines.lines().collect();
    assert_eq!(lines.len(), 4);
    assert_eq!([lines[0], lines[1], lines[3]], [MESSAGE_JSON; 3]);
    assert_eq!(parsed(lines[2])["message"], parsed(MESSAGE_JSON));
}

#[test]
fn what_follows_must_be_a_message_and_what_came_before_is_shown() {
    let input = [MESSAGE, b"\n", MESSAGE, b"x"].concat();
    let (lines, result) = decode(&[], &input);
    assert_eq!(lines, format!("{MESSAGE_JSON}\n{MESSAGE_JSON}\n"));
    let line = "octet 53: neither a message nor a letter begins here (malformed)";
    assert_eq!(failure(result), (2, line.into()));
}

#[test]
fn offsets_count_from_the_beginning_of_the_input() {
    let cut = &MESSAGE[..20];
    let (_, alone) = decode(&[], cut);
    let (code, line) = failure(alone);
    assert_eq!(code, 2);
    assert!(line.starts_with("octet 20: "), "{line}");

    let (lines, second) = decode(&[], &[MESSAGE, b"\n", cut].concat());
    assert_eq!(lines.lines().count(), 1);
    let (_, line) = failure(second);
    assert!(line.starts_with("octet 47: "), "{line}");
}

#[test]
fn an_offset_in_a_payload_counts_from_the_beginning_of_the_input() {
    let mut input = [MESSAGE, &letter()].concat();
    // The code of the content's string.
    let place = input.len() - 5;
    assert_eq!(input[place], 0x16);
    input[place] = 0x99;
    let (lines, result) = decode(&[], &input);
    assert_eq!(lines.lines().count(), 1);
    let (_, line) = failure(result);
    assert!(line.starts_with(&format!("octet {place}: ")), "{line}");
    let (lines, result) = decode(&["--raw"], &input);
    assert_eq!(result, Ok(()));
    assert_eq!(lines.lines().count(), 2);
}

#[test]
fn an_input_without_a_message_is_malformed() {
    for input in [&b""[..], b" \r\n\t"] {
        let (lines, result) = decode(&[], input);
        assert_eq!(lines, "");
        assert_eq!(failure(result), (2, "no message in the input".into()));
    }
}

#[test]
fn a_file_that_is_not_there_is_a_failure_of_the_environment() {
    let Command::Decode(args) = parse("decode", &["no/such/file"]) else {
        panic!("not decode");
    };
    let (code, line) = failure(commands::decode::run(&args));
    assert_eq!(code, 3);
    assert!(line.starts_with("no/such/file: "), "{line}");
}

#[test]
fn envelope_insists_on_a_letter() {
    let (_, result) = decode(&["--envelope"], MESSAGE);
    let line = "octet 0: no letter begins here (malformed)";
    assert_eq!(failure(result), (2, line.into()));
    let (lines, result) = decode(&["--envelope"], &letter());
    assert_eq!(result, Ok(()));
    assert_eq!(lines, decode(&[], &letter()).0);
}

#[test]
fn raw_shows_the_layers_and_the_payload() {
    let (lines, result) = decode(&["--raw"], &letter());
    assert_eq!(result, Ok(()));
    let raw = parsed(&lines);
    assert_eq!(raw["layers"].as_array().unwrap().len(), 1);
    assert_eq!(raw["layers"][0], raw["envelope"]);
    assert_eq!(raw.get("message"), None);
    let payload = "+hAIAgIQYUBoAAEDAhBiQGgAAQEEFgJoaQE=";
    assert_eq!(raw["payload"], json!({"base64": payload}));
}

#[test]
fn a_payload_of_an_unknown_representation_is_shown_unopened() {
    let letter = letter_of("com.example.rep", "hi");
    let (lines, result) = decode(&[], &letter);
    assert_eq!(result, Ok(()));
    let json = parsed(&lines);
    assert_eq!(json["payload"], json!({"base64": "aGk="}));
    assert_eq!(json["envelope"]["acl-representation"], "com.example.rep");
    let (lines, result) = decode(&["--as", "bit-efficient"], &letter);
    assert_eq!(lines, "");
    assert_eq!(failure(result).0, 2);
}

#[test]
fn what_stands_behind_the_message_of_an_announced_payload_is_ignored() {
    let json = json!({"envelope": {"date": NOW}, "payload": {"base64": "+hAIAXg="}});
    let (letter, _) = encode(&["--envelope", "bit-efficient"], &json.to_string());
    let (lines, result) = decode(&[], &letter);
    assert_eq!(result, Ok(()));
    assert_eq!(parsed(&lines)["message"], json!({"performative": "inform"}));
}
