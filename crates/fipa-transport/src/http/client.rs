use std::io::{self, IoSlice};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytes::BytesMut;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::time::{Instant, timeout_at};

use super::multipart::Boundary;
use super::request::{HttpLetter, Request};
use super::response::{self, Progress, ResponseHead};
use super::series::{self, AllSeries};

/// How long a connection may take to open.
const CONNECT: Duration = Duration::from_secs(3);

/// How long an idle connection is kept. JADE closes it after 60 s.
pub(super) const IDLE: Duration = Duration::from_secs(45);

/// Idle connections to one place, and to all places, at most. JADE keeps ten open.
const MAX_IDLE_A_PLACE: usize = 8;
const MAX_IDLE: usize = 256;

/// Octets of the rest of a body that are waited for, so that the connection can be used again.
pub(super) const MAX_BODY: u64 = 64 << 10;

/// Octets of an ordinary answer's head.
const ANSWER: usize = 512;

/// Why a letter was not taken over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PostError {
    /// Not all of it was written: nobody has it.
    #[error("{0}")]
    Unreached(String),
    /// It was written, and no answer came: nobody knows whether somebody has it.
    #[error("{0}")]
    Unanswered(String),
    /// The answer is "no".
    #[error("the answer is {status} {reason}")]
    Refused {
        /// The status, any but 200.
        status: u16,
        /// What stands behind it.
        reason: String,
    },
}

/// What is known once a letter was taken over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TakenOver {
    /// Letters that may be on their way to the place at once, if they have numbers; 0 where each
    /// waits for the answer to the one in front.
    pub ahead: usize,
}

/// Posts letters, one at a time on each connection, and keeps connections for the next ones; to
/// servers that allow it, without waiting for answers.
#[derive(Debug)]
pub struct HttpClient {
    all_series: Arc<AllSeries>,
    /// The connections that are kept, those that were used longest ago first.
    idle: Mutex<Vec<Idle>>,
    boundary: Boundary,
}

impl Default for HttpClient {
    fn default() -> HttpClient {
        HttpClient::new()
    }
}

/// A connection that may be used again, and where it leads.
#[derive(Debug)]
struct Idle {
    stream: TcpStream,
    host: String,
    port: u16,
    since: Instant,
}

impl Idle {
    fn leads_to(&self, letter: &HttpLetter<'_>) -> bool {
        self.port == letter.port && self.host == letter.host
    }
}

/// How far a request got on a connection.
enum Failed {
    Unwritten(io::Error),
    /// No answer began.
    Silent(io::Error),
    Broken(String),
}

impl HttpClient {
    /// A client without connections.
    pub fn new() -> HttpClient {
        HttpClient {
            all_series: Arc::default(),
            idle: Mutex::default(),
            boundary: Boundary::random(&mut fastrand::Rng::new()),
        }
    }

    /// Posts a letter and waits for the answer, no longer than this.
    ///
    /// A connection that was kept and ends without an answer says nothing about the letter: it is
    /// posted again, over a new one. The other side may so have it twice.
    pub async fn post(
        &self,
        letter: HttpLetter<'_>,
        timeout: Duration,
    ) -> Result<TakenOver, PostError> {
        let deadline = Instant::now() + timeout;
        let request = Request::of(&letter, &self.boundary, None);
        if let Some(mut kept) = self.take_idle(&letter) {
            match exchange(&mut kept.stream, &request, deadline).await {
                Err(Failed::Unwritten(e) | Failed::Silent(e))
                    if e.kind() != io::ErrorKind::TimedOut =>
                {
                    // The others are as old.
                    self.forget(&letter);
                }
                result => return self.conclude(kept, result),
            }
        }
        let stream = connect(letter.host, letter.port, deadline)
            .await
            .map_err(|error| PostError::Unreached(error.to_string()))?;
        let mut opened = Idle {
            stream,
            host: letter.host.to_owned(),
            port: letter.port,
            since: Instant::now(),
        };
        let result = exchange(&mut opened.stream, &request, deadline).await;
        self.conclude(opened, result)
    }

    /// Posts a letter behind those that were posted so to the same place before, without waiting
    /// for the answers to them, and tells what became of it. Nothing is told once the client is
    /// dropped.
    ///
    /// Wherever a connection ends, those that were not answered are posted again over a new one,
    /// in their order: the server knows them by their numbers. A server that does not know numbers
    /// gets the next letter only when it has answered.
    pub fn post_in_series(
        &self,
        letter: HttpLetter<'_>,
        timeout: Duration,
        runtime: &Handle,
        tell: impl FnOnce(Result<TakenOver, PostError>) + Send + 'static,
    ) {
        let deadline = Instant::now() + timeout;
        let place = (letter.host.to_owned(), letter.port);
        let request = |number| {
            let request = Request::of(&letter, &self.boundary, Some(number));
            match request.payload.is_empty() {
                true => request.head,
                false => [&request.head, request.payload, &request.tail].concat(),
            }
        };
        let open = || self.take_idle(&letter).map(|kept| kept.stream);
        let series = &self.all_series;
        series::enter(series, place, open, deadline, request, tell, runtime);
    }

