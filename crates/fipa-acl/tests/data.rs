//! Dates, expressions, replies and envelopes behave as the standard's data.

use fipa_acl::{
    AgentId, CivilTime, Envelope, Expression, FipaTime, Message, Performative, Relative, Slots,
    Text,
};
use proptest::prelude::*;

proptest! {
    #[test]
    fn civil_time_and_unix_time_agree(millis in -62_167_219_200_000_i64..253_402_300_800_000) {
        let civil = CivilTime::from_unix_millis(millis);
        prop_assert_eq!(civil.to_unix_millis(), Ok(millis));
    }

    #[test]
    fn a_shown_date_reads_back(millis in -62_167_219_200_000_i64..253_402_300_800_000) {
        let time = FipaTime::from_unix_millis(millis);
        prop_assert_eq!(time.to_string().parse(), Ok(time));
    }

    #[test]
    fn a_shown_span_reads_back_as_the_same_span(
        days in 0..100_u8, hours in 0..24_u8, minutes in 0..60_u8, seconds in 0..60_u8,
        millis in 0..1000_u16, negative: bool, years in 0..10_000_u16, months in 0..100_u8,
    ) {
        let span = FipaTime::Relative(Relative {
            negative, years, months, days, hours, minutes, seconds, millis,
        });
        prop_assert_eq!(span.to_string().parse(), Ok(span));
    }

    #[test]
    fn a_span_of_any_fields_is_shown_as_one_of_the_same_length(
        days in 0..100_u8, hours in 0..100_u8, minutes in 0..100_u8, seconds in 0..100_u8,
        millis in 0..1000_u16, negative: bool,
    ) {
        let span = Relative { negative, days, hours, minutes, seconds, millis, ..Relative::default() };
        let shown = FipaTime::Relative(span).to_string();
        let read: FipaTime = shown.parse().unwrap();
        prop_assert_eq!(read.resolve(0), span.as_millis());
        prop_assert_eq!(read.to_string(), shown);
    }

    #[test]
    fn no_text_breaks_the_readers(text in "\\PC{0,40}|[-+PT0-9YMDHS.:Z()\"#\\\\ a]{0,40}") {
        let _ = text.parse::<FipaTime>();
        let shown = Expression::from(text.as_str());
        prop_assert_eq!(Expression::from(shown.to_string()), shown);
    }
}

#[test]
fn durations_leave_zero_parts_out_and_carry() {
    for (given, shown) in [
        ("+PT10S", "+PT10S"),
        ("+PT300S", "+PT5M"),
        ("-PT36H", "-P1DT12H"),
        ("+PT0.25S", "+PT0.25S"),
        ("+PT0S", "+PT0S"),
        ("+P2D", "+P2D"),
        ("+P97DT48H", "+P99D"),
        ("+P98DT48H", "+P98DT48H"),
        ("-P99DT99H99M99.999S", "-P99DT99H99M99.999S"),
    ] {
        assert_eq!(given.parse::<FipaTime>().unwrap().to_string(), shown);
    }
    for wrong in [
        "+P100D",
        "+P98DT100H",
        "+P",
        "PT1",
        "+PT1X",
        "+PT99999999999999999999S",
    ] {
        assert!(wrong.parse::<FipaTime>().is_err(), "{wrong}");
    }
}

#[test]
fn rfc_3339_dates_are_read_with_any_offset() {
    let expected = "2026-11-22T10:00:00.500Z";
    for given in [
        "2026-11-22T10:00:00.5Z",
        "2026-11-22t11:00:00.500999+01:00",
        "2026-11-22 09:30:00.5-00:30",
        "2026-11-22T10:00:00.5",
    ] {
        assert_eq!(given.parse::<FipaTime>().unwrap().to_string(), expected);
    }
    for wrong in [
        "2026-02-29T00:00:00Z",
        "2026-13-01T00:00:00Z",
        "2026-11-22T10:00",
        "now",
    ] {
        assert!(wrong.parse::<FipaTime>().is_err(), "{wrong}");
    }
}

#[test]
fn text_becomes_the_expression_it_spells() {
    assert!(matches!(Expression::from("fipa-sl0"), Expression::Word(_)));
    assert!(matches!(Expression::from("c 1"), Expression::String(_)));
    assert!(matches!(Expression::from("42"), Expression::String(_)));
    let Expression::List(items) = Expression::from("( a  -1.5E3 #3\"x\\\" (b))") else {
        panic!("a list");
    };
    assert!(matches!(items[1], Expression::Number(_)));
    assert_eq!(items[2], Expression::String("x\\\"".into()));
    for no_list in ["(a", "(a) b", "(a ", "(#9\"x)", "(9lives)", "(\"a)"] {
        assert!(
            matches!(Expression::from(no_list), Expression::String(_)),
            "{no_list}"
        );
    }
    let deep = "(".repeat(10_000) + &")".repeat(10_000);
    assert!(matches!(Expression::from(deep), Expression::String(_)));
}

#[test]
fn a_reply_goes_to_reply_to_if_there_is_one() {
    let message = Message::new(Performative::Cfp)
        .from_agent("a@x")
        .conversation_id("c")
        .protocol("fipa-contract-net")
        .ontology("o")
        .reply_with("r");
    let answer = message.reply(Performative::Propose);
    assert_eq!(answer.receiver, [AgentId::new("a@x")]);
    assert_eq!(answer.in_reply_to, Some("r".into()));
    assert_eq!(answer.conversation_id, Some("c".into()));
    assert_eq!(answer.protocol, Some("fipa-contract-net".into()));
    assert_eq!(
        (answer.sender.clone(), answer.reply_with.clone()),
        (None, None)
    );
    let answer = message
        .reply_to("b@x")
        .reply_to("c@x")
        .reply(Performative::Refuse);
    assert_eq!(answer.receiver, [AgentId::new("b@x"), AgentId::new("c@x")]);
}

#[test]
fn the_newest_layer_that_has_a_slot_decides() {
    let mut envelope = Envelope::new(Slots {
        to: vec!["a@x".into(), "b@x".into()],
        from: Some("s@x".into()),
        payload_length: Some(3),
        user_defined: vec![("K".into(), "old".into()), ("L".into(), "l".into())],
        ..Slots::default()
    });
    assert_eq!(envelope.intended_receiver().len(), 2, "derived from to");
    for (receiver, value) in [("a@x", "mid"), ("b@x", "new")] {
        envelope.overlays.push(Slots {
            intended_receiver: vec![receiver.into()],
            user_defined: vec![("K".into(), value.into())],
            ..Slots::default()
        });
    }
    assert_eq!(envelope.intended_receiver(), [AgentId::new("b@x")]);
    assert_eq!(envelope.from().unwrap().name, "s@x");
    let flat = envelope.flattened();
    assert_eq!(
        flat.user_defined,
        [("K".into(), "new".into()), ("L".into(), "l".into())]
    );
    assert_eq!(flat.payload_length, Some(3));
}

#[test]
fn words_are_the_standards() {
    for (word, legal) in [
        ("a", true),
        ("tcp://[::1]:9", true),
        ("", false),
        ("a(b", false),
        ("-a", false),
        ("#a", false),
        ("@a", false),
        ("a b", false),
        ("é", false),
        ("\"a", false),
    ] {
        assert_eq!(Text::from(word).is_word(), legal, "{word}");
    }
}
