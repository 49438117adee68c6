//! What is read, and what is refused with which words.

use bytes::Bytes;
use fipa_acl::{FipaTime, Text};
use fipa_sl::{Content, Limits, ParseErrorKind, Profile, Term, agent_id};

fn term(text: &str) -> Term {
    text.parse().unwrap()
}

fn content(text: &str) -> Content {
    text.parse().unwrap()
}

/// Line, column and what was expected.
fn refused(text: &str) -> (usize, usize, &'static str) {
    let error = text.parse::<Content>().unwrap_err();
    match error.kind {
        ParseErrorKind::Expected { expected, .. } => (error.line, error.column, expected),
        other => panic!("{other:?}"),
    }
}

#[test]
fn constants_are_told_apart() {
    assert_eq!(
        term("word@host:1099/JADE"),
        Term::text("word@host:1099/JADE")
    );
    assert_eq!(term("\"two words\""), Term::text("two words"));
    assert_eq!(term("42").as_integer(), Some(42));
    assert_eq!(term("-0x2A").as_integer(), Some(-42));
    assert_eq!(term("1.5e3"), Term::Number("1.5e3".into()));
    assert_eq!(term("20310203T040506789Z").as_time(), {
        let time: FipaTime = "2031-02-03T04:05:06.789Z".parse().unwrap();
        Some(time)
    });
    assert!(matches!(
        term("+00000000T000500000"),
        Term::Time(FipaTime::Relative(_))
    ));
    assert_eq!(term("TRUE"), Term::Truth(true));
    assert_eq!(term("\"true\""), Term::text("true"));
    assert_eq!(term("?x"), Term::Variable("x".into()));
    assert_eq!(term("#3\"a)\""), Term::Octets(Bytes::from_static(b"a)\"")));
}

#[test]
fn octets_that_are_no_text_are_read() {
    let octets = Bytes::from_static(b"((data #2\"\xff\x00))");
    let content = Content::parse(&octets, &Limits::default()).unwrap();
    let data = content.first().functional("data").unwrap();
    assert_eq!(
        data.positional(),
        [Term::Octets(Bytes::from_static(b"\xff\0"))]
    );
    assert_eq!(content.to_bytes(), octets);
}

