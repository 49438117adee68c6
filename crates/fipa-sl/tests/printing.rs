//! What is printed, and that it is read as what it was.

use bytes::Bytes;
use fipa_acl::{AgentId, FipaTime, Relative, Zone};
use fipa_sl::{Content, Functional, Term};

/// The print of a term, after it was read back.
fn printed(term: impl Into<Term>) -> String {
    let term = term.into();
    let text = term.to_string();
    assert_eq!(text.parse::<Term>().unwrap(), term, "{text}");
    text
}

#[test]
fn a_string_is_a_word_where_it_is_a_legal_one() {
    assert_eq!(printed("fipa-request"), "fipa-request");
    assert_eq!(printed("@home"), "@home");
    assert_eq!(printed("http://p:80/acc"), "http://p:80/acc");
    assert_eq!(printed("a#b"), "a#b");
}

#[test]
fn what_would_be_read_as_something_else_is_quoted() {
    for text in [
        "",
        "two words",
        "a(b",
        "9lives",
        "-x",
        "?x",
        ":x",
        "#x",
        "5",
        "-1.5",
        ".5",
        "+5",
        "0x2A",
        "20310203T040506789Z",
        "+00000000T000500000",
        "true",
        "False",
        "é",
    ] {
        assert_eq!(printed(text), format!("\"{text}\""));
    }
    assert_eq!(printed("say \"hi\""), r#""say \"hi\"""#);
    assert_eq!(printed("a\"b"), r#""a\"b""#);
    assert_eq!(printed(r"a\nb c"), r#""a\nb c""#);
}

#[test]
fn what_no_literal_can_hold_is_counted() {
    assert_eq!(printed(r"at c:\"), "#6\"at c:\\");
    assert_eq!(printed("é\\\""), "#4\"é\\\"");
    assert_eq!(
        printed(Term::Octets(Bytes::from_static(b"AAEC"))),
        "#4\"AAEC"
    );
}

#[test]
fn one_blank_stands_between_terms_and_none_inside_parentheses() {
    let content: Content =
        "( (action  (agent-identifier\n:name a )(open\t\"the door\" (set)))\ntrue )"
            .parse()
            .unwrap();
    assert_eq!(
        content.to_string(),
        "((action (agent-identifier :name a) (open \"the door\" (set))) true)"
    );
}

#[test]
fn every_operator_is_printed_as_it_was_read() {
    for text in [
        "((not (and p (or q (implies r (equiv s t))))))",
        "((iota ?x (result (action a (get)) ?x)))",
        "((any (sequence ?x ?y) (p ?x ?y)) (all ?x (q ?x)))",
        "((forall ?x (exists ?y (= ?x ?y))))",
        "((B a (U b (PG c (I d false)))))",
        "((feasible (; (action a x) (| (action a y) (action a z))) true))",
        "((done (action a (+ 1 (* 2 -3.5E-2)))))",
    ] {
        assert_eq!(text.parse::<Content>().unwrap().to_string(), text);
    }
}

#[test]
fn dates_are_printed_in_utc() {
    let time = FipaTime::from_unix_millis(1_795_341_600_000);
    assert_eq!(printed(Term::Time(time)), "20261122T100000000Z");
    let local: Term = "20261122T120000000B".parse().unwrap();
    assert_eq!(local.to_string(), "20261122T100000000Z");
    let span = Relative {
        minutes: 5,
        ..Relative::default()
    };
    assert_eq!(
        printed(Term::Time(FipaTime::Relative(span))),
        "+00000000T000500000"
    );
}

#[test]
fn what_is_no_legal_constant_is_printed_as_something_legal() {
    assert_eq!(Term::Number("five".into()).to_string(), "five");
    let beyond = FipaTime::Absolute {
        unix_millis: i64::MAX,
        zone: Zone::Utc,
    };
    assert_eq!(Term::Time(beyond).to_string(), "99991231T235959999Z");
    let long = Relative {
        hours: 200,
        ..Relative::default()
    };
    assert_eq!(
        Term::Time(FipaTime::Relative(long)).to_string(),
        "19700109T080000000Z"
    );
}

#[test]
fn objects_are_built_from_parameters() {
    let object = Functional::object("property")
        .with("name", "max days")
        .with("value", Term::integer(5))
        .with_some("unit", None::<Term>);
    assert_eq!(printed(object), "(property :name \"max days\" :value 5)");
    assert_eq!(
        printed(Functional::object("ams-agent-description")),
        "(ams-agent-description)"
    );
}

#[test]
fn agents_are_printed_without_empty_lists() {
    let agent = AgentId::new("a@p")
        .address("http://p:80/acc")
        .user_defined("X-color", "dark red");
    assert_eq!(
        printed(&agent),
        "(agent-identifier :name a@p :addresses (sequence http://p:80/acc) :X-color \"dark red\")"
    );
    assert_eq!(
        printed(&AgentId::new("9@p")),
        "(agent-identifier :name \"9@p\")"
    );
}
