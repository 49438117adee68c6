use std::fmt;
use std::io::Write;
use std::str::FromStr;

use super::multipart::{Boundary, Multipart};

/// Octets of a payload that is copied to what stands around it; a larger one is written from where
/// it is.
const MAX_COPIED: usize = 16 << 10;

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

/// The field of a request with the number of its letter.
pub(super) const NUMBER: &str = "x-letter";

/// The field of an answer with how many requests may be on their way over the connection, if they
/// have numbers.
pub(super) const AHEAD: &str = "x-ahead";

/// The number of a letter that is posted before the one in front of it was answered. Whoever posts
/// it again gives it the same one. Letters of one series come in the order of their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LetterNumber {
    /// Chosen at random by the client for each place.
    pub series: u64,
    /// From 1.
    pub number: u64,
}

impl fmt::Display for LetterNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}.{}", self.series, self.number)
    }
}

impl FromStr for LetterNumber {
    type Err = ();

    fn from_str(text: &str) -> Result<LetterNumber, ()> {
        let (series, number) = text.split_once('.').ok_or(())?;
        Ok(LetterNumber {
            series: u64::from_str_radix(series, 16).map_err(drop)?,
            number: number.parse().map_err(drop)?,
        })
    }
}

/// A request, in parts that are written at once.
pub(super) struct Request<'a> {
    pub(super) head: Vec<u8>,
    /// Empty where it stands in the head.
    pub(super) payload: &'a [u8],
    pub(super) tail: Vec<u8>,
}

impl<'a> Request<'a> {
    /// A request of its own, or one of a series.
    pub(super) fn of(
        letter: &HttpLetter<'a>,
        boundary: &Boundary,
        number: Option<LetterNumber>,
    ) -> Request<'a> {
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
        head.extend_from_slice(b"\r\nConnection: Keep-Alive\r\n");
        if let Some(number) = number {
            let _ = write!(head, "{NUMBER}: {number}\r\n");
        }
        head.extend_from_slice(b"\r\n");
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
