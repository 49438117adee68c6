//! A transport that a program plugs in: here one letter a datagram.

use std::io;
use std::net::UdpSocket;
use std::sync::Arc;
use std::time::Duration;

use fipa::prelude::*;
use fipa::{Error, LetterInbox, LetterListener, LetterTransport, PlatformBuilder, PostFailure};

const PATIENCE: Duration = Duration::from_secs(10);

/// A port at which the transport fails as none should.
const BROKEN: u16 = 1;

#[derive(Debug)]
struct Datagrams;

impl LetterTransport for Datagrams {
    fn scheme(&self) -> &'static str {
        "datagram"
    }

    fn bind(&self, host: &str, port: u16) -> io::Result<Box<dyn LetterListener>> {
        let socket = UdpSocket::bind((host, port))?;
        socket.set_read_timeout(Some(Duration::from_millis(20)))?;
        Ok(Box::new(Socket(socket)))
    }

    fn send(&self, host: &str, port: u16, letter: &[u8], _: Duration) -> Result<(), PostFailure> {
        assert_ne!(port, BROKEN);
        if letter.len() > 60_000 {
            let reason = "it is too long for a datagram".to_owned();
            return Err(PostFailure::Refused(reason));
        }
        let sent = UdpSocket::bind("127.0.0.1:0").and_then(|own| own.send_to(letter, (host, port)));
        sent.map(drop)
            .map_err(|error| PostFailure::Unreached(error.to_string()))
    }
}

struct Socket(UdpSocket);

impl LetterListener for Socket {
    fn port(&self) -> u16 {
        self.0.local_addr().unwrap().port()
    }

    fn serve(self: Box<Self>, inbox: LetterInbox) {
        let mut letter = vec![0; 65_536];
        while inbox.is_open() {
            if let Ok((octets, from)) = self.0.recv_from(&mut letter) {
                inbox.put(from, letter[..octets].to_vec().into());
            }
        }
    }
}

fn platform(name: &str) -> PlatformBuilder {
    Platform::builder()
        .name(name)
        .mdns(false)
        .listen("tcp://127.0.0.1:0")
}

async fn plugged(name: &str) -> Platform {
    let builder = platform(name).transport(Arc::new(Datagrams));
    let builder = builder.listen("datagram://127.0.0.1:0");
    builder.start().await.unwrap()
}

async fn send(from: &Agent, address: &str, content: impl Into<bytes::Bytes>) -> ReceiverOutcome {
    let to = AgentId::new("drive@robot2").address(address.to_owned());
    let letter = Message::new(Performative::Inform).to(to).content(content);
    from.send_within(letter, PATIENCE).await.remove(0)
}

#[tokio::test]
async fn letters_go_and_come_by_a_transport_that_is_plugged_in() {
    let (one, two) = (plugged("robot1").await, plugged("robot2").await);
    let arm = one.agent("arm@robot1").await.unwrap();
    let drive = two.agent("drive@robot2").await.unwrap();
    let address = two.endpoints()[1].to_string();
    assert!(address.starts_with("datagram://127.0.0.1:"), "{address}");
    for number in 0..10 {
        let told = send(&arm, &address, format!("letter {number}")).await;
        assert_eq!(told.outcome, Outcome::Sent, "{told:?}");
        assert_eq!(told.via.as_deref(), Some(address.as_str()));
        let letter = tokio::time::timeout(PATIENCE, drive.receive()).await;
        let message = letter.unwrap().unwrap();
        assert_eq!(message.content_str(), Some(&*format!("letter {number}")));
    }
    let locations = &two.search("drive@robot2").unwrap()[0].entry.locations;
    assert_eq!(locations[1].address, address.as_str());
}

#[tokio::test]
async fn what_the_transport_says_is_what_the_sender_is_told() {
    let one = plugged("robot1").await;
    let arm = one.agent("arm@robot1").await.unwrap();
    let told = send(&arm, "datagram://127.0.0.1:9", vec![b'x'; 70_000]).await;
    assert_eq!(told.outcome, Outcome::Refused);
    assert!(
        told.reason.ends_with("it is too long for a datagram"),
        "{told:?}"
    );
    let told = send(&arm, &format!("datagram://127.0.0.1:{BROKEN}"), "hello").await;
    assert_eq!(told.outcome, Outcome::Timeout);
    assert!(told.reason.contains("the transport failed"), "{told:?}");
}

#[tokio::test]
async fn the_endpoint_goes_with_the_platform() {
    let platform = plugged("robot1").await;
    let endpoint = platform.endpoints()[1].to_string();
    let place = endpoint.trim_start_matches("datagram://").to_owned();
    assert!(UdpSocket::bind(&place).is_err());
    platform.shutdown().await;
    let until = std::time::Instant::now() + PATIENCE;
    while UdpSocket::bind(&place).is_err() {
        assert!(std::time::Instant::now() < until);
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test]
async fn a_transport_that_is_not_plugged_in_and_a_peer_that_is_no_link_are_told_at_once() {
    let without = platform("robot1").listen("datagram://127.0.0.1:0");
    let no_link = platform("robot1")
        .transport(Arc::new(Datagrams))
        .peer("datagram://127.0.0.1:4100");
    for builder in [without, no_link] {
        let Err(error @ Error::Address(_)) = builder.start().await else {
            panic!("it has started");
        };
        assert!(error.to_string().contains("datagram://"), "{error}");
    }
}
