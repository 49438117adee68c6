//! What peers of other makes wrote, translated to JSON, back, and to JSON again.

use std::path::{Path, PathBuf};

use fipa_cli::Failure;
use serde_json::Value;

use crate::{decode, decoded, encode_as, encoded, without_payload_slots};

/// The recordings that cannot be decoded: where that is found, and why.
const UNREADABLE: [(&str, &str); 17] = [
    // Cut short on purpose.
    ("dec_content_len32_truncated.bitefficient.bin", "octet 9:"),
    // No XML.
    ("dec_xml_garbage.xml.bin", "octet 0:"),
    // A message without its act.
    ("dec_xml_no_act.xml.bin", "octet 14:"),
    // A parameter of unknown extent, in an envelope whose length is wrong.
    ("decenv_encrypted_08.bitefficient.bin", "octet 14:"),
    // Envelopes written by hand, around a few octets that are no message.
    ("decenv_jumbo_base.bitefficient.bin", "octet 19:"),
    ("decenv_payload_len_plain.bitefficient.bin", "octet 18:"),
    ("decenv_spec_example.xml.bin", "octet 502:"),
    ("decenv_spec_paramorder.bitefficient.bin", "octet 30:"),
    ("decenv_userdef_param.bitefficient.bin", "octet 28:"),
    ("decenv_wrong_len.bitefficient.bin", "octet 15:"),
    // The announced payload is not there.
    ("env_empty_payload.bitefficient.bin", "octet 71:"),
    ("env_empty_payload.xml.bin", "octet 439:"),
    // An overlay names another representation than that of the payload.
    ("env_overlay_all.bitefficient.bin", "octet 235:"),
    ("env_overlay_all.xml.bin", "octet 1040:"),
    // The envelope announces a part of the payload only.
    ("env_payload_length_10.bitefficient.bin", "octet 77:"),
    ("env_payload_length_10.xml.bin", "octet 445:"),
    // Nobody can tell where the name of the agent ends.
    ("receiver_userparams.string.bin", "octet 78:"),
];

/// The recordings of fipa_acl of these kinds: file, octets, representation.
fn recordings(kinds: [&str; 2]) -> Vec<(String, Vec<u8>, &'static str)> {
    let index: Value = serde_json::from_slice(&read("fipa_acl/index.json")).unwrap();
    index
        .as_array()
        .unwrap()
        .iter()
        .filter(|entry| kinds.iter().any(|kind| entry["kind"] == *kind))
        .map(|entry| {
            let file = entry["file"].as_str().unwrap().to_owned();
            let octets = read(&format!("fipa_acl/{file}"));
            let rep = match entry["representation"].as_str().unwrap() {
                "bitefficient" => "bit-efficient",
                "string" => "string",
                "xml" => "xml",
                other => panic!("{other}"),
            };
            (file, octets, rep)
        })
        .collect()
}

/// Whether the recording is one that cannot be decoded, and that for the known reason.
fn is_unreadable(file: &str, octets: &[u8]) -> bool {
    let Some((_, place)) = UNREADABLE.iter().find(|(name, _)| *name == file) else {
        return false;
    };
    let failure = decode(&[], octets).1.expect_err(file);
    assert_eq!(failure.code(), 2, "{file}");
    assert!(failure.to_string().starts_with(place), "{file}: {failure}");
    true
}

#[test]
fn recorded_messages_survive_the_way_through_json() {
    let mut count = 0;
    for (file, octets, rep) in recordings(["message", "decode-only-message"]) {
        if is_unreadable(&file, &octets) {
            continue;
        }
        let message = only(decoded(&[], &octets));
        assert_eq!(only(decoded(&["--as", rep], &octets)), message, "{file}");
        if is_unwritable(&file, rep, &message) {
            continue;
        }
        let again = encoded(rep, &[], &message);
        assert_eq!(only(decoded(&["--as", rep], &again)), message, "{file}");
        count += 1;
    }
    assert!(count > 200, "only {count} recordings");
}

