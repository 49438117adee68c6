//! Letters over HTTP between two platforms, through a network that cuts connections.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use fipa::Outcome;
use fipa::prelude::*;
use fipa_acl::AgentId;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

const LETTERS: usize = 3000;

async fn robot(name: &'static str) -> Platform {
    let builder = Platform::builder().name(name).mdns(false);
    let builder = builder.http("127.0.0.1:0", "/acc");
    builder.start().await.unwrap()
}

/// Passes connections on, and cuts each in both directions after some octets, now and then not.
async fn cutting(to: SocketAddr, cut: Arc<AtomicUsize>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        let mut random = fastrand::Rng::with_seed(7);
        while let Ok((client, _)) = listener.accept().await {
            let octets = random.usize(500..60_000);
            let server = TcpStream::connect(to).await.unwrap();
            let cut = Arc::clone(&cut);
            tokio::spawn(async move {
                pass(client, server, octets).await;
                cut.fetch_add(1, Ordering::Relaxed);
            });
        }
    });
    address
}

/// Ends with one of both, or when so many octets were passed to the server.
async fn pass(mut client: TcpStream, mut server: TcpStream, mut left: usize) {
    let (mut from_client, mut to_client) = client.split();
    let (mut from_server, mut to_server) = server.split();
    let there = async {
        let mut octets = [0; 4096];
        while left > 0 {
            let most = left.min(octets.len());
            let Ok(read @ 1..) = from_client.read(&mut octets[..most]).await else {
                return;
            };
            left -= read;
            if to_server.write_all(&octets[..read]).await.is_err() {
                return;
            }
        }
    };
    tokio::select! {
        () = there => {}
        _ = tokio::io::copy(&mut from_server, &mut to_client) => {}
    }
}

#[tokio::test]
async fn through_a_network_that_cuts_connections_letters_come_once_in_order_and_as_told() {
    let (here, there) = (robot("here").await, robot("there").await);
    let url = there.http_urls()[0].to_string();
    let (_, at) = url.split_once("//").unwrap();
    let (at, _) = at.split_once('/').unwrap();
    let cut = Arc::new(AtomicUsize::new(0));
    let way = cutting(at.parse().unwrap(), Arc::clone(&cut)).await;
    let to = AgentId::new("b@there").address(format!("http://{way}/acc"));
    let receiver = there.agent("b@there").await.unwrap();
    let sender = Arc::new(here.agent("a@here").await.unwrap());
    let mut sending = JoinSet::new();
    for number in 0..LETTERS {
        let (sender, to) = (Arc::clone(&sender), to.clone());
        sending.spawn(async move {
            let message = Message::new(Performative::Inform).to(to);
            let report = sender.send(message.content(number.to_string())).await;
            (number, report)
        });
    }
    let mut told = vec![None; LETTERS];
    while let Some(ended) = sending.join_next().await {
        let (number, report) = ended.unwrap();
        told[number] = Some(report[0].outcome);
    }
    let mut come = Vec::new();
    while let Ok(Ok(message)) =
        tokio::time::timeout(Duration::from_millis(300), receiver.receive()).await
    {
        let number: usize = message.content_str().unwrap().parse().unwrap();
        come.push(number);
    }
    assert!(come.is_sorted_by(|a, b| a < b), "{come:?}");
    assert!(cut.load(Ordering::Relaxed) > 20);
    let sent = |number: &usize| told[*number] == Some(Outcome::Sent);
    let missing = (0..LETTERS)
        .filter(sent)
        .filter(|n| come.binary_search(n).is_err());
    assert_eq!(missing.collect::<Vec<_>>(), []);
    // Two connections one after the other may be cut before the same letter is answered.
    let unknown = told.iter().filter(|told| **told != Some(Outcome::Sent));
    let unknown = unknown.count();
    assert!(unknown < LETTERS / 20, "{unknown} of {LETTERS}");
}
