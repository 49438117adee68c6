//! Two sessions of zenoh in client mode with a router between them.

use std::sync::mpsc::{self, Receiver};
use std::time::{Duration, Instant};

use zenoh::bytes::ZBytes;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session, Wait};

use super::{Peer, Work};
use crate::end::{End, Tally};
use crate::middle::{self, Middle};

/// Reliable, and blocking where the way is congested, hop by hop; nobody learns what has arrived.
pub(crate) struct Zenoh {
    router: Middle,
    tally: Tally,
    source: Session,
    answers: Receiver<ZBytes>,
    waiting: End,
    _there: Session,
}

/// The router: what `zenohd` is without its plugins.
pub(crate) fn route() {
    let address = format!("127.0.0.1:{}", middle::free_port());
    let mut config = config("router");
    set(
        &mut config,
        "listen/endpoints",
        &format!("[\"tcp/{address}\"]"),
    );
    let _session = zenoh::open(config).wait().expect("a router");
    println!("{address}");
    loop {
        std::thread::park();
    }
}

impl Zenoh {
    pub(crate) fn start() -> Zenoh {
        let router = Middle::start("zenoh");
        let (there, source) = (client(&router), client(&router));
        let tally = Tally::default();
        let counting = tally.clone();
        let sink = there
            .declare_subscriber("bench/sink")
            .callback(move |sample| counting.add(sample.payload().len()));
        sink.background().wait().expect("a subscriber");
        let answer = there
            .declare_publisher("bench/back")
            .congestion_control(CongestionControl::Block)
            .express(true);
        let answer = answer.wait().expect("a publisher");
        let echo = there
            .declare_subscriber("bench/there")
            .callback(move |sample| answer.put(sample.payload().clone()).wait().expect("put"));
        echo.background().wait().expect("a subscriber");
        let (sender, answers) = mpsc::channel();
        let back = source
            .declare_subscriber("bench/back")
            // At the end nobody waits any more.
            .callback(move |sample| drop(sender.send(sample.payload().clone())));
        back.background().wait().expect("a subscriber");
        Zenoh {
            router,
            tally,
            source,
            answers,
            waiting: End::new(),
            _there: there,
        }
    }
}

fn client(router: &Middle) -> Session {
    let mut config = config("client");
    let endpoint = format!("[\"tcp/{}\"]", router.address);
    set(&mut config, "connect/endpoints", &endpoint);
    zenoh::open(config).wait().expect("the router")
}

/// The usual settings; nobody is looked for.
fn config(mode: &str) -> Config {
    let mut config = Config::default();
    set(&mut config, "mode", &format!("\"{mode}\""));
    set(&mut config, "scouting/multicast/enabled", "false");
    config
}

fn set(config: &mut Config, key: &str, value: &str) {
    config.insert_json5(key, value).expect("a setting");
}

impl Peer for Zenoh {
    fn name(&self) -> String {
        format!("zenoh {}", env!("VERSION_ZENOH"))
    }

    fn middle(&self) -> u32 {
        self.router.process()
    }

    fn one_way(&mut self, work: Work) {
        let all = self.tally.seen().0 + work.letters;
        let publisher = self
            .source
            .declare_publisher("bench/sink")
            .congestion_control(CongestionControl::Block);
        let publisher = publisher.wait().expect("a publisher");
        let content = ZBytes::from(vec![b'x'; work.octets]);
        for _ in 0..work.letters {
            publisher.put(content.clone()).wait().expect("put");
        }
        let tally = self.tally.clone();
        self.waiting.run(async move { tally.reached(all).await });
    }

    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration> {
        let publisher = self
            .source
            .declare_publisher("bench/there")
            .congestion_control(CongestionControl::Block)
            // At once, not with others.
            .express(true);
        let publisher = publisher.wait().expect("a publisher");
        let content = ZBytes::from(vec![b'x'; octets]);
        let trips = (0..count).map(|_| {
            let start = Instant::now();
            publisher.put(content.clone()).wait().expect("put");
            let answer = self.answers.recv().expect("an answer");
            let time = start.elapsed();
            assert_eq!(answer.len(), octets);
            time
        });
        trips.collect()
    }
}
