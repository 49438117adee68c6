//! How many packets discovery costs.
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use fipa_dsd::Mdns;
use socket2::{Domain, Socket, Type};

use crate::support::{agent, config, on_loopback};

/// How long a network has to come to rest: the first questions are asked within 13 seconds, and a
/// small machine is busy for longer with fifty platforms that start at the same moment.
const SETTLED: Duration = Duration::from_secs(45);
const WINDOW: Duration = Duration::from_secs(60);
/// Agents of each platform.
const AGENTS: usize = 20;

#[test]
#[ignore = "takes four minutes"]
fn traffic_of_one_platform() {
    traffic_does_not_grow_with_agents("traffic::traffic_of_one_platform", 1);
}

#[test]
#[ignore = "takes four minutes"]
fn traffic_of_ten_platforms() {
    traffic_does_not_grow_with_agents("traffic::traffic_of_ten_platforms", 10);
}

#[test]
#[ignore = "takes four minutes, and a release build: fifty platforms are much for one machine"]
fn traffic_of_fifty_platforms() {
    traffic_does_not_grow_with_agents("traffic::traffic_of_fifty_platforms", 50);
}

fn traffic_does_not_grow_with_agents(test: &str, platforms: u8) {
    on_loopback(test, || async move {
        let bare = packets_a_minute(platforms, 0).await;
        let with_agents = packets_a_minute(platforms, AGENTS).await;
        println!(
            "{platforms} platforms: {bare} packets a minute, with {AGENTS} agents each {with_agents}"
        );
        assert!(bare > 0, "nothing was counted");
        // Two repetitions a minute of two packets each, and a few questions of the library.
        let most = 10 * usize::from(platforms);
        assert!(bare <= most && with_agents <= most);
    });
}

/// Counts what platforms with so many agents each send once they know each other.
async fn packets_a_minute(platforms: u8, agents: usize) -> usize {
    let counter = Arc::new(Counter::default());
    let tasks: Vec<_> = (1..=platforms)
        .map(|n| {
            let mut mdns = Mdns::start(config(n, &["127.0.0.1:7000"])).unwrap();
            let entries = (0..agents).map(|i| agent(&format!("agent-{i}@robot-{n}")));
            assert_eq!(mdns.set_agents(entries).announced, agents);
            tokio::spawn(async move { while mdns.next().await.is_some() {} })
        })
        .collect();
    for address in [Ipv4Addr::UNSPECIFIED.into(), Ipv6Addr::UNSPECIFIED.into()] {
        let (socket, counter) = (listen(address), Arc::clone(&counter));
        std::thread::spawn(move || counter.run(&socket));
    }
    tokio::time::sleep(SETTLED).await;
    let begun = counter.so_far();
    tokio::time::sleep(WINDOW).await;
    let ended = counter.so_far();
    counter.ended.store(true, Ordering::Relaxed);
    println!(
        "{platforms} platforms, {agents} agents each: {begun:?} to begin with, then {ended:?}"
    );
    for task in tasks {
        task.abort();
        let _ = task.await;
    }
    // The goodbyes are not counted the next time.
    tokio::time::sleep(Duration::from_secs(2)).await;
    ended.questions - begun.questions + ended.answers - begun.answers
}

#[derive(Default)]
struct Counter {
    questions: AtomicUsize,
    answers: AtomicUsize,
    ended: AtomicBool,
}

/// How many packets there were so far.
#[derive(Debug)]
struct Packets {
    questions: usize,
    answers: usize,
}

impl Counter {
    fn run(&self, socket: &UdpSocket) {
        let mut buffer = [0; 9000];
        while !self.ended.load(Ordering::Relaxed) {
            if socket.recv(&mut buffer).is_ok() {
                let kind = match buffer[2] & 0x80 {
                    0 => &self.questions,
                    _ => &self.answers,
                };
                kind.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    fn so_far(&self) -> Packets {
        Packets {
            questions: self.questions.load(Ordering::Relaxed),
            answers: self.answers.load(Ordering::Relaxed),
        }
    }
}

/// A socket that hears all mDNS of one family on loopback.
fn listen(address: IpAddr) -> UdpSocket {
    let address = SocketAddr::new(address, 5353);
    let socket = Socket::new(Domain::for_address(address), Type::DGRAM, None).unwrap();
    socket.set_reuse_address(true).unwrap();
    socket.set_reuse_port(true).unwrap();
    let loopback = 1;
    match address.is_ipv4() {
        true => socket
            .join_multicast_v4(&Ipv4Addr::new(224, 0, 0, 251), &Ipv4Addr::LOCALHOST)
            .unwrap(),
        false => {
            socket.set_only_v6(true).unwrap();
            let group = Ipv6Addr::new(0xff02, 0, 0, 0, 0, 0, 0, 0xfb);
            socket.join_multicast_v6(&group, loopback).unwrap();
        }
    }
    socket.bind(&address.into()).unwrap();
    let patience = Some(Duration::from_millis(200));
    socket.set_read_timeout(patience).unwrap();
    socket.into()
}
