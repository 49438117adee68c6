//! Recordings of running C++ programs, value by value: the letters of a message transport service of
//! fipa_services, and the messages of its lock protocols.

mod support;

use fipa_acl::{
    AgentId, Envelope, FipaTime, Letter, Message, Performative, Received, Representation, Slots,
};
use fipa_codec::{
    Limits, decode_layers, decode_letter, decode_letter_prefix, decode_message, decode_payload,
};
use support::recording;

/// A letter of the service mts-0, and what is in it.
struct Sent {
    file: &'static str,
    /// The receivers of the message as they are asked for; patterns are names too.
    to: &'static [&'static str],
    /// Where this instance goes.
    intended: &'static str,
    /// When it was made and stamped, on the day of the recordings.
    time: &'static str,
    id: &'static str,
    /// Octets of the message as the agent gave it to the service.
    length: u64,
    content: Content,
}

enum Content {
    /// That of a request of agent-a.
    Request(&'static str),
    /// The notice that these could not be reached.
    Failure(&'static [&'static str]),
}

const SENT: [Sent; 9] = [
    Sent {
        file: "sent_00_to_agent-b",
        to: &["agent-b"],
        intended: "agent-b",
        time: "07:05:27.563",
        id: "1:20261122-07:05:27:563739",
        length: 76,
        content: Content::Request("one remote"),
    },
    Sent {
        file: "sent_01_to_jade",
        to: &["jade@1.2:1099/JADE"],
        intended: "jade@1?2:1099/JADE",
        time: "07:05:27.864",
        id: "2:20261122-07:05:27:864169",
        length: 84,
        content: Content::Request("one jade"),
    },
    Sent {
        file: "sent_02_to_agent-a",
        to: &["agent-a"],
        intended: "agent-a",
        time: "07:05:28.766",
        id: "6:20261122-07:05:28:766518",
        length: 320,
        content: Content::Failure(&["unregistered-1", "unregistered-2"]),
    },
    Sent {
        file: "sent_03_to_agent-b",
        to: &["agent-b", "local-1"],
        intended: "agent-b",
        time: "07:05:29.098",
        id: "7:20261122-07:05:29:098943",
        length: 81,
        content: Content::Request("mixed"),
    },
    Sent {
        file: "sent_04_to_agent-b",
        to: &["agent.*"],
        intended: "agent-b",
        time: "07:05:29.401",
        id: "8:20261122-07:05:29:401748",
        length: 103,
        content: Content::Request("regex: agent-b but not sender agent-a"),
    },
    Sent {
        file: "sent_05_to_agent-b",
        to: &[".*"],
        intended: "agent-b",
        time: "07:05:29.722",
        id: "9:20261122-07:05:29:722633",
        length: 69,
        content: Content::Request("broadcast"),
    },
    Sent {
        file: "sent_06_to_jade",
        to: &[".*"],
        intended: "jade@1?2:1099/JADE",
        time: "07:05:29.722",
        id: "9:20261122-07:05:29:722633",
        length: 69,
        content: Content::Request("broadcast"),
    },
    Sent {
        file: "sent_07_to_agent-a",
        to: &["agent-a"],
        intended: "agent-a",
        time: "07:05:30.327",
        id: "12:20261122-07:05:30:327961",
        length: 276,
        content: Content::Failure(&["odd-sig"]),
    },
    Sent {
        file: "sent_08_to_agent-a",
        to: &["agent-a"],
        intended: "agent-a",
        time: "07:05:30.629",
        id: "14:20261122-07:05:30:629230",
        length: 275,
        content: Content::Failure(&["fail-x"]),
    },
];

impl Sent {
    fn date(&self) -> FipaTime {
        format!("2026-11-22T{}", self.time).parse().unwrap()
    }

    fn from(&self) -> AgentId {
        AgentId::new(match self.content {
            Content::Request(_) => "agent-a",
            Content::Failure(_) => "mts-0",
        })
    }

    fn message(&self) -> Message {
        let (act, content) = match self.content {
            Content::Request(content) => (Performative::Request, content.to_owned()),
            Content::Failure(receivers) => (Performative::Failure, notice(receivers)),
        };
        let mut message = Message::new(act)
            .from_agent(self.from())
            .protocol("request")
            .conversation_id("conv-1")
            .content(content);
        message.receiver = self.to.iter().map(|name| AgentId::new(*name)).collect();
        match self.content {
            Content::Request(_) => message.reply_with("rw-1"),
            Content::Failure(_) => message
                .in_reply_to("rw-1")
                .ontology("fipa-agent-management"),
        }
    }

