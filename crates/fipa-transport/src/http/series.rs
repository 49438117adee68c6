//! A series of letters to one place: they have numbers, and go over one connection, each without
//! waiting for the answer to the one in front, as far as the server allows that.
//!
//! A connection that ends is replaced by a new one, on which everything that was not answered is
//! posted again, in order and with the same numbers, by which the server knows what it has. On a
//! new connection the first letter is alone until its answer says that others may follow: whoever
//! answers there now may be another one. A letter that certainly did not arrive is given up with all
//! behind it, so that whoever posts them again has them in order.

use std::collections::{HashMap, VecDeque};
use std::io::IoSlice;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use bytes::{Buf, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

use super::client::{IDLE, MAX_BODY, PostError, TakenOver, connect};
use super::request::LetterNumber;
use super::response::{self, Progress, ResponseHead};

/// Letters on their way over one connection at most, which is what our server allows.
pub(super) const MAX_AHEAD: usize = 64;

/// Octets of answers that are read at once.
const ANSWERS: usize = 4096;

/// Letters that are written at once at most.
const AT_ONCE: usize = 32;

/// Connections that may end one after the other without an answer before a letter is given up.
const TRIES: u32 = 2;

/// The host and port of each place with a series, and where its letters go.
pub(super) type AllSeries = Mutex<HashMap<(String, u16), Numbering>>;

/// What becomes of a letter.
type Answer = Result<TakenOver, PostError>;

/// The numbers of a series, and where its letters go.
#[derive(Debug)]
pub(super) struct Numbering {
    series: u64,
    /// The last one that was given.
    last: u64,
    letters: mpsc::UnboundedSender<Posting>,
}

/// A letter of a series that is not answered yet.
pub(super) struct Posting {
    request: Vec<u8>,
    tell: Box<dyn FnOnce(Answer) + Send>,
    deadline: Instant,
    /// All of it was written at some time.
    written: bool,
}

impl Posting {
    fn fail(self, reason: &str) {
        let reason = reason.to_owned();
        let error = match self.written {
            true => PostError::Unanswered(reason),
            false => PostError::Unreached(reason),
        };
        (self.tell)(Err(error));
    }
}

/// How a connection ended.
enum End {
    /// There is nothing to be posted any more.
    Idle,
    /// The server answered, and said that it closes: it took nothing behind that.
    Said,
    /// The first letter was not answered in time.
    Late,
    Broken(String),
}

/// The letters of a series that are not answered, in their order, and those that come.
struct Series {
    place: (String, u16),
    all: Weak<AllSeries>,
    letters: mpsc::UnboundedReceiver<Posting>,
    unanswered: VecDeque<Posting>,
    /// A connection for the first ones.
    open: Option<TcpStream>,
    /// Connections that ended since the last answer.
    lost: u32,
}

impl Series {
    /// Posts until nothing has come for a while.
    async fn run(mut self) {
        loop {
            while let Ok(posting) = self.letters.try_recv() {
                self.unanswered.push_back(posting);
            }
            let Some(first) = self.unanswered.front() else {
                if self.leave() {
                    return;
                }
                continue;
            };
            let (host, port) = &self.place;
            let opened = match self.open.take() {
                Some(open) => Ok(open),
                None => connect(host, *port, first.deadline).await,
            };
            let end = match opened {
                Ok(stream) => self.post_over(stream).await,
                Err(error) => {
                    self.fail_all(&error.to_string());
                    continue;
                }
            };
            match end {
                // Nobody is there any more to be told.
                End::Idle if self.letters.is_closed() => return,
                End::Idle | End::Said => {}
                End::Late => self.give_up_late(),
                End::Broken(reason) => self.try_again(&reason),
            }
        }
    }

    /// Ends the series, unless a letter has come meanwhile.
    fn leave(&mut self) -> bool {
        let Some(all) = self.all.upgrade() else {
            return true;
        };
        let mut all = all.lock().unwrap_or_else(PoisonError::into_inner);
        let is_over = self.letters.is_empty();
        if is_over {
            all.remove(&self.place);
        }
        is_over
    }

    fn give_up_late(&mut self) {
        let now = Instant::now();
        while let Some(first) = self.unanswered.pop_front_if(|first| first.deadline <= now) {
            let reason = match first.written {
                true => "it took the letter and did not answer in time",
                false => "it did not take the whole letter in time",
            };
            first.fail(reason);
        }
    }

    /// A connection ended: all is posted again, but for the letter of which nothing comes.
    fn try_again(&mut self, reason: &str) {
        self.lost += 1;
        if self.lost < TRIES {
            return;
        }
        self.lost = 0;
        match self.unanswered.pop_front_if(|first| first.written) {
            Some(first) => first.fail(reason),
            None => self.fail_all(reason),
        }
    }

    /// None goes on without those in front of it.
    fn fail_all(&mut self, reason: &str) {
        while let Ok(posting) = self.letters.try_recv() {
            self.unanswered.push_back(posting);
        }
        self.unanswered.drain(..).for_each(|p| p.fail(reason));
    }

    async fn post_over(&mut self, mut stream: TcpStream) -> End {
        let (mut read, mut write) = stream.split();
        let mut octets = BytesMut::with_capacity(ANSWERS);
        let mut reading = Reading { ahead: 1, rest: 0 };
        // How many are written, and how much of the next one.
        let (mut written, mut begun) = (0, 0);
        let mut used = Instant::now();
        loop {
            let until = match self.unanswered.front() {
                Some(first) => first.deadline,
                None => used + IDLE,
            };
            // Another server may be behind the next answer, which allows less.
            let writable = written..self.unanswered.len().min(reading.ahead).max(written);
            let (slices, count) = unwritten(&self.unanswered, writable, begun);
            let slices = slices.get(..count).unwrap_or_default();
            tokio::select! {
                biased;
                come = self.letters.recv() => match come {
                    Some(posting) => self.unanswered.push_back(posting),
                    None => return End::Idle,
                },
                result = write.write_vectored(slices), if !slices.is_empty() => match result {
                    Ok(octets) => {
                        begun += octets;
                        while let Some(posting) = self.unanswered.get_mut(written)
                            && begun >= posting.request.len()
                        {
                            begun -= posting.request.len();
                            posting.written = true;
                            written += 1;
                        }
                    }
                    Err(error) => return End::Broken(error.to_string()),
                },
                result = read.read_buf(&mut octets) => {
                    match result {
                        Ok(0) => {
                            let reason = "the other side closed the connection without an answer";
                            return End::Broken(reason.to_owned());
                        }
                        Ok(_) => {}
                        Err(error) => return End::Broken(error.to_string()),
                    }
                    loop {
                        let head = match reading.next(&mut octets) {
                            Ok(Some(head)) => head,
                            Ok(None) => break,
                            Err(reason) => return End::Broken(reason.to_owned()),
                        };
                        let goes_on = head.keeps_alive && written > 0 && reading.skips(&head);
                        let Some(first) = self.unanswered.pop_front() else {
                            return End::Broken("an answer came to no letter".to_owned());
                        };
                        self.lost = 0;
                        (first.tell)(head.into_answer());
                        if !goes_on {
                            return End::Said;
                        }
                        written -= 1;
                    }
                    used = Instant::now();
                }
                () = sleep_until(until) => return match self.unanswered.is_empty() {
                    true => End::Idle,
                    false => End::Late,
                },
            }
        }
    }
}

/// What is to be written of these letters, of the first one without so many octets.
fn unwritten(
    postings: &VecDeque<Posting>,
    which: Range<usize>,
    begun: usize,
) -> ([IoSlice<'_>; AT_ONCE], usize) {
    let mut slices = [IoSlice::new(&[]); AT_ONCE];
    let (mut skipped, mut count) = (begun, 0);
    for (slice, posting) in slices.iter_mut().zip(postings.range(which)) {
        *slice = IoSlice::new(posting.request.get(skipped..).unwrap_or_default());
        (skipped, count) = (0, count + 1);
    }
    (slices, count)
}

/// What is known of the answers that come.
struct Reading {
    /// Letters that may be on their way, after the last answer.
    ahead: usize,
    /// Octets of the body of the last answer that have not come.
    rest: u64,
}

impl Reading {
    /// Takes the head of the next answer out of what has come.
    fn next(&mut self, octets: &mut BytesMut) -> Result<Option<ResponseHead>, &'static str> {
        loop {
            let skipped = self.rest.min(octets.len() as u64);
            octets.advance(usize::try_from(skipped).unwrap_or_default());
            self.rest -= skipped;
            if self.rest > 0 || octets.is_empty() {
                return Ok(None);
            }
            match response::read(octets) {
                Progress::More => return Ok(None),
                Progress::Broken(reason) => return Err(reason),
                Progress::Head(head, length) => {
                    octets.advance(length);
                    // 100 Continue and the like: the answer itself follows.
                    if head.status >= 200 {
                        self.ahead = head.ahead.clamp(1, MAX_AHEAD);
                        return Ok(Some(head));
                    }
                }
            }
        }
    }

    /// Whether the answer behind the body of this one can be read.
    fn skips(&mut self, head: &ResponseHead) -> bool {
        // Where the length was not told, what comes is skipped in front of the next answer.
        self.rest = head.body.unwrap_or_default();
        self.rest <= MAX_BODY
    }
}

/// Takes a letter into the series of its place, which is begun if there is none, with a connection
/// that is open already, if there is one.
pub(super) fn enter(
    all: &Arc<AllSeries>,
    place: (String, u16),
    open: impl FnOnce() -> Option<TcpStream>,
    deadline: Instant,
    request: impl FnOnce(LetterNumber) -> Vec<u8>,
    tell: impl FnOnce(Answer) + Send + 'static,
    runtime: &Handle,
) {
    let mut begun = all.lock().unwrap_or_else(PoisonError::into_inner);
    let numbering = begun.entry(place.clone()).or_insert_with(|| {
        let (letters, coming) = mpsc::unbounded_channel();
        let series = Series {
            place,
            all: Arc::downgrade(all),
            letters: coming,
            unanswered: VecDeque::new(),
            open: open(),
            lost: 0,
        };
        // It leaves the table only under this lock, so not before this letter is in.
        runtime.spawn(series.run());
        Numbering {
            series: fastrand::u64(..),
            last: 0,
            letters,
        }
    });
    numbering.last += 1;
    let number = LetterNumber {
        series: numbering.series,
        number: numbering.last,
    };
    let posting = Posting {
        request: request(number),
        tell: Box::new(tell),
        deadline,
        written: false,
    };
    // A series that has ended is not in the table, unless the runtime has ended, too.
    let _ = numbering.letters.send(posting);
}
