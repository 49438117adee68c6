//! `fipa protocol`: checking, drawing and replaying protocol files.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};

use crate::support::daemon::tool;
use crate::support::process::{Ended, Process, keys, run};
use crate::support::skipped;

struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Files {
        Files(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

/// In the dialect of fipa_acl, without an ending.
const DIALECT: &str = r#"<scxml version="1.0" initial="1">
  <state id="1">
    <transition performative="request" from="initiator" to="B" target="2"/>
  </state>
  <state id="2">
    <transition performative="refuse" from="B" to="initiator" target="3"/>
    <transition performative="agree" from="B" to="initiator" target="4"/>
  </state>
  <state id="3" final="yes"/>
  <state id="4">
    <transition performative="inform|failure" from="B" to="initiator" target="5"/>
  </state>
  <state id="5" final="yes"></state>
</scxml>
"#;

/// The same in SCXML as W3C has it, with what a conversation has no use for.
const STANDARD: &str = r#"<?xml version="1.0"?>
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript">
  <datamodel><data id="x" expr="1"/></datamodel>
  <initial><transition target="1"/></initial>
  <state id="1"><transition event="request" target="2"/></state>
  <state id="2">
    <onentry><assign location="x" expr="2"/></onentry>
    <transition event="refuse" target="3"/>
    <transition event="agree" target="4"/>
  </state>
  <final id="3"/>
  <state id="4"><transition event="inform failure" target="5"/></state>
  <final id="5"/>
</scxml>
"#;

fn protocol(args: &[&str], paths: &[&Path]) -> Ended {
    let mut command = tool(&["protocol"]);
    command.args(args).args(paths);
    run(command)
}

/// `a>b act` for each message, as lines.
fn messages(said: &str) -> String {
    let line = |said: &str| {
        let (way, act) = said.split_once(' ').unwrap();
        let (from, to) = way.split_once('>').unwrap();
        json!({"performative": act, "sender": {"name": from}, "receiver": [{"name": to}],
            "protocol": "request", "conversation-id": "c-1"})
    };
    said.split(", ")
        .map(|said| format!("{}\n", line(said)))
        .collect()
}

fn replay(file: &Path, said: &str, options: &[&str]) -> Ended {
    let mut command = tool(&["protocol", "replay", "--messages", "-"]);
    command.args(options).arg(file);
    let mut process = Process::start(command);
    process.feed(messages(said).as_bytes());
    process.wait()
}

#[test]
fn the_protocols_of_fipa_are_without_warnings() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("protocols");
    let files = std::fs::read_dir(folder).unwrap();
    let files: Vec<PathBuf> = files.map(|entry| entry.unwrap().path()).collect();
    let paths: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let ended = protocol(&["check", "--strict", "--json"], &paths);
    assert_eq!((ended.code, ended.output.len()), (Some(0), 0), "{ended:?}");
    let ended = protocol(&["check"], &paths);
    assert_eq!(ended.output.len(), files.len(), "{ended:?}");
}

#[test]
fn the_dialect_and_standard_scxml_are_without_warnings() {
    let files = Files::new();
    let paths = [
        files.write("request", DIALECT),
        files.write("standard.scxml", STANDARD),
    ];
    let ended = protocol(&["check", "--strict"], &[&paths[0], &paths[1]]);
    assert_eq!((ended.code, ended.errors.len()), (Some(0), 0), "{ended:?}");
}

#[test]
fn a_finding_has_its_place_its_code_and_advice() {
    let files = Files::new();
    let wrong = DIALECT.replace("\"4\"", "\"agreed\"");
    let wrong = wrong.replace("target=\"agreed\"", "target=\"agred\"");
    let wrong = files.write("wrong", &wrong);
    let ended = protocol(&["check", "--json"], &[&wrong]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let finding = ended.only_json();
    assert_eq!(
        keys(&finding),
        ["file", "line", "column", "severity", "code", "message"]
    );
    assert_eq!(finding["file"], wrong.to_str().unwrap());
    assert_eq!(
        (&finding["line"], &finding["column"]),
        (&json!(7), &json!(62))
    );
    assert_eq!(
        (&finding["severity"], &finding["code"]),
        (&json!("error"), &json!("undeclared-target"))
    );
    assert_eq!(
        finding["message"],
        r#"the target "agred" is no state of this file; did you mean agreed?"#
    );

    let ended = protocol(&["check"], &[&wrong]);
    assert!(ended.output[0].ends_with(r#"wrong:7:62: error [undeclared-target]: the target "agred" is no state of this file; did you mean agreed?"#));
    assert_eq!(ended.only_error(), "fipa protocol: errors: 1, warnings: 0");
}

#[test]
fn warnings_are_errors_where_that_is_asked_for() {
    let files = Files::new();
    let extra = DIALECT.replace("</scxml>", "  <state id=\"6\" final=\"yes\"/>\n</scxml>");
    let extra = files.write("extra", &extra);
    let ended = protocol(&["check", "--json"], &[&extra]);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(
        (&ended.only_json()["severity"], &ended.only_json()["code"]),
        (&json!("warning"), &json!("unreachable-state"))
    );
    let ended = protocol(&["check", "--json", "--strict"], &[&extra]);
    assert_eq!(
        (ended.code, &ended.only_json()["severity"]),
        (Some(1), &json!("error"))
    );
}

#[test]
fn what_is_not_xml_ends_it_with_2_after_all_files_were_looked_at() {
    let files = Files::new();
    let broken = files.write("broken", "<scxml>\n  <state id=\"1\">\n</scxml>");
    let dead = files.write("dead", "<scxml><state id=\"1\"/></scxml>");
    let ended = protocol(&["check", "--json"], &[&broken, &dead]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.only_error().contains("broken:3:"), "{ended:?}");
    let codes: Vec<Value> = ended
        .json()
        .iter()
        .map(|finding| finding["code"].clone())
        .collect();
    assert_eq!(codes, ["syntax", "dead-end"]);

    let ended = protocol(&["check"], &[Path::new("/no/such/file")]);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    let ended = protocol(&["check"], &[]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
}

#[test]
fn a_conversation_is_replayed_to_its_end() {
    let files = Files::new();
    for file in [
        files.write("request", DIALECT),
        files.write("standard.scxml", STANDARD),
    ] {
        let ended = replay(
            &file,
            "a>b request, b>a agree, b>a inform",
            &["--json", "--complete"],
        );
        assert_eq!((ended.code, ended.errors.len()), (Some(0), 0), "{ended:?}");
        let lines = ended.json();
        assert_eq!(
            keys(&lines[0]),
            ["n", "verdict", "state", "rule", "expected"]
        );
        let states: Vec<&Value> = lines.iter().map(|line| &line["state"]).collect();
        assert_eq!(states, ["2", "4", "5"]);
        let verdicts = lines
            .iter()
            .all(|line| line["verdict"] == "accepted" && line["rule"].is_null());
        assert!(verdicts, "{lines:?}");
    }
}

#[test]
fn the_first_violation_ends_it_and_says_what_was_expected() {
    let files = Files::new();
    let file = files.write("request", DIALECT);
    let ended = replay(&file, "a>b request, b>a inform, b>a agree", &["--json"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let lines = ended.json();
    assert_eq!(lines.len(), 2);
    assert_eq!(
        lines[1],
        json!({"n": 2, "verdict": "violation", "state": "2", "rule": "performative", "expected": [
            {"performative": "refuse", "from": "B", "to": "initiator"},
            {"performative": "agree", "from": "B", "to": "initiator"},
        ]})
    );
    assert_eq!(
        ended.only_error(),
        "fipa protocol: message 2: b may not send inform in the state 2 of request; \
         expected: refuse or agree from B (b) to initiator (a)"
    );
    let ended = replay(&file, "a>b agree", &[]);
    assert_eq!(
        ended.output,
        [
            "1  a -> b: agree  violation [opening]: agree begins no conversation of request; expected: request from initiator to B"
        ]
    );
}

#[test]
fn a_conversation_without_an_end_is_complete_only_if_that_is_not_asked_for() {
    let files = Files::new();
    let file = files.write("request", DIALECT);
    assert_eq!(replay(&file, "a>b request, b>a agree", &[]).code, Some(0));
    let ended = replay(&file, "a>b request, b>a agree", &["--complete"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_eq!(
        ended.only_error(),
        "fipa protocol: after 2 messages, request is in the state 4, where it does not end"
    );
}

#[test]
fn one_conversation_of_several_is_replayed_alone() {
    let files = Files::new();
    let file = files.write("request", DIALECT);
    let said = "a>b request, b>a agree, b>a inform";
    let ended = replay(&file, said, &["--conversation-id", "c-1", "--complete"]);
    assert_eq!((ended.code, ended.output.len()), (Some(0), 3), "{ended:?}");
    let ended = replay(&file, said, &["--conversation-id", "c-2"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_eq!(
        ended.only_error(),
        "fipa protocol: there is no conversation c-2 in -"
    );
}

#[test]
fn a_log_without_a_conversation_of_the_protocol_is_a_no() {
    let files = Files::new();
    let file = files.write("request", DIALECT);
    let log = files.write("log", "{\"event\":\"lost\",\"count\":3}\n");
    let mut command = tool(&["protocol", "replay", "--messages"]);
    command.arg(&log).arg(&file);
    let ended = run(command);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let log = log.display();
    assert_eq!(
        ended.errors,
        [
            format!("{log}: 3 letters are missing in it"),
            format!("fipa protocol: there is no conversation by request in {log}"),
        ]
    );
}

#[test]
fn input_that_is_no_messages_or_no_protocol_ends_it_with_2() {
    let files = Files::new();
    let file = files.write("request", DIALECT);
    for (text, place) in [
        ("{\"performative\":\"request\"}\n{\"perf", ":2:"),
        ("\n  {\"receiver\":[]}", ":2:3: performative: missing"),
    ] {
        let messages = files.write("messages", text);
        let mut command = tool(&["protocol", "replay", "--messages"]);
        command.arg(&messages).arg(&file);
        let ended = run(command);
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(ended.only_error().contains(place), "{ended:?}");
    }
    let dead = files.write("dead", "<scxml><state id=\"1\"/></scxml>");
    let messages = files.write("messages", &messages("a>b request"));
    let ended = protocol(&["replay", "--messages"], &[&messages, &dead]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(
        ended.only_error().contains("dead:1:8: error [dead-end]"),
        "{ended:?}"
    );
}

#[test]
fn a_protocol_is_drawn_in_every_format() {
    let files = Files::new();
    let file = files.write("request", DIALECT);
    for (format, begins) in [
        ("svg", "<svg "),
        ("dot", "digraph \"request\" {"),
        ("mermaid", "stateDiagram-v2"),
    ] {
        let ended = protocol(&["draw", "--format", format], &[&file]);
        assert_eq!(ended.code, Some(0), "{ended:?}");
        assert!(ended.output[0].starts_with(begins), "{ended:?}");
    }
    assert!(protocol(&["draw"], &[&file]).output[0].starts_with("<svg "));
    let broken = files.write("broken", "<scxml>");
    assert_eq!(protocol(&["draw"], &[&broken]).code, Some(2));
}

#[test]
fn graphviz_takes_what_is_drawn_for_it() {
    if Command::new("dot").arg("-V").output().is_err() {
        return skipped("dot (Debian: graphviz)");
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("protocols/brokering.scxml");
    let drawn = protocol(&["draw", "--format", "dot"], &[&file]);
    let mut command = Command::new("dot");
    command.arg("-Tplain");
    let mut dot = Process::start(command);
    dot.feed(drawn.output.join("\n").as_bytes());
    let ended = dot.wait();
    assert_eq!((ended.code, ended.errors.len()), (Some(0), 0), "{ended:?}");
    assert_eq!(
        ended
            .output
            .iter()
            .filter(|line| line.starts_with("node "))
            .count(),
        9
    );
}
