//! What holds for every content and for any octets.

use bytes::Bytes;
use fipa_acl::{AgentId, FipaTime, Relative, Text};
use fipa_sl::{Arguments, Content, Functional, Limits, Term, agent_id};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

fn text() -> impl Strategy<Value = Text> {
    prop_oneof![
        "[a-z@.:/-]{1,8}",
        "[ -~]{0,10}",
        "\\PC{0,6}",
        "[\"\\\\a ]{0,6}",
        "[0-9T+.ex#-]{1,10}",
        select(&["true", "set", "20310203T040506789Z", "+00000000T000500000"][..])
            .prop_map(str::to_owned),
    ]
    .prop_map(Text::from)
}

fn time() -> impl Strategy<Value = FipaTime> {
    let span = (any::<bool>(), 0..10_000_u16, 0..100_u8, 0..1000_u16);
    let span = span.prop_map(|(negative, years, days, millis)| {
        FipaTime::Relative(Relative {
            negative,
            years,
            days,
            millis,
            ..Relative::default()
        })
    });
    let point = (-62_167_219_200_000..253_402_300_800_000_i64).prop_map(FipaTime::from_unix_millis);
    prop_oneof![point, span]
}

fn term() -> impl Strategy<Value = Term> {
    let leaf = prop_oneof![
        4 => text().prop_map(Term::Text),
        1 => vec(any::<u8>(), 0..6).prop_map(|octets| Term::Octets(octets.into())),
        1 => any::<i64>().prop_map(Term::integer),
        1 => "[+-]?[0-9]{1,3}(\\.[0-9]{0,2})?([eE][+-]?[0-9]{1,2})?"
            .prop_map(|number| Term::Number(number.into())),
        1 => time().prop_map(Term::Time),
        1 => any::<bool>().prop_map(Term::Truth),
        1 => text().prop_map(Term::Variable),
    ];
    leaf.prop_recursive(5, 40, 5, |inner| {
        let positional = vec(inner.clone(), 0..5).prop_map(Arguments::Positional);
        let named = vec((text(), inner), 0..4).prop_map(Arguments::Named);
        (text(), prop_oneof![positional, named])
            .prop_map(|(symbol, arguments)| Functional { symbol, arguments }.into())
    })
}

fn content() -> impl Strategy<Value = Content> {
    (term(), vec(term(), 0..3))
        .prop_map(|(first, others)| others.into_iter().fold(Content::new(first), Content::and))
}

/// Reads the octets; what was read is printed, and read as the same and printed as the same.
fn is_stable(octets: &Bytes) -> Result<(), TestCaseError> {
    if let Ok(content) = Content::parse(octets, &Limits::default()) {
        let printed = content.to_bytes();
        let again = Content::parse(&printed, &Limits::default());
        prop_assert_eq!(again.as_ref(), Ok(&content));
        prop_assert_eq!(again.unwrap().to_bytes(), printed);
        content.profile();
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn what_is_printed_is_read_as_it_was(content in content()) {
        let printed = content.to_bytes();
        let read = Content::parse(&printed, &Limits::default());
        prop_assert_eq!(read.as_ref(), Ok(&content), "{}", content);
        prop_assert_eq!(read.unwrap().to_bytes(), printed);
    }

    #[test]
    fn any_octets_are_read_or_refused_in_their_bounds(octets in vec(any::<u8>(), 0..200)) {
        let octets = Bytes::from(octets);
        if let Err(error) = Content::parse(&octets, &Limits::default()) {
            prop_assert!(error.offset <= octets.len());
        }
        is_stable(&octets)?;
    }

    #[test]
    fn what_looks_like_sl_is_read_or_refused(text in "[()\"\\\\#:?a1 T.+-]{0,60}") {
        is_stable(&Bytes::from(format!("({text})")))?;
    }

    #[test]
    fn cut_and_changed_contents_are_read_or_refused(
        content in content(), cut in 0..200_usize, at in 0..200_usize, octet in any::<u8>(),
    ) {
        let mut octets = content.to_bytes().to_vec();
        if let Some(place) = octets.get_mut(at) {
            *place = octet;
        }
        is_stable(&Bytes::copy_from_slice(&octets))?;
        octets.truncate(cut);
        is_stable(&Bytes::from(octets))?;
    }

    #[test]
    fn agents_come_back_from_their_terms(
        name in text(), addresses in vec(text(), 0..3), resolver in text(), user in "[a-z]{1,5}",
    ) {
        prop_assume!(!name.is_empty() && !resolver.is_empty());
        prop_assume!(addresses.iter().all(|address| !address.is_empty()));
        let agent = AgentId { addresses, ..AgentId::new(name) }
            .resolver(resolver)
            .user_defined(user, "a value");
        let printed = Term::from(&agent).to_string();
        prop_assert_eq!(agent_id(&printed.parse().unwrap()), Ok(agent));
    }
}
