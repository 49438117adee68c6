//! Letters to and from a C++ program that knows nothing but libudt.

mod support;

use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use fipa_udt::{Connection, Listener, MAX_LETTER};

use support::{PATIENCE, Running, compiled, recordings};

#[test]
fn recorded_letters_of_a_cpp_sender_arrive_whole_and_in_order() {
    let listener = Listener::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let files = recordings();
    let child = Command::new(compiled("sender"))
        .args(["send", &port.to_string()])
        .args(&files)
        .spawn()
        .unwrap();
    let _running = Running(child);
    let caller = listener.accept(PATIENCE).unwrap().expect("a caller");
    assert_eq!(caller.peer_addr().unwrap().ip(), &Ipv4Addr::LOCALHOST);
    for file in files {
        let letter = caller.receive(PATIENCE).unwrap().expect("a letter");
        assert_eq!(letter, std::fs::read(file).unwrap());
    }
}

#[test]
fn letters_of_every_size_reach_a_cpp_receiver() {
    let letters: Vec<Vec<u8>> = [1, 1_456, 1_457, 100_000, 5_000_000]
        .into_iter()
        .map(|octets| (0..octets).map(|i| (i * 7 % 251) as u8).collect())
        .collect();
    let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("received");
    let mut child = Command::new(compiled("receiver"))
        .args(["receive", &letters.len().to_string()])
        .arg(&prefix)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let _running = Running(child);
    let mut number = || lines.next().unwrap().unwrap().parse::<usize>().unwrap();
    let port = u16::try_from(number()).unwrap();
    let peer = Connection::connect(SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)).unwrap();
    for (index, letter) in letters.iter().enumerate() {
        peer.send(letter, PATIENCE).unwrap();
        assert_eq!(number(), letter.len());
        let received = std::fs::read(format!("{}{index}", prefix.display())).unwrap();
        assert!(received == *letter, "letter {index} differs");
    }
}

#[test]
fn a_wait_ends_when_nobody_calls_and_nothing_comes() {
    let short = Duration::from_millis(50);
    let listener = Listener::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    assert!(listener.accept(short).unwrap().is_none());
    let caller = Connection::connect(listener.local_addr().unwrap()).unwrap();
    let called = listener.accept(PATIENCE).unwrap().expect("a caller");
    assert_eq!(called.receive(short), Ok(None));
    called.send(b"back", PATIENCE).unwrap();
    assert_eq!(
        caller.receive(PATIENCE).unwrap().as_deref(),
        Some(&b"back"[..])
    );
}

#[test]
fn the_end_of_a_connection_is_an_error_for_who_waits() {
    let listener = Listener::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    let caller = Connection::connect(listener.local_addr().unwrap()).unwrap();
    let called = listener.accept(PATIENCE).unwrap().expect("a caller");
    drop(caller);
    let error = called.receive(PATIENCE).unwrap_err();
    assert_eq!(error.to_string(), "cannot receive: Connection was broken");
}

#[test]
fn what_cannot_work_is_an_error_at_once() {
    let listener = Listener::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let caller = Connection::connect(address).unwrap();
    for letter in [&[][..], &vec![0; MAX_LETTER + 1]] {
        let error = caller.send(letter, PATIENCE).unwrap_err();
        assert!(
            error.to_string().contains("1 to 10000000 octets"),
            "{error}"
        );
    }
    let nobody = Connection::connect(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9)).unwrap_err();
    assert!(
        nobody.to_string().starts_with("cannot connect: "),
        "{nobody}"
    );
    assert_ne!(nobody.code(), 0);
}
