//! `fipa sniff` and the letter log of `fipad`.

use std::fs;
use std::net::UdpSocket;
use std::path::Path;
use std::time::Instant;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::support::daemon::{Daemon, Place, tool};
use crate::support::process::{Ended, Process, keys, run};
use crate::support::{PATIENCE, skipped};

/// A command that watches the daemon.
fn watch(daemon: &Daemon, words: &[&str]) -> Process {
    let mut sniffer = Process::start(daemon.fipa(&[&["sniff"], words].concat()));
    assert_eq!(sniffer.error_line(), format!("watching {}", daemon.name()));
    sniffer
}

/// A request and its answer.
fn ask(daemon: &Daemon, content: &str) {
    let words = "send --to echo@robot1 --from arm@robot1 --performative request --wait 10 \
                 --protocol fipa-request --conversation-id c-1 --content";
    let words: Vec<&str> = words.split_whitespace().chain([content]).collect();
    let ended = daemon.run(&words);
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

/// A letter to nobody.
fn send_to_nobody(daemon: &Daemon) {
    let words = "send --to nobody@robot1 --from arm@robot1 --performative inform \
                 --conversation-id c-2 --content hello";
    let ended = daemon.run(&words.split_whitespace().collect::<Vec<_>>());
    assert_eq!(ended.code, Some(1), "{ended:?}");
}

/// Reads a log.
fn sniff(file: &Path, words: &[&str]) -> Ended {
    let file = file.to_str().unwrap();
    run(tool(&[&["sniff", "--file", file], words].concat()))
}

/// The lines of a log, once there are so many.
fn log(file: &Path, lines: usize) -> Vec<Value> {
    let until = Instant::now() + PATIENCE;
    loop {
        let text = fs::read_to_string(file).unwrap_or_default();
        if text.lines().count() >= lines && text.ends_with('\n') {
            let json = |line| serde_json::from_str(line).unwrap();
            return text.lines().map(json).collect();
        }
        assert!(Instant::now() < until, "{text}");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
}

#[test]
fn every_letter_is_shown_with_its_outcome_while_it_passes() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _echo = daemon.attach("echo", "echo@robot1");
    let mut all = watch(&daemon, &["--json"]);
    let mut lines = watch(&daemon, &["--agent", "nobody@.*"]);
    ask(&daemon, "dock");
    send_to_nobody(&daemon);
    let (request, answer, failed) = (all.json(), all.json(), all.json());
    assert_eq!(
        keys(&request),
        [
            "time", "event", "number", "octets", "from", "via", "envelope", "message", "outcomes"
        ]
    );
    assert_eq!(request["event"], "letter");
    assert_eq!(request["number"], 1);
    assert_eq!(request["via"], "unix");
    assert!(request["octets"].as_u64().unwrap() > 50, "{request}");
    assert_eq!(request["envelope"]["from"]["name"], "arm@robot1");
    assert_eq!(request["message"]["performative"], "request");
    assert_eq!(request["message"]["content"], "dock");
    assert_eq!(request["outcomes"][0]["to"], "echo@robot1");
    assert_eq!(request["outcomes"][0]["outcome"], "delivered");
    assert_eq!(answer["message"]["performative"], "inform");
    assert_eq!(answer["message"]["conversation-id"], "c-1");
    assert_eq!(failed["outcomes"][0]["outcome"], "unknown");
    let line = lines.line();
    let (time, line) = line.split_once("  ").unwrap();
    assert_eq!(time, failed["time"]);
    let octets = &failed["octets"];
    let why = &failed["outcomes"][0]["reason"].as_str().unwrap();
    assert_eq!(
        line,
        format!("arm@robot1 -> nobody@robot1  inform  -  c-2  {octets} B  unknown ({why})")
    );
    for sniffer in [all, lines] {
        sniffer.signal(Signal::INT);
        let ended = sniffer.wait();
        assert_eq!((ended.code, ended.output), (Some(0), Vec::new()));
    }
}

#[test]
fn a_chart_comes_when_the_watch_is_interrupted() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let _echo = daemon.attach("echo", "echo@robot1");
    let mut control = watch(&daemon, &["--json"]);
    let chart = watch(&daemon, &["--format", "chart"]);
    ask(&daemon, "dock");
    control.json();
    control.json();
    chart.signal(Signal::INT);
    let ended = chart.wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let text = ended.output.join("\n");
    assert_eq!(ended.output[0], "conversation c-1, fipa-request", "{text}");
    assert!(text.contains(" request (dock) "), "{text}");
    assert!(text.contains(" inform (dock) "), "{text}");
}

