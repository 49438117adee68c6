//! What others make of the same message: Protocol Buffers, MessagePack, and a plain copy of the
//! content.

use std::hint::black_box;

use bytes::Bytes;
use fipa_acl::Message as AclMessage;
use prost::Message;
use serde::{Deserialize, Serialize};

use crate::messages;
use crate::operations::{Operation, Task};

/// The fields of the message, all owned.
#[derive(Clone, PartialEq, Message, Serialize, Deserialize)]
struct Owned {
    #[prost(message, required, tag = "1")]
    header: Header,
    #[prost(bytes = "vec", tag = "2")]
    #[serde(with = "serde_bytes")]
    content: Vec<u8>,
}

/// The same; the content shares the buffer that was read, as ours does.
#[derive(Clone, PartialEq, Message)]
struct Shared {
    #[prost(message, required, tag = "1")]
    header: Header,
    #[prost(bytes = "bytes", tag = "2")]
    content: Bytes,
}

#[derive(Clone, PartialEq, Message, Serialize, Deserialize)]
struct Header {
    #[prost(string, tag = "1")]
    performative: String,
    #[prost(string, optional, tag = "2")]
    sender: Option<String>,
    #[prost(string, repeated, tag = "3")]
    receiver: Vec<String>,
    #[prost(string, repeated, tag = "4")]
    reply_to: Vec<String>,
    #[prost(string, optional, tag = "5")]
    language: Option<String>,
    #[prost(string, optional, tag = "6")]
    encoding: Option<String>,
    #[prost(string, optional, tag = "7")]
    ontology: Option<String>,
    #[prost(string, optional, tag = "8")]
    protocol: Option<String>,
    #[prost(string, optional, tag = "9")]
    conversation_id: Option<String>,
    #[prost(string, optional, tag = "10")]
    reply_with: Option<String>,
    #[prost(string, optional, tag = "11")]
    in_reply_to: Option<String>,
    #[prost(int64, optional, tag = "12")]
    reply_by: Option<i64>,
}

/// What the rivals do with a message with so many octets of content.
pub fn operations(octets: usize) -> Vec<Operation> {
    let message = messages::message(octets);
    let owned = Owned {
        header: header(&message),
        content: messages::content(octets),
    };
    let wire = owned.encode_to_vec();
    vec![
        copying("memcpy", Task::Encode, messages::content(octets)),
        prost_encoding(owned.clone()),
        pack_encoding(owned.clone()),
        copying("memcpy", Task::Decode, messages::content(octets)),
        prost_decoding::<Owned>("prost", wire.clone()),
        prost_decoding::<Shared>("prost-shared", wire),
        pack_decoding(&owned),
    ]
}

fn header(message: &AclMessage) -> Header {
    let text = |value: &Option<fipa_acl::Expression>| value.as_ref().map(ToString::to_string);
    let names = |agents: &[fipa_acl::AgentId]| agents.iter().map(|a| a.name.to_string()).collect();
    Header {
        performative: message.performative.to_string(),
        sender: message.sender.as_ref().map(|a| a.name.to_string()),
        receiver: names(&message.receiver),
        reply_to: names(&message.reply_to),
        language: text(&message.language),
        encoding: text(&message.encoding),
        ontology: text(&message.ontology),
        protocol: message.protocol.as_ref().map(ToString::to_string),
        conversation_id: text(&message.conversation_id),
        reply_with: text(&message.reply_with),
        in_reply_to: text(&message.in_reply_to),
        reply_by: message.reply_by.and_then(|time| time.unix_millis()),
    }
}

/// Into a buffer that is used again where something is written, into a new one where it is read.
fn copying(by: &'static str, task: Task, content: Vec<u8>) -> Operation {
    let mut buffer = Vec::new();
    let run: Box<dyn FnMut()> = match task {
        Task::Encode => Box::new(move || {
            buffer.clear();
            buffer.extend_from_slice(black_box(&content));
            black_box(&buffer);
        }),
        Task::Decode => Box::new(move || drop(black_box(black_box(&content).clone()))),
    };
    Operation { task, by, run }
}

fn prost_encoding(message: Owned) -> Operation {
    let mut buffer = Vec::new();
    let run = Box::new(move || {
        buffer.clear();
        black_box(&message).encode(&mut buffer).expect("written");
        black_box(&buffer);
    });
    Operation {
        task: Task::Encode,
        by: "prost",
        run,
    }
}

fn prost_decoding<M: Message + Default>(by: &'static str, octets: Vec<u8>) -> Operation {
    let octets = Bytes::from(octets);
    let run = Box::new(move || {
        let message = M::decode(black_box(&octets).clone()).expect("read");
        drop(black_box(message));
    });
    Operation {
        task: Task::Decode,
        by,
        run,
    }
}

fn pack_encoding(message: Owned) -> Operation {
    let mut buffer = Vec::new();
    let run = Box::new(move || {
        buffer.clear();
        rmp_serde::encode::write(&mut buffer, black_box(&message)).expect("written");
        black_box(&buffer);
    });
    Operation {
        task: Task::Encode,
        by: "rmp-serde",
        run,
    }
}

fn pack_decoding(message: &Owned) -> Operation {
    let octets = rmp_serde::to_vec(message).expect("written");
    let run = Box::new(move || {
        let message: Owned = rmp_serde::from_slice(black_box(&octets)).expect("read");
        drop(black_box(message));
    });
    Operation {
        task: Task::Decode,
        by: "rmp-serde",
        run,
    }
}
