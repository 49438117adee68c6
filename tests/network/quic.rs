//! Daemons that are linked over QUIC.

use std::time::{Duration, Instant};

use fipa::blocking::Platform;
use fipa::{Message, Outcome, Performative};
use rustix::process::Signal;

use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};

/// Two daemons, of which the second dials the first over QUIC.
fn pair(place: &Place) -> (Daemon, Daemon) {
    let one = place.start_with("robot1", &["--no-mdns", "--listen", "quic://127.0.0.1:0"]);
    assert!(one.endpoint().starts_with("quic://127.0.0.1:"));
    let two = place.start_with("robot2", &["--no-mdns", "--peer", one.endpoint()]);
    (one, two)
}

#[test]
fn letters_of_all_sizes_and_urgencies_go_both_ways() {
    let place = Place::new();
    let (one, two) = pair(&place);
    let at = [&one, &two].map(|daemon| Platform::attach_to(&daemon.control).unwrap());
    let (first, second) = (
        at[0].agent("a@robot1").unwrap(),
        at[1].agent("b@robot2").unwrap(),
    );
    at[0].wait_for("b@robot2", PATIENCE).unwrap();
    at[1].wait_for("a@robot1", PATIENCE).unwrap();
    for (n, size) in [0, 100, 70_000, 3_000_000].into_iter().enumerate() {
        for (from, to, name) in [(&first, &second, "b@robot2"), (&second, &first, "a@robot1")] {
            let content = "x".repeat(size);
            let message = Message::new(Performative::Inform)
                .to(name)
                .user_defined("X-Priority", (n % 3).to_string())
                .content(content.clone());
            let told = from.send(message).remove(0);
            assert_eq!(told.outcome, Outcome::Delivered, "{told:?}");
            let come = to.receive_timeout(PATIENCE).unwrap().unwrap();
            assert_eq!(come.content_str().unwrap(), content);
        }
    }
}

#[test]
fn an_agent_that_was_just_registered_is_answered() {
    let place = Place::new();
    let (one, two) = pair(&place);
    let _echo = one.attach("echo", "echo@robot1");
    two.wait_for("echo@robot1");
    for _ in 0..20 {
        let ended = two.run(&["ping", "echo@robot1", "--count", "1"]);
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
}

#[test]
fn a_daemon_that_ends_is_gone_at_once() {
    let place = Place::new();
    let (one, two) = pair(&place);
    let echo = one.attach("echo", "echo@robot1");
    two.wait_for("echo@robot1");
    let platform = Platform::attach_to(&two.control).unwrap();
    let is_gone = |within: Duration| {
        let begun = Instant::now();
        while !platform.search("echo@robot1").unwrap().is_empty() {
            assert!(begun.elapsed() < within, "it is still known");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    one.signal(Signal::TERM);
    is_gone(Duration::from_secs(3));
    drop(echo);
    assert_eq!(one.into_process().wait().code, Some(0));
}
