//! A link over QUIC beside QUIC alone, between two threads with a runtime each, in one run: frames,
//! heads, receipts and four streams against octets behind a length on one stream, of which each is
//! answered by one octet.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use bytes::{Bytes, BytesMut};
use fipa_benches::table::Times;
use fipa_directory::{Address, InstanceId, Now};
use fipa_link::{
    Event, Frame, Hello, LetterFrame, Link, LinkConfig, Outcome, ReceiverOutcome, Role,
    WrittenOutcomes,
};
use fipa_transport::raw::{RawClient, RawQuicServer};
use fipa_transport::{Buffers, Driver, End, Handle, Listener, Quic, Stream, dial_link, pump};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::Notify;

/// Rounds of all, and round trips that are timed in each.
const ROUNDS: usize = 7;
const COUNT: usize = 2_000;

/// Octets of the letters that go to and fro.
const PING: usize = 100;

/// Octets of the letters whose rate is measured, and how many are under way.
const SIZES: [(usize, u64); 3] = [(256, 1024), (1 << 10, 1024), (64 << 10, 64)];

/// For how long.
const SPAN: Duration = Duration::from_millis(600);

/// The lane of letters of ordinary urgency.
const LANE: usize = 1;

fn main() -> ExitCode {
    let (bare, link) = serve();
    runtime().block_on(async {
        let alone = (
            RawClient::quic_echo(bare).await.expect("an echo"),
            RawClient::quic_sink(bare).await.expect("a sink"),
        );
        let caller = Caller::dial(&link).await;
        compare(alone, &caller).await;
    });
    ExitCode::SUCCESS
}

async fn compare((mut echo, mut sink): (RawClient, RawClient), caller: &Caller) {
    println!("what                       alone     link  link/alone (1.3 at most)");
    let (mut alone, mut linked) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let frame = [b'x'; PING];
        let mut times = Vec::with_capacity(COUNT);
        for _ in 0..COUNT {
            let start = Instant::now();
            echo.round_trip(&frame).await.expect("an echo");
            times.push(start.elapsed());
        }
        alone.push(Times::new(times).percentile(0.5));
        linked.push(caller.round_trips().await.percentile(0.5));
    }
    row("round trip, us", &alone, &linked, |alone, link| {
        link / alone
    });
    for (octets, window) in SIZES {
        let frame = vec![b'x'; octets];
        let (mut alone, mut linked) = (Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            let taken = sink.flood(&frame, window, SPAN).await.expect("a sink");
            alone.push(taken as f64 / SPAN.as_secs_f64());
            linked.push(caller.rate(&frame, window).await);
        }
        let what = format!("{octets} octets, letters/s");
        row(&what, &alone, &linked, |alone, link| alone / link);
    }
}

