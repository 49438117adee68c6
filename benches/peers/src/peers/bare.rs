//! Two partners of a daemon over TCP that do next to nothing: what the daemon alone costs.

use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use fipa_benches::daemons::Daemon;
use fipa_benches::partner::{self, Partner};

use super::{Peer, Work};

const SOURCE: &str = "source@bench";
const SINK: &str = "sink@bench";

/// Octets that are written at once.
const BATCH: usize = 64 << 10;

/// Until the middle knows who came and who went.
const PAUSE: Duration = Duration::from_millis(100);

/// Letters that are written ready, and receipts that are only counted.
pub(crate) struct Bare {
    daemon: Daemon,
    /// The source and the sink.
    ends: Option<(Partner, Partner)>,
    /// Letters that were sent by each of them.
    sent: u64,
    returned: u64,
    _folder: tempfile::TempDir,
}

impl Bare {
    pub(crate) fn start() -> Bare {
        let folder = tempfile::tempdir().expect("a folder");
        let daemon = Daemon::start(folder.path(), "bare", &[]);
        Bare {
            daemon,
            ends: None,
            sent: 0,
            returned: 0,
            _folder: folder,
        }
    }
}

impl Peer for Bare {
    fn name(&self) -> String {
        "fipad, bare ends".to_owned()
    }

    fn prepare(&mut self) {
        // While others are measured these say nothing, and so are given up.
        self.ends = None;
        thread::sleep(PAUSE);
        self.ends = Some(ends(&self.daemon));
    }

    fn middle(&self) -> u32 {
        self.daemon.process()
    }

    fn one_way(&mut self, work: Work) {
        let (source, sink) = self.ends.as_mut().expect("prepared");
        let mut stream = source.writer();
        let confirmed = &AtomicUsize::new(0);
        let first = self.sent;
        self.sent += work.letters as u64;
        thread::scope(|scope| {
            scope.spawn(|| sink.take_letters(work.letters, SINK));
            let writing = thread::current();
            scope.spawn(move || {
                source.await_receipts(work.letters, || {
                    confirmed.fetch_add(1, Ordering::Release);
                    writing.unpark();
                });
            });
            write_letters(&mut stream, work, first, confirmed);
        });
    }

    fn round_trips(&mut self, octets: usize, count: usize) -> Vec<Duration> {
        let (source, sink) = self.ends.as_mut().expect("prepared");
        let (mut there, mut back) = (source.writer(), sink.writer());
        let (sent, returned) = (self.sent, self.returned);
        self.sent += count as u64;
        self.returned += count as u64;
        thread::scope(|scope| {
            scope.spawn(move || {
                let mut letter = partner::payload_frame(SOURCE, octets);
                for number in 0..count as u64 {
                    sink.take_letters(1, SINK);
                    letter[partner::NUMBER].copy_from_slice(&(returned + number).to_be_bytes());
                    back.write_all(&letter).expect("written");
                }
            });
            let mut letter = partner::payload_frame(SINK, octets);
            let trips = (0..count as u64).map(|number| {
                letter[partner::NUMBER].copy_from_slice(&(sent + number).to_be_bytes());
                let start = Instant::now();
                there.write_all(&letter).expect("written");
                source.take_letters(1, SOURCE);
                start.elapsed()
            });
            trips.collect()
        })
    }
}

fn ends(daemon: &Daemon) -> (Partner, Partner) {
    let sink = Partner::greet(daemon.endpoint(), "sink", SINK);
    let source = Partner::greet(daemon.endpoint(), "source", SOURCE);
    // What they have is known in the middle.
    thread::sleep(PAUSE);
    (source, sink)
}

/// Writes letters, as many at once as fit into a batch, and waits where too many are not confirmed.
fn write_letters(stream: &mut TcpStream, work: Work, first: u64, confirmed: &AtomicUsize) {
    let mut letter = partner::payload_frame(SINK, work.octets);
    let mut batch = Vec::with_capacity(BATCH + letter.len());
    for written in 0..work.letters {
        let number = first + written as u64;
        letter[partner::NUMBER].copy_from_slice(&number.to_be_bytes());
        batch.extend_from_slice(&letter);
        let is_full = written + 1 - confirmed.load(Ordering::Acquire) >= work.window;
        if is_full || batch.len() >= BATCH || written + 1 == work.letters {
            stream.write_all(&batch).expect("written");
            batch.clear();
        }
        while written + 1 - confirmed.load(Ordering::Acquire) >= work.window {
            thread::park();
        }
    }
}
