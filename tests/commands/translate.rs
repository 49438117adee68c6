//! `fipa decode` and `fipa encode` between pipes.

use std::path::Path;
use std::process::Command;

use crate::support::daemon::tool;
use crate::support::process::{Ended, Process};

fn piped(command: Command, octets: &[u8]) -> Ended {
    let mut process = Process::start(command);
    process.feed(octets);
    process.wait()
}

#[test]
fn a_recording_is_the_same_json_after_it_was_encoded_again() {
    let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/fipa_acl");
    let recording = std::fs::read(vectors.join("all_fields.bitefficient.bin")).unwrap();
    let decoded = piped(tool(&["decode"]), &recording);
    assert_eq!(decoded.code, Some(0), "{decoded:?}");
    let json = decoded.only_json();
    assert_eq!(json["performative"], "request");

    let mut pipeline = Command::new("sh");
    let script =
        r#""$0" decode | "$0" encode --as bit-efficient | "$0" decode --as bit-efficient -"#;
    pipeline.args(["-c", script, env!("CARGO_BIN_EXE_fipa")]);
    let again = piped(pipeline, &recording);
    assert_eq!(again.code, Some(0), "{again:?}");
    assert_eq!(again.only_json(), json);
}

#[test]
fn a_message_goes_through_every_representation_and_both_envelopes() {
    let json = concat!(
        r#"{"performative":"inform","sender":{"name":"a@h"},"receiver":[{"name":"b@h"}],"#,
        r#""content":"grüß","conversation-id":"c-1"}"#,
    );
    let mut process = Command::new("sh");
    let script = r#""$0" encode --as string | "$0" decode |
        "$0" encode --as xml | "$0" decode --as xml |
        "$0" encode --as xml --envelope bit-efficient | "$0" decode --envelope |
        "$0" encode --as string --envelope xml | "$0" decode"#;
    process.args(["-c", script, env!("CARGO_BIN_EXE_fipa")]);
    let ended = piped(process, json.as_bytes());
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let letter = ended.only_json();
    let message: serde_json::Value = serde_json::from_str(json).unwrap();
    assert_eq!(letter["message"], message);
    let envelope = &letter["envelope"];
    assert_eq!(envelope["acl-representation"], "fipa.acl.rep.string.std");
    assert_eq!(envelope["payload-encoding"], "UTF-8");
    assert_eq!(envelope["intended-receiver"], message["receiver"]);
}

/// fipa_services puts its newest overlay behind the others, directly in front of the base.
#[test]
fn layers_are_shown_and_written_as_they_stand() {
    let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors");
    for (file, rep) in [
        (
            "fipa_acl/env_stamped2_msg_string.bitefficient.bin",
            "bit-efficient",
        ),
        ("fipa_acl/env_stamped2_msg_string.xml.bin", "xml"),
    ] {
        let recording = std::fs::read(vectors.join(file)).unwrap();
        let shown = piped(tool(&["decode", "--raw"]), &recording);
        assert_eq!(shown.code, Some(0), "{shown:?}");
        let letter = shown.only_json();
        let in_layers: Vec<_> = letter["layers"]
            .as_array()
            .unwrap()
            .iter()
            .map(|layer| layer["received"][0]["by"].as_str())
            .collect();
        let mut expected = [Some("mts-0"), None, Some("mts-1"), None];
        if rep == "xml" {
            expected.rotate_right(1);
        }
        assert_eq!(in_layers, expected, "{file}");
        // In the order of travel.
        let stamps = letter["envelope"]["received"].as_array().unwrap();
        let by: Vec<_> = stamps.iter().map(|stamp| stamp["by"].as_str()).collect();
        assert_eq!(by, [Some("mts-0"), Some("mts-1")], "{file}");

        let mut pipeline = Command::new("sh");
        let script = format!(
            r#""$0" decode --raw | "$0" encode --as string --envelope {rep} | "$0" decode --raw"#
        );
        pipeline.args(["-c", &script, env!("CARGO_BIN_EXE_fipa")]);
        let again = piped(pipeline, &recording);
        assert_eq!(again.code, Some(0), "{again:?}");
        assert_eq!(again.only_json(), letter, "{file}");
    }
}

#[test]
fn octets_that_are_no_message_end_it_with_2_and_say_where() {
    let recording = [0xFA, 0x10, 0x09, 0x02, 0xFF];
    let ended = piped(tool(&["decode"]), &recording);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.only_error().contains("octet "), "{ended:?}");
    assert_eq!(ended.output, [""; 0]);
}

#[test]
fn json_that_is_no_message_ends_it_with_2_and_says_where() {
    let ended = piped(
        tool(&["encode", "--as", "bit-efficient"]),
        b"{\"performative\":\"inform\"}\n{\"performative\":",
    );
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.only_error().contains("2:"), "{ended:?}");
}
