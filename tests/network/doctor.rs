//! `fipa doctor` names the cause for which robots do not see each other.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use crate::support::daemon::{Daemon, Place, fipa, fipad};
use crate::support::namespace::Namespace;
use crate::support::process::run;

/// mDNS, as rules of nftables name it.
const MDNS: &str = "udp dport 5353";

/// Check and state of each.
fn verdicts(checks: &[Value]) -> Vec<(&str, &str)> {
    checks.iter().map(verdict).collect()
}

fn verdict(check: &Value) -> (&str, &str) {
    (
        check["check"].as_str().unwrap(),
        check["state"].as_str().unwrap(),
    )
}

fn said(check: &Value) -> &str {
    check["said"].as_str().unwrap()
}

#[test]
fn where_all_is_well_nothing_is_wrong_and_without_a_daemon_that_is_said() {
    let place = Place::new();
    let (one, two, _echo) = place.pair();
    // This machine may have interfaces on which nobody is let out.
    let checks = one.doctor(None, &["robot2"]);
    let others = ["interface", "multicast"];
    let other = |check: &&Value| !others.contains(&check["check"].as_str().unwrap());
    assert_eq!(checks.iter().filter(other).count(), 0, "{checks:?}");
    let ended = one.run(&["doctor", "echo@robot2"]);
    let link = |line: &&String| line.contains("the link with robot2 is open");
    assert_eq!(ended.output.iter().filter(link).count(), 1, "{ended:?}");
    drop(two);

    let nowhere = place.path("nowhere.sock");
    let words = ["doctor", "--json", "--mdns-port", "1"];
    let ended = run(fipa(&nowhere, &words));
    let first = &ended.json()[0];
    assert_eq!(first["check"], "daemon");
    assert_eq!(first["state"], "warning");
    assert!(said(first).starts_with("no daemon at "), "{first}");
}

#[test]
fn multicast_that_the_own_host_blocks_is_named() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    if !host1.block("input", MDNS) {
        return;
    }
    let place = Place::at_the_usual_port();
    let two = place.start_in(&host2, "robot2", &["--listen", "10.0.0.2:0"]);
    let options = ["--listen", "10.0.0.1:0", "--peer", two.endpoint()];
    let one = place.start_in(&host1, "robot1", &options);
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    let checks = one.doctor(Some(&host1), &[]);
    let blocked = checks.iter().filter(|check| check["state"] == "failed");
    // Over IPv6 it is blocked as well, as soon as the host has an address that it may use.
    let blocked = blocked.map(said).filter(|said| !said.starts_with("IPv6"));
    let blocked: Vec<&str> = blocked.collect();
    assert_eq!(
        blocked,
        [
            "multicast is blocked on wire: what is sent does not come back",
            "multicast is blocked on lo: what is sent does not come back"
        ]
    );
    assert!(host1.block("output", MDNS));
    let checks = one.doctor(Some(&host1), &[]);
    let start = "multicast is blocked on wire: it cannot be sent: ";
    assert!(said(&checks[0]).starts_with(start), "{checks:?}");
}

#[test]
fn multicast_that_the_network_eats_is_named() {
    let Some(hosts) = Namespace::bridged(2) else {
        return;
    };
    if !hosts[2].block("forward", MDNS) {
        return;
    }
    let place = Place::at_the_usual_port();
    let two = place.start_in(&hosts[1], "robot2", &["--listen", "0.0.0.0:0"]);
    let options = ["--listen", "0.0.0.0:0", "--peer", two.endpoint()];
    let one = place.start_in(&hosts[0], "robot1", &options);
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    let checks = one.doctor(Some(&hosts[0]), &[]);
    assert_eq!(verdicts(&checks), [("multicast", "warning")]);
    let end = ", but not heard by mDNS";
    assert!(
        said(&checks[0]).starts_with("robot2 is linked"),
        "{checks:?}"
    );
    assert!(said(&checks[0]).ends_with(end), "{checks:?}");
}

#[test]
fn a_port_that_is_blocked_is_named() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    if !host2.block("input", "tcp dport 4100") {
        return;
    }
    // Nor may the other side call.
    assert!(host2.block("output", "tcp flags syn / syn,ack"));
    let place = Place::at_the_usual_port();
    let one = place.start_in(&host1, "robot1", &["--listen", "10.0.0.1:0"]);
    let _two = place.start_in(&host2, "robot2", &["--listen", "10.0.0.2:4100"]);
    let checks = one.doctor(Some(&host1), &["robot2"]);
    assert_eq!(verdicts(&checks), [("port", "failed")], "{checks:?}");
    let start = "the port of robot2 is blocked: it is heard by mDNS, but not reached: \
                 tcp://10.0.0.2:4100: no answer";
    assert!(said(&checks[0]).starts_with(start), "{checks:?}");
}

#[test]
fn a_way_out_that_is_no_way_in_is_named() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    // Whoever calls is dropped; answers to what this host calls come through.
    if !host1.block("input", "iifname wire tcp flags syn / syn,ack") {
        return;
    }
    let place = Place::at_the_usual_port();
    let two = place.start_in(&host2, "robot2", &["--listen", "10.0.0.2:4100"]);
    let one = place.start_in(&host1, "robot1", &["--listen", "10.0.0.1:4100"]);
    let _echo = two.attach("echo", "echo@robot2");
    one.wait_for("echo@robot2");
    let checks = one.doctor(Some(&host1), &["robot2"]);
    assert_eq!(verdicts(&checks), [("port", "failed")], "{checks:?}");
    let blocked = "robot2 cannot reach this daemon at tcp://10.0.0.1:4100: no answer within 3 s";
    assert_eq!(said(&checks[0]), blocked);
    // Seen from the other side it is the port of robot1 that is blocked.
    let checks = two.doctor(Some(&host2), &["robot1"]);
    assert_eq!(verdicts(&checks), [("port", "failed")], "{checks:?}");
    let start = "the port of robot1 is blocked: ";
    assert!(said(&checks[0]).starts_with(start), "{checks:?}");
}