/// Two letters of a conversation in the order of their outcomes, and a message of a device.
fn small_log(place: &Place) -> std::path::PathBuf {
    let letter = |number: u64, time: &str, from: &str, message: Value, outcome: Value| {
        json!({
            "time": time, "event": "letter", "number": number, "octets": 100, "from": null,
            "via": null, "envelope": {"from": {"name": from}}, "message": message,
            "outcomes": [outcome],
        })
    };
    let told = |to: &str, outcome: &str, reason: Option<&str>| json!({"to": to, "outcome": outcome, "via": null, "reason": reason});
    let says = |from: &str, performative: &str, content: &str| {
        json!({
            "performative": performative, "sender": {"name": from}, "content": content,
            "conversation-id": "c-7",
        })
    };
    let lines = [
        letter(
            2,
            "2026-11-22T10:00:00.250Z",
            "drive@robot2",
            says("drive@robot2", "agree", "(done \"dock\")"),
            told("arm@robot1", "delivered", None),
        ),
        letter(
            1,
            "2026-11-22T10:00:00.000Z",
            "arm@robot1",
            says("arm@robot1", "request", "go to the <dock>"),
            told("drive@robot2", "delivered", None),
        ),
        letter(
            3,
            "2026-11-22T10:00:01.500Z",
            "drive@robot2",
            says("drive@robot2", "inform", "there"),
            told("arm@robot1", "timeout", Some("robot1 is gone")),
        ),
        json!({
            "time": "2026-11-22T10:00:02.000Z", "event": "text", "number": 4, "direction": "in",
            "place": "udp://127.0.0.1:5000", "text": {"origin": "drive", "status": "up"},
        }),
    ];
    let path = place.path("letters.jsonl");
    let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_log_is_drawn_as_a_chart() {
    let place = Place::new();
    let ended = sniff(&small_log(&place), &["--format", "chart"]);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let wanted = "\
conversation c-7

       arm@robot1             drive@robot2
0.000       │ request (go to the <dock>)
            ├──────────────────────▶│
0.250       │ agree (done \"dock\")   │
            │◀──────────────────────┤
1.500       │ inform (there)        │
            │✗──────────────────────┤
            │ ✗ timeout: robot1 is gone
            │                       │

devices, text

       drive                  daemon
0.000    │ status (up)           │
         ├──────────────────────▶│
         │                       │";
    assert_eq!(ended.output.join("\n"), wanted);
}

#[test]
fn a_log_is_shown_in_the_order_of_its_letters_and_read_again() {
    let place = Place::new();
    let log = small_log(&place);
    let ended = sniff(&log, &["--agent", "arm@.*"]);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(
        ended.output,
        [
            "2026-11-22T10:00:00.000Z  arm@robot1 -> drive@robot2  request  -  c-7  100 B  \
             delivered",
            "2026-11-22T10:00:00.250Z  drive@robot2 -> arm@robot1  agree  -  c-7  100 B  delivered",
            "2026-11-22T10:00:01.500Z  drive@robot2 -> arm@robot1  inform  -  c-7  100 B  \
             timeout (robot1 is gone)",
        ]
    );
    let shown = sniff(&log, &["--json"]);
    let again = place.path("again.jsonl");
    fs::write(&again, shown.output.join("\n")).unwrap();
    assert_eq!(sniff(&again, &["--json"]).output, shown.output);
    let numbers: Vec<Value> = shown.json().iter().map(|l| l["number"].clone()).collect();
    assert_eq!(numbers, [1, 2, 3, 4]);
}

#[test]
fn a_chart_as_svg_is_well_formed() {
    let place = Place::new();
    let log = small_log(&place);
    let ended = sniff(&log, &["--format", "svg"]);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let svg = ended.output.join("\n");
    assert!(
        svg.contains(">request (go to the &lt;dock&gt;)</text>"),
        "{svg}"
    );
    let file = place.path("chart.svg");
    fs::write(&file, &svg).unwrap();
    let mut xmllint = std::process::Command::new("xmllint");
    match xmllint.arg("--noout").arg(&file).output() {
        Ok(output) => assert!(output.status.success(), "{output:?}"),
        Err(_) => skipped("xmllint"),
    }
}

#[test]
fn a_line_of_a_log_that_is_none_is_reported_and_passed_over() {
    let place = Place::new();
    let log = small_log(&place);
    let text = fs::read_to_string(&log).unwrap();
    fs::write(&log, format!("{{\"time\"\n{text}{{}}\n")).unwrap();
    let ended = sniff(&log, &["--json"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert_eq!(ended.output.len(), 4);
    assert_eq!(ended.errors.len(), 2);
    assert!(
        ended.errors[0].starts_with("fipa sniff: line 1: "),
        "{ended:?}"
    );
    assert!(
        ended.errors[1].starts_with("fipa sniff: line 6: "),
        "{ended:?}"
    );
    let ended = run(tool(&["sniff", "--file", "/nowhere/log"]));
    assert_eq!(ended.code, Some(3), "{ended:?}");
    let ended = run(tool(&[
        "sniff",
        "--agent",
        "(",
        "--file",
        log.to_str().unwrap(),
    ]));
    assert_eq!(ended.code, Some(2), "{ended:?}");
}

#[test]
fn a_daemon_logs_letters_and_the_log_survives_its_end() {
    let place = Place::new();
    let file = place.path("letters.jsonl");
    let old = place.path("letters.jsonl.1");
    let words = ["--no-mdns", "--log-letters", file.to_str().unwrap()];
    let daemon = place.start_with("robot1", &words);
    let _echo = daemon.attach("echo", "echo@robot1");
    ask(&daemon, "dock");
    assert_eq!(log(&file, 2).len(), 2);
    // It is moved away, as a log that has grown large is.
    fs::rename(&file, &old).unwrap();
    send_to_nobody(&daemon);
    assert_eq!(log(&file, 1)[0]["outcomes"][0]["outcome"], "unknown");
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.into_process().wait().code, Some(0));

    let daemon = place.start_with("robot1", &words);
    send_to_nobody(&daemon);
    daemon.kill();
    assert_eq!(log(&file, 2).len(), 2);
    let messages = log(&old, 2);
    let acts: Vec<&Value> = messages
        .iter()
        .map(|l| &l["message"]["performative"])
        .collect();
    assert_eq!(acts, ["request", "inform"]);

    // The messages are such as the tool takes.
    let mut encoding = Process::start(tool(&["encode", "--as", "string"]));
    let lines: Vec<String> = messages
        .iter()
        .map(|l| format!("{}\n", l["message"]))
        .collect();
    encoding.feed(lines.concat().as_bytes());
    let encoded = encoding.wait();
    assert_eq!(encoded.code, Some(0), "{encoded:?}");
    assert!(encoded.output.concat().contains("\"dock\""), "{encoded:?}");
}

#[test]
fn what_is_under_way_when_the_daemon_ends_is_in_the_log() {
    let place = Place::new();
    let file = place.path("letters.jsonl");
    let daemon = place.start_with(
        "robot1",
        &["--no-mdns", "--log-letters", file.to_str().unwrap()],
    );
    let stopped = daemon.attach("echo", "echo@robot1");
    stopped.signal(Signal::STOP);
    let words = "send --to echo@robot1 --performative inform --content dock --timeout";
    let words = |timeout| {
        words
            .split_whitespace()
            .chain([timeout])
            .collect::<Vec<_>>()
    };
    let _sending = Process::start(daemon.fipa(&words("60")));
    // A letter that was sent after it has been given up.
    let ended = daemon.run(&words("0.5"));
    assert_eq!(ended.code, Some(1), "{ended:?}");
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.into_process().wait().code, Some(0));
    let lines = log(&file, 2);
    assert_eq!(lines[0]["outcomes"][0]["outcome"], "timeout");
    assert_eq!(lines[1]["outcomes"], json!([]));
}

#[test]
fn a_disk_that_is_full_is_said_once_and_the_daemon_goes_on() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns", "--log-letters", "/dev/full"]);
    let _echo = daemon.attach("echo", "echo@robot1");
    ask(&daemon, "dock");
    ask(&daemon, "dock");
    daemon.signal(Signal::TERM);
    let ended = daemon.into_process().wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(
        ended.only_error().contains("letter log /dev/full"),
        "{ended:?}"
    );

    let mut command = place.fipad("robot2");
    command.args(["--no-mdns", "--log-letters", "/nowhere/log"]);
    let ended = run(command);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.only_error().contains("/nowhere/log"), "{ended:?}");
}

