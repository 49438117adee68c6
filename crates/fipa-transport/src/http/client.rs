use std::collections::HashMap;
use std::io::{self, IoSlice};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout_at};

use super::multipart::Multipart;
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

/// A letter to be posted.
#[derive(Clone, Debug)]
pub struct HttpLetter {
    /// The name or IP address of the host, without brackets.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// The path, with its slash.
    pub path: String,
    /// The envelope in XML.
    pub envelope: Bytes,
    /// The payload.
    pub payload: Bytes,
    /// The media type of the payload.
    pub payload_type: String,
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
#[derive(Debug, Default)]
pub struct HttpClient {
    idle: Mutex<HashMap<(String, u16), Vec<Idle>>>,
}

#[derive(Debug)]
struct Idle {
    stream: TcpStream,
    since: Instant,
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
        HttpClient::default()
    }

    /// Posts a letter and waits for the answer, no longer than this.
    ///
    /// A connection that was kept and ends without an answer says nothing about the letter: it is
    /// posted again, over a new one. The other side may so have it twice.
    pub async fn post(&self, letter: &HttpLetter, timeout: Duration) -> Result<(), PostError> {
        let deadline = Instant::now() + timeout;
        let request = Request::of(letter);
        let place = (letter.host.clone(), letter.port);
        if let Some(mut stream) = self.take_idle(&place) {
            match exchange(&mut stream, &request, deadline).await {
                Err(Failed::Unwritten(e) | Failed::Silent(e))
                    if e.kind() != io::ErrorKind::TimedOut =>
                {
                    // The others are as old.
                    self.forget(&place);
                }
                result => return self.conclude(place, stream, result),
            }
        }
        let mut stream = connect(letter, deadline)
            .await
            .map_err(|error| PostError::Unreached(error.to_string()))?;
        let result = exchange(&mut stream, &request, deadline).await;
        self.conclude(place, stream, result)
    }

    fn conclude(
        &self,
        place: (String, u16),
        stream: TcpStream,
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
            self.keep(place, stream);
        }
        match head.status {
            200 => Ok(()),
            status => Err(PostError::Refused {
                status,
                reason: head.reason,
            }),
        }
    }

    /// A connection to this place that is still open. What is left of an answer is dropped.
    fn take_idle(&self, place: &(String, u16)) -> Option<TcpStream> {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = idle.get_mut(place)?;
        let mut found = None;
        while let Some(Idle { stream, since }) = kept.pop() {
            if since.elapsed() < IDLE && is_open(&stream) {
                found = Some(stream);
                break;
            }
        }
        if kept.is_empty() {
            idle.remove(place);
        }
        found
    }

    fn keep(&self, place: (String, u16), stream: TcpStream) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.values().map(Vec::len).sum::<usize>() >= MAX_IDLE {
            idle.values_mut()
                .for_each(|kept| kept.retain(|one| one.since.elapsed() < IDLE));
            idle.retain(|_, kept| !kept.is_empty());
        }
        let full = idle.values().map(Vec::len).sum::<usize>() >= MAX_IDLE;
        let kept = idle.entry(place).or_default();
        if kept.len() < MAX_IDLE_A_PLACE && !full {
            let since = Instant::now();
            kept.push(Idle { stream, since });
        }
    }

    fn forget(&self, place: &(String, u16)) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        idle.remove(place);
    }
}

/// A request, in parts that are written at once.
struct Request {
    parts: [Bytes; 6],
}

impl Request {
    fn of(letter: &HttpLetter) -> Request {
        let mut random = fastrand::Rng::new();
        let HttpLetter {
            envelope, payload, ..
        } = letter;
        let body = Multipart::new(envelope, payload, &letter.payload_type, &mut random);
        let host = match letter.host.contains(':') {
            true => format!("[{}]:{}", letter.host, letter.port),
            false => format!("{}:{}", letter.host, letter.port),
        };
        // These fields in this order, each with one blank: JADE reads no others.
        let head = format!(
            "POST http://{host}{} HTTP/1.1\r\n\
             Cache-Control: no-cache\r\n\
             Mime-Version: 1.0\r\n\
             Host: {host}\r\n\
             Content-Type: multipart/mixed ; boundary=\"{}\"\r\n\
             Content-Length: {}\r\n\
             Connection: Keep-Alive\r\n\r\n",
            letter.path,
            body.boundary,
            body.len(),
        );
        let [a, b, c, d, e] = body.parts;
        Request {
            parts: [head.into(), a, b, c, d, e],
        }
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

async fn connect(letter: &HttpLetter, deadline: Instant) -> io::Result<TcpStream> {
    let attempt = async {
        let mut last = io::Error::other("the host name has no address");
        for address in tokio::net::lookup_host((letter.host.as_str(), letter.port)).await? {
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
    request: &Request,
    deadline: Instant,
) -> Result<(ResponseHead, bool), Failed> {
    let late = |what| io::Error::new(io::ErrorKind::TimedOut, what);
    timeout_at(deadline, write(stream, &request.parts))
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

async fn write(stream: &mut TcpStream, parts: &[Bytes]) -> io::Result<()> {
    let mut slices: Vec<IoSlice<'_>> = parts.iter().map(|part| IoSlice::new(part)).collect();
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
    let mut octets = BytesMut::new();
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
