//! Stations on loopback and on a pseudo terminal.

use std::io::{Read, Write};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hiac::links::{Endpoint, Node, NodeEvent, Watcher};
use hiac::station::{Event, Options, Role, StationConfig, Workgroup};
use hiac::{Content, Mask, Packet, PacketType, edcp};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

const PATIENCE: Duration = Duration::from_secs(10);

fn employer() -> StationConfig {
    let address = "20:C4:D2:00".parse().unwrap();
    StationConfig {
        address: Some(address),
        workgroups: vec![Workgroup {
            address,
            mask: Mask::new(0xFF).unwrap(),
        }],
        ..StationConfig::default()
    }
}

/// The next thing that the station of a node tells.
async fn event(node: &mut Node) -> Event {
    let told = async {
        loop {
            if let NodeEvent::Station(event) = node.next().await {
                return event;
            }
        }
    };
    tokio::time::timeout(PATIENCE, told)
        .await
        .expect("an event")
}

#[tokio::test]
async fn an_employer_that_listens_and_a_device_that_dials_talk_and_meet_again() {
    let mut employer = Node::new(employer());
    let listen: Endpoint = "tcp://127.0.0.1:0?listen".parse().unwrap();
    let bound = employer.open(&listen).await.unwrap().unwrap();
    let mut device = Node::new(StationConfig::default());
    let dial = bound.to_string().replace("?listen", "?role=employee");
    device
        .open(&dial.parse::<Endpoint>().unwrap())
        .await
        .unwrap();
    for _ in 0..2 {
        let (one, other) = tokio::join!(event(&mut employer), event(&mut device));
        let Event::Connected { partner, .. } = one else {
            panic!("{one:?}");
        };
        assert!(matches!(
            other,
            Event::Connected {
                role: Role::Employee,
                ..
            }
        ));
        let signal = Content::Signal {
            number: 3,
            arguments: &[0xF9],
        };
        let now = employer.now();
        let sent = employer
            .station()
            .send(now, None, partner, &signal, Options::CONFIRMED);
        let ticket = sent.unwrap();
        let both = async {
            assert_eq!(event(&mut employer).await, Event::Written(ticket));
            assert_eq!(event(&mut employer).await, Event::Confirmed(ticket));
        };
        let (heard, ()) = tokio::join!(event(&mut device), both);
        assert!(matches!(heard, Event::Signal { number: 3, .. }));
        // The device dials again once its stream has ended.
        drop(std::mem::replace(
            &mut employer,
            Node::new(self::employer()),
        ));
        assert!(matches!(
            event(&mut device).await,
            Event::Disconnected { .. }
        ));
        employer.open(&bound).await.expect("the port is free again");
    }
}

/// What passed, while that is wanted.
#[derive(Clone, Debug, Default)]
struct Watch(Arc<Mutex<(bool, Vec<Shown>)>>);

type Shown = (bool, String, PacketType, Option<Mask>);

impl Watcher for Watch {
    fn is_watching(&self) -> bool {
        self.0.lock().unwrap().0
    }

    fn passed(&mut self, incoming: bool, place: &str, packet: edcp::Event<'_>, mask: Option<Mask>) {
        if let edcp::Event::Packet(octets) = packet {
            let kind = Packet::decode(octets, mask).unwrap().kind;
            let shown = (incoming, place.to_owned(), kind, mask);
            self.0.lock().unwrap().1.push(shown);
        }
    }
}

#[tokio::test]
async fn who_watches_is_shown_both_directions_and_only_while_it_wants() {
    let mut employer = Node::new(employer());
    let watch = Watch::default();
    employer.set_watcher(Box::new(watch.clone()));
    let listen: Endpoint = "tcp://127.0.0.1:0?listen".parse().unwrap();
    let bound = employer.open(&listen).await.unwrap().unwrap();
    let dial = bound.to_string().replace("?listen", "?role=employee");
    let mut device = Node::new(StationConfig::default());
    device
        .open(&dial.parse::<Endpoint>().unwrap())
        .await
        .unwrap();
    let (connected, _) = tokio::join!(event(&mut employer), event(&mut device));
    let Event::Connected { partner, .. } = connected else {
        panic!("{connected:?}");
    };
    assert_eq!(watch.0.lock().unwrap().1, []);
    watch.0.lock().unwrap().0 = true;
    let signal = Content::Signal {
        number: 3,
        arguments: &[0xF9],
    };
    let now = employer.now();
    let sent = employer
        .station()
        .send(now, None, partner, &signal, Options::CONFIRMED);
    let ticket = sent.unwrap();
    let both = async { while event(&mut employer).await != Event::Confirmed(ticket) {} };
    tokio::join!(event(&mut device), both);
    let shown = std::mem::take(&mut watch.0.lock().unwrap().1);
    let [out, back] = &shown[..] else {
        panic!("{shown:?}");
    };
    assert_eq!((out.0, out.2), (false, PacketType::SIG));
    assert_eq!((back.0, back.2), (true, PacketType::SYS));
    assert_eq!((&out.1, out.3), (&back.1, Mask::new(0xFF).ok()));
    assert!(out.1.starts_with("tcp://127.0.0.1:"), "{}", out.1);
}

#[tokio::test]
async fn a_serial_line_carries_packets_and_stays_when_nobody_answers() {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let url = format!("serial://{}?address=20:C4:D2:05", name.to_str().unwrap());
    let mut node = Node::new(employer());
    let endpoint: Endpoint = url.parse().unwrap();
    assert_eq!(endpoint.to_string(), url.replace('?', "?baud=115200&"));
    node.open(&endpoint).await.unwrap();
    assert!(matches!(node.next().await, NodeEvent::Opened(_)));
    let mut line = std::fs::File::from(master);
    // It is called every second until it answers.
    let reader = tokio::task::spawn_blocking(move || {
        let mut incon = [0; 2 * 48];
        line.read_exact(&mut incon).unwrap();
        assert_eq!(incon[..48], incon[48..]);
        line.write_all(&ACCON).unwrap();
        (line, incon)
    });
    let connected = event(&mut node).await;
    assert!(
        matches!(connected, Event::Connected { .. }),
        "{connected:?}"
    );
    let (line, incon) = reader.await.unwrap();
    assert_eq!(incon[..4], [0xF8, 0x1E, 0x01, 0x20]);
    assert!(matches!(event(&mut node).await, Event::Disconnected { .. }));
    drop(line);
}

const ACCON: [u8; 56] = [
    0xF8, 0x1E, 0x01, 0x20, 0xC4, 0xD2, 0x00, 0x20, 0xC4, 0xD2, 0x05, 0x28, 0x03, 0x01, 0x04, 0x20,
    0xC4, 0xD2, 0x05, 0x02, 0x04, 0x00, 0x00, 0x00, 0xFC, 0xCF, 0x03, 0x02, 0x03, 0xE8, 0x04, 0x04,
    0x00, 0x00, 0x00, 0x40, 0x05, 0x01, 0x03, 0x06, 0x02, 0x40, 0x0A, 0x07, 0x01, 0x02, 0x0A, 0x05,
    0x64, 0x72, 0x69, 0x76, 0x65, 0x46, 0xF9, 0xF8,
];
