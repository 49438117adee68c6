//! What the codecs do with the benchmark's message, one operation each.

use std::hint::black_box;

use bytes::{Buf, Bytes};
use fipa_acl::{Letter, Message, Representation};
use fipa_codec::{DecodeError, EncodeError, Limits, Output, bit_efficient, string, xml};

use crate::messages;

/// Something that can be done again and again.
pub struct Operation {
    /// Whether it writes or reads.
    pub task: Task,
    /// Which form, or which rival.
    pub by: &'static str,
    /// Does it once.
    pub run: Box<dyn FnMut()>,
}

/// What an operation is compared with: all that write, or all that read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// A message or letter to octets.
    Encode,
    /// Octets to an owned message or letter.
    Decode,
}

impl Task {
    /// Its name.
    pub fn as_str(self) -> &'static str {
        match self {
            Task::Encode => "encode",
            Task::Decode => "decode",
        }
    }
}

/// How a message or a letter is written and read.
struct Form<T> {
    name: &'static str,
    encode: fn(&T, &mut Output) -> Result<(), EncodeError>,
    decode: fn(&Bytes, &Limits) -> Result<T, DecodeError>,
}

const MESSAGES: [Form<Message>; 3] = [
    Form {
        name: "bit-efficient",
        encode: bit_efficient::encode_message,
        decode: bit_efficient::decode_message,
    },
    Form {
        name: "string",
        encode: string::encode_message,
        decode: string::decode_message,
    },
    Form {
        name: "xml",
        encode: xml::encode_message,
        decode: xml::decode_message,
    },
];

const LETTERS: [Form<Letter>; 2] = [
    Form {
        name: "bit-efficient-letter",
        encode: bit_efficient::encode_letter,
        decode: bit_efficient::decode_letter,
    },
    Form {
        name: "xml-letter",
        encode: xml::encode_letter,
        decode: xml::decode_letter,
    },
];

/// Everything the codecs do with a message with so many octets of content. The payload of the
/// letters is the bit-efficient message.
pub fn operations(octets: usize) -> Vec<Operation> {
    let message = messages::message(octets);
    let payload = written(&message, MESSAGES[0].encode);
    let envelope = messages::envelope(Representation::BitEfficient, payload.len());
    let letter = Letter { envelope, payload };
    let of_messages = MESSAGES.iter().flat_map(|form| form.operations(&message));
    let of_letters = LETTERS.iter().flat_map(|form| form.operations(&letter));
    let mut all: Vec<_> = of_messages.chain(of_letters).collect();
    all.push(in_one_piece(message));
    all
}

impl<T: Clone + 'static> Form<T> {
    fn operations(&self, value: &T) -> [Operation; 2] {
        let encode = encoding(value.clone(), self.encode, |out| {
            drop(black_box(out.take()))
        });
        let decode = decoding(written(value, self.encode), self.decode);
        [(Task::Encode, encode), (Task::Decode, decode)].map(|(task, run)| Operation {
            task,
            by: self.name,
            run,
        })
    }
}

/// Large contents are passed on by reference; here they are copied, as rivals do.
fn in_one_piece(message: Message) -> Operation {
    let finish = |out: &mut Output| {
        let mut parts = out.take();
        black_box(parts.copy_to_bytes(parts.remaining()));
    };
    Operation {
        task: Task::Encode,
        by: "bit-efficient-one-piece",
        run: encoding(message, MESSAGES[0].encode, finish),
    }
}

/// The output is used again and again, as a connection does.
fn encoding<T: 'static>(
    value: T,
    encode: fn(&T, &mut Output) -> Result<(), EncodeError>,
    finish: fn(&mut Output),
) -> Box<dyn FnMut()> {
    let mut out = Output::new();
    Box::new(move || {
        encode(black_box(&value), &mut out).expect("can be written");
        finish(&mut out);
    })
}

fn decoding<T: 'static>(
    octets: Bytes,
    decode: fn(&Bytes, &Limits) -> Result<T, DecodeError>,
) -> Box<dyn FnMut()> {
    let limits = Limits::default();
    Box::new(move || {
        let value = decode(black_box(&octets), &limits).expect("can be read");
        drop(black_box(value));
    })
}

fn written<T>(value: &T, encode: fn(&T, &mut Output) -> Result<(), EncodeError>) -> Bytes {
    let mut out = Output::new();
    encode(value, &mut out).expect("can be written");
    out.take_bytes()
}
