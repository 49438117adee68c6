//! What cannot be written.

use fipa_acl::{
    AgentId, Envelope, FipaTime, Message, Performative, Received, Representation, Slots,
};
use fipa_codec::EncodeError;
use fipa_codec::Output;
use fipa_codec::bit_efficient::{encode_envelope, encode_message, encode_overlay};

fn base() -> Slots {
    Slots {
        acl_representation: Some(Representation::BitEfficient),
        date: Some(FipaTime::from_unix_millis(0)),
        ..Slots::default()
    }
}

fn nobodys_stamp() -> Received {
    Received {
        by: "".into(),
        from: None,
        date: FipaTime::from_unix_millis(0),
        id: None,
        via: None,
        user_defined: Vec::new(),
    }
}

#[test]
fn what_cannot_be_written_is_refused_and_leaves_the_output_as_it_was() {
    let refused = |message: Message| -> EncodeError {
        let mut out = Output::new();
        out.put_slice(b"before");
        let error = encode_message(&message, &mut out).unwrap_err();
        assert_eq!(out.take_bytes(), &b"before"[..]);
        error
    };
    let inform = || Message::new(Performative::Inform);
    assert_eq!(refused(inform().to("two words")).parameter, "receiver");
    assert_eq!(refused(inform().from_agent("9lives")).parameter, "sender");
    assert_eq!(refused(inform().protocol("pröt")).parameter, "protocol");
    assert_eq!(
        refused(inform().user_defined("a b", "v")).parameter,
        "user-defined"
    );
    assert_eq!(
        refused(inform().user_defined("X-", "v")).parameter,
        "user-defined"
    );
    let far = AgentId::new("a").resolver(AgentId::new("b").address("http://a b"));
    assert_eq!(refused(inform().reply_to(far)).parameter, "reply-to");
    assert_eq!(refused(Message::new("two words")).parameter, "performative");
}

#[test]
fn envelopes_without_a_place_for_their_values_are_refused() {
    let refused = |change: fn(&mut Slots), parameter: &str| {
        let mut envelope = Envelope::new(base());
        change(&mut envelope.base);
        let mut out = Output::new();
        out.put_slice(b"before");
        let error = encode_envelope(&envelope, &mut out).unwrap_err();
        assert_eq!(error.parameter, parameter);
        assert_eq!(out.take_bytes(), &b"before"[..]);
    };
    refused(|base| base.date = None, "date");
    refused(|base| base.date = Some("+PT1S".parse().unwrap()), "date");
    refused(|base| base.acl_representation = None, "acl-representation");
    refused(|base| base.comments = Some("a\0b".into()), "comments");
    refused(|base| base.to = vec!["a\0b".into()], "to");
    refused(|base| base.received = Some(nobodys_stamp()), "received");
    let dated = Slots {
        date: Some(FipaTime::from_unix_millis(0)),
        ..Slots::default()
    };
    assert_eq!(
        encode_overlay(&dated, &mut Output::new())
            .unwrap_err()
            .parameter,
        "date"
    );
}
