//! `fipa send`: outcomes, exit codes, replies.

use rustix::process::Signal;
use serde_json::Value;

use crate::support::daemon::{Daemon, Place, fipa, tool};
use crate::support::process::{Ended, Process, keys, run};

/// The words of a command that sends an inform.
fn inform<'a>(to: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let words = ["send", "--to", to, "--performative", "inform", "--json"];
    [&words[..], more].concat()
}

/// The only outcome, which has the keys of the contract.
fn outcome(ended: &Ended) -> Value {
    let outcome = ended.only_json();
    assert_eq!(keys(&outcome), ["to", "outcome", "via", "reason"]);
    outcome
}

#[test]
fn a_message_that_arrived_ends_with_0() {
    let place = Place::new();
    let (one, two, _echo) = place.pair();
    let ended = one.run(&inform("echo@robot2", &[]));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let outcome = outcome(&ended);
    assert_eq!(outcome["to"], "echo@robot2");
    assert_eq!(outcome["outcome"], "delivered");
    assert_eq!(outcome["via"], two.endpoint());
    assert_eq!(outcome["reason"], Value::Null);
}

#[test]
fn any_regular_expression_is_a_receiver() {
    let place = Place::new();
    let (one, _two, _echo) = place.pair();
    let ended = one.run(&inform("(echo|nobody)@robot[0-9]", &[]));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(outcome(&ended)["to"], "echo@robot2");
}

#[test]
fn a_performative_of_two_words_is_wrong_usage() {
    let words = ["send", "--to", "x", "--performative", "two words"];
    let ended = run(tool(&words));
    assert_eq!(ended.code, Some(2), "{ended:?}");
}

#[test]
fn a_message_for_nobody_ends_with_1() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    for (to, why) in [
        ("nobody@robot2", "no agent of this name"),
        ("[a", "regular expression"),
    ] {
        let ended = daemon.run(&inform(to, &[]));
        assert_eq!(ended.code, Some(1), "{ended:?}");
        let outcome = outcome(&ended);
        assert_eq!(outcome["to"], to);
        assert_eq!(outcome["outcome"], "unknown");
        assert_eq!(outcome["via"], Value::Null);
        assert!(outcome["reason"].as_str().unwrap().contains(why));
        ended.only_error();
    }
}

#[test]
fn a_message_to_a_daemon_that_stands_still_times_out_and_ends_with_1() {
    let place = Place::new();
    let (one, two, _echo) = place.pair();
    two.signal(Signal::STOP);
    let ended = one.run(&inform("echo@robot2", &["--timeout", "2"]));
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let outcome = outcome(&ended);
    assert_eq!(outcome["outcome"], "timeout");
    assert!(outcome["reason"].is_string());
}

#[test]
fn a_message_under_way_to_a_daemon_that_dies_ends_with_1() {
    let place = Place::new();
    let (one, two, _echo) = place.pair();
    two.signal(Signal::STOP);
    let sending = Process::start(one.fipa(&inform("echo@robot2", &["--timeout", "60"])));
    // A message that was sent after it has been given up.
    let later = one.run(&inform("echo@robot2", &["--timeout", "0.5"]));
    assert_eq!(outcome(&later)["outcome"], "timeout");
    two.kill();
    let ended = sending.wait();
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let outcome = outcome(&ended);
    assert_eq!(outcome["outcome"], "timeout");
    let reason = outcome["reason"].as_str().unwrap();
    assert!(reason.contains("gone"), "{reason}");
}

#[test]
fn without_a_daemon_every_command_ends_with_3() {
    let place = Place::new();
    let nowhere = place.path("nowhere.sock");
    for words in [
        &["agents"][..],
        &["attach", "--as", "a@robot1"],
        &["echo", "--as", "a@robot1"],
        &["listen", "--as", "a@robot1"],
        &["ping", "a@robot1"],
        &inform("a@robot1", &[]),
    ] {
        let ended = run(fipa(&nowhere, words));
        assert_eq!(ended.code, Some(3), "{words:?}: {ended:?}");
        let error = ended.only_error();
        assert!(error.contains(nowhere.to_str().unwrap()), "{error}");
        assert_eq!(ended.output, [""; 0]);
    }
}

