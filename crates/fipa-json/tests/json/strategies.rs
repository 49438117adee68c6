//! Values that JSON shows without loss: names each once, expressions in their shown form.

use bytes::Bytes;
use fipa_acl::{AgentId, Expression, FipaTime, Message, Performative, Relative, Text, UserDefined};
use proptest::collection::{btree_map, vec};
use proptest::option::of;
use proptest::prelude::*;

pub(crate) fn text() -> impl Strategy<Value = Text> {
    "\\PC{0,12}".prop_map(Text::from)
}

/// Names without `X-`, each once, with texts.
pub(crate) fn parameters() -> impl Strategy<Value = Vec<(Text, Text)>> {
    btree_map("[A-Wa-w][A-Za-z0-9-]{0,6}", text(), 0..3)
        .prop_map(|map| map.into_iter().map(|(k, v)| (k.into(), v)).collect())
}

pub(crate) fn octets() -> impl Strategy<Value = Bytes> {
    prop_oneof![
        text().prop_map(Text::into_bytes),
        vec(any::<u8>(), 0..20).prop_map(Bytes::from),
    ]
}

pub(crate) fn time() -> impl Strategy<Value = FipaTime> {
    let span = (any::<bool>(), 0..100_u8, 0..60_u8, 0..1000_u16);
    prop_oneof![
        (-62_167_219_200_000_i64..253_402_300_800_000).prop_map(FipaTime::from_unix_millis),
        span.prop_map(|(negative, days, seconds, millis)| {
            FipaTime::Relative(Relative {
                negative,
                days,
                seconds,
                millis,
                ..Relative::default()
            })
        }),
    ]
}

pub(crate) fn agent() -> impl Strategy<Value = AgentId> {
    let leaf = agent_without_resolvers();
    leaf.prop_recursive(2, 6, 2, |inner| {
        (agent_without_resolvers(), vec(inner, 0..3)).prop_map(|(mut agent, resolvers)| {
            agent.resolvers = resolvers;
            agent
        })
    })
}

pub(crate) fn message() -> impl Strategy<Value = Message> {
    let participants = (of(agent()), vec(agent(), 0..3), vec(agent(), 0..2));
    let meaning = (
        of(octets()),
        of(expression()),
        of(expression()),
        of(expression()),
    );
    let control = (
        of(text()),
        of(expression()),
        of(expression()),
        of(expression()),
        of(time()),
    );
    (
        performative(),
        participants,
        meaning,
        control,
        user_defined(),
    )
        .prop_map(
            |(performative, participants, meaning, control, user_defined)| {
                let (sender, receiver, reply_to) = participants;
                let (content, language, encoding, ontology) = meaning;
                let (protocol, conversation_id, reply_with, in_reply_to, reply_by) = control;
                Message {
                    performative,
                    sender,
                    receiver,
                    reply_to,
                    content,
                    language,
                    encoding,
                    ontology,
                    protocol,
                    conversation_id,
                    reply_with,
                    in_reply_to,
                    reply_by,
                    user_defined,
                }
            },
        )
}

fn performative() -> impl Strategy<Value = Performative> {
    prop_oneof![
        (0..22_usize).prop_map(|i| Performative::STANDARD[i].clone()),
        text().prop_map(Performative::from),
    ]
}

fn agent_without_resolvers() -> impl Strategy<Value = AgentId> {
    (text(), vec(text(), 0..3), user_defined()).prop_map(|(name, addresses, user_defined)| {
        AgentId {
            name,
            addresses,
            resolvers: Vec::new(),
            user_defined,
        }
    })
}

fn user_defined() -> impl Strategy<Value = Vec<UserDefined>> {
    btree_map("[A-Wa-w][A-Za-z0-9-]{0,6}", expression(), 0..3).prop_map(|map| {
        map.into_iter()
            .map(|(name, value)| UserDefined::new(name, value))
            .collect()
    })
}

fn expression() -> impl Strategy<Value = Expression> {
    prop_oneof![
        text().prop_map(Expression::from),
        vec(nested(), 0..4).prop_map(Expression::List),
    ]
}

fn nested() -> impl Strategy<Value = Expression> {
    let leaf = prop_oneof![
        "[a-z:][a-z0-9@.-]{0,4}".prop_map(|word| Expression::Word(word.into())),
        "-?[0-9]{1,3}".prop_map(|number| Expression::Number(number.into())),
        "(\\PC|[\"\\\\() #]){0,8}".prop_map(|string| Expression::String(string.into())),
    ];
    leaf.prop_recursive(3, 12, 3, |inner| {
        vec(inner, 0..3).prop_map(Expression::List)
    })
}
