//! Streams that robots of a fleet secure.

mod support;

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bytes::{Bytes, BytesMut};
use fipa_directory::Address;
use fipa_fleet::{FleetKey, Membership};
use fipa_transport::{
    Buffers, Driver, End, FirstOctet, Handle, Listener, Stream, Tls, dial, dial_secured, pump,
};
use tokio::sync::mpsc;

use self::support::careless;

const PATIENCE: Duration = Duration::from_secs(20);

fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap()
}

fn fleet() -> FleetKey {
    FleetKey::generate(now()).unwrap()
}

fn member(fleet: &FleetKey, name: &str) -> Membership {
    fleet.issue(name, 30, now(), &[], None).unwrap()
}

fn tls(membership: Membership) -> Tls {
    Tls::new(Arc::new(membership)).unwrap()
}

async fn listener() -> (Listener, Address) {
    let listener = Listener::bind(&Address::tcp("127.0.0.1", 0)).await.unwrap();
    let address = listener.address().clone();
    (listener, address)
}

/// Both ends of a stream, or why there is none.
async fn meet(caller: &Tls, called: &Tls) -> (Result<Stream, String>, Result<Stream, String>) {
    let (listener, address) = listener().await;
    let addresses = [address];
    let accepted = async {
        let stream = listener.accept().await.unwrap();
        assert_eq!(stream.first_octet().await.unwrap(), FirstOctet::Tls);
        called
            .accept(stream)
            .await
            .map_err(|error| error.to_string())
    };
    let (dialled, accepted) = tokio::join!(dial_secured(&addresses, caller), accepted);
    let dialled = dialled.map(|(stream, _)| stream);
    (dialled.map_err(|error| error.to_string()), accepted)
}

/// Gives what it has, and tells what comes and how it ends.
struct Both {
    parts: Mutex<VecDeque<Bytes>>,
    told: mpsc::UnboundedSender<Told>,
}

#[derive(Debug)]
enum Told {
    Octets(Bytes),
    Closed(String, bool),
}

impl Driver for Both {
    fn received(&self, octets: &mut BytesMut) {
        let _ = self.told.send(Told::Octets(octets.split().freeze()));
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        parts.append(&mut self.parts.lock().unwrap());
        false
    }

    fn closed(&self, end: &End, all_written: bool) {
        let _ = self.told.send(Told::Closed(end.to_string(), all_written));
    }
}

fn run(stream: Stream, parts: Vec<Bytes>) -> (Arc<Handle>, mpsc::UnboundedReceiver<Told>) {
    let (told, receiver) = mpsc::unbounded_channel();
    let handle = Arc::new(Handle::default());
    let driver = Both {
        parts: Mutex::new(parts.into()),
        told,
    };
    tokio::spawn(pump(
        stream,
        Arc::clone(&handle),
        Arc::new(Buffers::default()),
        driver,
    ));
    (handle, receiver)
}

/// Everything until the end, and how it ended.
async fn all(mut told: mpsc::UnboundedReceiver<Told>) -> (Vec<u8>, String, bool) {
    let mut octets = Vec::new();
    loop {
        match tokio::time::timeout(PATIENCE, told.recv())
            .await
            .unwrap()
            .unwrap()
        {
            Told::Octets(more) => octets.extend_from_slice(&more),
            Told::Closed(reason, all_written) => return (octets, reason, all_written),
        }
    }
}

#[tokio::test]
async fn robots_of_a_fleet_meet_and_know_whom_they_met() {
    let fleet = fleet();
    let (one, two) = (tls(member(&fleet, "robot1")), tls(member(&fleet, "robot2")));
    let (dialled, accepted) = meet(&one, &two).await;
    let (dialled, accepted) = (dialled.unwrap(), accepted.unwrap());
    assert_eq!(dialled.identity(), Some("robot2"));
    assert_eq!(accepted.identity(), Some("robot1"));
    assert!(dialled.same_host());
    assert!(dialled.remote().starts_with("tcp://127.0.0.1:"));
}

