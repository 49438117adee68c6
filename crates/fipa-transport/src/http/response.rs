//! The head of an answer, as JADE and others write it.

use super::client::{PostError, TakenOver};
use super::request::AHEAD;

/// Octets in front of a status line that are skipped: what is left of the body of the answer
/// before, whose length nobody was told.
const MAX_JUNK: usize = 64 << 10;

/// Octets of the head of an answer at most.
const MAX_HEAD: usize = 16 << 10;

/// Fields of the head of an answer at most.
const MAX_FIELDS: usize = 64;

/// The head of an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ResponseHead {
    pub(super) status: u16,
    pub(super) reason: String,
    /// Octets of the body, if that is told.
    pub(super) body: Option<u64>,
    /// Whether the next request may go over the same connection.
    pub(super) keeps_alive: bool,
    /// Requests that may be on their way over the connection, if they have numbers.
    pub(super) ahead: usize,
}

impl ResponseHead {
    /// Only 200 says that a letter was taken over.
    pub(super) fn into_answer(self) -> Result<TakenOver, PostError> {
        match self.status {
            200 => Ok(TakenOver { ahead: self.ahead }),
            status => Err(PostError::Refused {
                status,
                reason: self.reason,
            }),
        }
    }
}

/// What is to be done with the octets that have come.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// More are needed.
    More,
    /// A head is whole; so many octets belong to it or stand in front of it.
    Head(ResponseHead, usize),
    /// That is no answer.
    Broken(&'static str),
}

/// Reads the next head. Lines in front of its status line are skipped: JADE's answers have bodies
/// without a length on connections that stay open.
pub(super) fn read(octets: &[u8]) -> Progress {
    let Some(begin) = status_line(octets) else {
        return match octets.len() > MAX_JUNK {
            true => Progress::Broken("no status line has come"),
            false => Progress::More,
        };
    };
    let rest = octets.get(begin..).unwrap_or_default();
    let mut fields = [httparse::EMPTY_HEADER; MAX_FIELDS];
    let mut response = httparse::Response::new(&mut fields);
    match response.parse(rest) {
        Ok(httparse::Status::Complete(length)) => match head(&response) {
            Some(head) => Progress::Head(head, begin + length),
            None => Progress::Broken("the answer's length cannot be read"),
        },
        Ok(httparse::Status::Partial) if rest.len() <= MAX_HEAD => Progress::More,
        Ok(httparse::Status::Partial) => Progress::Broken("the head of the answer is too long"),
        Err(_) => Progress::Broken("the head of the answer cannot be read"),
    }
}

/// Whether the octets hold the beginning of an answer, and not only what is left of the one before.
pub(super) fn has_begun(octets: &[u8]) -> bool {
    status_line(octets).is_some()
}

/// Where the first line begins that is a status line.
fn status_line(octets: &[u8]) -> Option<usize> {
    const BEGIN: &[u8] = b"HTTP/1.";
    let mut at = 0;
    loop {
        let rest = octets.get(at..)?;
        if rest.starts_with(BEGIN) {
            return Some(at);
        }
        at += memchr::memchr(b'\n', rest)? + 1;
    }
}

fn head(response: &httparse::Response<'_, '_>) -> Option<ResponseHead> {
    let status = response.code?;
    let mut body = None;
    let mut keeps_alive = true;
    let mut ahead = 0;
    for field in response.headers.iter() {
        let value = || String::from_utf8_lossy(field.value);
        if field.name.eq_ignore_ascii_case("content-length") {
            body = Some(value().trim().parse().ok()?);
        } else if field.name.eq_ignore_ascii_case("transfer-encoding") {
            // Its end is not looked for.
            keeps_alive = false;
        } else if field.name.eq_ignore_ascii_case("connection") {
            let closes = |word: &str| word.trim().eq_ignore_ascii_case("close");
            keeps_alive &= !value().split(',').any(closes);
        } else if field.name.eq_ignore_ascii_case(AHEAD) {
            ahead = value().trim().parse().unwrap_or_default();
        }
    }
    if matches!(status, 100..=199 | 204 | 304) {
        body = Some(0);
    }
    Some(ResponseHead {
        status,
        reason: response.reason.unwrap_or_default().to_owned(),
        body,
        keeps_alive,
        ahead,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head_of(octets: &[u8]) -> (ResponseHead, usize) {
        match read(octets) {
            Progress::Head(head, length) => (head, length),
            other => panic!("{other:?}"),
        }
    }

    const JADE: &[u8] = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\n\
        Cache-Control: no-cache\r\nConnection: Keep-Alive\r\n\r\n";

    #[test]
    fn an_answer_ends_with_its_head_where_it_tells_no_length() {
        let (head, length) = head_of(JADE);
        assert_eq!((head.status, head.body, length), (200, None, JADE.len()));
        assert!(head.keeps_alive);
    }

    #[test]
    fn what_is_left_of_the_answer_before_is_skipped() {
        let junk = b"<html><body><h1>200 OK</h1></body></html>\r\n";
        let (head, length) = head_of(&[junk, JADE].concat());
        assert_eq!((head.status, length), (200, junk.len() + JADE.len()));
        for end in 0..junk.len() + JADE.len() {
            assert_eq!(read(&[junk, JADE].concat()[..end]), Progress::More);
        }
    }

    #[test]
    fn what_is_left_of_the_answer_before_is_no_beginning() {
        let junk = b"<html><body><h1>200 OK</h1></body></html>\r\n";
        assert!(!has_begun(junk));
        assert!(!has_begun(b""));
        assert!(has_begun(&[&junk[..], b"HTTP/1.1 2"].concat()));
    }

    #[test]
    fn whoever_says_close_is_not_asked_again_on_the_same_connection() {
        let close = head_of(b"HTTP/1.0 200 OK\r\nconnection: Close\r\n\r\n").0;
        assert!(!close.keeps_alive);
        let chunks = head_of(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n").0;
        assert!(!chunks.keeps_alive);
        assert!(head_of(b"HTTP/1.0 200 OK\r\n\r\n").0.keeps_alive);
    }

    #[test]
    fn what_never_becomes_an_answer_is_given_up() {
        assert!(matches!(read(&[b'x'; MAX_JUNK + 1]), Progress::Broken(_)));
        let endless = [b"HTTP/1.1 200 OK\r\nA: ".to_vec(), vec![b'a'; MAX_HEAD]].concat();
        assert!(matches!(read(&endless), Progress::Broken(_)));
        let wrong = b"HTTP/1.1 200 OK\r\nContent-Length: many\r\n\r\n";
        assert!(matches!(read(wrong), Progress::Broken(_)));
    }
}
