//! What holds for all descriptions and for any message.

mod support;

use bytes::Bytes;
use fipa_acl::{AgentId, FipaTime, Message, Performative, Text};
use fipa_directory::Now;
use fipa_management::client::{self, search_result};
use fipa_management::{
    Ams, AmsConfig, Df, DfAgentDescription, DfConfig, Origin, Property, Reason, SearchConstraints,
    ServiceDescription,
};
use fipa_sl::Term;
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use support::{Town, only, sent};

/// Few words, so that templates match.
fn word() -> impl Strategy<Value = Text> {
    select(&["weather", "News", "fipa-df", "9 lives", "true"][..]).prop_map(Text::from)
}

fn words() -> impl Strategy<Value = Vec<Text>> {
    vec(word(), 0..2)
}

fn property() -> impl Strategy<Value = Property> {
    let value = option::of(prop_oneof![
        word().prop_map(Term::Text),
        (0..3_i64).prop_map(Term::integer)
    ]);
    (word(), value).prop_map(|(name, value)| Property { name, value })
}

fn service() -> impl Strategy<Value = ServiceDescription> {
    (
        option::of(word()),
        option::of(word()),
        option::of(word()),
        words(),
        vec(property(), 0..2),
    )
        .prop_map(
            |(name, kind, ownership, languages, properties)| ServiceDescription {
                name,
                kind,
                ownership,
                languages,
                properties,
                ..ServiceDescription::default()
            },
        )
}

fn description() -> impl Strategy<Value = DfAgentDescription> {
    let name = option::of((0..6_u8).prop_map(|n| AgentId::new(format!("a{n}@robot1"))));
    (
        name,
        vec(service(), 0..3),
        words(),
        words(),
        option::of(0..i64::from(i32::MAX)),
    )
        .prop_map(
            |(name, services, ontologies, protocols, lease)| DfAgentDescription {
                name,
                services,
                ontologies,
                protocols,
                lease_time: lease.map(FipaTime::from_unix_millis),
                ..DfAgentDescription::default()
            },
        )
}

/// Whether all that is wanted is there, said as plainly as can be.
fn plainly_matches(wanted: &DfAgentDescription, there: &DfAgentDescription) -> bool {
    let texts = |wanted: &[Text], there: &[Text]| {
        let there: Vec<String> = there.iter().map(|t| t.to_lowercase()).collect();
        wanted
            .iter()
            .all(|text| there.contains(&text.to_lowercase()))
    };
    let text = |wanted: &Option<Text>, there: &Option<Text>| {
        wanted.as_ref().is_none_or(|wanted| {
            there
                .as_ref()
                .is_some_and(|there| there.to_lowercase() == wanted.to_lowercase())
        })
    };
    let property = |wanted: &Property, there: &Property| {
        wanted.name.to_lowercase() == there.name.to_lowercase()
            && (wanted.value.is_none() || wanted.value == there.value)
    };
    let service = |wanted: &ServiceDescription, there: &ServiceDescription| {
        text(&wanted.name, &there.name)
            && text(&wanted.kind, &there.kind)
            && text(&wanted.ownership, &there.ownership)
            && texts(&wanted.languages, &there.languages)
            && wanted
                .properties
                .iter()
                .all(|wanted| there.properties.iter().any(|there| property(wanted, there)))
    };
    wanted
        .name
        .as_ref()
        .is_none_or(|name| there.name.as_ref().is_some_and(|n| n == name))
        && texts(&wanted.ontologies, &there.ontologies)
        && texts(&wanted.protocols, &there.protocols)
        && wanted
            .services
            .iter()
            .all(|wanted| there.services.iter().any(|there| service(wanted, there)))
}

