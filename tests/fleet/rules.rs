//! Rules of the operator: who may send, who may register, and who needs no key.

use std::io::{self, Write};
use std::net::{Shutdown, TcpStream};

use crate::place::{Fleet, agents, refused, socket_address};
use crate::stranger::{Intrusion, letter};
use crate::support::daemon::Place;
use crate::support::process::run;

#[test]
fn a_rule_says_who_may_send_to_whom_and_a_refusal_names_it() {
    let fleet = Fleet::new();
    let config = "[[rules]]\ndeny = \"send\"\nagent = \".*@robot2\"\nto = \"motors@.*\"\n";
    let one = fleet.start_with("robot1", &[], config);
    let two = fleet.start("robot2", &[&one]);
    let _motors = one.attach("echo", "motors@robot1");
    let _lamp = one.attach("echo", "lamp@robot1");
    two.wait_for("lamp@robot1");
    let send = |to: &str| {
        let words = [
            "send",
            "--from",
            "a@robot2",
            "--to",
            to,
            "--performative",
            "inform",
            "--json",
        ];
        two.run(&words).only_json()
    };
    assert_eq!(send("lamp@robot1")["outcome"], "delivered");
    let refused = send("motors@robot1");
    assert_eq!(refused["outcome"], "refused");
    assert_eq!(
        refused["reason"],
        "rule 1 of the configuration denies a@robot2 to send"
    );
}

#[test]
fn a_rule_says_who_may_register() {
    let fleet = Fleet::new();
    let config = "[[rules]]\ndeny = \"register\"\nagent = \"spy.*\"\n";
    let mut one = fleet.start_with("robot1", &[], config);
    let two = fleet.start("robot2", &[&one]);
    let _spy = two.attach("echo", "spy@robot2");
    let _lamp = two.attach("echo", "lamp@robot2");
    one.wait_for("lamp@robot2");
    assert_eq!(agents(&one), ["lamp@robot2"]);
    refused(
        &mut one,
        "rule 1 of the configuration denies spy@robot2 to register",
    );
    let here = run(one.fipa(&["echo", "--as", "spy@robot1"]));
    assert_eq!(here.code, Some(1));
    assert!(
        here.only_error().contains("rule 1 of the configuration"),
        "{here:?}"
    );
}

#[test]
fn a_robot_that_has_a_rule_may_use_a_name_of_another() {
    let fleet = Fleet::new();
    let config = "[[rules]]\nallow = [\"register\", \"send\"]\nagent = \"drive@robot1\"\nrobot = \"robot2\"\n";
    let mut one = fleet.start_with("robot1", &[], config);
    let robot2 = fleet.join("robot2");
    let _sink = one.attach("echo", "sink@robot1");
    let moved = Intrusion {
        name: "robot2",
        agent: "drive@robot1",
        from: "drive@robot1",
        to: "sink@robot1",
    };
    let answer = moved.secretly(one.endpoint(), Some(&robot2));
    assert_eq!(answer.receipt.unwrap().0, "delivered");
    let other = Intrusion {
        agent: "arm@robot1",
        ..moved
    };
    other.secretly(one.endpoint(), Some(&robot2));
    refused(&mut one, "arm@robot1 is a name of robot1");
}

#[test]
fn who_has_no_key_is_admitted_by_its_address() {
    let fleet = Fleet::new();
    let config = "[[rules]]\nallow = \"send\"\naddress = \"127.0.0.0/8\"\nagent = \".*@rover\"\n";
    let one = fleet.start_with("robot1", &[], config);
    let mut sink = one.attach_with(&["listen", "--as", "sink@robot1", "--json"]);
    for from in ["arm@robot1", "arm@elsewhere", "arm@rover"] {
        let mut caller = TcpStream::connect(socket_address(&one)).unwrap();
        caller.write_all(&letter(from, "sink@robot1")).unwrap();
        caller.shutdown(Shutdown::Write).unwrap();
        let _ = io::copy(&mut caller, &mut io::sink());
    }
    let first = sink.json();
    assert_eq!(
        first["message"]["sender"]["name"], "arm@rover",
        "the others are not admitted"
    );
}

#[test]
fn only_pinned_robots_are_let_in_where_some_are() {
    let fleet = Fleet::new();
    let two = fleet.join("robot2");
    let three = fleet.join("robot3");
    fleet.join("robot1");
    let mut command = fleet.fipad("robot1", &[]);
    command.args(["--fleet-mode", "pinned", "--pinned"]);
    command.arg(two.certificate().fingerprint().to_string());
    let mut one = crate::support::daemon::Daemon::start(command);
    let _sink = one.attach("echo", "sink@robot1");
    let honest = Intrusion::honest("robot3", "arm@robot3");
    assert_eq!(honest.secretly(one.endpoint(), Some(&three)).receipt, None);
    refused(&mut one, "the certificate of robot3 is not pinned here");
    let honest = Intrusion::honest("robot2", "arm@robot2");
    let answer = honest.secretly(one.endpoint(), Some(&two));
    assert_eq!(answer.receipt.unwrap().0, "delivered");
}

#[test]
fn rules_hold_without_a_fleet_as_well() {
    let place = Place::new();
    let file = place.path("rules.toml");
    std::fs::write(&file, "[[rules]]\ndeny = \"send\"\nto = \"motors@.*\"\n").unwrap();
    let mut command = place.fipad("robot1");
    command.arg("--no-mdns").arg("--config").arg(&file);
    let one = crate::support::daemon::Daemon::start(command);
    let _motors = one.attach("echo", "motors@robot1");
    let words = [
        "send",
        "--to",
        "motors@robot1",
        "--performative",
        "inform",
        "--json",
    ];
    assert_eq!(one.run(&words).only_json()["outcome"], "refused");
}

#[test]
fn rules_that_make_no_sense_are_told_with_their_place() {
    let place = Place::new();
    for (rules, said) in [
        (
            "[[rules]]\nagent = \"a\"\n",
            "rules: a rule needs allow or deny",
        ),
        (
            "[[rules]]\nallow = \"sned\"\n",
            "2:9: allow: \"sned\" is neither send nor register",
        ),
        ("[[rules]]\nallow = []\n", "says what it allows"),
        (
            "[[rules]]\nallow = \"send\"\ndeny = \"send\"\n",
            "one of allow and deny",
        ),
        (
            "[[rules]]\nallow = \"send\"\nadress = \"::\"\n",
            "3:1: rules: unknown key \"adress\" (did you mean \"address\"?)",
        ),
        (
            "[[rules]]\nallow = \"send\"\nagent = \"(\"\n",
            "is no regular expression",
        ),
        (
            "[[rules]]\nallow = \"send\"\naddress = \"robot1\"\n",
            "is no network",
        ),
        ("[rules]\nallow = \"send\"\n", "this takes tables"),
    ] {
        let file = place.path("rules.toml");
        std::fs::write(&file, rules).unwrap();
        let mut command = place.fipad("robot1");
        command.arg("--config").arg(&file);
        let ended = run(command);
        assert_eq!(ended.code, Some(2), "{rules}");
        assert!(ended.only_error().contains(said), "{ended:?}");
    }
}