#[test]
fn ipv6_multicast_that_the_own_host_blocks_is_named() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    host1.add_address_v6("fd00::1");
    host2.add_address_v6("fd00::2");
    let place = Place::at_the_usual_port();
    let listen = ["--listen", "[fd00::1]:4100", "--listen", "10.0.0.1:4100"];
    let one = place.start_in(&host1, "robot1", &listen);
    assert_eq!(one.doctor(Some(&host1), &[]), [Value::Null; 0]);
    if !host1.block("input", "ip6 daddr ff02::fb") {
        return;
    }
    let checks = one.doctor(Some(&host1), &[]);
    assert_eq!(verdicts(&checks), [("multicast", "warning")], "{checks:?}");
    let blocked = "IPv6 multicast is blocked on wire: what is sent does not come back";
    assert_eq!(said(&checks[0]), blocked);
    assert!(host1.block("output", "ip6 daddr ff02::fb"));
    let checks = one.doctor(Some(&host1), &[]);
    assert_eq!(verdicts(&checks), [("multicast", "warning")], "{checks:?}");
    let start = "IPv6 multicast is blocked on wire: it cannot be sent: ";
    assert!(said(&checks[0]).starts_with(start), "{checks:?}");
}

#[test]
fn the_wrong_interface_is_named() {
    let Some((host1, host2)) = Namespace::pair() else {
        return;
    };
    host1.add_dead_end("lab", "172.16.0.1");
    let place = Place::at_the_usual_port();
    let one = place.start_in(&host1, "robot1", &["--listen", "172.16.0.1:4100"]);
    let _two = place.start_in(&host2, "robot2", &["--listen", "10.0.0.2:0"]);
    let checks = one.doctor(Some(&host1), &["robot2"]);
    assert_eq!(verdicts(&checks), [("interface", "failed")], "{checks:?}");
    let end = "; robot2 is heard there, but the daemon listens at tcp://172.16.0.1:4100 only";
    assert!(
        said(&checks[0]).starts_with("wire has 10.0.0.1"),
        "{checks:?}"
    );
    assert!(said(&checks[0]).ends_with(end), "{checks:?}");
}

#[test]
fn a_clock_that_is_off_by_an_hour_is_named() {
    let place = Place::new();
    let one = place.start_with("robot1", &["--no-mdns"]);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let late = std::thread::spawn(move || {
        let (mut caller, _) = listener.accept().unwrap();
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        let hour_ago = now - Duration::from_secs(3600);
        caller.write_all(&hello(hour_ago)).unwrap();
        // Until the caller has heard enough.
        let _ = caller.read_to_end(&mut Vec::new());
    });
    let checks = one.doctor(None, &[&address]);
    late.join().unwrap();
    let clock = checks.iter().find(|check| check["check"] == "clock");
    let clock = clock.expect("a word on the clock");
    assert_eq!(clock["state"], "failed");
    let start = format!("the clock of {address} is 36");
    assert!(said(clock).starts_with(&start), "{clock}");
    assert!(said(clock).ends_with(" s behind of ours"), "{clock}");
}

/// The first octets of a daemon called `late` whose clock shows this.
fn hello(clock: Duration) -> Vec<u8> {
    let mut body = vec![1, 0, 1, 0];
    body.extend([7; 16]);
    for text in ["late", ""] {
        body.extend(u32::try_from(text.len()).unwrap().to_be_bytes());
        body.extend(text.as_bytes());
    }
    body.extend([0; 4]);
    body.extend(1_000_000_u64.to_be_bytes());
    body.extend(i64::try_from(clock.as_millis()).unwrap().to_be_bytes());
    let length = u32::try_from(body.len()).unwrap().to_be_bytes();
    [&b"\x8fFIPA\r\n\x01"[..], &length, &body].concat()
}

#[test]
fn a_name_that_two_daemons_bear_is_named() {
    let place = Place::new();
    let mut one = place.start("robot1");
    let mut second = fipad();
    second
        .args([
            "--json",
            "--no-mdns",
            "--name",
            "robot1",
            "--peer",
            one.endpoint(),
        ])
        .arg("--control")
        .arg(place.path("second.sock"));
    let _second = Daemon::start(second);
    assert_eq!(one.event()["event"], "conflict");
    let checks = one.doctor(None, &[]);
    let double = checks.iter().find(|check| check["check"] == "duplicate");
    let double = double.expect("a word on the name");
    assert_eq!(double["state"], "failed");
    assert_eq!(said(double), "2 daemons bear the name robot1");
}

#[test]
fn a_peer_that_is_down_is_named() {
    let place = Place::new();
    let two = place.start("robot2");
    let endpoint = two.endpoint().to_owned();
    let one = place.start_with("robot1", &["--no-mdns", "--peer", &endpoint]);
    two.kill();
    let failed = |words: &[&str]| {
        let checks = one.doctor(None, words);
        let failed = checks.iter().filter(|check| check["state"] == "failed");
        let port = |check: &&Value| !said(check).starts_with("multicast");
        failed.filter(port).cloned().collect::<Vec<Value>>()
    };
    let checks = failed(&[]);
    assert_eq!(verdicts(&checks), [("port", "failed")], "{checks:?}");
    let end = format!(" is down: its host is there, but nobody listens at {endpoint}");
    assert!(said(&checks[0]).ends_with(&end), "{checks:?}");
    let checks = failed(&["robot9"]);
    assert_eq!(verdicts(&checks), [("peer", "failed")], "{checks:?}");
}
