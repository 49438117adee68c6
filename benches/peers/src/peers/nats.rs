//! Two clients of NATS with a server of the system between them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use async_nats::{Client, Subscriber};
use bytes::Bytes;
use futures_util::StreamExt;
use tokio::sync::Mutex;

use super::{Peer, Work};
use crate::end::{End, Tally};
use crate::middle::Middle;

/// At most once: a client that does not keep up loses messages, or its connection, so that there
/// never are more than a window under way here.
pub(crate) struct Nats {
    server: Middle,
    version: String,
    tally: Tally,
    source: Client,
    answers: Arc<Mutex<Subscriber>>,
    here: End,
    _there: End,
}

impl Nats {
    pub(crate) fn start() -> Option<Nats> {
        let options = |port| ["-a", "127.0.0.1", "-p", &format!("{port}")].map(str::to_owned);
        let server = Middle::serve("nats-server", |port| options(port).to_vec())?;
        let (here, there) = (End::new(), End::new());
        let tally = Tally::default();
        there.run(serve(server.address.clone(), tally.clone()));
        let address = server.address.clone();
        let (source, version, answers) = here.run(async move {
            let client = async_nats::connect(address).await.expect("the server");
            let version = client.server_info().version;
            let answers = client.subscribe("bench.back").await.expect("subscribed");
            client.flush().await.expect("the server");
            (client, version, answers)
        });
        Some(Nats {
            server,
            version,
            tally,
            source,
            answers: Arc::new(Mutex::new(answers)),
            here,
            _there: there,
        })
    }
}

/// The other end: it counts what comes to one subject, and sends back what comes to another.
async fn serve(address: String, tally: Tally) {
    let client = async_nats::connect(address).await.expect("the server");
    let mut sink = client.subscribe("bench.sink").await.expect("subscribed");
    let mut echo = client.subscribe("bench.there").await.expect("subscribed");
    client.flush().await.expect("the server");
    tokio::spawn(async move {
        while let Some(message) = sink.next().await {
            tally.add(message.payload.len());
        }
    });
    tokio::spawn(async move {
        while let Some(message) = echo.next().await {
            let sent = client.publish("bench.back", message.payload).await;
            sent.expect("the server");
        }
    });
}

impl Peer for Nats {
    fn name(&self) -> String {
        let client = env!("VERSION_ASYNC_NATS");
        format!("NATS {}, client {client}", self.version)
    }

    fn middle(&self) -> u32 {
        self.server.process()
    }

    fn one_way(&mut self, work: Work) {
        let before = self.tally.seen().0;
        let (source, tally) = (self.source.clone(), self.tally.clone());
        self.here.run(async move {
            let content = Bytes::from(vec![b'x'; work.octets]);
            for sent in before..before + work.letters {
                if sent - tally.seen().0 >= work.window {
                    tally.reached(sent - work.window / 2).await;
                }
                let sent = source.publish("bench.sink", content.clone()).await;
                sent.expect("the server");
            }
            tally.reached(before + work.letters).await;
        });
    }

    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration> {
        let (source, answers) = (self.source.clone(), Arc::clone(&self.answers));
        self.here.run(async move {
            let content = Bytes::from(vec![b'x'; octets]);
            let mut answers = answers.lock().await;
            let mut times = Vec::with_capacity(count);
            for _ in 0..count {
                let start = Instant::now();
                let sent = source.publish("bench.there", content.clone()).await;
                sent.expect("the server");
                let answer = answers.next().await.expect("an answer");
                times.push(start.elapsed());
                assert_eq!(answer.payload, content);
            }
            times
        })
    }
}
