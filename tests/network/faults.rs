//! Daemons under load that are killed, and links that stall, break and are changed on their way: no
//! letter comes twice, and what senders are told is true.
//!
//! A long run: `cargo test --test network faults -- --ignored`.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

use crate::load::Load;
use crate::support::daemon::{Daemon, Place};
use crate::support::namespace::Namespace;

/// Seconds of the usual test, and of the long one.
const SHORT: u64 = 7;
const LONG: u64 = 120;

#[test]
fn no_letter_is_lost_or_comes_twice_while_daemons_are_killed() {
    kill_daemons(Duration::from_secs(SHORT));
}

#[test]
#[ignore = "takes two minutes"]
fn no_letter_is_lost_or_comes_twice_while_daemons_are_killed_for_two_minutes() {
    kill_daemons(Duration::from_secs(LONG));
}

fn kill_daemons(span: Duration) {
    let place = Place::new();
    let start = |n: usize| {
        let name = format!("robot{}", n + 1);
        let state = place.path(&format!("{name}.state")).display().to_string();
        place.start_with(&name, &["--state", &state])
    };
    let mut daemons: Vec<Option<Daemon>> = (0..3).map(|n| Some(start(n))).collect();
    let controls = daemons.iter().flatten().map(|d| d.control.clone());
    let controls: Vec<_> = controls.collect();
    let controls: Vec<_> = controls.iter().map(AsRef::as_ref).collect();
    let until = Instant::now() + span;
    let load = Load::begin(&controls, until);
    let mut random = fastrand::Rng::with_seed(7);
    let mut kills = 0;
    while Instant::now() < until {
        sleep(Duration::from_millis(random.u64(100..1500)));
        let n = random.usize(0..daemons.len());
        daemons[n].take().unwrap().kill();
        kills += 1;
        sleep(Duration::from_millis(random.u64(100..3500)));
        daemons[n] = Some(start(n));
    }
    let counts = load.check();
    println!("{kills} kills, {counts:?}");
    assert!(
        counts["delivered"] > 0 && counts["stored"] > 0,
        "{counts:?}"
    );
}

#[test]
fn no_letter_is_lost_or_changed_while_a_proxy_stalls_cuts_and_corrupts() {
    disturb_links(Duration::from_secs(SHORT));
}

#[test]
#[ignore = "takes two minutes"]
fn no_letter_is_lost_or_changed_while_a_proxy_disturbs_for_two_minutes() {
    disturb_links(Duration::from_secs(LONG));
}

/// Two daemons that reach each other through a proxy alone: each is on a host of its own, without
/// any wire.
fn disturb_links(span: Duration) {
    let (Some(here), Some(there)) = (Namespace::new(), Namespace::new()) else {
        return;
    };
    let place = Place::new();
    let state = |name: &str| place.path(&format!("{name}.state")).display().to_string();
    let one = ["--no-mdns", "--state", &state("robot1")];
    let one = place.start_in(&here, "robot1", &one);
    let endpoint = one.endpoint().trim_start_matches("tcp://").to_owned();
    let listener = there.run_inside(|| TcpListener::bind("127.0.0.1:0").unwrap());
    let peer = format!("tcp://{}", listener.local_addr().unwrap());
    spawn(move || proxy(&listener, &here, &endpoint));
    let two = ["--no-mdns", "--state", &state("robot2"), "--peer", &peer];
    let two = place.start_in(&there, "robot2", &two);
    let load = Load::begin(&[&one.control, &two.control], Instant::now() + span);
    let counts = load.check();
    let faults = [&STALLS, &CUTS, &CHANGES].map(|count| count.load(Ordering::Relaxed));
    println!("stalls, cuts, changes: {faults:?}; {counts:?}");
    assert!(counts["delivered"] > 0 && faults.iter().all(|count| *count > 0));
}

/// What the proxy has done.
static STALLS: AtomicUsize = AtomicUsize::new(0);
static CUTS: AtomicUsize = AtomicUsize::new(0);
static CHANGES: AtomicUsize = AtomicUsize::new(0);

/// Passes on what comes, and disturbs it. The load ends and the faults go on: whatever is stored
/// gets through between them.
fn proxy(listener: &TcpListener, host: &Namespace, endpoint: &str) {
    for (number, caller) in (0..).zip(listener.incoming()) {
        let Ok(caller) = caller else {
            continue;
        };
        let Ok(called) = host.run_inside(|| TcpStream::connect(endpoint)) else {
            continue;
        };
        let ways = [
            (caller.try_clone().unwrap(), called.try_clone().unwrap()),
            (called, caller),
        ];
        for (way, (from, to)) in (0..).zip(ways) {
            spawn(move || pass(from, to, fastrand::Rng::with_seed(2 * number + way)));
        }
    }
}

/// One direction of a connection, until it ends.
fn pass(mut from: TcpStream, mut to: TcpStream, mut random: fastrand::Rng) {
    let mut octets = vec![0; 16 << 10];
    let mut next = pause(&mut random);
    while let Ok(count @ 1..) = from.read(&mut octets) {
        if Instant::now() >= next {
            next = pause(&mut random);
            let fault = match random.u8(0..5) {
                0 | 1 => &STALLS,
                2 => &CUTS,
                _ => &CHANGES,
            };
            fault.fetch_add(1, Ordering::Relaxed);
            if std::ptr::eq(fault, &STALLS) {
                sleep(Duration::from_millis(random.u64(100..4000)));
            } else if std::ptr::eq(fault, &CUTS) {
                break;
            } else {
                octets[random.usize(0..count)] ^= 1 << random.u8(0..8);
            }
        }
        if to.write_all(&octets[..count]).is_err() {
            break;
        }
    }
    // It may have ended by itself.
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}

/// When the next fault is due.
fn pause(random: &mut fastrand::Rng) -> Instant {
    Instant::now() + Duration::from_millis(random.u64(50..1500))
}