#[tokio::test]
async fn much_goes_both_ways_at_once_and_the_end_is_an_end() {
    let fleet = fleet();
    let (one, two) = (tls(member(&fleet, "robot1")), tls(member(&fleet, "robot2")));
    let (dialled, accepted) = meet(&one, &two).await;
    let much =
        |seed: u8| -> Vec<u8> { (0..5_000_000_u32).map(|i| (i / 251) as u8 ^ seed).collect() };
    let (from_one, from_two) = (much(1), much(2));
    let parts = |octets: &[u8]| octets.chunks(70_001).map(Bytes::copy_from_slice).collect();
    let (one, told_one) = run(dialled.unwrap(), parts(&from_one));
    let (_two, mut told_two) = run(accepted.unwrap(), parts(&from_two));
    let mut octets = Vec::new();
    while octets.len() < from_one.len() {
        match tokio::time::timeout(PATIENCE, told_two.recv())
            .await
            .unwrap()
            .unwrap()
        {
            Told::Octets(more) => octets.extend_from_slice(&more),
            other => panic!("{other:?}"),
        }
    }
    assert!(octets == from_one);
    one.finish();
    let (rest, reason, _) = all(told_two).await;
    assert!(rest.is_empty());
    assert_eq!(reason, "the other side closed the connection");
    let (_, reason, all_written) = all(told_one).await;
    assert_eq!((reason.as_str(), all_written), ("closed", true));
}

#[tokio::test]
async fn a_stranger_is_refused_by_both_sides() {
    let (one, stranger) = (
        tls(member(&fleet(), "robot1")),
        tls(member(&fleet(), "robot2")),
    );
    let (dialled, accepted) = meet(&stranger, &one).await;
    let wrong = "it is not of this fleet: another key made its certificate";
    assert!(
        dialled.unwrap_err().ends_with(wrong),
        "the caller sees it first"
    );
    let told = accepted.unwrap_err();
    assert_eq!(
        told,
        "the other side does not accept our certificate: it is of another fleet"
    );
}

/// A caller who takes any certificate, as a stranger would: it shows its own, or none.
async fn call_carelessly(called: &Tls, caller: Option<&Membership>) -> String {
    let (listener, address) = listener().await;
    let Address::Tcp { port, .. } = address else {
        unreachable!("it was bound so");
    };
    let caller = careless::config(caller);
    let calling = tokio::task::spawn_blocking(move || careless::call(port, caller));
    let stream = listener.accept().await.unwrap();
    let accepted = called
        .accept(stream)
        .await
        .map_err(|error| error.to_string());
    calling.await.unwrap();
    accepted.expect_err("a stranger was let in")
}

#[tokio::test]
async fn whoever_has_no_good_certificate_is_told_why() {
    let fleet = fleet();
    let day = Duration::from_secs(24 * 3600);
    let one = member(&fleet, "robot1");
    let two = member(&fleet, "robot2");
    let late = fleet
        .issue("robot2", 1, now() - day * 9, &[], None)
        .unwrap();
    let early = fleet
        .issue("robot2", 9, now() + day * 9, &[], None)
        .unwrap();
    let wrong = member(&self::fleet(), "robot2");
    let revoked = fleet
        .revoke(&[two.certificate().clone()], None, now())
        .unwrap();
    one.learn(revoked.der()).unwrap();
    let one = tls(one);
    for (shown, said) in [
        (None, "it has no key: it showed no certificate"),
        (
            Some(&wrong),
            "it is not of this fleet: another key made its certificate",
        ),
        (Some(&late), "the certificate of robot2 expired at"),
        (Some(&early), "the certificate of robot2 is valid from"),
        (Some(&two), "the certificate of robot2 is revoked"),
    ] {
        let told = call_carelessly(&one, shown).await;
        assert!(told.starts_with(said), "{told}");
    }
}

#[tokio::test]
async fn a_certificate_without_its_key_opens_nothing() {
    let fleet = fleet();
    let (one, two) = (member(&fleet, "robot1"), member(&fleet, "robot2"));
    let other = member(&fleet, "robot3");
    let (listener, address) = listener().await;
    let Address::Tcp { port, .. } = address else {
        unreachable!("it was bound so");
    };
    let caller = careless::config_with(two.certificate().der(), other.private_key());
    let calling = tokio::task::spawn_blocking(move || careless::call(port, caller));
    let stream = listener.accept().await.unwrap();
    let refused = tls(one).accept(stream).await.unwrap_err().to_string();
    calling.await.unwrap();
    assert_eq!(
        refused,
        "it does not have the key of the certificate that it showed"
    );
}

