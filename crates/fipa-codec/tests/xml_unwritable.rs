//! What XML cannot hold is refused, and nothing of it is written.

mod xml_support;

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, Expression, FipaTime, Message, Performative, Received, Relative, Slots,
};
use fipa_codec::Output;
use fipa_codec::xml::{encode_envelope, encode_message};

fn inform() -> Message {
    Message::new(Performative::Inform)
}

fn message_error(message: &Message) -> &'static str {
    let mut out = Output::new();
    out.put_slice(b"before");
    let error = encode_message(message, &mut out).unwrap_err();
    assert_eq!(out.take_bytes(), "before");
    error.parameter
}

#[test]
fn messages_that_xml_cannot_hold_are_refused() {
    assert_eq!(message_error(&Message::new("shout")), "performative");
    assert_eq!(message_error(&inform().language("\u{1}")), "language");
    assert_eq!(
        message_error(&inform().ontology(Expression::List(vec!["\u{fffe}".into()]))),
        "ontology"
    );
    assert_eq!(
        message_error(&inform().conversation_id("\0")),
        "conversation-id"
    );
    assert_eq!(message_error(&inform().protocol("\u{b}")), "protocol");
    assert_eq!(message_error(&inform().to("")), "receiver");
    assert_eq!(
        message_error(&inform().from_agent(AgentId::new("a").address("\u{2}"))),
        "sender"
    );
    assert_eq!(
        message_error(&inform().user_defined("", "v")),
        "user-defined"
    );
    let too_long = FipaTime::Relative(Relative {
        days: 100,
        ..Relative::default()
    });
    assert_eq!(message_error(&inform().reply_by(too_long)), "reply-by");
    let late = FipaTime::Absolute {
        unix_millis: i64::MAX,
        zone: fipa_acl::Zone::Utc,
    };
    let content = inform().content(vec![b'x'; 10_000]).reply_by(late);
    assert_eq!(message_error(&content), "reply-by");
}

fn envelope_error(change: impl FnOnce(&mut Slots)) -> &'static str {
    let mut envelope = Envelope::default();
    change(&mut envelope.base);
    let mut out = Output::new();
    let error = encode_envelope(&envelope, &mut out).unwrap_err();
    assert!(out.is_empty());
    error.parameter
}

#[test]
fn envelopes_that_xml_cannot_hold_are_refused() {
    let span = FipaTime::Relative(Relative::default());
    assert_eq!(envelope_error(|base| base.date = Some(span)), "date");
    let stamp = |change: fn(&mut Received)| {
        let mut stamp = Received {
            by: "mts".into(),
            from: None,
            date: FipaTime::from_unix_millis(0),
            id: None,
            via: None,
            user_defined: Vec::new(),
        };
        change(&mut stamp);
        envelope_error(|base| base.received = Some(stamp))
    };
    assert_eq!(stamp(|stamp| stamp.by = "".into()), "received");
    assert_eq!(
        stamp(|stamp| stamp.date = FipaTime::Relative(Relative::default())),
        "received"
    );
    assert_eq!(stamp(|stamp| stamp.id = Some("\u{3}".into())), "received");
    assert_eq!(
        envelope_error(|base| base.comments = Some("\0".into())),
        "comments"
    );
    let octets = Bytes::from_static(b"\xff");
    let behaviour = envelope_error(|base| base.transport_behaviour = Some(octets));
    assert_eq!(behaviour, "transport-behaviour");
}
