//! Requests as they were sent to JADE, sent to a daemon of ours that bears its platform's name.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;

use bytes::Bytes;
use fipa::{Message, Performative, Representation};
use fipa_codec::{Limits, decode_message};

use crate::agents::{HTTP, http_of};
use crate::fake::Jade;
use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};

fn recorded(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/jade");
    fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// A recorded request whose answers go to another port, with the length that it has: JADE looks at
/// none, and not every one was recorded with its own.
fn request(name: &str, port: u16) -> Vec<u8> {
    let octets = recorded(&format!("{name}.req.http"));
    let end = octets.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4;
    let (head, body) = octets.split_at(end);
    let mut head = String::from_utf8(head.to_vec()).unwrap();
    let ours = format!("127.0.0.1:{port}");
    let body = replaced(body, b"127.0.0.1:9991", ours.as_bytes());
    let body = replaced(&body, b"127.0.0.1:9992", ours.as_bytes());
    if let Some(field) = head
        .split("\r\n")
        .find(|field| field.starts_with("Content-Length: "))
    {
        head = head.replace(field, &format!("Content-Length: {}", body.len()));
    }
    [head.as_bytes(), &body, b"\r\n"].concat()
}

fn replaced(mut octets: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut done = Vec::new();
    while let Some(at) = octets.windows(from.len()).position(|w| w == from) {
        done.extend_from_slice(&octets[..at]);
        done.extend_from_slice(to);
        octets = &octets[at + from.len()..];
    }
    done.extend_from_slice(octets);
    done
}

fn post(daemon: &Daemon, request: &[u8]) -> String {
    let url = http_of(daemon);
    let authority = url
        .strip_prefix("http://")
        .unwrap()
        .split('/')
        .next()
        .unwrap();
    let mut stream = TcpStream::connect(authority).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(request).unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).unwrap();
    String::from_utf8(answer.to_vec()).unwrap()
}

/// What JADE answered.
fn jades(name: &str) -> Message {
    let octets = Bytes::from(recorded(&format!("{name}.reply.acl")));
    let representation = match octets.first() {
        Some(b'(') => Representation::String,
        Some(b'<') => Representation::Xml,
        _ => Representation::BitEfficient,
    };
    decode_message(&representation, &octets, &Limits::default()).unwrap()
}

#[test]
fn every_recorded_request_to_an_echo_agent_gets_the_answer_that_jade_gave() {
    let (place, fake) = (Place::new(), Jade::silent("pyplat"));
    let daemon = place.start_with("platA", &HTTP);
    let _echo = daemon.attach("echo", "echo@platA");
    for name in [
        "in_echo-basic",
        "in_echo-base64",
        "in_echo-ble",
        "in_echo-lowercase-act",
        "in_echo-quotes",
        "in_echo-sender-noaddr",
        "in_echo-upper-hap",
        "in_echo-uri-path",
        "in_echo-utf8-decl",
        "in_echo-word-content",
        "in_payload-newline-end",
        "in2_content-type-acl",
        "in2_date-T",
        "in2_rep-upper",
        "in2_wrong-payload-length",
    ] {
        assert_eq!(
            post(&daemon, &request(name, fake.port)),
            "HTTP/1.1 200",
            "{name}"
        );
        let (ours, jades) = (fake.letter().message, jades(name));
        assert_eq!(ours.performative, Performative::Inform, "{name}");
        assert_eq!(ours.in_reply_to, jades.in_reply_to, "{name}");
        assert_eq!(ours.conversation_id, jades.conversation_id, "{name}");
        assert_eq!(ours.content, jades.content, "{name}");
    }
}

#[test]
fn recorded_requests_of_every_shape_are_taken_over() {
    let place = Place::new();
    let daemon = place.start_with("platA", &HTTP);
    for name in [
        "in2_http-blank-preamble",
        "in2_http-conn-lower",
        "in2_http-conn-none",
        "in2_http-crlf-preamble",
        "in2_http-ct-nospace",
        "in2_http-expect100",
        "in2_http-http10",
        "in2_http-no-host",
        "in2_http-no-mime",
        "in2_http-no-tail",
        "in2_http-otherpath",
        "in2_http-part-extra-headers",
        "in2_http-unquoted-boundary",
        "in2_http-xml-multiline",
        "in2_http-xml-ns",
        "in2_http-xml-prefix",
        "in2_env-no-date",
    ] {
        let answer = post(&daemon, &request(name, 1));
        let taken = ["HTTP/1.1 200", "HTTP/1.0 200", "HTTP/1.1 100"];
        assert!(taken.contains(&answer.as_str()), "{name}: {answer}");
    }
    for (name, status) in [
        ("in2_http-get", "HTTP/1.1 200"),
        ("in2_http-put", "HTTP/1.1 405"),
        ("in2_http-no-content-length", "HTTP/1.1 411"),
        ("in2_http-empty-envelope", "HTTP/1.1 400"),
        // It declares an entity.
        ("in2_http-xml-doctype", "HTTP/1.1 400"),
        // Header lines are not folded any more (RFC 9112 section 5.2).
        ("in2_http-ct-folded", "HTTP/1.1 400"),
    ] {
        let answer = post(&daemon, &request(name, 1));
        assert_eq!(answer, status, "{name}");
    }
}

#[test]
fn recorded_requests_to_the_management_are_answered_as_jade_does() {
    let (place, fake) = (Place::new(), Jade::silent("pyplat"));
    let daemon = place.start_with("platA", &HTTP);
    // In this order, as a later one may need what an earlier one did.
    for name in [
        "in_df-register",
        "in_df-search-type",
        "in_df-search-none",
        "in_df-lower-ontology",
        "in_df-no-protocol",
        "in_df-register-noname",
        "in_df-unknown-action",
        "in_df-bad-content",
        "in_df-deregister",
        "in_ams-search-name",
    ] {
        assert_eq!(
            post(&daemon, &request(name, fake.port)),
            "HTTP/1.1 200",
            "{name}"
        );
        let (ours, jades) = (fake.letter().message, jades(name));
        assert_eq!(ours.performative, jades.performative, "{name}: {ours:?}");
        assert_eq!(ours.in_reply_to, jades.in_reply_to, "{name}");
        assert_eq!(ours.conversation_id, jades.conversation_id, "{name}");
    }
    // Strangers are not registered as agents of our platform.
    assert_eq!(
        post(&daemon, &request("in_ams-register", fake.port)),
        "HTTP/1.1 200"
    );
    assert_eq!(fake.letter().message.performative, Performative::Refuse);
}
