//! The examples, as two robots would run them.

mod support;

use std::path::PathBuf;
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

/// An example, which cargo builds beside the tests.
fn example(name: &str) -> Command {
    let test = std::env::current_exe().unwrap();
    let target = test.ancestors().nth(2).unwrap();
    let example: PathBuf = target.join("examples").join(name);
    Command::new(example)
}