/// Whether a message was read that must not be written.
fn is_unwritable(file: &str, rep: &str, message: &Value) -> bool {
    let (parameter, place) = match file {
        // No legal words.
        "dec_word_starts_digit.bitefficient.bin" | "dec_word_utf8.bitefficient.bin" => {
            ("protocol", "1:1: protocol: ")
        }
        "dec_str_userdef_perf.string.bin" => ("performative", "1:1: performative: "),
        _ => return false,
    };
    assert!(message.get(parameter).is_some(), "{file}");
    let failure = encode_as(rep, &[], &message.to_string()).1.expect_err(file);
    assert!(failure.to_string().starts_with(place), "{file}: {failure}");
    true
}

#[test]
fn recorded_letters_survive_the_way_through_json() {
    let mut count = 0;
    for (file, octets, rep) in recordings(["envelope", "decode-only-envelope"]) {
        if is_unreadable(&file, &octets) {
            continue;
        }
        let letter = only(decoded(&["--envelope"], &octets));
        if letter.get("message").is_none() {
            // Nobody knows how the few octets in it are represented.
            continue;
        }
        let again = encoded(payload_rep(&letter), &["--envelope", rep], &letter);
        // Our encoding of the message is another than the peer's.
        assert_eq!(
            without_payload_slots(&only(decoded(&["--envelope"], &again))),
            without_payload_slots(&letter),
            "{file}"
        );
        count += 1;
    }
    assert!(count > 40, "only {count} recordings");
}

#[test]
fn recorded_envelopes_survive_the_way_through_their_raw_form() {
    let mut count = 0;
    for (file, octets, rep) in recordings(["envelope", "decode-only-envelope"]) {
        let (first, result) = decode(&["--raw", "--envelope"], &octets);
        if ["env_payload_length_10.", "decenv_encrypted_08."]
            .iter()
            .any(|name| file.starts_with(name))
        {
            // What follows the announced payload is nothing.
            assert!(result.is_err(), "{file}");
            continue;
        }
        assert_eq!(result, Ok(()), "{file}");
        let (again, result) = encode_as("string", &["--envelope", rep], &first);
        assert_eq!(result, Ok(()), "{file}: {first}");
        let (second, result) = decode(&["--raw"], &again);
        assert_eq!(result, Ok(()), "{file}");
        assert_eq!(first, second, "{file}");
        count += 1;
    }
    assert!(count > 50, "only {count} recordings");
}

#[test]
fn recorded_payloads_are_messages_in_any_form() {
    let mut count = 0;
    for path in files("fipa_acl", ".payload.bin") {
        let octets = std::fs::read(&path).unwrap();
        if octets.is_empty() {
            continue;
        }
        let message = only(decoded(&[], &octets));
        assert!(message.get("performative").is_some(), "{path:?}");
        count += 1;
    }
    assert!(count > 20, "only {count} payloads");
}

#[test]
fn messages_of_jade_survive_the_way_through_json() {
    let mut count = 0;
    for path in files("jade", ".acl") {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with("be_codetable") {
            // They belong together.
            continue;
        }
        let octets = std::fs::read(&path).unwrap();
        let message = only(decoded(&[], &octets));
        let (again, result) = encode_as(rep_of(&octets), &[], &message.to_string());
        if has_no_words(&name, &result) {
            continue;
        }
        assert_eq!(only(decoded(&[], &again)), message, "{name}");
        count += 1;
    }
    assert!(count > 150, "only {count} messages");
}

/// Whether names or a protocol were read that are no legal words; else the message was written.
fn has_no_words(name: &str, result: &Result<(), Failure>) -> bool {
    let is_one = ["protocol-two-words", "aid-odd-names"]
        .iter()
        .any(|case| name.contains(case));
    match result {
        Err(failure) if is_one => assert!(failure.to_string().ends_with(": not a word")),
        result => assert_eq!(*result, Ok(()), "{name}"),
    }
    result.is_err()
}

