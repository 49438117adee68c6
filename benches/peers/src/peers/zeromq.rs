//! Sockets of libzmq with a proxy of libzmq between them.

use std::thread;
use std::time::{Duration, Instant};

use zmq::{Context, Socket, SocketType};

use super::{Peer, Work};
use crate::end::{End, Tally};
use crate::middle::Middle;

/// PUSH and PULL: in order and blocking while the connections last, what is under way when one ends
/// is lost; no names, whoever pulls gets it. There and back it is REQ and REP.
pub(crate) struct ZeroMq {
    proxy: Middle,
    tally: Tally,
    push: Socket,
    request: Socket,
    waiting: End,
}

/// The proxy: one thread for each of the two patterns. It prints its four addresses.
pub(crate) fn proxy() {
    let context = Context::new();
    let bound = |kind: SocketType| {
        let socket = socket(&context, kind);
        socket.bind("tcp://127.0.0.1:*").expect("a port");
        let address = socket.get_last_endpoint().expect("bound");
        (socket, address.expect("text"))
    };
    let (pull, from) = bound(zmq::PULL);
    let (push, to) = bound(zmq::PUSH);
    let (router, asked) = bound(zmq::ROUTER);
    let (dealer, answered) = bound(zmq::DEALER);
    println!("{from} {to} {asked} {answered}");
    thread::spawn(move || zmq::proxy(&router, &dealer));
    zmq::proxy(&pull, &push).expect("a proxy");
}

impl ZeroMq {
    pub(crate) fn start() -> ZeroMq {
        let proxy = Middle::start("zeromq");
        let addresses: Vec<&str> = proxy.address.split(' ').collect();
        let [to, from, ask, answer] = addresses[..] else {
            panic!("no addresses: {}", proxy.address);
        };
        let connected = |kind: SocketType, address: &str| {
            // Each end has a thread of its own for its connections.
            let socket = socket(&Context::new(), kind);
            socket.connect(address).expect("the proxy");
            socket
        };
        let tally = Tally::default();
        let counting = tally.clone();
        let (sink, echo) = (connected(zmq::PULL, from), connected(zmq::REP, answer));
        thread::spawn(move || {
            let mut message = zmq::Message::new();
            while sink.recv(&mut message, 0).is_ok() {
                counting.add(message.len());
            }
        });
        thread::spawn(move || {
            while let Ok(query) = echo.recv_msg(0) {
                echo.send(query, 0).expect("sent");
            }
        });
        let (push, request) = (connected(zmq::PUSH, to), connected(zmq::REQ, ask));
        ZeroMq {
            proxy,
            tally,
            push,
            request,
            waiting: End::new(),
        }
    }
}

/// A socket that does not outlast the comparison.
fn socket(context: &Context, kind: SocketType) -> Socket {
    let socket = context.socket(kind).expect("a socket");
    socket.set_linger(0).expect("a setting");
    socket
}

impl Peer for ZeroMq {
    fn name(&self) -> String {
        let (major, minor, patch) = zmq::version();
        format!("libzmq {major}.{minor}.{patch}")
    }

    fn middle(&self) -> u32 {
        self.proxy.process()
    }

    fn one_way(&mut self, work: Work) {
        let all = self.tally.seen().0 + work.letters;
        let content = vec![b'x'; work.octets];
        for _ in 0..work.letters {
            self.push.send(&content[..], 0).expect("sent");
        }
        let tally = self.tally.clone();
        self.waiting.run(async move { tally.reached(all).await });
    }

    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration> {
        let content = vec![b'x'; octets];
        let mut answer = zmq::Message::new();
        let trips = (0..count).map(|_| {
            let start = Instant::now();
            self.request.send(&content[..], 0).expect("sent");
            self.request.recv(&mut answer, 0).expect("an answer");
            let time = start.elapsed();
            assert_eq!(answer.len(), octets);
            time
        });
        trips.collect()
    }
}
