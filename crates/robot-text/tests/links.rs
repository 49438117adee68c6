//! A platform's sockets and serial lines, on loopback and a pair of pseudo terminals.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

use robot_text::links::{Endpoint, LinkEvent, Links};
use robot_text::{Kind, Message, Place, StreamId, parse};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

const PATIENCE: Duration = Duration::from_secs(10);
const ACTION: &str = "{D:B;A:x}";

fn endpoint(url: &str) -> Endpoint {
    url.parse().unwrap()
}

fn action() -> Message {
    parse(ACTION.as_bytes()).unwrap()
}

async fn next(links: &mut Links) -> LinkEvent {
    tokio::time::timeout(PATIENCE, links.next())
        .await
        .expect("an event")
}

async fn opened(links: &mut Links) -> StreamId {
    match next(links).await {
        LinkEvent::Opened { stream, .. } => stream,
        event => panic!("{event:?}"),
    }
}

async fn received(links: &mut Links) -> (Place, String) {
    match next(links).await {
        LinkEvent::Received(from, message) => (from, message.to_text().unwrap()),
        event => panic!("{event:?}"),
    }
}

fn read(mut stream: impl Read) -> String {
    let mut octets = [0; 64];
    let count = stream.read(&mut octets).unwrap();
    String::from_utf8_lossy(&octets[..count]).into_owned()
}

#[tokio::test]
async fn datagrams_come_and_go_by_the_socket_of_the_platform() {
    let mut links = Links::new();
    let bound = links.open(&endpoint("udp://127.0.0.1:0")).await.unwrap();
    let Some(Endpoint::Udp(place)) = bound else {
        panic!("{bound:?}");
    };
    let agent = UdpSocket::bind("127.0.0.1:0").unwrap();
    agent.set_read_timeout(Some(PATIENCE)).unwrap();
    agent.send_to(b"{O:A;S:up}{O:A;S:", &place).unwrap();
    let from = Place::Datagram(agent.local_addr().unwrap());
    assert_eq!(received(&mut links).await, (from, "{O:A;S:up}".to_owned()));
    let event = next(&mut links).await;
    assert!(
        matches!(event, LinkEvent::Unreadable(place, _) if place == from),
        "{event:?}"
    );

    links.write(from, &action(), Some(7));
    let event = next(&mut links).await;
    assert!(matches!(event, LinkEvent::Written(7, Ok(()))), "{event:?}");
    let mut octets = [0; 64];
    let (count, sender) = agent.recv_from(&mut octets).unwrap();
    assert_eq!(
        (&octets[..count], sender.to_string()),
        (ACTION.as_bytes(), place)
    );
}

#[tokio::test]
async fn whoever_dials_is_a_stream_until_it_ends() {
    let mut links = Links::new();
    let bound = links
        .open(&endpoint("tcp://127.0.0.1:0?listen"))
        .await
        .unwrap();
    let Some(Endpoint::TcpListen(place)) = bound else {
        panic!("{bound:?}");
    };
    let mut agent = TcpStream::connect(place).unwrap();
    let stream = opened(&mut links).await;
    agent.write_all(b"{O:A;S:").unwrap();
    agent.write_all(b"up}").unwrap();
    let expected = (Place::Stream(stream), "{O:A;S:up}".to_owned());
    assert_eq!(received(&mut links).await, expected);
    links.write(Place::Stream(stream), &action(), Some(1));
    let event = next(&mut links).await;
    assert!(matches!(event, LinkEvent::Written(1, Ok(()))), "{event:?}");
    assert_eq!(read(&agent), ACTION);
    drop(agent);
    let event = next(&mut links).await;
    assert!(
        matches!(event, LinkEvent::Closed(closed, _) if closed == stream),
        "{event:?}"
    );
}

#[tokio::test]
async fn a_stream_is_dialled_until_somebody_is_there_and_again_when_it_ends() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let dial = endpoint(&format!("tcp://{address}"));
    let mut links = Links::new();
    assert_eq!(links.open(&dial).await.unwrap(), None);
    let event = next(&mut links).await;
    assert!(
        matches!(&event, LinkEvent::Failed(failed, _) if *failed == dial),
        "{event:?}"
    );
    let listener = TcpListener::bind(address).unwrap();
    let first = loop {
        match next(&mut links).await {
            LinkEvent::Opened {
                stream,
                endpoint,
                place,
            } => {
                assert_eq!(place, dial.to_string());
                assert_eq!(endpoint, dial);
                break stream;
            }
            event => assert!(matches!(event, LinkEvent::Failed(..)), "{event:?}"),
        }
    };
    drop(listener.accept().unwrap());
    let event = next(&mut links).await;
    assert!(
        matches!(event, LinkEvent::Closed(closed, _) if closed == first),
        "{event:?}"
    );
    assert_ne!(opened(&mut links).await, first);
}

#[tokio::test]
async fn a_serial_line_carries_messages_both_ways() {
    let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let name = ptsname(&controller, Vec::new()).unwrap();
    let url = format!("serial://{}?baud=115200", name.to_str().unwrap());
    let mut links = Links::new();
    links.open(&endpoint(&url)).await.unwrap();
    let stream = opened(&mut links).await;
    let mut device = std::fs::File::from(controller);
    device.write_all(b"\r\nboot...{O:A;S:up}").unwrap();
    let expected = (Place::Stream(stream), "{O:A;S:up}".to_owned());
    assert_eq!(received(&mut links).await, expected);
    links.write(Place::Stream(stream), &action(), None);
    let text = tokio::task::spawn_blocking(move || read(&device))
        .await
        .unwrap();
    assert_eq!(text, ACTION);
}

#[tokio::test]
async fn what_cannot_be_written_is_told() {
    let mut links = Links::new();
    let nowhere = Place::Datagram("127.0.0.1:9".parse().unwrap());
    links.write(nowhere, &action(), Some(1));
    let event = next(&mut links).await;
    assert!(
        matches!(&event, LinkEvent::Written(1, Err(said)) if said.contains("no socket")),
        "{event:?}"
    );
    links.write(nowhere, &Message::new(Kind::Action, "x"), Some(2));
    let event = next(&mut links).await;
    assert!(
        matches!(&event, LinkEvent::Written(2, Err(said)) if said.contains("D")),
        "{event:?}"
    );
}

#[test]
fn endpoints_are_urls() {
    for url in [
        "udp://127.0.0.1:5000",
        "tcp://[::1]:5000",
        "tcp://robot:5000?listen",
        "serial:///dev/ttyUSB0?baud=9600",
    ] {
        assert_eq!(endpoint(url).to_string(), url);
    }
    assert_eq!(
        endpoint("serial:///dev/ttyUSB0").to_string(),
        "serial:///dev/ttyUSB0?baud=115200"
    );
    for url in [
        "",
        "udp://127.0.0.1",
        "udp://:1",
        "udp://a:1?listen",
        "tcp://a:1?dial",
        "tcp://a:99999",
        "serial://ttyUSB0",
        "serial:///dev/ttyUSB0?baud=fast",
        "http://a:1",
    ] {
        let error = url.parse::<Endpoint>().unwrap_err();
        assert!(error.to_string().contains("is no place"), "{error}");
    }
}
