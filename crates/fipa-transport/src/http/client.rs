use std::io::{self, IoSlice, Write};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use bytes::BytesMut;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout_at};

use super::multipart::{Boundary, Multipart};
use super::response::{self, Progress, ResponseHead};

/// How long a connection may take to open.
const CONNECT: Duration = Duration::from_secs(3);

/// How long an idle connection is kept. JADE closes it after 60 s.
const IDLE: Duration = Duration::from_secs(45);

/// Idle connections to one place, and to all places, at most. JADE keeps ten open.
const MAX_IDLE_A_PLACE: usize = 8;
const MAX_IDLE: usize = 256;

/// Octets of the rest of a body that are waited for, so that the connection can be used again.
const MAX_BODY: u64 = 64 << 10;

/// Octets of a payload that is copied to what stands around it; a larger one is written from where
/// it is.
const MAX_COPIED: usize = 16 << 10;

/// Octets of an ordinary answer's head.
const ANSWER: usize = 512;

/// A letter to be posted.
#[derive(Clone, Copy, Debug)]
pub struct HttpLetter<'a> {
    /// The name or IP address of the host, without brackets.
    pub host: &'a str,
    /// Its port.
    pub port: u16,
    /// The path, with its slash.
    pub path: &'a str,
    /// The envelope in XML.
    pub envelope: &'a [u8],
    /// The payload.
    pub payload: &'a [u8],
    /// The media type of the payload.
    pub payload_type: &'a str,
}

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

/// Posts letters, one at a time on each connection, and keeps connections for the next ones.
#[derive(Debug)]
pub struct HttpClient {
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
            idle: Mutex::default(),
            boundary: Boundary::random(&mut fastrand::Rng::new()),
        }
    }

    /// Posts a letter and waits for the answer, no longer than this.
    ///
    /// A connection that was kept and ends without an answer says nothing about the letter: it is
    /// posted again, over a new one. The other side may so have it twice.
    pub async fn post(&self, letter: HttpLetter<'_>, timeout: Duration) -> Result<(), PostError> {
        let deadline = Instant::now() + timeout;
        let request = Request::of(&letter, &self.boundary);
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
        let stream = connect(&letter, deadline)
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

    fn conclude(
        &self,
        used: Idle,
        result: Result<(ResponseHead, bool), Failed>,
    ) -> Result<(), PostError> {
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
        match head.status {
            200 => Ok(()),
            status => Err(PostError::Refused {
                status,
                reason: head.reason,
            }),
        }
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

/// A request, in parts that are written at once.
struct Request<'a> {
    head: Vec<u8>,
    /// Empty where it stands in the head.
    payload: &'a [u8],
    tail: Vec<u8>,
}

impl<'a> Request<'a> {
    fn of(letter: &HttpLetter<'a>, boundary: &Boundary) -> Request<'a> {
        let HttpLetter {
            envelope, payload, ..
        } = *letter;
        let body = Multipart::new(boundary, envelope, payload, letter.payload_type);
        let (is_copied, length) = (payload.len() <= MAX_COPIED, body.len());
        let written = if is_copied {
            length
        } else {
            length - payload.len()
        };
        let mut head = Vec::with_capacity(HEAD + written);
        head.extend_from_slice(b"POST http://");
        write_host(letter, &mut head);
        head.extend_from_slice(letter.path.as_bytes());
        // These fields in this order, each with one blank: JADE reads no others.
        head.extend_from_slice(
            b" HTTP/1.1\r\nCache-Control: no-cache\r\nMime-Version: 1.0\r\nHost: ",
        );
        write_host(letter, &mut head);
        head.extend_from_slice(b"\r\nContent-Type: multipart/mixed ; boundary=\"");
        head.extend_from_slice(body.boundary.as_str().as_bytes());
        head.extend_from_slice(b"\"\r\nContent-Length: ");
        // Writing to memory does not fail.
        let _ = write!(head, "{length}");
        head.extend_from_slice(b"\r\nConnection: Keep-Alive\r\n\r\n");
        body.write_head(&mut head);
        if is_copied {
            head.extend_from_slice(payload);
            body.write_tail(&mut head);
            return Request {
                head,
                payload: &[],
                tail: Vec::new(),
            };
        }
        let mut tail = Vec::new();
        body.write_tail(&mut tail);
        Request {
            head,
            payload,
            tail,
        }
    }
}

/// Octets of the head of a request, more or less.
const HEAD: usize = 512;

fn write_host(letter: &HttpLetter<'_>, head: &mut Vec<u8>) {
    // Writing to memory does not fail.
    let _ = match letter.host.contains(':') {
        true => write!(head, "[{}]:{}", letter.host, letter.port),
        false => write!(head, "{}:{}", letter.host, letter.port),
    };
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

async fn connect(letter: &HttpLetter<'_>, deadline: Instant) -> io::Result<TcpStream> {
    let attempt = async {
        let mut last = io::Error::other("the host name has no address");
        for address in tokio::net::lookup_host((letter.host, letter.port)).await? {
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
