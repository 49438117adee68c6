//! HIAC devices behind one daemon, and the fleet behind another.

use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use serde_json::Value;

use crate::support::daemon::{Daemon, Place, tool};
use crate::support::process::Process;

/// A daemon that takes devices, and a device.
fn robot(place: &Place) -> (Daemon, Process) {
    let options = [
        "--hiac",
        "tcp://127.0.0.1:0?listen",
        "--hiac-address",
        "20:C4:D2:00/00:00:00:FF",
    ];
    let daemon = place.start_with("robot1", &options);
    let device = device(&daemon, "drive");
    (daemon, device)
}

fn device(daemon: &Daemon, name: &str) -> Process {
    let url = daemon.ready["hiac"][0].as_str().unwrap();
    let url = url.strip_suffix("?listen").unwrap();
    let mut device = Process::start(tool(&["hiac", "device", url, "--name", name, "--json"]));
    let connected = device.json();
    assert_eq!(connected["event"], "connected", "{connected}");
    assert_eq!(connected["employer"], "20:C4:D2:00");
    device
}

/// Sends something and prints what comes back.
fn say(daemon: &Daemon, performative: &str, content: &str) -> Process {
    Process::start(daemon.fipa(&[
        "send",
        "--to",
        "drive@robot1",
        "--from",
        "m@robot2",
        "--performative",
        performative,
        "--content",
        content,
        "--conversation-id",
        "c-1",
        "--wait",
        "10",
        "--json",
    ]))
}

fn message(process: &mut Process) -> Value {
    process.json()["message"].take()
}

#[test]
fn a_device_is_found_asked_and_told_by_the_fleet() {
    let place = Place::new();
    let (one, mut drive) = robot(&place);
    let two = place.start("robot2");
    two.wait_for("drive@robot1");

    let mut query = say(&two, "query-ref", "where are you");
    assert_eq!(query.json()["outcome"], "delivered");
    let answer = message(&mut query);
    assert_eq!(answer["performative"], "inform");
    assert_eq!(answer["content"], "where are you");
    assert_eq!(answer["sender"]["name"], "drive@robot1");
    assert_eq!(answer["conversation-id"], "c-1");
    let question = drive.json();
    assert_eq!(question["event"], "question");
    assert_eq!(question["text"], "where are you");

    let mut request = say(&two, "request", "stop");
    assert_eq!(request.json()["outcome"], "delivered");
    assert_eq!(message(&mut request)["performative"], "agree");
    assert_eq!(message(&mut request)["performative"], "inform");
    assert_eq!(drive.json()["event"], "command");

    let devices = one.run(&["hiac", "devices", "--json"]);
    assert_eq!(devices.code, Some(0), "{devices:?}");
    assert_eq!(
        devices.output,
        [r#"{"name":"drive@robot1","address":"20:C4:D2:01"}"#]
    );
    let none = two.run(&["hiac", "devices", "--json"]);
    assert_eq!(none.code, Some(1), "{none:?}");
}

#[test]
fn a_device_that_is_killed_fails_what_it_owes_and_leaves_the_directory() {
    let place = Place::new();
    let (one, drive) = robot(&place);
    let two = place.start("robot2");
    two.wait_for("drive@robot1");
    // It holds still, so that the question stays open, and then it is gone.
    drive.signal(rustix::process::Signal::STOP);
    let mut query = say(&two, "query-ref", "where");
    assert_eq!(query.json()["outcome"], "delivered");
    drive.kill();
    let answer = message(&mut query);
    assert_eq!(answer["performative"], "failure", "{answer}");
    assert_eq!(answer["conversation-id"], "c-1");
    let gone = one.run(&["hiac", "devices"]);
    assert_eq!(gone.code, Some(1), "{gone:?}");
    // It comes back under its name.
    let _drive = device(&one, "drive");
    two.wait_for("drive@robot1");
}

/// Writes the certificate of an authority, and one that it gave with its key.
fn certify(place: &Place) {
    let mut params = CertificateParams::new(Vec::new()).unwrap();
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    let key = KeyPair::generate().unwrap();
    let authority = params.self_signed(&key).unwrap().pem();
    let issuer = Issuer::new(params, key);
    let key = KeyPair::generate().unwrap();
    let params = CertificateParams::new(["127.0.0.1".to_owned()]).unwrap();
    let certificate = params.signed_by(&key, &issuer).unwrap().pem();
    for (name, text) in [
        ("ca.pem", authority),
        ("cert.pem", certificate),
        ("key.pem", key.serialize_pem()),
    ] {
        std::fs::write(place.path(name), text).unwrap();
    }
}

#[test]
fn under_tls_a_device_with_a_certificate_is_taken_and_one_without_is_not() {
    let place = Place::new();
    certify(&place);
    let file = |name: &str| place.path(name).display().to_string();
    let (cert, key, ca) = (file("cert.pem"), file("key.pem"), file("ca.pem"));
    let listen = format!("tls://127.0.0.1:0?listen&cert={cert}&key={key}&ca={ca}");
    let group = "20:C4:D2:00/00:00:00:FF";
    let one = place.start_with("robot1", &["--hiac", &listen, "--hiac-address", group]);
    let bound = one.ready["hiac"][0].as_str().unwrap();
    let dial = bound.split_once('?').unwrap().0;
    let device = |url: &str, name: &str| {
        Process::start(tool(&["hiac", "device", url, "--name", name, "--json"]))
    };
    let mut stranger = device(&format!("{dial}?ca={ca}"), "stranger");
    let mut drive = device(&format!("{dial}?cert={cert}&key={key}&ca={ca}"), "drive");
    assert_eq!(drive.json()["event"], "connected");
    one.wait_for("drive@robot1");
    let mut query = say(&one, "query-ref", "where are you");
    assert_eq!(query.json()["outcome"], "delivered");
    assert_eq!(message(&mut query)["content"], "where are you");
    let devices = one.run(&["hiac", "devices", "--json"]);
    assert_eq!(devices.output.len(), 1, "{devices:?}");
    stranger.signal(rustix::process::Signal::TERM);
    while let Some(line) = stranger.line_or_end() {
        assert!(!line.contains("connected"), "{line}");
    }

    let unverified = tool(&["hiac", "device", dial]);
    let unverified = crate::support::process::run(unverified);
    assert_eq!(unverified.code, Some(2), "{unverified:?}");
    let said = unverified.errors.join(" ");
    assert!(said.contains("cannot be verified"), "{said}");
}
