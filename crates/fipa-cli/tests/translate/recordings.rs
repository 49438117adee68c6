//! What a peer of another make wrote, translated to JSON, back, and to JSON again.

use std::path::PathBuf;

use serde_json::Value;

use crate::{decode, encode};

#[test]
fn recorded_messages_survive_the_way_through_json() {
    let mut count = 0;
    for name in recordings("message") {
        let octets = read(&name);
        let (first, result) = decode(&[], &octets);
        assert_eq!(result, Ok(()), "{name}");
        let (again, result) = encode(&[], &first);
        assert_eq!(result, Ok(()), "{name}: {first}");
        let (second, result) = decode(&[], &again);
        assert_eq!(result, Ok(()), "{name}");
        assert_eq!(first, second, "{name}");
        count += 1;
    }
    assert!(count > 60, "only {count} recordings");
}

#[test]
fn recorded_envelopes_survive_the_way_through_their_raw_form() {
    let mut count = 0;
    for name in recordings("envelope") {
        let (first, result) = decode(&["--raw", "--envelope"], &read(&name));
        if name == SHORT {
            assert!(result.is_err());
            continue;
        }
        assert_eq!(result, Ok(()), "{name}");
        let (again, result) = encode(&["--envelope", "bit-efficient"], &first);
        assert_eq!(result, Ok(()), "{name}: {first}");
        let (second, result) = decode(&["--raw"], &again);
        assert_eq!(result, Ok(()), "{name}");
        assert_eq!(first, second, "{name}");
        count += 1;
    }
    assert!(count > 20, "only {count} recordings");
}

#[test]
fn recorded_letters_survive_the_way_through_json() {
    let mut count = 0;
    for name in recordings("envelope") {
        let (first, result) = decode(&[], &read(&name));
        if result.is_err() {
            // Not of a representation that can be read, or no payload at all.
            continue;
        }
        let (again, result) = encode(&["--envelope", "bit-efficient"], &first);
        assert_eq!(result, Ok(()), "{name}: {first}");
        let (second, result) = decode(&["--envelope"], &again);
        assert_eq!(result, Ok(()), "{name}");
        // Our encoding of the message is another than the peer's.
        assert_eq!(without_length(&first), without_length(&second), "{name}");
        count += 1;
    }
    assert!(count > 10, "only {count} recordings");
}

/// The recording whose envelope announces a part of the payload only: what follows that part is
/// no message.
const SHORT: &str = "env_payload_length_10.bitefficient.bin";

fn without_length(letter: &str) -> Value {
    let mut letter: Value = serde_json::from_str(letter).unwrap();
    letter["envelope"]
        .as_object_mut()
        .unwrap()
        .shift_remove("payload-length");
    letter
}

/// The files of this kind in bit-efficient form.
fn recordings(kind: &str) -> Vec<String> {
    let index: Value = serde_json::from_slice(&read("index.json")).unwrap();
    index
        .as_array()
        .unwrap()
        .iter()
        .filter(|entry| entry["kind"] == kind && entry["representation"] == "bitefficient")
        .map(|entry| entry["file"].as_str().unwrap().to_owned())
        .collect()
}

fn read(name: &str) -> Vec<u8> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let path = root.join("../../tests/vectors/fipa_acl").join(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}
