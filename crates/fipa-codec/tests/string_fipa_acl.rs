//! Recordings of fipa_acl in string form.

mod string_support;
mod support;

use fipa_acl::{AgentId, FipaTime, Message, Performative, Zone};
use fipa_codec::string::decode_message;
use fipa_codec::{Fault, Form, Limits, detect};
use string_support::{octets_of, read, refused};
use support::{expected_message, fipa_acl, index, recording, string};

/// Messages whose values are not all in their octets: the encoder writes the user-defined
/// parameters of an agent directly behind its name, so that nobody can tell where it ends.
const LOST: [&str; 1] = ["receiver_userparams"];

#[test]
fn recorded_messages_have_the_values_of_the_index() {
    let mut equal = 0;
    for (name, octets, entry) in fipa_acl("string", "message") {
        assert_eq!(detect(&octets), Form::String, "{name}");
        if LOST.contains(&&*name) {
            let agent_name = octets.windows(4).rposition(|here| here == b"recv").unwrap();
            assert_eq!(refused(&octets), (agent_name, Fault::Malformed), "{name}");
            continue;
        }
        assert_eq!(read(octets), expected_message(&entry["message"]), "{name}");
        equal += 1;
    }
    assert!(equal > 50, "{equal} messages");
}

#[test]
fn recorded_messages_come_back_unchanged() {
    for (name, octets, _) in fipa_acl("string", "message") {
        if LOST.contains(&&*name) {
            continue;
        }
        let mut message = read(octets);
        let written = octets_of(&message);
        if let Some(FipaTime::Absolute { zone, .. }) = &mut message.reply_by {
            *zone = Zone::Utc;
        }
        assert_eq!(read(written), message, "{name}");
    }
}

#[test]
fn recorded_contents_share_the_input() {
    for (name, octets, _) in fipa_acl("string", "message") {
        let Ok(message) = decode_message(&octets, &Limits::default()) else {
            continue;
        };
        let input = octets.as_ptr_range();
        for content in message.content.iter().filter(|content| !content.is_empty()) {
            assert!(input.contains(&content.as_ptr()), "{name}");
        }
    }
}

/// What the standard says that the hand-written messages mean.
fn decode_only(name: &str) -> Message {
    let inform = Message::new(Performative::Inform);
    match name {
        "dec_str_spec_example" => inform
            .from_agent(AgentId::new("agent1@example.org").address("http://example.org/acc"))
            .to("hpl-auction-server")
            .content("(price (bid good02) 150)")
            .in_reply_to("round-4")
            .reply_with("bid04")
            .language("Sl")
            .ontology("hpl-auction"),
        "dec_str_upper" => inform.from_agent("a").content("x"),
        // The peer reads no act outside the standard, and resolvers of one level only.
        "dec_str_userdef_perf" => Message::new("my-act").content("x"),
        "dec_str_nested_resolvers" => {
            inform.to(AgentId::new("a").resolver(AgentId::new("b").resolver("c")))
        }
        _ => panic!("{name} is not in the table"),
    }
}

#[test]
fn hand_written_messages_mean_what_the_standard_says() {
    for (name, octets, _) in fipa_acl("string", "decode-only-message") {
        assert_eq!(read(octets), decode_only(&name), "{name}");
    }
}

#[test]
fn payloads_in_string_form_of_recorded_envelopes_are_read() {
    let mut read_ones = 0;
    for entry in index("fipa_acl/index.json") {
        if entry["kind"] != "envelope" || entry["message_representation"] != "string" {
            continue;
        }
        let payload = recording(&format!("fipa_acl/{}", string(&entry["payload_file"])));
        let name = string(&entry["name"]);
        assert_eq!(read(payload), expected_message(&entry["message"]), "{name}");
        read_ones += 1;
    }
    assert!(read_ones > 4, "{read_ones} payloads");
}
