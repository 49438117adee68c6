//! The examples, as two robots would run them.

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;

use support::namespace::Namespace;
use support::process::Process;

#[test]
fn request_is_answered_by_serve() {
    // They speak mDNS at its usual port, where others of this machine would hear them.
    let Some(host) = Namespace::new() else {
        return;
    };
    let mut serve = Process::start(host.enter(&example("serve")));
    assert_eq!(serve.line(), "drive@robot2 is there");
    let request = Process::start(host.enter(&example("request"))).wait();
    assert_eq!(request.code, Some(0), "{request:?}");
    assert_eq!(request.output, ["inform: at the dock"]);
    assert_eq!(serve.line(), "go to the dock");
    assert_eq!(serve.line(), "the answer is delivered");
}

#[test]
fn balaro_goes_on_over_the_ice_when_its_control_unit_fails() {
    let ended = Process::start(example("balaro")).wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let lines = [
        "The coast station employs the control unit, and that its three devices:",
        "  control is 20:C4:01:00, employed by 20:C4:00:00",
        "  sensor is 20:C4:01:01, employed by 20:C4:01:00",
        "  gps is 20:C4:01:02, employed by 20:C4:01:00",
        "  drive is 20:C4:01:03, employed by 20:C4:01:00",
        "Colleagues talk through their employer, which does not care what they say:",
        r#"  drive hears from 20:C4:01:01: Warning "thin ice ahead""#,
        r#"  gps hears from 20:C4:01:01: Question "where are we?""#,
        r#"  sensor is answered: "46.9 N 17.9 E""#,
        "The coast station commands a subemployee, one way:",
        r#"  drive hears from 20:C4:00:00: Command "stop""#,
        "  coast may not ask the drive: not permitted in the hierarchy",
        "The control unit fails; a spare one takes over:",
        "  spare is 20:C4:02:00, employed by 20:C4:00:00",
        "  control has no employer any more: Lost",
        "  sensor has no employer any more: Lost",
        "  gps has no employer any more: Lost",
        "  drive has no employer any more: Lost",
        "  sensor is 20:C4:02:01, employed by 20:C4:02:00",
        "  gps is 20:C4:02:02, employed by 20:C4:02:00",
        "  drive is 20:C4:02:03, employed by 20:C4:02:00",
        r#"  drive hears from 20:C4:02:00: Command "go on""#,
        "The control unit is repaired, and the coast station has it given its workgroup:",
        "  control is 20:C4:01:00, employed by 20:C4:00:00",
        "  sensor has no employer any more: Transferred",
        "  gps has no employer any more: Transferred",
        "  drive has no employer any more: Transferred",
        "  sensor is 20:C4:01:01, employed by 20:C4:01:00",
        "  gps is 20:C4:01:02, employed by 20:C4:01:00",
        "  drive is 20:C4:01:03, employed by 20:C4:01:00",
        r#"  drive hears from 20:C4:01:01: Information "the ice is thick""#,
    ];
    assert_eq!(ended.output, lines);
}

#[test]
fn the_best_bidder_that_lives_gets_the_contract() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("letters.jsonl");
    let mut command = example("contract_net");
    command.arg(&log);
    let ended = Process::start(command).wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let lines: Vec<&str> = ended.output.iter().map(String::as_str).collect();
    let of = |part: &str| {
        let found = lines.iter().filter(|line| line.contains(part));
        found.copied().collect::<Vec<&str>>()
    };
    assert_eq!(
        lines[..2],
        [
            "master@robot1 -> 20 bidders: cfp carry the payload to the dock",
            "robot3 fails",
        ]
    );
    assert_eq!(of(": propose ").len(), 14);
    let lost = of("no proposal: ");
    assert_eq!(lost.len(), 6);
    assert!(lost.iter().all(|line| line.ends_with("@robot3 is gone")));
    // What robot3 had proposed was better: 4 minutes.
    assert_eq!(
        of("7 minutes")[0],
        "bidder13@robot2 -> master@robot1: propose 7 minutes"
    );
    assert_eq!(
        of(": accept-proposal"),
        ["master@robot1 -> bidder13@robot2: accept-proposal"]
    );
    assert_eq!(of(": reject-proposal").len(), 13);
    assert_eq!(
        lines.last(),
        Some(&"bidder13@robot2 -> master@robot1: inform the payload is at the dock")
    );
    // Its sequence chart: all twenty are called, and each is told where it stands.
    let text = chart(&log, "chart");
    let title = text.lines().next().unwrap_or_default();
    assert!(title.ends_with(", fipa-contract-net"), "{text}");
    let svg = chart(&log, "svg");
    for drawn in [&text, &svg] {
        let count = |part: &str| drawn.matches(part).count();
        assert_eq!(count("cfp (carry the payload to the dock)"), BIDDERS);
        // The last of robot3 bid before it failed.
        assert_eq!((count("· called"), count("· proposed")), (1, BIDDERS));
        assert_eq!((count("· accepted"), count("· done")), (1, 1));
        assert_eq!(count("violation"), 0, "{drawn}");
    }
    assert!(svg.starts_with("<svg "), "{svg}");
}

const BIDDERS: usize = 20;

/// What `fipa sniff` draws of a log.
fn chart(log: &Path, format: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fipa"));
    command
        .args(["sniff", "--format", format, "--file"])
        .arg(log);
    let ended = Process::start(command).wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    ended.output.join("\n")
}

#[test]
fn two_robots_dock_while_a_third_watches() {
    let ended = Process::start(example("docking")).wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(
        ended.output.join("\n"),
        r#"crex: actions
  approach(target: text, distance: number) "Drive towards another robot, up to so many metres."
  turn(degrees: number) "Turn where it stands."
  dock(target: text, emi: number) "Drive to an interface and lock it."
sherpa: do approach(target: sherpa, distance: 0.5)
crex: status
  1 done approach(target: sherpa, distance: 0.5)
sherpa: do turn(degrees: -12.5)
crex: status
  2 done turn(degrees: -12.5)
sherpa: do dock(target: sherpa)
refused by crex: emi is missing
sherpa: do dock(target: sherpa, emi: 2)
crex: status
  3 done dock(target: sherpa, emi: 2)
ground saw: 1 running 0% approach(target: sherpa, distance: 0.5)
ground saw: 1 running 50% approach(target: sherpa, distance: 0.5)
ground saw: 1 done approach(target: sherpa, distance: 0.5)
ground saw: 2 running 0% turn(degrees: -12.5)
ground saw: 2 running 50% turn(degrees: -12.5)
ground saw: 2 done turn(degrees: -12.5)
ground saw: 3 running 0% dock(target: sherpa, emi: 2)
ground saw: 3 running 50% dock(target: sherpa, emi: 2)
ground saw: 3 done dock(target: sherpa, emi: 2)"#
    );
}

/// An example, which cargo builds beside the tests.
fn example(name: &str) -> Command {
    let test = std::env::current_exe().unwrap();
    let target = test.ancestors().nth(2).unwrap();
    let example: PathBuf = target.join("examples").join(name);
    Command::new(example)
}