#[test]
fn wrong_usage_ends_with_2_and_one_line() {
    for words in [
        &[][..],
        &["dance"],
        &["send", "--to", "a@robot1"],
        &inform("a@robot1", &["--timeout", "soon"]),
        &inform("a@robot1", &["--content", "a", "--content-file", "b"]),
        &["listen"],
        &["ping", "a@robot1", "--window", "0"],
    ] {
        let ended = run(tool(words));
        assert_eq!(ended.code, Some(2), "{words:?}: {ended:?}");
        ended.only_error();
        assert_eq!(ended.output, [""; 0]);
    }
}

#[test]
fn replies_are_printed_for_as_long_as_they_are_waited_for() {
    let place = Place::new();
    let (one, _two, _echo) = place.pair();
    let words = "send --to echo@robot2 --performative request --content dock --wait 10 --json";
    let words: Vec<&str> = words.split(' ').collect();
    let ended = one.run(&words);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let lines = ended.json();
    assert_eq!(lines.len(), 2, "{ended:?}");
    assert_eq!(lines[0]["outcome"], "delivered");
    assert_eq!(keys(&lines[1]), ["message"]);
    assert_eq!(lines[1]["message"]["performative"], "inform");
    assert_eq!(lines[1]["message"]["content"], "dock");

    // Nobody answers an inform.
    let ended = one.run(&inform("echo@robot2", &["--wait", "0.2"]));
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_eq!(outcome(&ended)["outcome"], "delivered");
}

#[test]
fn a_message_in_the_name_of_another_connection_is_answered_there() {
    let place = Place::new();
    let (one, _two, _echo) = place.pair();
    let mut holder = one.attach_with(&["listen", "--as", "arm@robot1", "--count", "1", "--json"]);
    let words = "send --to echo@robot2 --from arm@robot1 --performative request --content dock";
    let words: Vec<&str> = words.split(' ').collect();

    let ended = one.run(&[&words[..], &["--wait", "1"]].concat());
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.only_error().contains("arm@robot1"), "{ended:?}");

    let ended = one.run(&words);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let reply = holder.json();
    assert_eq!(reply["message"]["sender"]["name"], "echo@robot2");
    assert_eq!(reply["message"]["content"], "dock");
    assert_eq!(holder.wait().code, Some(0));
}

#[test]
fn what_the_options_say_is_in_the_message() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--no-mdns"]);
    let mut listener = daemon.attach_with(&["listen", "--as", "drive@robot1", "--json"]);
    let file = place.path("content");
    std::fs::write(&file, [0, 1, 2, 255]).unwrap();
    send(
        &daemon,
        "--performative propose --content hello --protocol fipa-propose --conversation-id c1 \
         --language l1 --ontology o1 --reply-with r1 --from arm@robot1",
    );
    let letter = listener.json();
    let message = &letter["message"];
    for (key, value) in [
        ("performative", "propose"),
        ("content", "hello"),
        ("protocol", "fipa-propose"),
        ("conversation-id", "c1"),
        ("language", "l1"),
        ("ontology", "o1"),
        ("reply-with", "r1"),
    ] {
        assert_eq!(message[key], value);
    }
    assert_eq!(message["sender"]["name"], "arm@robot1");

    let file = file.to_str().unwrap();
    send(
        &daemon,
        &format!("--performative inform --content-file {file}"),
    );
    let letter = listener.json();
    assert_eq!(letter["message"]["content"]["base64"], "AAEC/w==");
    // Without --from the process itself is the sender.
    let sender = letter["message"]["sender"]["name"].as_str().unwrap();
    assert!(
        sender.starts_with("fipa-") && sender.contains('@'),
        "{sender}"
    );
}

fn send(daemon: &Daemon, options: &str) {
    let words = ["send", "--to", "drive@robot1"];
    let options: Vec<&str> = options.split_whitespace().collect();
    let ended = daemon.run(&[&words[..], &options].concat());
    assert_eq!(ended.code, Some(0), "{ended:?}");
}
