//! Generators of what the representations can carry, for property tests.
//!
//! What they make is in the form in which it is read back: dates in UTC, user-defined names
//! without `X-`, names and addresses that are words.

use bytes::Bytes;
use fipa_acl::{
    AgentId, Envelope, Expression, FipaTime, Letter, Message, Performative, Received, Relative,
    Representation, Slots, Text, UserDefined,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// A legal word.
pub fn word() -> impl Strategy<Value = Text> {
    "[!$-&*-,./:-?A-~][!-'*-~]{0,12}".prop_map(Text::from)
}

/// Any text without zero characters, empty ones and awkward ones included.
pub fn text() -> impl Strategy<Value = Text> {
    prop_oneof![
        "[ -~]{0,16}",
        "[\u{1}-\u{10ffff}]{0,8}",
        "[\"\\\\#() a1]{0,8}",
    ]
    .prop_map(Text::from)
}

/// A text that has at least one character, none of them zero.
pub fn non_empty_text() -> impl Strategy<Value = Text> {
    text().prop_filter("not empty", |text| !text.is_empty())
}

/// Octets, mostly few.
pub fn octets() -> impl Strategy<Value = Bytes> {
    prop_oneof![
        8 => vec(any::<u8>(), 0..64),
        1 => vec(any::<u8>(), 250..600),
        1 => (65_500_usize..65_600).prop_map(|len| vec![7; len]),
    ]
    .prop_map(Bytes::from)
}

/// An act of the standard, or another word.
pub fn performative() -> impl Strategy<Value = Performative> {
    prop_oneof![
        4 => prop::sample::select(Performative::STANDARD.to_vec()),
        1 => word().prop_map(Performative::from),
    ]
}

/// A word, a string, a number, or lists of them within lists.
pub fn expression() -> impl Strategy<Value = Expression> {
    leaf().prop_recursive(4, 24, 5, |inner| {
        vec(inner, 0..5).prop_map(Expression::List)
    })
}

/// A word, a string (that can hold zero characters) or a number.
pub fn leaf() -> impl Strategy<Value = Expression> {
    prop_oneof![
        word().prop_map(Expression::Word),
        text().prop_map(Expression::String),
        "[a\"\\\\\u{0}]{0,6}".prop_map(|text| Expression::String(text.into())),
        "[-+]?[0-9]{1,9}(\\.[0-9]{1,3})?(E-?[0-9]{1,2})?"
            .prop_map(|number| Expression::Number(number.into())),
    ]
}

/// An agent identifier as a message can hold it.
pub fn agent_id() -> impl Strategy<Value = AgentId> {
    agent_id_with(expression().boxed())
}

/// An agent identifier as an envelope can hold it: no lists in user-defined parameters.
pub fn envelope_agent_id() -> impl Strategy<Value = AgentId> {
    agent_id_with(leaf().boxed())
}

fn agent_id_with(value: BoxedStrategy<Expression>) -> impl Strategy<Value = AgentId> {
    let one = move |resolvers: BoxedStrategy<Vec<AgentId>>| {
        let user_defined =
            (user_name(), value.clone()).prop_map(|(name, value)| UserDefined { name, value });
        (
            word(),
            vec(word(), 0..3),
            resolvers,
            vec(user_defined, 0..2),
        )
            .prop_map(|(name, addresses, resolvers, user_defined)| AgentId {
                name,
                addresses,
                resolvers,
                user_defined,
            })
    };
    let none = one(Just(Vec::new()).boxed());
    none.prop_recursive(3, 6, 2, move |inner| one(vec(inner, 0..3).boxed()))
}

/// A point in time or a span.
pub fn time() -> impl Strategy<Value = FipaTime> {
    let two_digits = prop::array::uniform5(0_u8..100);
    let span = (0_u16..10_000, two_digits, 0_u16..1000, any::<bool>());
    let relative = span.prop_map(|(years, fields, millis, negative)| {
        let [months, days, hours, minutes, seconds] = fields;
        FipaTime::Relative(Relative {
            negative,
            years,
            months,
            days,
            hours,
            minutes,
            seconds,
            millis,
        })
    });
    prop_oneof![2 => point_in_time(), 1 => relative]
}

/// A point in time of the years 0 to 9999, in UTC.
pub fn point_in_time() -> impl Strategy<Value = FipaTime> {
    (-62_167_219_200_000_i64..253_402_300_800_000).prop_map(FipaTime::from_unix_millis)
}

/// A message with any of its parameters.
pub fn message() -> impl Strategy<Value = Message> {
    let agents = || vec(agent_id(), 0..4);
    let tag = || option::of(expression());
    let user_defined =
        (user_name(), expression()).prop_map(|(name, value)| UserDefined { name, value });
    let head = (performative(), option::of(agent_id()), agents(), agents());
    let about = (
        option::of(octets()),
        tag(),
        tag(),
        tag(),
        option::of(word()),
    );
    let control = (
        tag(),
        tag(),
        tag(),
        option::of(time()),
        vec(user_defined, 0..3),
    );
    (head, about, control).prop_map(|(head, about, control)| Message {
        performative: head.0,
        sender: head.1,
        receiver: head.2,
        reply_to: head.3,
        content: about.0,
        language: about.1,
        encoding: about.2,
        ontology: about.3,
        protocol: about.4,
        conversation_id: control.0,
        reply_with: control.1,
        in_reply_to: control.2,
        reply_by: control.3,
        user_defined: control.4,
    })
}

/// A stamp.
pub fn received() -> impl Strategy<Value = Received> {
    let text = || option::of(text());
    let who = (non_empty_text(), text(), point_in_time());
    (who, text(), text(), user_texts()).prop_map(|((by, from, date), id, via, user_defined)| {
        Received {
            by,
            from,
            date,
            id,
            via,
            user_defined,
        }
    })
}

/// The base of an envelope: it has a representation and a date.
pub fn base() -> impl Strategy<Value = Slots> {
    (slots(), representation(), point_in_time()).prop_map(|(slots, representation, date)| Slots {
        acl_representation: Some(representation),
        date: Some(date),
        ..slots
    })
}

/// An overlay: it has no date.
pub fn overlay() -> impl Strategy<Value = Slots> {
    slots()
}

/// An envelope with up to four overlays.
pub fn envelope() -> impl Strategy<Value = Envelope> {
    (base(), vec(overlay(), 0..4)).prop_map(|(base, overlays)| Envelope { base, overlays })
}

/// A letter with any octets as its payload.
pub fn letter() -> impl Strategy<Value = Letter> {
    (envelope(), octets()).prop_map(|(envelope, payload)| Letter { envelope, payload })
}

fn slots() -> impl Strategy<Value = Slots> {
    let agents = || vec(envelope_agent_id(), 0..3);
    let text = || option::of(non_empty_text());
    let who = (agents(), option::of(envelope_agent_id()), agents());
    let payload = (
        option::of(representation()),
        option::of(any::<u64>()),
        text(),
    );
    let rest = (
        text(),
        option::of(received()),
        option::of(octets()),
        user_texts(),
    );
    (who, payload, rest).prop_map(|(who, payload, rest)| Slots {
        to: who.0,
        from: who.1,
        comments: rest.0,
        acl_representation: payload.0,
        payload_length: payload.1,
        payload_encoding: payload.2,
        date: None,
        intended_receiver: who.2,
        received: rest.1,
        transport_behaviour: rest.2,
        user_defined: rest.3,
    })
}

fn representation() -> impl Strategy<Value = Representation> {
    prop_oneof![
        Just(Representation::BitEfficient),
        Just(Representation::String),
        Just(Representation::Xml),
        non_empty_text().prop_map(Representation::from),
    ]
}

fn user_texts() -> impl Strategy<Value = Vec<(Text, Text)>> {
    vec((user_name(), text()), 0..3)
}

/// A name without `X-`, which is a word behind one.
fn user_name() -> impl Strategy<Value = Text> {
    "[!-'*-~]{1,8}"
        .prop_map(|name| fipa_acl::canonical_user_name(name.into()))
        .prop_filter("not empty", |name| !name.is_empty())
}
