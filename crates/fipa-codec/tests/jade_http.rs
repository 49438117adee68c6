//! Recorded HTTP requests between JADE and others: the two parts of each body are an envelope in XML
//! and a message in whichever form.

mod support;

use bytes::Bytes;
use fipa_acl::{Envelope, Expression, Message, Performative, Representation};
use fipa_codec::{
    DecodeError, Fault, Limits, decode_envelope, decode_payload, payload_representation,
};
use serde_json::Value;
use support::{index, recording, string};

/// The envelope and the payload in the body of a request.
fn parts(request: &Bytes) -> Option<(Bytes, Bytes)> {
    let head = find(request, b"\r\n\r\n", 0)?;
    let name = find(&request.slice(..head), b"boundary=\"", 0)? + 10;
    let end = find(request, b"\"", name)?;
    let delimiter = [b"--", &request[name..end]].concat();
    let mut at = find(request, &delimiter, head)?;
    let mut part = || {
        let begin = find(request, b"\r\n\r\n", at)? + 4;
        at = find(request, &[b"\r\n", &delimiter[..]].concat(), begin)?;
        let part = request.slice(begin..at);
        at += 2;
        Some(part)
    };
    Some((part()?, part()?))
}

fn find(octets: &[u8], wanted: &[u8], from: usize) -> Option<usize> {
    let mut windows = octets.get(from..)?.windows(wanted.len());
    windows.position(|here| here == wanted).map(|at| from + at)
}

/// The entries of the index of this kind, by file.
fn requests(kind: &str) -> Vec<(String, Value)> {
    let entries = index("jade/index.json").into_iter();
    entries
        .filter(|entry| entry["kind"] == kind)
        .map(|entry| (string(&entry["file"]), entry))
        .collect()
}

fn envelope(octets: &Bytes) -> Result<Envelope, DecodeError> {
    let (envelope, used) = decode_envelope(octets, &Limits::default())?;
    assert_eq!(used, octets.len());
    Ok(envelope)
}

fn message(envelope: &Envelope, payload: &Bytes) -> Result<Message, DecodeError> {
    decode_payload(envelope, payload, &Limits::default())
}

/// The letter in the body of a request that can be read.
fn letter(file: &str) -> (Envelope, Message) {
    let (head, payload) = parts(&recording(&format!("jade/{file}"))).unwrap();
    let envelope = envelope(&head).unwrap();
    let message = message(&envelope, &payload).unwrap();
    (envelope, message)
}

#[test]
fn letters_of_jade_are_those_that_were_recorded_alone() {
    let mut seen = 0;
    for (file, entry) in requests("http-request") {
        let Some(representation) = entry["representation"].as_str() else {
            continue;
        };
        let alone = |kind: &str| recording(&format!("jade/{}", file.replace(".http", kind)));
        let (head, payload) = parts(&recording(&format!("jade/{file}"))).unwrap();
        assert!(
            head == alone(".env.xml") && payload == alone(".acl"),
            "{file}"
        );
        let envelope = envelope(&head).unwrap();
        assert_eq!(
            envelope.payload_length(),
            Some(payload.len() as u64),
            "{file}"
        );
        let expected = match representation {
            "be" => Representation::BitEfficient,
            "string" => Representation::String,
            _ => Representation::Xml,
        };
        let named = payload_representation(&envelope, &payload);
        assert_eq!(named, Some(expected), "{file}");
        let message = message(&envelope, &payload).unwrap();
        // JADE writes the addresses of its transport into both.
        let from = envelope.from().unwrap();
        let sender = message.sender.unwrap();
        assert_eq!(
            (&from.name, &from.addresses),
            (&sender.name, &sender.addresses),
            "{file}"
        );
        // Each receiver gets its own envelope.
        let [intended] = envelope.intended_receiver() else {
            panic!("{file}: not one intended receiver");
        };
        let receivers = message.receiver.iter().map(|agent| &agent.name);
        assert!(
            receivers.clone().any(|name| *name == intended.name),
            "{file}"
        );
        assert!(
            receivers.eq(envelope.to().iter().map(|agent| &agent.name)),
            "{file}"
        );
        seen += 1;
    }
    assert_eq!(seen, 113);
}

/// Requests whose envelope or message must not be read, or that no parts can be found in, and why.
fn unreadable(file: &str) -> Option<(&'static str, Fault)> {
    Some(match file {
        // JADE drops it too.
        "in2_bad-rep.req.http" => ("nobody here knows this representation", Fault::Unsupported),
        // A date as the web has it.
        "in2_date-bad.req.http" => ("a date is like 20260102T030405678Z", Fault::Violation),
        // The lengths of the chunks stand between the tags.
        "in2_http-chunked2.req.http" => ("no tag begins like this", Fault::Malformed),
        // An entity of its own.
        "in2_http-xml-doctype.req.http" => ("an internal subset", Fault::Unsupported),
        _ => return None,
    })
}

