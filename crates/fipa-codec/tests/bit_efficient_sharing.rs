//! What was read is held within its value or shares the buffer of the input, and lists have room for
//! what they hold.

mod support;

use std::ops::Range;

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, Text};
use fipa_codec::Output;
use fipa_codec::bit_efficient::encode_message;
use support::{letter, message, recording};

/// Checks that nothing has octets of its own outside its value.
struct Input(Range<*const u8>);

impl Input {
    fn of(octets: &Bytes) -> Input {
        Input(octets.as_ptr_range())
    }

    fn holds(&self, octets: &[u8]) {
        let Range { start, end } = octets.as_ptr_range();
        assert!(self.0.contains(&start) && end <= self.0.end, "{octets:?}");
    }

    fn holds_text(&self, text: &Text) {
        if text.len() > Text::SHORT {
            return self.holds(text.as_bytes());
        }
        let value = std::slice::from_ref(text).as_ptr_range();
        let value = value.start.cast()..value.end.cast();
        assert!(value.contains(&text.as_ptr()), "{text:?}");
    }

    fn holds_agents<'a>(&self, agents: impl IntoIterator<Item = &'a AgentId>) {
        for agent in agents {
            self.holds_text(&agent.name);
            agent
                .addresses
                .iter()
                .for_each(|text| self.holds_text(text));
            self.holds_agents(&agent.resolvers);
        }
    }
}

#[test]
fn no_text_of_a_message_is_allocated() {
    let octets = recording("fipa_acl/bench_1024.bitefficient.bin");
    let mut out = Output::new();
    // As fipa_acl writes it, and as it is written here.
    encode_message(&message(octets.clone()), &mut out).unwrap();
    for octets in [octets, out.take_bytes()] {
        let input = Input::of(&octets);
        let message = message(octets.clone());
        input.holds_agents(&message.sender);
        input.holds_agents(&message.receiver);
        input.holds_agents(&message.reply_to);
        input.holds(message.content.as_ref().unwrap());
        input.holds_text(message.protocol.as_ref().unwrap());
        let expressions = [
            &message.language,
            &message.encoding,
            &message.ontology,
            &message.conversation_id,
            &message.reply_with,
        ];
        for expression in expressions {
            match expression {
                Some(Expression::Word(text) | Expression::String(text)) => input.holds_text(text),
                other => panic!("{other:?}"),
            }
        }
        // The only allocations: both lists, for one agent each.
        assert_eq!(
            (message.receiver.capacity(), message.reply_to.capacity()),
            (1, 1)
        );
        let lists = |agent: &AgentId| {
            agent.addresses.capacity() + agent.resolvers.capacity() + agent.user_defined.capacity()
        };
        assert_eq!(lists(&message.sender.unwrap()), 0);
        assert_eq!(message.user_defined.capacity(), 0);
    }
}

#[test]
fn no_text_of_an_envelope_is_allocated() {
    let octets = recording("fipa_acl/env_stamped2_msg_string.bitefficient.bin");
    let input = Input::of(&octets);
    let letter = letter(octets);
    for slots in letter.envelope.layers() {
        input.holds_agents(&slots.to);
        input.holds_agents(&slots.from);
        input.holds_agents(&slots.intended_receiver);
        if let Some(received) = &slots.received {
            input.holds_text(&received.by);
            input.holds_text(received.id.as_ref().unwrap());
        }
    }
    input.holds(&letter.payload);
}

#[test]
fn a_long_text_is_a_slice_of_the_input() {
    let name = "a@".to_owned() + &"robot".repeat(5);
    let original = fipa_acl::Message::new("inform")
        .to(&name)
        .language("two words and three more");
    let mut out = Output::new();
    encode_message(&original, &mut out).unwrap();
    let octets = out.take_bytes();
    let input = Input::of(&octets);
    let message = message(octets);
    input.holds_text(&message.receiver[0].name);
    match message.language {
        Some(Expression::String(text)) => input.holds_text(&text),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_large_content_is_written_and_read_without_a_copy() {
    let content = Bytes::from(vec![b'x'; 1 << 20]);
    let original = fipa_acl::Message::new("inform").content(content.clone());
    let mut out = Output::new();
    encode_message(&original, &mut out).unwrap();
    let parts = out.take().into_parts();
    assert_eq!(parts.len(), 3);
    assert_eq!(parts[1].as_ptr(), content.as_ptr());
    let octets = Bytes::from(parts.concat());
    let decoded = message(octets.clone());
    Input::of(&octets).holds(&decoded.content.unwrap());
}