    /// The envelope, around a payload of so many octets.
    fn envelope(&self, payload: usize) -> Envelope {
        let to: Vec<AgentId> = self.to.iter().map(|name| AgentId::new(*name)).collect();
        let base = Slots {
            to: to.clone(),
            from: Some(self.from()),
            acl_representation: Some(Representation::BitEfficient),
            payload_length: Some(self.length),
            date: Some(self.date()),
            intended_receiver: to,
            ..Slots::default()
        };
        let stamped = Slots {
            received: Some(Received {
                by: "mts-0".into(),
                from: None,
                date: self.date(),
                id: Some(self.id.into()),
                via: None,
                user_defined: Vec::new(),
            }),
            ..Slots::default()
        };
        let dedicated = Slots {
            intended_receiver: vec![AgentId::new(self.intended)],
            ..Slots::default()
        };
        let mut overlays = vec![stamped, dedicated];
        if self.is_for_jade() {
            overlays.push(Slots {
                from: Some(self.from().address("tcp://10.99.0.1:44317")),
                acl_representation: Some(Representation::String),
                payload_length: Some(payload as u64),
                ..Slots::default()
            });
        }
        Envelope { base, overlays }
    }

    fn is_for_jade(&self) -> bool {
        self.file.ends_with("_to_jade")
    }
}

/// What the service has to say to a sender: a message in string form.
fn notice(receivers: &[&str]) -> String {
    let agent = |name: &&str| format!("(agent-identifier:name{name})");
    let receivers: String = receivers.iter().map(agent).collect();
    let text = "description: message delivery failed\ndelivery path: mts-0";
    format!(
        "(inform:sender(agent-identifier:nameagent-a):receiver(set{receivers})\
         :content#57\"{text}:language#14\"internal-error)"
    )
}

#[test]
fn letters_of_a_message_transport_service_have_their_values() {
    let limits = Limits::default();
    for sent in &SENT {
        let file = sent.file;
        let octets = recording(&format!("mts/{file}.bin"));
        let Letter { envelope, payload } = decode_letter(&octets, &limits).unwrap();
        assert_eq!(envelope, sent.envelope(payload.len()), "{file}");
        assert_eq!(
            envelope.payload_length(),
            Some(payload.len() as u64),
            "{file}"
        );
        let message = decode_payload(&envelope, &payload, &limits);
        assert_eq!(message, Ok(sent.message()), "{file}");
        let prefix = decode_letter_prefix(&octets, &limits);
        let letter = Letter { envelope, payload };
        assert_eq!(prefix, Ok((letter, octets.len())), "{file}");
    }
    let files = std::fs::read_dir(support::path("mts")).unwrap();
    assert_eq!(files.count(), SENT.len());
}

/// In bit-efficient form the newest overlay of the service stands last, directly in front of the
/// base; in XML the base is first.
#[test]
fn layers_are_told_in_the_order_of_the_wire() {
    for sent in &SENT {
        let octets = recording(&format!("mts/{}.bin", sent.file));
        let letter = decode_letter(&octets, &Limits::default()).unwrap();
        let Envelope { base, overlays } = sent.envelope(letter.payload.len());
        let expected: Vec<Slots> = match sent.is_for_jade() {
            true => std::iter::once(base).chain(overlays).collect(),
            false => overlays.into_iter().chain([base]).collect(),
        };
        let layers = decode_layers(&octets, &Limits::default());
        assert_eq!(layers, Ok(expected), "{}", sent.file);
    }
}

#[test]
fn a_notice_of_failure_has_a_message_in_it() {
    for sent in &SENT {
        let Content::Failure(receivers) = sent.content else {
            continue;
        };
        let content = sent.message().content.unwrap();
        let read = decode_message(&Representation::String, &content, &Limits::default());
        let mut expected = Message::new(Performative::Inform)
            .from_agent("agent-a")
            .language("internal-error")
            .content("description: message delivery failed\ndelivery path: mts-0");
        expected.receiver = receivers.iter().map(|name| AgentId::new(*name)).collect();
        assert_eq!(read, Ok(expected), "{}", sent.file);
    }
}

/// The message of a line of the table: file, step, act, agents, and what is named.
fn of_line(line: &str) -> Option<(&str, Message)> {
    let [file, _, act, agents, named @ ..] = &line.split('\t').collect::<Vec<_>>()[..] else {
        return None;
    };
    let (from, to) = agents.split_once(" -> ").unwrap();
    let mut message = Message::new(Performative::from(fipa_acl::Text::from(*act)));
    message.sender = Some(AgentId::new(from));
    message.receiver = to.split(',').map(AgentId::new).collect();
    for (name, value) in named.iter().map(|named| named.split_once('=').unwrap()) {
        message = match name {
            _ if value.is_empty() => message,
            "protocol" => message.protocol(value),
            "conv" => message.conversation_id(value),
            "lang" => message.language(value),
            "content" => message.content(value.replace("\\n", "\n")),
            _ => panic!("{line}"),
        };
    }
    Some((file, message))
}

#[test]
fn messages_of_the_lock_protocols_have_the_values_of_their_table() {
    let table = String::from_utf8(recording("dlm/messages.tsv").to_vec()).unwrap();
    let mut seen = 0;
    for (file, expected) in table.lines().filter_map(of_line) {
        let octets = recording(&format!("dlm/{file}"));
        let read = decode_message(&Representation::BitEfficient, &octets, &Limits::default());
        assert_eq!(read, Ok(expected), "{file}");
        seen += 1;
    }
    assert_eq!(seen, 70);
}