/// Requests whose parts only an HTTP server could look for: no body, other line ends, a boundary
/// without quotes.
const NO_PARTS: [&str; 3] = [
    "in2_http-get.req.http",
    "in2_http-lf-only.req.http",
    "in2_http-unquoted-boundary.req.http",
];

/// What a letter that was sent to JADE has for a length and a conversation where they are not those
/// of its payload and its case.
fn oddity(file: &str) -> Option<(Option<u64>, Option<&'static str>)> {
    Some(match file {
        "in2_http-empty-envelope.req.http" => (None, None),
        "in2_wrong-payload-length.req.http" => (Some(7), Some("in-wrong-payload-length")),
        _ => return None,
    })
}

#[test]
fn letters_that_were_sent_to_jade_are_read() {
    let (mut seen, mut without_parts, mut refused) = (0, 0, 0);
    for (file, entry) in requests("http-request") {
        if entry["representation"].is_string() {
            continue;
        }
        let Some((head, payload)) = parts(&recording(&format!("jade/{file}"))) else {
            assert!(NO_PARTS.contains(&&*file), "{file}");
            without_parts += 1;
            continue;
        };
        let read = envelope(&head).and_then(|envelope| {
            let message = message(&envelope, &payload)?;
            Ok((envelope, message))
        });
        let (envelope, message) = match (read, unreadable(&file)) {
            (Ok(read), None) => read,
            (Err(error), Some((what, fault))) => {
                assert!(error.what.starts_with(what), "{file}: {error}");
                assert_eq!(error.fault, fault, "{file}");
                refused += 1;
                continue;
            }
            (read, expected) => panic!("{file}: {read:?}, not {expected:?}"),
        };
        let id = message
            .conversation_id
            .as_ref()
            .and_then(Expression::as_str);
        match oddity(&file) {
            Some(odd) => assert_eq!((envelope.payload_length(), id), odd, "{file}"),
            None => {
                let length = Some(payload.len() as u64);
                assert_eq!(envelope.payload_length(), length, "{file}");
                assert_eq!(
                    envelope.from().unwrap().name,
                    message.sender.unwrap().name,
                    "{file}"
                );
                assert!(id.is_some(), "{file}");
            }
        }
        if file == "in2_unknown-performative.req.http" {
            assert_eq!(message.performative, Performative::Other("SHOUT".into()));
        } else {
            assert!(
                !matches!(message.performative, Performative::Other(_)),
                "{file}"
            );
        }
        seen += 1;
    }
    assert_eq!((seen, without_parts, refused), (102, 3, 4));
}

/// Requests to the agent that sends contents back, whose answer has another content.
const ECHOED_OTHERWISE: [&str; 5] = [
    // ISO-8859-1 is not copied into the answer, so two octets of it became question marks.
    "in_echo-ble-binary",
    // Without a charset JADE reads and writes US-ASCII.
    "in_echo-utf8-nodecl",
    // The XML add-on puts blanks around references, and does not undo Base64.
    "in2_xml-echo",
    "in2_xml-echo-href",
    "in2_xml-echo-b64",
];

/// Answers that are none: a notification of a subscriber, and a search that is passed on.
const NO_ANSWERS: [&str; 2] = [
    "in_df-deregister-notify.reply.http",
    "in_df-search-federated.reply.http",
];

/// JADE copies from the request what it has read there: so what is read here is the same.
#[test]
fn answers_of_jade_belong_to_the_requests_as_they_are_read_here() {
    let (mut answers, mut echoes) = (0, 0);
    for (file, _) in requests("http-request carrying JADE's reply") {
        let (head, payload) = parts(&recording(&format!("jade/{file}"))).unwrap();
        assert_eq!(
            payload,
            recording(&format!("jade/{}", file.replace(".http", ".acl")))
        );
        let (envelope, answer) = letter(&file);
        assert_eq!(
            envelope.payload_length(),
            Some(payload.len() as u64),
            "{file}"
        );
        assert!(!head.is_empty());
        let case = file.split(".reply").next().unwrap();
        let (_, request) = letter(&format!("{case}.req.http"));
        if NO_ANSWERS.contains(&&*file) {
            assert_ne!(answer.conversation_id, request.conversation_id, "{file}");
            continue;
        }
        assert_eq!(answer.in_reply_to, request.reply_with, "{file}");
        assert_eq!(answer.conversation_id, request.conversation_id, "{file}");
        assert_eq!(answer.protocol, request.protocol, "{file}");
        let asked = request
            .receiver
            .first()
            .map(|agent| agent.name.to_ascii_lowercase());
        let answers_for = answer
            .sender
            .as_ref()
            .map(|agent| agent.name.to_ascii_lowercase());
        let is_echo = asked.as_deref() == Some("echo@plata") && answers_for == asked;
        if is_echo {
            let echoed = !ECHOED_OTHERWISE.contains(&case);
            assert_eq!(answer.content == request.content, echoed, "{file}");
            echoes += 1;
        }
        answers += 1;
    }
    assert_eq!((answers, echoes), (65, 27));
}
