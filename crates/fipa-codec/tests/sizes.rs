//! Octets of the benchmark message of fipa_acl with one octet of content, and of the letters
//! around it, beside those of fipa_acl's own encoders.

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Message, Performative, Representation, Slots};
use fipa_codec::bit_efficient::{CodeTable, encode_message_with};
use fipa_codec::{EnvelopeRepresentation, Output, encode_letter, encode_message};

/// Octets of a message, and with either envelope around it.
struct Sizes {
    representation: Representation,
    message: [usize; 2],
    bit_efficient_letter: [usize; 2],
    xml_letter: [usize; 2],
}

/// Ours, and those of fipa_acl.
const SIZES: [Sizes; 3] = [
    Sizes {
        representation: Representation::BitEfficient,
        message: [160, 162],
        bit_efficient_letter: [239, 242],
        xml_letter: [645, 647],
    },
    Sizes {
        representation: Representation::String,
        message: [350, 330],
        bit_efficient_letter: [429, 410],
        xml_letter: [829, 809],
    },
    Sizes {
        representation: Representation::Xml,
        message: [608, 624],
        bit_efficient_letter: [687, 704],
        xml_letter: [1084, 1100],
    },
];

#[test]
fn sizes_are_those_of_the_table() {
    for sizes in SIZES {
        let message = written(&sizes.representation);
        let letter = |form| letter(&sizes.representation, &message, form).len();
        let measured = [
            message.len(),
            letter(EnvelopeRepresentation::BitEfficient),
            letter(EnvelopeRepresentation::Xml),
        ];
        let expected = sizes.columns().map(|[ours, _]| ours);
        assert_eq!(measured, expected, "{:?}", sizes.representation);
    }
}

/// A code table of so many entries, and octets of the bit-efficient message and of the letters
/// around it: when the table is empty, and when the same message went before.
struct WithTable {
    entries: usize,
    cold: [usize; 3],
    warm: [usize; 3],
}

const WITH_TABLE: [WithTable; 2] = [
    WithTable {
        entries: 256,
        cold: [155, 234, 640],
        warm: [55, 134, 539],
    },
    WithTable {
        entries: 65_536,
        cold: [156, 235, 641],
        warm: [64, 143, 548],
    },
];

#[test]
fn sizes_with_a_code_table_are_those_of_the_table() {
    let representation = Representation::BitEfficient;
    for sizes in WITH_TABLE {
        let mut table = CodeTable::new(sizes.entries).unwrap();
        for expected in [sizes.cold, sizes.warm] {
            let mut out = Output::new();
            encode_message_with(&message(), &mut table, &mut out).unwrap();
            let message = out.take_bytes();
            let letter = |form| letter(&representation, &message, form).len();
            let measured = [
                message.len(),
                letter(EnvelopeRepresentation::BitEfficient),
                letter(EnvelopeRepresentation::Xml),
            ];
            assert_eq!(measured, expected, "{} entries", sizes.entries);
        }
    }
}

#[test]
fn nothing_is_longer_than_what_fipa_acl_writes() {
    for sizes in SIZES {
        let blanks = blanks(&sizes.representation);
        for [ours, theirs] in sizes.columns() {
            assert!(ours - blanks <= theirs, "{:?}", sizes.representation);
        }
    }
}

/// Those between the tokens of the string form: fipa_acl leaves them out, so that only readers
/// that know all keywords find where one ends.
fn blanks(representation: &Representation) -> usize {
    if *representation != Representation::String {
        return 0;
    }
    let message = written(representation);
    let outside_quotes = message.split(|octet| *octet == b'"').step_by(2);
    let blanks = |text: &[u8]| text.iter().filter(|octet| **octet == b' ').count();
    outside_quotes.map(blanks).sum()
}

impl Sizes {
    fn columns(&self) -> [[usize; 2]; 3] {
        [self.message, self.bit_efficient_letter, self.xml_letter]
    }
}

fn written(representation: &Representation) -> Bytes {
    let mut out = Output::new();
    encode_message(representation, &message(), &mut out).unwrap();
    out.take_bytes()
}

fn letter(representation: &Representation, message: &Bytes, form: EnvelopeRepresentation) -> Bytes {
    let letter = Letter {
        envelope: envelope(representation, message.len()),
        payload: message.clone(),
    };
    let mut out = Output::new();
    encode_letter(form, &letter, &mut out).unwrap();
    out.take_bytes()
}

/// 99 octets of information, as its authors count: the protocol is not among them.
fn message() -> Message {
    Message::new(Performative::Request)
        .from_agent("proxy")
        .to("crex_0")
        .reply_to("proxy")
        .protocol("RIMRES")
        .language("test language")
        .encoding("test encoding")
        .ontology("test ontology")
        .reply_with("test reply_with")
        .reply_by(FipaTime::from_unix_millis(1_293_105_637_980))
        .conversation_id("test conversationID")
        .content("A")
}

fn envelope(representation: &Representation, octets: usize) -> Envelope {
    Envelope::new(Slots {
        to: vec![AgentId::new("crex_0")],
        from: Some(AgentId::new("proxy")),
        intended_receiver: vec![AgentId::new("crex_0")],
        acl_representation: Some(representation.clone()),
        payload_length: Some(octets as u64),
        payload_encoding: Some("test encoding".into()),
        date: Some(FipaTime::from_unix_millis(1_399_470_309_123)),
        ..Slots::default()
    })
}
