//! The content language: what is printed is read as the same, and what is wrong is told where.

use fipa_actions::{
    Action, Content, Kind, Limits, Mismatch, Name, Number, Signature, Task, TaskState, Value, parse,
};
use proptest::prelude::*;

fn read(text: &str) -> Result<Content, String> {
    parse(text, &Limits::default()).map_err(|error| error.to_string())
}

fn name(text: &str) -> Name {
    Name::new(text).unwrap()
}

#[test]
fn every_content_is_read() {
    let dock = Action {
        name: name("dock"),
        arguments: vec![
            (name("target"), Value::Text("sherpa@robot1".to_owned())),
            (name("emi"), Value::Number(Number::new(-0.5).unwrap())),
            (name("lock"), Value::Truth(true)),
            (name("why"), Value::Text("a \"b\" \\ c\nd".to_owned())),
        ],
    };
    let text = r#"dock(target: sherpa@robot1, emi: -0.5, lock: true, why: "a \"b\" \\ c\nd")"#;
    assert_eq!(read(&format!("do {text}")), Ok(Content::Do(dock.clone())));
    assert_eq!(read("actions?"), Ok(Content::AskActions(None)));
    assert_eq!(
        read("actions? dock"),
        Ok(Content::AskActions(Some(name("dock"))))
    );
    assert_eq!(read("status?"), Ok(Content::AskStatus(None)));
    assert_eq!(read("status? 7"), Ok(Content::AskStatus(Some(7))));
    assert_eq!(read("actions"), Ok(Content::Actions(Vec::new())));
    let signature = Signature {
        name: name("dock"),
        parameters: vec![(name("target"), Kind::Text), (name("emi"), Kind::Number)],
        description: "Drive there.".to_owned(),
    };
    let text = format!("status\n  7 running 40% {text}\n  8 waiting stop()\n");
    let Ok(Content::Status(tasks)) = read(&text) else {
        panic!("{text}")
    };
    assert_eq!(tasks[0].action, dock);
    assert_eq!(tasks[0].percent, Some(40));
    assert_eq!(tasks[1].state, TaskState::Waiting);
    assert_eq!(tasks[1].percent, None);
    assert_eq!(
        read("actions dock(target: text, emi: number) \"Drive there.\""),
        Ok(Content::Actions(vec![signature]))
    );
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    for (text, told) in [
        ("", "1:1: expected do, actions or status, found the end"),
        ("go", "1:1: expected do, actions or status, found \"go\""),
        ("do", "1:3: expected a name, found the end"),
        ("do dock", "1:8: expected \"(\", found the end"),
        ("do dock(a: 1 b: 2)", "1:14: expected \",\", found \"b\""),
        ("do dock(a: 1, a: 2)", "1:15: a stands twice"),
        ("do dock(a: )", "1:12: expected a value, found \")\""),
        (
            "do dock(a: 1.)",
            "1:12: expected a number such as -0.5, found \"1.\"",
        ),
        ("do dock(a:\n  \"b)", "2:3: this text has no closing quote"),
        (
            "do dock(a: \"\\x\")",
            "1:13: after \\ there must be \", \\ or n",
        ),
        ("do dock() now", "1:11: expected the end, found \"now\""),
        (
            "status? dock",
            "1:9: expected the number of a task, found \"dock\"",
        ),
        (
            "status 1 done 101% dock()",
            "1:15: expected 0 to 100, found \"101\"",
        ),
        (
            "status\n 1 gone dock()",
            "2:4: expected waiting or running or done or failed or cancelled, found \"gone\"",
        ),
        (
            "actions dock(a: metres)",
            "1:17: expected number or text or truth, found \"metres\"",
        ),
    ] {
        assert_eq!(read(text), Err(told.to_owned()), "{text}");
    }
}