#[test]
fn a_backslash_means_something_in_front_of_a_quote_only() {
    assert_eq!(term(r#""a \"b\" \n \\c""#), Term::text(r#"a "b" \n \\c"#));
    // One that ends in a backslash, as one peer writes it.
    assert_eq!(term(r#""c:\""#), Term::text(r"c:\"));
    assert_eq!(
        content(r#"((open "c:\"))"#)
            .first()
            .functional("open")
            .unwrap()
            .positional(),
        [Term::text(r"c:\")]
    );
}

#[test]
fn parameters_are_found_in_any_order_and_case_and_the_last_counts() {
    let term = term("(thing :b 2 :a 1 :A 3)");
    let thing = term.functional("THING").unwrap();
    assert_eq!(thing.parameter("a").unwrap().as_integer(), Some(3));
    assert_eq!(thing.parameter("B").unwrap().as_integer(), Some(2));
    assert_eq!(thing.parameter("c"), None);
    assert!(thing.positional().is_empty());
}

#[test]
fn sets_and_sequences_have_items() {
    assert_eq!(term("(set a b)").items().unwrap().len(), 2);
    assert_eq!(term("(SEQUENCE)").items(), Some(&[][..]));
    assert_eq!(term("(bag a)").items(), None);
}

#[test]
fn agents_keep_what_the_standard_does_not_know() {
    let term = term(
        "(agent-identifier :name a@p :addresses (sequence http://p:80/acc tcp://p:1) \
         :resolvers (sequence (agent-identifier :name ams@p)) :X-JADE-agent-classname lab.Echo)",
    );
    let agent = agent_id(&term).unwrap();
    assert_eq!(agent.name, "a@p");
    assert_eq!(agent.addresses, ["http://p:80/acc", "tcp://p:1"]);
    assert_eq!(agent.resolvers[0].name, "ams@p");
    assert_eq!(agent.user_defined[0].name, "JADE-agent-classname");
    assert_eq!(Term::from(&agent), term);
}

#[test]
fn what_is_no_agent_says_why() {
    let why = |text: &str| agent_id(&term(text)).unwrap_err().to_string();
    assert_eq!(why("a@p"), "expected (agent-identifier …)");
    assert_eq!(
        why("(agent-identifier :addresses (sequence))"),
        "agent-identifier needs a parameter :name"
    );
    assert_eq!(
        why("(agent-identifier :name a :addresses http://x)"),
        "agent-identifier cannot have http://x as its :addresses"
    );
}

#[test]
fn errors_tell_where_and_what_was_expected() {
    assert_eq!(refused(""), (1, 1, "the parenthesis that begins a content"));
    assert_eq!(refused("()"), (1, 2, "an action or a proposition"));
    assert_eq!(refused("((foo)"), (1, 7, "a closing parenthesis"));
    assert_eq!(refused("((foo)) x"), (1, 9, "the end"));
    assert_eq!(
        refused("(\n  ((a)))"),
        (2, 4, "a symbol such as action or set")
    );
    assert_eq!(
        refused("((f :a 1 b))").2,
        "a parameter such as :name, or a closing parenthesis"
    );
    assert_eq!(refused("((f b :a 1))"), (1, 7, "a term"));
    assert_eq!(
        refused("((f 9lives))"),
        (1, 5, "a number, a date, or text in quotes")
    );
    assert_eq!(
        refused("((f 20260230T000000000Z))"),
        (1, 5, "a date that the calendar has")
    );
    assert_eq!(
        refused("((f \"é\" -x))"),
        (1, 9, "a number, a date, or text in quotes")
    );
    assert_eq!(
        refused("((f \"abc))"),
        (1, 5, "a literal that ends with a quote")
    );
    assert_eq!(refused("((f #9\"abc))").2, "as many octets as # announces");
    assert_eq!(
        refused("((f #99999999999999999999999\"abc))").2,
        "as many octets as # announces"
    );
    assert_eq!(refused("((f :))").2, "the name of a parameter");
    let error = "((f\n ((".parse::<Content>().unwrap_err();
    assert_eq!(
        error.to_string(),
        "2:3 (octet 6): expected a symbol such as action or set, found '('"
    );
}

#[test]
fn octets_outside_utf_8_are_an_error_where_they_stand() {
    let octets = Bytes::from_static(b"((a \"b\xff\"))");
    let error = Content::parse(&octets, &Limits::default()).unwrap_err();
    assert_eq!((error.offset, error.kind), (6, ParseErrorKind::NotUtf8));
}

#[test]
fn limits_hold() {
    let limits = Limits {
        max_octets: 40,
        max_depth: 4,
        max_terms: 6,
    };
    let read = |text: &str| {
        let octets = Bytes::copy_from_slice(text.as_bytes());
        Content::parse(&octets, &limits).map_err(|error| error.kind)
    };
    assert!(read("((a (b (c))))").is_ok());
    let deep = ParseErrorKind::Limit("parentheses are nested too deep");
    assert_eq!(read("((a (b (c (d)))))"), Err(deep));
    assert!(read("((a 1 2 3 4 5))").is_ok());
    let many = ParseErrorKind::Limit("too many terms");
    assert_eq!(read("((a 1 2 3 4 5 6))"), Err(many));
    let long = ParseErrorKind::Limit("the content is too long");
    assert_eq!(read(&format!("({})", "x".repeat(40))), Err(long));
}

#[test]
fn a_mountain_of_parentheses_is_refused_whatever_the_limit() {
    let octets = Bytes::from("(a ".repeat(1_000_000));
    let limits = Limits {
        max_depth: usize::MAX,
        ..Limits::default()
    };
    let error = Term::parse(&octets, &limits).unwrap_err();
    assert!(matches!(error.kind, ParseErrorKind::Limit(_)));
}

#[test]
fn the_smallest_profile_is_found() {
    let profile = |text: &str| content(text).profile();
    assert_eq!(profile("((action a (open door)))"), Profile::Sl0);
    assert_eq!(
        profile("((done (action a (open door))) true)"),
        Profile::Sl0
    );
    assert_eq!(
        profile("((result (action a (get)) (sequence 1 2)))"),
        Profile::Sl0
    );
    assert_eq!(
        profile("((not (and p (or q (implies r (equiv s t))))))"),
        Profile::Sl1
    );
    assert_eq!(
        profile("((iota ?x (result (action a (get)) ?x)))"),
        Profile::Sl2
    );
    assert_eq!(profile("((= (any ?x (p ?x)) 1))"), Profile::Sl2);
    assert_eq!(profile("((B a (U b (PG c (I d p)))))"), Profile::Sl2);
    assert_eq!(
        profile("((feasible (; (action a x) (| (action a y) (action a z)))))"),
        Profile::Sl2
    );
    assert_eq!(
        profile("((forall ?x (exists ?y (loves ?x ?y))))"),
        Profile::Sl2
    );
    assert_eq!(
        profile("((exists ?y (forall ?x (loves ?x ?y))))"),
        Profile::Sl
    );
    assert_eq!(profile("((not (exists ?x (p ?x))))"), Profile::Sl);
    // A predicate of an application may bear the name of an operator.
    assert_eq!(profile("((all clear here now))"), Profile::Sl0);
}

#[test]
fn a_language_names_a_profile() {
    assert_eq!(Profile::from_language("FIPA-SL0"), Some(Profile::Sl0));
    assert_eq!(Profile::from_language("fipa-sl"), Some(Profile::Sl));
    assert_eq!(Profile::from_language("kif"), None);
    assert!(Profile::Sl2.language() == "fipa-sl2" && Profile::Sl2 < Profile::Sl);
}

#[test]
fn long_texts_share_the_buffer_they_were_read_from() {
    let octets = Bytes::from_static(b"((open \"the gripper of the left arm\"))");
    let content = Content::parse(&octets, &Limits::default()).unwrap();
    let open = content.first().functional("open").unwrap();
    let text: Text = open.positional()[0].as_text().unwrap();
    assert!(octets.as_ptr_range().contains(&text.as_ptr()));
}