fn row(what: &str, alone: &[f64], linked: &[f64], ratio: impl Fn(f64, f64) -> f64) {
    let ratios = alone.iter().zip(linked).map(|(a, l)| ratio(*a, *l));
    let ratio = median(ratios.collect());
    let (alone, linked) = (median(alone.to_vec()), median(linked.to_vec()));
    println!("{what:24} {alone:8.1} {linked:8.1} {ratio:11.2}");
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn runtime() -> Runtime {
    let built = Builder::new_current_thread().enable_all().build();
    built.expect("a runtime")
}

/// Serves both on a thread; where.
fn serve() -> (SocketAddr, Address) {
    let (tell, told) = std::sync::mpsc::channel();
    thread::spawn(move || {
        runtime().block_on(async {
            let bare = RawQuicServer::bind("127.0.0.1:0").await.expect("a port");
            let any = Address::quic("127.0.0.1", 0);
            let listener = Listener::bind_link(&any, &anybody()).await;
            let listener = listener.expect("a port");
            let at = (bare.address(), listener.address().clone());
            tell.send(at).expect("they wait");
            tokio::spawn(bare.serve());
            let called = listener.accept().await.expect("a call").settle().await;
            run(called.expect("a link"), None).pumped.await;
        });
    });
    told.recv().expect("a server")
}

fn anybody() -> Quic {
    Quic::new(None).expect("a key")
}

/// One end of the link.
struct Half {
    link: Mutex<Link>,
    begun: Instant,
    /// Where receipts and answers are counted; who has none answers.
    answers: Option<Arc<Notify>>,
    counted: Mutex<u64>,
    /// What all letters are confirmed with, as by a daemon in the middle.
    receipt: WrittenOutcomes,
}

impl Half {
    fn now(&self) -> Now {
        Now {
            mono: self.begun.elapsed(),
            unix_millis: 0,
        }
    }

    fn link(&self) -> MutexGuard<'_, Link> {
        self.link.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn hear(&self, lane: Option<usize>, octets: &mut BytesMut) -> bool {
        let now = self.now();
        let mut link = self.link();
        let mut count = 0;
        loop {
            let heard = match lane {
                None => link.receive(now, octets),
                Some(lane) => link.receive_on(now, lane, octets),
            };
            let Some(event) = heard.expect("a frame") else {
                break;
            };
            match event {
                Event::Frame(Frame::Letter(letter)) if self.answers.is_none() => {
                    self.answer(now, &mut link, letter);
                }
                Event::Frame(Frame::Letter(_) | Frame::Receipt { .. }) => count += 1,
                _ => {}
            }
        }
        let more = lane.is_none_or(|lane| !link.is_held(lane));
        drop(link);
        if let (Some(answers), 1..) = (&self.answers, count) {
            *self.counted.lock().unwrap_or_else(PoisonError::into_inner) += count;
            answers.notify_one();
        }
        more
    }

    /// A letter that goes to and fro goes back, another one is confirmed.
    fn answer(&self, now: Now, link: &mut Link, letter: LetterFrame) {
        if letter.parts.iter().map(Bytes::len).sum::<usize>() == PING {
            link.send_letter(now, LANE, letter);
            return;
        }
        link.send_written_receipt(now, letter.id, &self.receipt);
    }
}

struct Driven(Arc<Half>);

impl Driver for Driven {
    fn received(&self, octets: &mut BytesMut) {
        self.0.hear(None, octets);
    }

    fn received_on(&self, lane: usize, octets: &mut BytesMut) -> bool {
        self.0.hear(Some(lane), octets)
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        let mut link = self.0.link();
        parts.extend(std::iter::from_fn(|| link.poll_transmit()));
        false
    }

    fn transmit_on(&self, lane: usize, parts: &mut VecDeque<Bytes>) -> bool {
        let mut link = self.0.link();
        parts.extend(std::iter::from_fn(|| link.poll_transmit_on(lane)));
        false
    }

    fn closed(&self, end: &End, _: bool) {
        if self.0.answers.is_some() {
            panic!("the link ended: {end}");
        }
    }
}

/// A link that is moved.
struct Running<P> {
    half: Arc<Half>,
    handle: Arc<Handle>,
    pumped: P,
}

fn run(stream: Stream, answers: Option<Arc<Notify>>) -> Running<impl Future<Output = ()>> {
    let hello = Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([7; 16]),
        name: "robot".into(),
        scope: "".into(),
        endpoints: Vec::new(),
        max_letter: 1 << 20,
        unix_millis: 0,
        checks: false,
    };
    let config = LinkConfig {
        lanes: true,
        ..LinkConfig::new(hello)
    };
    let told = ReceiverOutcome {
        to: "sink@robot2".into(),
        outcome: Outcome::Delivered,
        via: None,
        reason: "".into(),
    };
    let half = Arc::new(Half {
        link: Mutex::new(Link::new(config, Now::default())),
        begun: Instant::now(),
        answers,
        counted: Mutex::default(),
        receipt: WrittenOutcomes::new(&[told]),
    });
    let handle = Arc::<Handle>::default();
    let driver = Driven(Arc::clone(&half));
    let pumped = pump(
        stream,
        Arc::clone(&handle),
        Arc::<Buffers>::default(),
        driver,
    );
    Running {
        half,
        handle,
        pumped,
    }
}

/// Who has dialled.
struct Caller {
    half: Arc<Half>,
    handle: Arc<Handle>,
    answers: Arc<Notify>,
}

impl Caller {
    async fn dial(to: &Address) -> Caller {
        let (stream, _) = dial_link(std::slice::from_ref(to), &anybody())
            .await
            .expect("a link");
        let answers = Arc::<Notify>::default();
        let Running {
            half,
            handle,
            pumped,
        } = run(stream, Some(Arc::clone(&answers)));
        tokio::spawn(pumped);
        Caller {
            half,
            handle,
            answers,
        }
    }

    fn send(&self, ids: std::ops::RangeInclusive<u64>, content: &Bytes) {
        let now = self.half.now();
        let mut link = self.half.link();
        for id in ids {
            let letter = LetterFrame {
                id,
                ttl_millis: 5_000,
                parts: content.clone().into(),
            };
            link.send_letter(now, LANE, letter);
        }
        drop(link);
        self.handle.transmit();
    }

    /// How many answers have come, once there are so many.
    async fn answered(&self, wanted: u64) -> u64 {
        loop {
            let counted = *self
                .half
                .counted
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            if counted >= wanted {
                return counted;
            }
            self.answers.notified().await;
        }
    }

    async fn round_trips(&self) -> Times {
        let content = Bytes::from(vec![b'x'; PING]);
        let mut times = Vec::with_capacity(COUNT);
        for _ in 0..COUNT {
            let before = self.answered(0).await;
            let start = Instant::now();
            self.send(before + 1..=before + 1, &content);
            self.answered(before + 1).await;
            times.push(start.elapsed());
        }
        Times::new(times)
    }

    /// Letters a second that were confirmed.
    async fn rate(&self, content: &[u8], window: u64) -> f64 {
        let content = Bytes::copy_from_slice(content);
        let begun = self.answered(0).await;
        let (mut sent, mut come) = (begun, begun);
        let start = Instant::now();
        loop {
            let may_send = start.elapsed() < SPAN;
            if may_send {
                self.send(sent + 1..=come + window, &content);
                sent = come + window;
            }
            if sent == come {
                return (come - begun) as f64 / start.elapsed().as_secs_f64();
            }
            come = self.answered(come + 1).await;
        }
    }
}