#[test]
fn limits_hold() {
    let limits = Limits {
        max_octets: 40,
        max_items: 2,
    };
    let told = |text: &str| parse(text, &limits).map_err(|error| error.to_string());
    assert!(told("do a(b: 1, c: 2)").is_ok());
    assert_eq!(
        told("do a(b: 1, c: 2, d: 3)"),
        Err("1:18: there are more than 2".to_owned())
    );
    assert_eq!(
        told("actions a() b() c()"),
        Err("1:17: there are more than 2".to_owned())
    );
    assert_eq!(
        told(&"a".repeat(41)),
        Err("1:1: the content is longer than 40 octets".to_owned())
    );
}

#[test]
fn an_action_is_measured_by_its_signature() {
    let Ok(Content::Actions(signatures)) = read("actions dock(target: text, emi: number)") else {
        panic!()
    };
    let check = |text: &str| {
        let Ok(Content::Do(action)) = read(text) else {
            panic!("{text}")
        };
        signatures[0].check(&action)
    };
    assert_eq!(check("do dock(emi: 2, target: crex)"), Ok(()));
    assert_eq!(check("do stop()"), Err(Mismatch::Action(name("stop"))));
    assert_eq!(
        check("do dock(emi: 2)"),
        Err(Mismatch::Missing(name("target")))
    );
    let wrong = check("do dock(emi: two, target: crex)").unwrap_err();
    assert_eq!(wrong.to_string(), "emi is not a number");
    assert_eq!(
        check("do dock(emi: 2, target: crex, speed: 1)"),
        Err(Mismatch::Unknown(name("speed")))
    );
}

fn names() -> impl Strategy<Value = Name> {
    "[a-zA-Z][a-zA-Z0-9_.@-]{0,8}".prop_map(|text| Name::new(text).unwrap())
}

fn values() -> impl Strategy<Value = Value> {
    let number = any::<f64>().prop_filter_map("finite", |number| Number::new(number).ok());
    prop_oneof![
        number.prop_map(Value::Number),
        any::<bool>().prop_map(Value::Truth),
        any::<String>().prop_map(Value::Text),
        names().prop_map(|name| Value::Text(name.to_string())),
    ]
}

fn kinds() -> impl Strategy<Value = Kind> {
    prop_oneof![Just(Kind::Number), Just(Kind::Text), Just(Kind::Truth)]
}

fn pairs<T: std::fmt::Debug>(
    part: impl Strategy<Value = T>,
) -> impl Strategy<Value = Vec<(Name, T)>> {
    let map = proptest::collection::btree_map(names(), part, 0..4);
    map.prop_map(|map| map.into_iter().collect())
}

fn actions() -> impl Strategy<Value = Action> {
    let both = (names(), pairs(values()));
    both.prop_map(|(name, arguments)| Action { name, arguments })
}

fn signatures() -> impl Strategy<Value = Signature> {
    let all = (names(), pairs(kinds()), any::<String>());
    all.prop_map(|(name, parameters, description)| Signature {
        name,
        parameters,
        description,
    })
}

fn tasks() -> impl Strategy<Value = Task> {
    let states = prop_oneof![Just(TaskState::Running), Just(TaskState::Cancelled)];
    let percent = proptest::option::of(0..=100u8);
    let all = (any::<u32>(), states, percent, actions());
    all.prop_map(|(number, state, percent, action)| Task {
        number,
        state,
        percent,
        action,
    })
}

fn contents() -> impl Strategy<Value = Content> {
    let some = 0..4;
    prop_oneof![
        actions().prop_map(Content::Do),
        proptest::option::of(names()).prop_map(Content::AskActions),
        any::<Option<u32>>().prop_map(Content::AskStatus),
        proptest::collection::vec(signatures(), some.clone()).prop_map(Content::Actions),
        proptest::collection::vec(tasks(), some).prop_map(Content::Status),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_printed_is_read_as_the_same(content in contents()) {
        prop_assert_eq!(read(&content.to_string()), Ok(content));
    }

    #[test]
    fn any_text_is_read_or_refused_with_a_place_in_it(text in "(do|status|actions)?[ a-z0-9():,\"\\\\?%\n.-]{0,40}") {
        if let Err(error) = parse(&text, &Limits::default()) {
            prop_assert!(error.line <= text.lines().count() + 1);
            prop_assert!(error.column <= text.chars().count() + 1);
        }
    }
}