    fn conclude(
        &self,
        used: Idle,
        result: Result<(ResponseHead, bool), Failed>,
    ) -> Result<TakenOver, PostError> {
        let (head, reusable) = match result {
            Ok(answer) => answer,
            Err(Failed::Unwritten(error)) => return Err(PostError::Unreached(error.to_string())),
            Err(Failed::Silent(error)) if error.kind() == io::ErrorKind::UnexpectedEof => {
                let reason = "the other side closed the connection without an answer";
                return Err(PostError::Unanswered(reason.to_owned()));
            }
            Err(Failed::Silent(error)) => return Err(PostError::Unanswered(error.to_string())),
            Err(Failed::Broken(reason)) => return Err(PostError::Unanswered(reason)),
        };
        if reusable {
            self.keep(used);
        }
        head.into_answer()
    }

    /// A connection to this place that is still open, that which was used last. What is left of an
    /// answer is dropped.
    fn take_idle(&self, letter: &HttpLetter<'_>) -> Option<Idle> {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let found = idle.iter().rposition(|kept| kept.leads_to(letter))?;
            let kept = idle.remove(found);
            if kept.since.elapsed() < IDLE && is_open(&kept.stream) {
                return Some(kept);
            }
        }
    }

    fn keep(&self, used: Idle) {
        let since = Instant::now();
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.len() >= MAX_IDLE {
            idle.retain(|kept| since.duration_since(kept.since) < IDLE);
        }
        let same = |kept: &&Idle| kept.port == used.port && kept.host == used.host;
        if idle.len() < MAX_IDLE && idle.iter().filter(same).count() < MAX_IDLE_A_PLACE {
            idle.push(Idle { since, ..used });
        }
    }

    fn forget(&self, letter: &HttpLetter<'_>) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        idle.retain(|kept| !kept.leads_to(letter));
    }
}

/// Whether nothing says that the connection has ended.
fn is_open(stream: &TcpStream) -> bool {
    let mut junk = [0; 1024];
    loop {
        match stream.try_read(&mut junk) {
            Ok(0) => return false,
            Ok(_) => {}
            Err(error) => return error.kind() == io::ErrorKind::WouldBlock,
        }
    }
}

pub(super) async fn connect(host: &str, port: u16, deadline: Instant) -> io::Result<TcpStream> {
    let attempt = async {
        let mut last = io::Error::other("the host name has no address");
        for address in tokio::net::lookup_host((host, port)).await? {
            match TcpStream::connect(address).await {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    return Ok(stream);
                }
                Err(error) => last = error,
            }
        }
        Err(last)
    };
    let until = deadline.min(Instant::now() + CONNECT);
    timeout_at(until, attempt).await.unwrap_or_else(|_| {
        Err(io::Error::new(
            io::ErrorKind::TimedOut,
            "the connection could not be opened in time",
        ))
    })
}

/// Writes a request and reads the head of its answer. Whether the connection can be used again.
async fn exchange(
    stream: &mut TcpStream,
    request: &Request<'_>,
    deadline: Instant,
) -> Result<(ResponseHead, bool), Failed> {
    let late = |what| io::Error::new(io::ErrorKind::TimedOut, what);
    timeout_at(deadline, write(stream, request))
        .await
        .unwrap_or_else(|_| Err(late("it did not take the whole letter in time")))
        .map_err(Failed::Unwritten)?;
    timeout_at(deadline, answer(stream))
        .await
        .unwrap_or_else(|_| {
            Err(Failed::Silent(late(
                "it took the letter and did not answer in time",
            )))
        })
}

async fn write(stream: &mut TcpStream, request: &Request<'_>) -> io::Result<()> {
    let Request {
        head,
        payload,
        tail,
    } = request;
    let mut slices = [&head[..], payload, tail].map(IoSlice::new);
    let mut rest = &mut slices[..];
    while !rest.is_empty() {
        match stream.write_vectored(rest).await? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            written => IoSlice::advance_slices(&mut rest, written),
        }
    }
    Ok(())
}

async fn answer(stream: &mut TcpStream) -> Result<(ResponseHead, bool), Failed> {
    let mut octets = BytesMut::with_capacity(ANSWER);
    loop {
        match response::read(&octets) {
            Progress::More => {}
            // 100 Continue and the like: the answer itself follows.
            Progress::Head(head, length) if head.status < 200 => {
                let _ = octets.split_to(length);
                continue;
            }
            Progress::Head(head, length) => {
                let _ = octets.split_to(length);
                let reusable = head.keeps_alive && skip_body(stream, &head, octets.len()).await;
                return Ok((head, reusable));
            }
            Progress::Broken(reason) => return Err(Failed::Broken(reason.to_owned())),
        }
        // What is left of the answer before says nothing about this letter.
        let silent = !response::has_begun(&octets);
        let failed = |error| match silent {
            true => Failed::Silent(error),
            false => Failed::Broken(format!("the answer broke off: {error}")),
        };
        match stream.read_buf(&mut octets).await {
            Ok(0) => return Err(failed(io::ErrorKind::UnexpectedEof.into())),
            Ok(_) => {}
            Err(error) => return Err(failed(error)),
        }
    }
}

/// Reads what is left of a body whose length was told; `come` octets of it are there.
async fn skip_body(stream: &mut TcpStream, head: &ResponseHead, come: usize) -> bool {
    let left = match head.body {
        // Where the length was not told, what comes is skipped in front of the next answer.
        None => return true,
        Some(length) if length > MAX_BODY => return false,
        Some(length) => length.saturating_sub(come as u64),
    };
    if left == 0 {
        return true;
    }
    let mut rest = stream.take(left);
    let mut sink = tokio::io::sink();
    matches!(tokio::io::copy(&mut rest, &mut sink).await, Ok(read) if read == left)
}
