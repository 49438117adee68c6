//! Recorded requests, made to fit where they are sent now, and sending them.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;

use bytes::Bytes;
use fipa::{Message, Representation};
use fipa_codec::{Limits, decode_message};

use crate::support::PATIENCE;

/// The ports at which whoever was recorded could be answered.
const ANSWERS: [&str; 7] = ["9991", "9992", "9994", "9995", "9996", "7780", "7781"];

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/jade")
}

pub(crate) fn recorded(file: &str) -> Vec<u8> {
    fs::read(folder().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The recordings whose files have this ending, without it, in order.
pub(crate) fn recordings(ending: &str) -> Vec<String> {
    let files = fs::read_dir(folder()).unwrap();
    let names = files.map(|file| file.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names
        .filter_map(|name| Some(name.strip_suffix(ending)?.to_owned()))
        .collect();
    names.sort();
    names
}

/// What JADE answered.
pub(crate) fn jades(name: &str) -> Message {
    let octets = Bytes::from(recorded(&format!("{name}.reply.acl")));
    let representation = match octets.first() {
        Some(b'(') => Representation::String,
        Some(b'<') => Representation::Xml,
        _ => Representation::BitEfficient,
    };
    decode_message(&representation, &octets, &Limits::default()).unwrap()
}

/// A recorded request whose answers go to another port, with the lengths that this makes: JADE
/// looks at none, and not every one was recorded with its own.
pub(crate) fn request(file: &str, port: u16) -> Vec<u8> {
    let mut octets = recorded(file);
    let mut done = Vec::new();
    // One of them holds two requests.
    while let Some(second) = find(&octets[1..], b"\r\nPOST ") {
        let rest = octets.split_off(second + 3);
        done.extend(fitted(&octets, port));
        octets = rest;
    }
    done.extend(fitted(&octets, port));
    done
}

fn fitted(octets: &[u8], port: u16) -> Vec<u8> {
    let end = find(octets, b"\r\n\r\n").map(|at| at + 4);
    let end = end
        .or_else(|| find(octets, b"\n\n").map(|at| at + 2))
        .unwrap();
    let (head, body) = octets.split_at(end);
    let head = String::from_utf8(head.to_vec()).unwrap();
    let in_chunks = head.contains("Transfer-Encoding: chunked");
    let mut body = match in_chunks {
        true => joined(body),
        false => body.to_vec(),
    };
    for recorded in ANSWERS {
        let (from, to) = (format!("127.0.0.1:{recorded}"), format!("127.0.0.1:{port}"));
        body = replaced(&body, from.as_bytes(), to.as_bytes());
    }
    if in_chunks {
        return [head.as_bytes(), &cut(&body)].concat();
    }
    let fields = head.split_inclusive('\n').map(|field| {
        let length = field.strip_prefix("Content-Length: ");
        let ending = field.trim_start_matches(|c: char| c != '\r' && c != '\n');
        length.map_or(field.to_owned(), |_| {
            format!("Content-Length: {}{ending}", body.len())
        })
    });
    let head: String = fields.collect();
    [head.as_bytes(), &body, b"\r\n"].concat()
}

fn find(octets: &[u8], what: &[u8]) -> Option<usize> {
    octets.windows(what.len()).position(|window| window == what)
}

fn replaced(mut octets: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut done = Vec::new();
    while let Some(at) = find(octets, from) {
        done.extend_from_slice(&octets[..at]);
        done.extend_from_slice(to);
        octets = &octets[at + from.len()..];
    }
    done.extend_from_slice(octets);
    done
}

/// What chunks hold.
fn joined(mut chunks: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    loop {
        let line = find(chunks, b"\r\n").unwrap();
        let length = std::str::from_utf8(&chunks[..line]).unwrap();
        let length = usize::from_str_radix(length, 16).unwrap();
        if length == 0 {
            return body;
        }
        body.extend_from_slice(&chunks[line + 2..line + 2 + length]);
        chunks = &chunks[line + 2 + length + 2..];
    }
}

fn cut(body: &[u8]) -> Vec<u8> {
    let chunks = body.chunks(200).map(|chunk| {
        let length = format!("{:x}\r\n", chunk.len());
        [length.as_bytes(), chunk, b"\r\n"].concat()
    });
    let mut all: Vec<u8> = chunks.flatten().collect();
    all.extend_from_slice(b"0\r\n\r\n");
    all
}

/// Sends octets over a connection of their own; the status of so many answers.
pub(crate) fn post(url: &str, octets: &[u8], answers: usize) -> Vec<u16> {
    let authority = url.strip_prefix("http://").unwrap();
    let authority = authority.split('/').next().unwrap();
    let mut stream = TcpStream::connect(authority).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(octets).unwrap();
    (0..answers).map(|_| status(&mut stream)).collect()
}

/// The status of the next answer, once its head has come. That the rest may be sent is none.
fn status(stream: &mut TcpStream) -> u16 {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut octet = [0];
        stream.read_exact(&mut octet).expect("no answer");
        head.push(octet[0]);
    }
    let head = String::from_utf8(head).unwrap();
    match head.split(' ').nth(1).unwrap().parse().unwrap() {
        100 => status(stream),
        // What JADE needs so that it can use the connection again.
        200 if head.contains("\r\nConnection: Keep-Alive\r\n") => {
            let is_empty = head.contains("\r\nContent-Length: 0\r\n");
            assert!(
                is_empty || head.contains("\r\nContent-Type: text/plain"),
                "{head}"
            );
            200
        }
        status => status,
    }
}
