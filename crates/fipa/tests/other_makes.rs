//! Over real sockets with programs that write one letter a connection, as `fipa_services` does.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

use fipa::Outcome;
use fipa::prelude::*;
use fipa_acl::{AgentId, Letter};
use fipa_codec::{Limits, decode_letter, decode_payload};

const PATIENCE: Duration = Duration::from_secs(10);

async fn robot() -> Platform {
    let builder = Platform::builder().name("here").mdns(false);
    builder.start().await.unwrap()
}

/// Reads so many connections to their ends, after a while each.
fn reader(connections: usize, pause: Duration) -> (String, JoinHandle<Vec<Vec<u8>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let reading = std::thread::spawn(move || {
        let read = |_| {
            let (mut stream, _) = listener.accept().unwrap();
            std::thread::sleep(pause);
            let mut octets = Vec::new();
            stream.read_to_end(&mut octets).unwrap();
            octets
        };
        (0..connections).map(read).collect()
    });
    (address, reading)
}

fn read(octets: Vec<u8>) -> (Letter, Message) {
    let limits = Limits::default();
    let letter = decode_letter(&octets.into(), &limits).unwrap();
    let message = decode_payload(&letter.envelope, &letter.payload, &limits).unwrap();
    (letter, message)
}

fn to(name: &str, address: &str, content: impl Into<bytes::Bytes>) -> Message {
    let mut message = Message::new(Performative::Inform).content(content.into());
    message.receiver.push(AgentId::new(name).address(address));
    message
}

#[tokio::test]
async fn a_recorded_letter_written_by_a_plain_socket_is_received() {
    let platform = robot().await;
    let agent = platform.agent("agent-b").await.unwrap();
    let octets = include_bytes!("../../../tests/vectors/mts/sent_00_to_agent-b.bin");
    let endpoint = platform.endpoints()[0].to_string();
    let address = endpoint.trim_start_matches("tcp://").to_owned();
    let writing = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(address).unwrap();
        for part in octets.chunks(100) {
            stream.write_all(part).unwrap();
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let received = tokio::time::timeout(PATIENCE, agent.receive_letter()).await;
    let (letter, message) = received.expect("a letter in time").unwrap();
    let message = message.unwrap();
    assert_eq!(message.content_str(), Some("one remote"));
    assert_eq!(message.sender, Some("agent-a".into()));
    let stamps: Vec<_> = letter.envelope.stamps().map(|s| s.by.to_string()).collect();
    assert_eq!(stamps.first().map(String::as_str), Some("mts-0"));
    assert_eq!(stamps.last().map(String::as_str), Some("here"));
    writing.await.unwrap();
}

#[tokio::test]
async fn a_plain_socket_that_reads_to_the_end_gets_letters_after_one_greeting() {
    let platform = robot().await;
    let agent = platform.agent("agent-a").await.unwrap();
    let (address, reading) = reader(3, Duration::ZERO);
    for content in ["first", "second"] {
        let outcomes = agent.send(to("agent-b", &address, content)).await;
        assert_eq!(outcomes[0].outcome, Outcome::Sent, "{outcomes:?}");
        assert_eq!(outcomes[0].via.as_deref(), Some(address.as_str()));
    }
    let mut connections = reading.join().unwrap().into_iter();
    let greeting = connections.next().unwrap();
    assert!(greeting.starts_with(b"\x8fFIPA"));
    for (octets, content) in connections.zip(["first", "second"]) {
        let (letter, message) = read(octets);
        assert_eq!(message.content_str(), Some(content));
        let receiver = &letter.envelope.intended_receiver()[0];
        assert_eq!(receiver.name, "agent-b");
    }
}

#[tokio::test]
async fn a_plain_socket_that_reads_late_gets_a_large_letter_whole() {
    let platform = robot().await;
    let agent = platform.agent("agent-a").await.unwrap();
    let (address, reading) = reader(2, Duration::from_millis(1500));
    let content = vec![b'x'; 20_000_000];
    let outcomes = agent.send(to("agent-b", &address, content.clone())).await;
    assert_eq!(outcomes[0].outcome, Outcome::Sent, "{outcomes:?}");
    let (_, message) = read(reading.join().unwrap().remove(1));
    assert!(message.content.is_some_and(|octets| octets == content));
}