#[tokio::test]
async fn a_recorded_handshake_opens_nothing() {
    let fleet = fleet();
    let (one, two) = (tls(member(&fleet, "robot1")), tls(member(&fleet, "robot2")));
    let (listener, address) = listener().await;
    let Address::Tcp { port, .. } = address else {
        unreachable!("it was bound so");
    };
    // Somebody between them records what the caller writes.
    let between = TcpListener::bind("127.0.0.1:0").unwrap();
    let addresses = [Address::tcp(
        "127.0.0.1",
        between.local_addr().unwrap().port(),
    )];
    let recording = tokio::task::spawn_blocking(move || record(&between, port));
    let accepted = async { two.accept(listener.accept().await.unwrap()).await };
    let (dialled, accepted) = tokio::join!(dial_secured(&addresses, &one), accepted);
    assert_eq!(accepted.unwrap().identity(), Some("robot1"));
    drop(dialled);
    let recorded = recording.await.unwrap();
    assert!(recorded.len() > 500, "{}", recorded.len());

    let replaying = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream.write_all(&recorded).unwrap();
        io::copy(&mut stream, &mut io::sink())
    });
    let refused = two
        .accept(listener.accept().await.unwrap())
        .await
        .unwrap_err();
    assert!(
        refused.to_string().contains("it is a recording"),
        "{refused}"
    );
    let _ = replaying.await.unwrap();
}

/// Passes on what both sides write, until one of them ends; what the caller wrote.
fn record(between: &TcpListener, port: u16) -> Vec<u8> {
    let (mut caller, _) = between.accept().unwrap();
    let mut called = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let (mut back, mut from) = (caller.try_clone().unwrap(), called.try_clone().unwrap());
    std::thread::spawn(move || io::copy(&mut from, &mut back));
    let mut recorded = Vec::new();
    let mut chunk = [0; 4096];
    while let Ok(octets @ 1..) = caller.read(&mut chunk) {
        recorded.extend_from_slice(&chunk[..octets]);
        if called.write_all(&chunk[..octets]).is_err() {
            break;
        }
    }
    recorded
}

#[tokio::test]
async fn a_stream_that_is_cut_off_did_not_end() {
    let fleet = fleet();
    let (one, two) = (tls(member(&fleet, "robot1")), tls(member(&fleet, "robot2")));
    let (dialled, accepted) = meet(&one, &two).await;
    let (_two, told) = run(accepted.unwrap(), Vec::new());
    drop(dialled);
    let (_, reason, _) = all(told).await;
    assert!(reason.starts_with("the connection was cut off"), "{reason}");
}

#[tokio::test]
async fn who_does_not_speak_tls_is_told_from_who_does() {
    let one = tls(member(&fleet(), "robot1"));
    let (listener, address) = listener().await;
    let addresses = [address.clone()];
    let (dialled, accepted) = tokio::join!(dial(&addresses), listener.accept());
    let (_quiet, loud) = (dialled.unwrap(), accepted.unwrap());
    drop(loud);
    let Address::Tcp { port, .. } = address else {
        unreachable!("it was bound so");
    };
    let mut plain = TcpStream::connect(("127.0.0.1", port)).unwrap();
    plain.write_all(b"\x8fFIPA").unwrap();
    let accepted = listener.accept().await.unwrap();
    assert_eq!(accepted.first_octet().await.unwrap(), FirstOctet::Other);

    let plain = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = plain.local_addr().unwrap().port();
    std::thread::spawn(move || {
        let (mut stream, _) = plain.accept().unwrap();
        stream.write_all(b"\x8fFIPA\r\n\x01 and so on").unwrap();
        io::copy(&mut stream, &mut io::sink())
    });
    let addresses = [Address::tcp("127.0.0.1", port)];
    let refused = dial_secured(&addresses, &one)
        .await
        .unwrap_err()
        .to_string();
    assert!(refused.contains("it does not speak TLS"), "{refused}");
}