/// Something like a request.
fn request() -> impl Strategy<Value = Message> {
    let acts = select(
        &[
            "request",
            "subscribe",
            "cancel",
            "inform",
            "failure",
            "query-ref",
        ][..],
    );
    let function = select(
        &[
            "register",
            "modify",
            "deregister",
            "search",
            "get-description",
        ][..],
    );
    let argument = prop_oneof![
        description().prop_map(|d| Term::from(&d).to_string()),
        Just("(search-constraints :max-results -1 :max-depth 2)".to_owned()),
        Just("(ams-agent-description :name (agent-identifier :name a1@robot1))".to_owned()),
        "[a-z() :\"]{0,12}",
    ];
    let content =
        (function, vec(argument, 0..3), any::<bool>()).prop_map(|(function, arguments, iota)| {
            let action = format!("(action df ({function} {}))", arguments.join(" "));
            match iota {
                true => format!("((iota ?x (result {action} ?x)))"),
                false => format!("({action})"),
            }
        });
    let content = prop_oneof![
        content.prop_map(Bytes::from),
        vec(any::<u8>(), 0..40).prop_map(Bytes::from)
    ];
    (acts, content, 0..4_u8, any::<bool>()).prop_map(|(act, content, sender, tagged)| {
        let message = Message::new(act)
            .from_agent(format!("a{sender}@robot1"))
            .content(content);
        match tagged {
            true => message.in_reply_to("df@robot1-u-1").reply_with("r"),
            false => message,
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn descriptions_come_back_from_their_terms(description in description()) {
        let printed = Term::from(&description).to_string();
        let read = DfAgentDescription::try_from(&printed.parse::<Term>().unwrap());
        prop_assert_eq!(read, Ok(description), "{}", printed);
    }

    #[test]
    fn a_search_finds_what_a_look_at_everything_finds(
        known in vec(description(), 0..12), template in description(),
    ) {
        let template = DfAgentDescription { lease_time: None, ..template };
        let (mut df, town) = (Df::new(DfConfig::new("df@robot1", "u")), Town::new("robot1", "tcp://x:1"));
        let mut registered: Vec<DfAgentDescription> = Vec::new();
        for description in known {
            let description = DfAgentDescription { lease_time: None, ..description };
            let request = client::df_register_request(&"df@robot1".into(), &description);
            df.handle(Now::default(), Origin::Local, &request.from_agent("x@y"), &town);
            if client::done(&only(&mut df)).is_ok() {
                registered.push(description);
            }
        }
        let request = client::df_search_request(
            &"df@robot1".into(), &template, &SearchConstraints::all(),
        );
        df.handle(Now::default(), Origin::Local, &request.from_agent("x@y"), &town);
        registered.retain(|there| plainly_matches(&template, there));
        prop_assert_eq!(search_result(&only(&mut df)), Ok(registered));
    }

    #[test]
    fn any_messages_are_answered_by_messages_that_can_be_read(
        messages in vec((request(), any::<bool>()), 1..12),
    ) {
        let mut town = Town::new("robot1", "tcp://x:1").with("a3@robot1", "motor", true);
        let mut df = Df::new(DfConfig::new("df@robot1", "u"));
        let mut ams = Ams::new(AmsConfig::new("ams@robot1"));
        for (message, local) in messages {
            let origin = if local { Origin::Local } else { Origin::Foreign };
            df.handle(Now::default(), origin, &message, &town);
            let answers = sent(&mut df).into_iter().chain(ams.handle(origin, &message, &mut town));
            for answer in answers {
                prop_assert!(!answer.receiver.is_empty());
                let content = answer.content.clone().unwrap();
                let read = fipa_sl::Content::parse(&content, &fipa_sl::Limits::default());
                prop_assert!(read.is_ok(), "{content:?}: {read:?}");
            }
        }
    }

    #[test]
    fn reasons_come_back_from_their_terms(words in "\\PC{0,12}", more in word()) {
        for reason in [
            Reason::InternalError(Text::from(&words)),
            Reason::MissingParameter { object: more.clone(), parameter: Text::from(&words) },
            Reason::UnrecognisedParameterValue { parameter: more, value: Text::from(&words) },
            Reason::Unauthorised,
        ] {
            let printed = Term::from(&reason).to_string();
            prop_assert_eq!(Reason::from(&printed.parse::<Term>().unwrap()), reason);
        }
    }
}

#[test]
fn a_request_is_not_answered_by_a_mountain() {
    let (mut df, town) = (
        Df::new(DfConfig::new("df@robot1", "u")),
        Town::new("robot1", "tcp://x:1"),
    );
    let content = format!("((action df (search {})))", "(set ".repeat(200_000));
    let request = Message::new(Performative::Request)
        .from_agent("x@y")
        .content(content);
    df.handle(Now::default(), Origin::Foreign, &request, &town);
    assert_eq!(
        only(&mut df).content_str(),
        Some("((unrecognised-value content))")
    );
}