#[test]
fn letters_of_jade_survive_the_way_through_json() {
    let mut count = 0;
    for path in files("jade", ".env.xml") {
        let envelope = std::fs::read_to_string(&path).unwrap();
        let payload = path.to_string_lossy().replace(".env.xml", ".acl");
        let octets = [envelope.as_bytes(), &std::fs::read(payload).unwrap()].concat();
        let letter = only(decoded(&["--envelope"], &octets));
        assert!(letter.get("message").is_some(), "{path:?}");
        for rep in ["xml", "bit-efficient"] {
            let (again, result) = encode_as(
                payload_rep(&letter),
                &["--envelope", rep],
                &letter.to_string(),
            );
            if has_no_words(&path.to_string_lossy(), &result) {
                continue;
            }
            assert_eq!(
                without_payload_slots(&only(decoded(&[], &again))),
                without_payload_slots(&letter),
                "{path:?}"
            );
        }
        count += 1;
    }
    assert!(count > 100, "only {count} letters");
}

#[test]
fn letters_in_recorded_requests_are_read() {
    let mut count = 0;
    let xml = |path: &PathBuf| path.to_str().is_some_and(|path| path.contains("xml"));
    for path in files("jade", ".req.http").into_iter().filter(xml) {
        let request = std::fs::read_to_string(&path).unwrap();
        let (envelope, payload) = parts(&request);
        let octets = format!("{envelope}{payload}");
        if path.ends_with("in2_http-xml-doctype.req.http") {
            // An internal subset is refused.
            let failure = decode(&[], octets.as_bytes()).1.unwrap_err();
            assert_eq!(failure.code(), 2);
            continue;
        }
        let letter = only(decoded(&["--envelope"], octets.as_bytes()));
        assert!(letter.get("message").is_some(), "{path:?}");
        count += 1;
    }
    assert!(count > 5, "only {count} requests");
}

/// The envelope and the payload in an HTTP request.
fn parts(request: &str) -> (&str, &str) {
    let mut parts = request.split("\r\n--B0undary42").skip(1).map(|part| {
        let (_, body) = part.split_once("\r\n\r\n").unwrap();
        body
    });
    (parts.next().unwrap(), parts.next().unwrap())
}

#[test]
fn other_recorded_letters_are_read() {
    let mut letters = files("mts", ".bin");
    letters.extend(files("jade", ".bin"));
    for path in &letters {
        let octets = std::fs::read(path).unwrap();
        if path.to_string_lossy().contains("be_envelope_") {
            // Envelopes alone: most announce payloads that are not there.
            let raw = only(decoded(&["--envelope", "--raw"], &octets));
            assert_eq!(raw["payload"]["base64"], "", "{path:?}");
            continue;
        }
        let letter = only(decoded(&["--envelope"], &octets));
        assert!(letter.get("message").is_some(), "{path:?}");
    }
    assert!(letters.len() > 10, "only {} letters", letters.len());
}

fn only(mut values: Vec<Value>) -> Value {
    assert_eq!(values.len(), 1, "{values:?}");
    values.remove(0)
}

/// What the message of the letter is encoded as.
fn payload_rep(letter: &Value) -> &'static str {
    match letter["envelope"]["acl-representation"].as_str() {
        Some("fipa.acl.rep.string.std") => "string",
        Some("fipa.acl.rep.xml.std") => "xml",
        _ => "bit-efficient",
    }
}

fn rep_of(octets: &[u8]) -> &'static str {
    match octets.trim_ascii_start().first() {
        Some(b'(') => "string",
        Some(b'<') => "xml",
        _ => "bit-efficient",
    }
}

/// The recordings in this folder whose names end so.
fn files(folder: &str, end: &str) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(vectors().join(folder))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.to_string_lossy().ends_with(end))
        .collect();
    files.sort();
    files
}

/// The octets of a recording.
pub(crate) fn read(name: &str) -> Vec<u8> {
    let path = vectors().join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn vectors() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/vectors")
}
