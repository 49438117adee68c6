//! Two clients of gRPC, and a server between them that passes on what one streams to the other.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bytes::Bytes;
use prost::Message;
use tokio::net::TcpListener;
use tokio::sync::{Mutex as Turn, mpsc};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tokio_stream::{Stream, StreamExt};
use tonic::transport::{Channel, Server};
use tonic::{Request, Response, Status, Streaming};

use super::{Peer, Work};
use crate::end::{End, Tally};
use crate::middle::Middle;

mod service {
    #![allow(missing_docs, unreachable_pub)]

    include!(concat!(env!("OUT_DIR"), "/peers.Relay.rs"));
}

use service::relay_client::RelayClient;
use service::relay_server::{Relay, RelayServer};

/// What passes: a name and what is for whoever takes under it.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct Letter {
    #[prost(string, tag = "1")]
    pub(crate) name: String,
    #[prost(bytes = "bytes", tag = "2")]
    pub(crate) content: Bytes,
}

/// Letters that wait in the middle for one name, and at an end to be written.
const WAITING: usize = 1024;

/// Octets that may be under way on a stream and on a connection: gRPC's usual 64 KiB hold it up.
const UNDER_WAY: u32 = 4 << 20;

/// In order and blocking while the streams last; the sender of a stream learns at its end that the
/// middle has read it.
pub(crate) struct Grpc {
    server: Middle,
    tally: Tally,
    source: RelayClient<Channel>,
    asking: mpsc::Sender<Letter>,
    answers: Arc<Turn<Streaming<Letter>>>,
    here: End,
    _there: End,
}

/// Who takes, by name.
#[derive(Default)]
struct Middleman(Mutex<HashMap<String, mpsc::Sender<Result<Letter, Status>>>>);

impl Middleman {
    fn taker(&self, name: &str) -> Result<mpsc::Sender<Result<Letter, Status>>, Status> {
        let takers = self.0.lock().expect("no panic");
        let taker = takers.get(name).cloned();
        taker.ok_or_else(|| Status::not_found(name))
    }
}

#[tonic::async_trait]
impl Relay for Middleman {
    type TakeStream = ReceiverStream<Result<Letter, Status>>;

    async fn put(&self, letters: Request<Streaming<Letter>>) -> Result<Response<Letter>, Status> {
        let mut letters = letters.into_inner();
        while let Some(letter) = letters.message().await? {
            let taker = self.taker(&letter.name)?;
            let passed = taker.send(Ok(letter)).await;
            passed.map_err(|_| Status::unavailable("the taker is gone"))?;
        }
        Ok(Response::new(Letter::default()))
    }

    async fn take(&self, name: Request<Letter>) -> Result<Response<Self::TakeStream>, Status> {
        let (sender, receiver) = mpsc::channel(WAITING);
        let mut takers = self.0.lock().expect("no panic");
        takers.insert(name.into_inner().name, sender);
        Ok(Response::new(ReceiverStream::new(receiver)))
    }
}

/// The server in the middle.
pub(crate) fn relay() {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    runtime.block_on(async {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        println!("http://{}", listener.local_addr().expect("bound"));
        let callers = TcpListenerStream::new(listener)
            .map(|caller| caller.inspect(|stream| stream.set_nodelay(true).expect("a socket")));
        Server::builder()
            .initial_stream_window_size(UNDER_WAY)
            .initial_connection_window_size(UNDER_WAY)
            .add_service(RelayServer::new(Middleman::default()))
            .serve_with_incoming(callers)
            .await
            .expect("served");
    });
}

impl Grpc {
    pub(crate) fn start() -> Grpc {
        let server = Middle::start("grpc");
        let (here, there) = (End::new(), End::new());
        let tally = Tally::default();
        there.run(serve(server.address.clone(), tally.clone()));
        let address = server.address.clone();
        let (source, asking, answers) = here.run(async move {
            let mut client = connect(address).await;
            let answers = take(&mut client, "back").await;
            (client.clone(), putting(client), answers)
        });
        Grpc {
            server,
            tally,
            source,
            asking,
            answers: Arc::new(Turn::new(answers)),
            here,
            _there: there,
        }
    }
}

async fn connect(address: String) -> RelayClient<Channel> {
    let endpoint = Channel::from_shared(address)
        .expect("an address")
        .initial_stream_window_size(UNDER_WAY)
        .initial_connection_window_size(UNDER_WAY);
    let channel = endpoint.connect();
    RelayClient::new(channel.await.expect("the server"))
}

async fn take(client: &mut RelayClient<Channel>, name: &str) -> Streaming<Letter> {
    let letters = client.take(letter(name, Bytes::new())).await;
    letters.expect("the server").into_inner()
}

/// A stream of letters that goes on as long as somebody may put something in.
fn putting(mut client: RelayClient<Channel>) -> mpsc::Sender<Letter> {
    let (sender, receiver) = mpsc::channel(WAITING);
    tokio::spawn(async move { client.put(ReceiverStream::new(receiver)).await });
    sender
}

fn letter(name: &str, content: Bytes) -> Letter {
    let name = name.to_owned();
    Letter { name, content }
}

/// The other end: it counts what comes under one name, and sends back what comes under another.
async fn serve(address: String, tally: Tally) {
    let mut client = connect(address).await;
    let mut sink = take(&mut client, "sink").await;
    let mut echo = take(&mut client, "there").await;
    let answering = putting(client);
    tokio::spawn(async move {
        while let Ok(Some(letter)) = sink.message().await {
            tally.add(letter.content.len());
        }
    });
    tokio::spawn(async move {
        while let Ok(Some(query)) = echo.message().await {
            let sent = answering.send(letter("back", query.content)).await;
            sent.expect("the server");
        }
    });
}

impl Peer for Grpc {
    fn name(&self) -> String {
        format!("gRPC: tonic {}", env!("VERSION_TONIC"))
    }

    fn middle(&self) -> u32 {
        self.server.process()
    }

    fn one_way(&mut self, work: Work) {
        let all = self.tally.seen().0 + work.letters;
        let (mut source, tally) = (self.source.clone(), self.tally.clone());
        self.here.run(async move {
            source.put(letters(work)).await.expect("the server");
            tally.reached(all).await;
        });
    }

    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration> {
        let (asking, answers) = (self.asking.clone(), Arc::clone(&self.answers));
        self.here.run(async move {
            let content = Bytes::from(vec![b'x'; octets]);
            let mut answers = answers.lock().await;
            let mut times = Vec::with_capacity(count);
            for _ in 0..count {
                let start = Instant::now();
                let sent = asking.send(letter("there", content.clone())).await;
                sent.expect("the server");
                let answer = answers.message().await.expect("the server");
                times.push(start.elapsed());
                assert_eq!(answer.expect("an answer").content, content);
            }
            times
        })
    }
}

fn letters(work: Work) -> impl Stream<Item = Letter> {
    let content = Bytes::from(vec![b'x'; work.octets]);
    tokio_stream::iter(0..work.letters).map(move |_| letter("sink", content.clone()))
}
