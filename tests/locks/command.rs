//! `fipa lock` and `fipa lock list`: exit codes, the environment of the command, signals.

use std::time::Duration;

use rustix::process::Signal;
use serde_json::json;

use crate::robots::{BOTH, Member, Robots};
use crate::support::daemon::{Place, tool};
use crate::support::process::{Process, keys, run};

#[test]
fn the_exit_code_is_that_of_the_command_and_its_number_is_in_its_environment() {
    let robots = Robots::start();
    let mut last = 0;
    for algorithm in BOTH {
        let options = ["--algorithm", algorithm];
        for (at, script, code) in [
            (0, "echo $FIPA_LOCK_FENCING", 0),
            (1, "echo $FIPA_LOCK_FENCING; exit 7", 7),
            (2, "echo $FIPA_LOCK_FENCING; kill -9 $$", 137),
        ] {
            let ended = robots.member(at).run(&options, script);
            assert_eq!(ended.code, Some(code), "{ended:?}");
            assert!(ended.errors.is_empty(), "{ended:?}");
            let number: u64 = ended.output[0].parse().unwrap();
            assert!(number > last, "{number} after {last}");
            last = number;
        }
    }
}

#[test]
fn the_list_shows_every_owner_with_holder_and_waiters_to_every_daemon() {
    let robots = Robots::start();
    let peer = robots.daemons[0].endpoint();
    let options = ["--no-mdns", "--owns", "the door", "--peer", peer];
    let other = robots.place.start_with("robot4", &options);
    robots.daemons[2].wait_for("locks@robot4");
    let holder = robots.member(1).hold(&[]);
    let waiting = Process::start(robots.member(2).lock("counter", &[], "true"));
    let expected = json!({
        "resource": "counter",
        "owner": "locks@robot1",
        "holder": "a@robot2",
        "waiting": ["a@robot3"],
        "fencing": 1
    });
    let listed = |at: usize| {
        let ended = robots.daemons[at].run(&["lock", "list", "--json"]);
        assert_eq!(ended.code, Some(0), "{ended:?}");
        ended.json()
    };
    while listed(2)[0] != expected {
        std::thread::sleep(Duration::from_millis(20));
    }
    for at in 0..3 {
        let views = listed(at);
        assert_eq!(views.len(), 2, "{views:?}");
        assert_eq!(views[0], expected);
        let order = ["resource", "owner", "holder", "waiting", "fencing"];
        assert_eq!(keys(&views[0]), order);
        assert_eq!(views[1]["resource"], "the door");
        assert_eq!(views[1]["owner"], "locks@robot4");
        assert!(views[1]["holder"].is_null());
    }
    let table = robots.daemons[0].run(&["lock", "list"]).output;
    let words: Vec<&str> = table[1].split_whitespace().collect();
    assert_eq!(
        words,
        ["counter", "locks@robot1", "a@robot2", "1", "a@robot3"]
    );
    drop(holder);
    assert_eq!(waiting.wait().code, Some(0));

    drop(other);
    let place = Place::new();
    let lonely = place.start("robot9");
    let ended = lonely.run(&["lock", "list", "--json"]);
    assert_eq!(ended.code, Some(1));
    assert_eq!(ended.only_error(), "fipa lock: no agent owns anything");
}

#[test]
fn what_is_not_granted_ends_with_1_and_runs_nothing() {
    let robots = Robots::start();
    let _holder = robots.member(1).hold(&[]);
    let late = robots.member(2).run(&["--timeout", "0.3"], "echo ran");
    assert_eq!(late.code, Some(1));
    let said = "fipa lock: counter: it was not granted within 300ms";
    assert_eq!(late.only_error(), said);
    assert!(late.output.is_empty());

    let nobody = robots
        .member(0)
        .lock("window", &["--heartbeat", "0.05"], "echo ran");
    let nobody = run(nobody);
    assert_eq!(nobody.code, Some(1));
    assert_eq!(nobody.only_error(), "fipa lock: window: no agent owns it");

    let again = robots.member(1).run(&[], "echo ran");
    assert_eq!(again.code, Some(1), "{again:?}");
    assert!(again.only_error().contains("held by another"), "{again:?}");

    let waiting = Process::start(robots.member(2).lock("counter", &[], "echo ran"));
    while robots.listed(0)["waiting"] != json!(["a@robot3"]) {
        std::thread::sleep(Duration::from_millis(20));
    }
    waiting.signal(Signal::INT);
    let ended = waiting.wait();
    assert_eq!(ended.code, Some(1));
    let said = "fipa lock: counter: interrupted before it was granted";
    assert_eq!(ended.only_error(), said);
    assert!(ended.output.is_empty());
}