#[test]
fn messages_of_text_agents_are_in_the_log() {
    let place = Place::new();
    let file = place.path("letters.jsonl");
    let words = ["--no-mdns", "--text", "udp://127.0.0.1:0"];
    let more = ["--log-letters", file.to_str().unwrap()];
    let daemon = place.start_with("robot1", &[&words[..], &more].concat());
    let bound = daemon.ready["text"][0].as_str().unwrap();
    let drive = UdpSocket::bind("127.0.0.1:0").unwrap();
    drive.set_read_timeout(Some(PATIENCE)).unwrap();
    let say = |text: &str| {
        let to = bound.strip_prefix("udp://").unwrap();
        drive.send_to(text.as_bytes(), to).unwrap();
    };
    say("{O:drive;S:up}");
    daemon.wait_for("drive@robot1");
    let words = "send --to drive@robot1 --from m@robot1 --performative query-ref --content where";
    let ended = daemon.run(&words.split(' ').collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let mut heard = [0; 2048];
    drive.recv(&mut heard).unwrap();
    let lines = log(&file, 3);
    let place = format!("udp://{}", drive.local_addr().unwrap());
    assert_eq!(
        keys(&lines[0]),
        ["time", "event", "number", "direction", "place", "text"]
    );
    assert_eq!(
        (&lines[0]["direction"], &lines[0]["place"]),
        (&json!("in"), &json!(place))
    );
    assert_eq!(lines[0]["text"], json!({"origin": "drive", "status": "up"}));
    let told = lines
        .iter()
        .find(|line| line["direction"] == "out")
        .unwrap();
    assert_eq!(told["place"], place);
    assert_eq!(told["text"]["question"], "where");
    let letter = lines.iter().find(|line| line["event"] == "letter").unwrap();
    assert_eq!(letter["message"]["performative"], "query-ref");
}

#[test]
fn packets_of_hiac_devices_are_in_the_log_and_in_charts() {
    let place = Place::new();
    let file = place.path("letters.jsonl");
    let words = "--no-mdns --hiac tcp://127.0.0.1:0?listen --hiac-address 20:C4:D2:00/00:00:00:FF";
    let more = ["--log-letters", file.to_str().unwrap()];
    let words: Vec<&str> = words.split(' ').chain(more).collect();
    let daemon = place.start_with("robot1", &words);
    let url = daemon.ready["hiac"][0].as_str().unwrap();
    let url = url.strip_suffix("?listen").unwrap();
    let drive = Process::start(tool(&["hiac", "device", url, "--name", "drive"]));
    daemon.wait_for("drive@robot1");
    let words = "send --to drive@robot1 --from m@robot1 --performative query-ref --content where \
                 --wait 10";
    let ended = daemon.run(&words.split_whitespace().collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{ended:?}");
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.into_process().wait().code, Some(0));
    drop(drive);

    let lines = log(&file, 6);
    let packets: Vec<&Value> = lines.iter().filter(|l| l["event"] == "hiac").collect();
    assert_eq!(
        keys(packets[0]),
        ["time", "event", "number", "direction", "place", "hiac"]
    );
    let place = packets[0]["place"].as_str().unwrap();
    assert!(place.starts_with("tcp://127.0.0.1:"), "{place}");
    assert!(packets.iter().all(|l| l["place"] == place), "{packets:?}");
    // It is called for, agrees, and has its address.
    let call = (&packets[0]["direction"], &packets[0]["hiac"]["type"]);
    assert_eq!(call, (&json!("out"), &json!("SYS")));
    assert_eq!(packets[0]["hiac"]["target"], "20:C4:D2:01");
    assert_eq!(packets[1]["direction"], "in");
    assert_eq!(packets[1]["hiac"]["source"], "20:C4:D2:01");
    let hex: String = b"where"
        .iter()
        .map(|octet| format!("{octet:02x}"))
        .collect();
    for direction in ["out", "in"] {
        let said = packets.iter().find(|line| {
            let data = line["hiac"]["data"].as_str();
            let is_it = data.is_some_and(|data| data.ends_with(&hex));
            line["direction"] == direction && line["hiac"]["type"] == "MSG" && is_it
        });
        assert!(said.is_some(), "{direction}: {packets:?}");
    }
    assert!(packets.iter().all(|l| l["hiac"]["type"] != "ALIVE"));

    let chart = sniff(&file, &["--format", "chart"]);
    let text = chart.output.join("\n");
    assert!(text.contains("devices, hiac\n\n"), "{text}");
    assert!(text.contains(" SYS 20:C4:D2:00>20:C4:D2:01 ("), "{text}");
}

/// Two requests, of which the second goes on after its end, and a letter without protocol.
fn recorded(place: &Place) -> std::path::PathBuf {
    let file = place.path("letters.jsonl");
    let words = ["--no-mdns", "--log-letters", file.to_str().unwrap()];
    let daemon = place.start_with("robot1", &words);
    let _echo = daemon.attach("echo", "echo@robot1");
    let say = |act: &str, id: &str, wait: &[&str]| {
        let words = "send --to echo@robot1 --from arm@robot1 --protocol fipa-request --content x";
        let more = ["--performative", act, "--conversation-id", id];
        let words: Vec<&str> = words.split(' ').chain(more).collect();
        let ended = daemon.run(&[&words, wait].concat());
        assert_eq!(ended.code, Some(0), "{ended:?}");
    };
    say("request", "c-good", &["--wait", "10"]);
    say("request", "c-bad", &["--wait", "10"]);
    send_to_nobody(&daemon);
    say("cfp", "c-bad", &[]);
    log(&file, 6);
    file
}

/// What the protocol says of the last message of the second one.
const ENDED: &str = "cfp of arm@robot1 came after the end in the state done of fipa-request; \
                     expected: nothing more";

#[test]
fn a_chart_shows_the_states_of_the_protocol_and_marks_violations() {
    let place = Place::new();
    let file = recorded(&place);
    let chart = sniff(&file, &["--format", "chart"]).output.join("\n");
    let charts: Vec<&str> = chart.split("\n\nconversation ").collect();
    for (chart, remarks) in [
        (charts[0], vec!["· requested", "· done"]),
        (
            charts[1],
            vec!["· requested", "· done", "✗ violation [ended]: "],
        ),
        (charts[2], vec!["✗ unknown: "]),
    ] {
        let marks = |line: &&str| line.contains("│ ·") || line.contains("│ ✗");
        let found: Vec<&str> = chart.lines().filter(marks).collect();
        for (found, wanted) in found.iter().zip(&remarks) {
            assert!(found.contains(wanted), "{chart}");
        }
        assert!(found.len() >= remarks.len(), "{chart}");
    }
    assert!(charts[0].ends_with("│"), "{chart}");
    let svg = sniff(&file, &["--format", "svg"]).output.join("\n");
    assert!(svg.contains(">· requested</text>"), "{svg}");
    assert!(svg.contains("<text class=\"bad\""), "{svg}");
    assert!(svg.contains("✗ violation [ended]: "), "{svg}");
}

#[test]
fn a_letter_log_is_replayed_by_the_protocol_of_its_conversations() {
    let place = Place::new();
    let file = recorded(&place);
    let replay = |words: &[&str]| {
        let protocol = concat!(env!("CARGO_MANIFEST_DIR"), "/protocols/request.scxml");
        let file = file.to_str().unwrap();
        run(tool(
            &[&["protocol", "replay", protocol, "--messages", file], words].concat(),
        ))
    };
    let ended = replay(&["--json"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let said: Vec<(Value, Value, Value)> = ended
        .json()
        .into_iter()
        .map(|l| {
            (
                l["conversation-id"].clone(),
                l["n"].clone(),
                l["verdict"].clone(),
            )
        })
        .collect();
    let line = |id: &str, n: u64, verdict: &str| (json!(id), json!(n), json!(verdict));
    assert_eq!(
        said,
        [
            line("c-good", 1, "accepted"),
            line("c-good", 2, "accepted"),
            line("c-bad", 1, "accepted"),
            line("c-bad", 2, "accepted"),
            line("c-bad", 3, "violation"),
        ]
    );
    let error = ended.only_error();
    assert_eq!(
        error,
        format!("fipa protocol: conversation c-bad: message 3: {ENDED}")
    );
    let ended = replay(&[]);
    assert_eq!(ended.output[0], "conversation c-good:");
    assert_eq!(
        ended.output[2],
        "2  echo@robot1 -> arm@robot1: inform  done"
    );

    let one = replay(&["--conversation-id", "c-good", "--complete"]);
    assert_eq!(one.code, Some(0), "{one:?}");
    assert_eq!(one.output.len(), 2);
    // It has no protocol, and is replayed when it is asked for.
    let other = replay(&["--conversation-id", "c-2"]);
    assert_eq!(other.code, Some(1), "{other:?}");
    let error = other.only_error();
    assert!(error.contains("inform begins no conversation"), "{error}");
    let none = replay(&["--conversation-id", "c-3"]);
    assert_eq!(none.code, Some(1), "{none:?}");
    assert!(
        none.only_error()
            .contains("there is no conversation c-3 in ")
    );
}