#[test]
fn signals_go_to_the_command_and_the_resource_is_given_back() {
    let robots = Robots::start();
    for (signal, code) in [(Signal::TERM, 143), (Signal::INT, 130), (Signal::HUP, 129)] {
        let holder = Process::start(robots.member(1).lock(
            "counter",
            &[],
            "echo held; exec sleep 60",
        ));
        let mut holder = holder;
        holder.line();
        holder.signal(signal);
        assert_eq!(holder.wait().code, Some(code));
        assert!(robots.listed(1)["holder"].is_null());
    }
    // One that handles the signal ends as it likes.
    let script = "trap 'exit 9' TERM; echo held; while :; do sleep 0.05; done";
    let mut holder = Process::start(robots.member(1).lock("counter", &[], script));
    holder.line();
    holder.signal(Signal::TERM);
    assert_eq!(holder.wait().code, Some(9));
}

#[test]
fn wrong_usage_ends_with_2_and_what_cannot_be_run_with_3() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--owns", "door"]);
    let member = Member::at(&daemon);
    for options in [
        &["--heartbeat", "0"][..],
        &["--heartbeat", "1e9"],
        &["--with", "(a"],
        &["--algorithm", "bakery"],
        &["--timeout", "soon"],
    ] {
        let ended = run(member.lock("door", options, "echo ran"));
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(ended.output.is_empty());
        ended.only_error();
    }
    let ended = run(member.lock("two\nlines", &[], "echo ran"));
    assert_eq!(ended.code, Some(2), "{ended:?}");
    for words in [
        &["lock"][..],
        &["lock", "door"],
        &["lock", "door", "--as", "a"],
        &["lock", "door", "--", "true"],
        &["lock", "list", "--as", "a", "--", "true"],
    ] {
        let ended = run(tool(words));
        assert_eq!(ended.code, Some(2), "{ended:?}");
        ended.only_error();
    }
    let mut missing = tool(&["lock", "door", "--as", "a", "--control"]);
    missing
        .arg(&daemon.control)
        .args(["--", "/no/such/program"]);
    let ended = run(missing);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.only_error().contains("/no/such/program"));
    let mut nobody = tool(&["lock", "door", "--as", "a", "--control"]);
    nobody.arg(place.path("none")).args(["--", "true"]);
    assert_eq!(run(nobody).code, Some(3));
}

#[test]
fn numbers_grow_over_restarts_of_a_daemon_with_a_state_even_if_it_was_killed() {
    let place = Place::new();
    let state = place.path("state/robot1");
    let options = ["--owns", "door", "--state", state.to_str().unwrap()];
    for number in 1..4 {
        let daemon = place.start_with("robot1", &options);
        let member = Member::at(&daemon);
        let ended = run(member.lock("door", &[], "echo $FIPA_LOCK_FENCING"));
        assert_eq!(ended.output, [number.to_string()], "{ended:?}");
        // Else it would wait for whoever holds it.
        let free = format!("{number} free door\n");
        while std::fs::read_to_string(state.join("fencing")).unwrap() != free {
            std::thread::sleep(Duration::from_millis(5));
        }
        daemon.kill();
    }
    std::fs::write(state.join("fencing"), "nonsense\n").unwrap();
    let mut command = place.fipad("robot1");
    command.args(options);
    let ended = run(command);
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert!(ended.only_error().contains("fencing:1:"), "{ended:?}");
}

#[test]
fn a_daemon_that_owns_without_a_state_says_what_that_means() {
    let place = Place::new();
    let mut command = place.fipad("robot1");
    command.args(["--owns", "door"]).env("FIPA_LOG", "warn");
    let mut daemon = Process::start(command);
    let said = daemon.error_line();
    assert!(said.contains("--owns without --state"), "{said}");
}
