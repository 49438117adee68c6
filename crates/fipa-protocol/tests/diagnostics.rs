//! What is wrong with a file: where, what, and what to do about it.

use fipa_protocol::{Limits, Severity, load};
use proptest::prelude::*;

/// The diagnostics of a file of these states, whose first line is the outermost element.
fn diagnostics(states: &str) -> Vec<String> {
    let text =
        format!("<scxml initial=\"1\" xmlns:f=\"urn:x-fipa:protocol:1\">\n{states}\n</scxml>");
    let loaded = load("test", text.as_bytes(), &Limits::default()).unwrap();
    let errors = loaded
        .diagnostics
        .iter()
        .any(|d| d.severity == Severity::Error);
    assert_eq!(loaded.protocol.is_none(), errors);
    loaded.diagnostics.iter().map(ToString::to_string).collect()
}

fn refusal(text: impl AsRef<[u8]>) -> String {
    load("test", text.as_ref(), &Limits::default())
        .unwrap_err()
        .to_string()
}

const A: &str =
    r#"<state id="1"><transition performative="request" from="I" to="P" target="2"/></state>"#;

#[test]
fn a_target_that_is_not_there() {
    let wrong = r#"<state id="1"><transition performative="request" from="I" to="P" target="2"/></state>
<state id="2"><transition performative="inform" from="P" to="I" target="done2"/></state>
<final id="done"/>"#;
    assert_eq!(
        diagnostics(wrong),
        [
            r#"3:65: error [undeclared-target]: the target "done2" is no state of this file; did you mean done?"#
        ]
    );
    let text = r#"<scxml
  initial="x"><final id="1"/></scxml>"#;
    let loaded = load("test", text.as_bytes(), &Limits::default()).unwrap();
    assert_eq!(
        loaded.diagnostics[0].to_string(),
        r#"2:3: error [undeclared-target]: the initial state "x" is no state of this file; declare it, or name a state that is there"#
    );
}

#[test]
fn everything_that_is_wrong_is_told_at_once() {
    let wrong = r#"<f:role name="nobody"/>
<state id="1"><transition performative="request" from="I" to="P" target="nowhere"/>
<transition performative="inform" from="I" to="P" target="2"/>
<transition performative="inform" from="I" to="P" target="3"/>
<transition performative="(" from="I" to="P" target="3"/></state>
<state id="2"/><final id="3"/><final id="4"/>"#;
    let found = diagnostics(wrong);
    let codes = found
        .iter()
        .map(|one| one.split([' ', ']']).nth(2).unwrap());
    assert_eq!(
        codes.collect::<Vec<_>>(),
        [
            "[unused-role",
            "[undeclared-target",
            "[ambiguous-transition",
            "[syntax",
            "[dead-end",
            "[unreachable-state",
        ],
        "{found:#?}"
    );
}

#[test]
fn a_state_that_cannot_be_reached() {
    assert_eq!(
        diagnostics(&format!("{A}\n<final id=\"2\"/>\n  <final id=\"3\"/>")),
        [
            "4:3: warning [unreachable-state]: no message leads to the state 3; add a transition to it, or take it out"
        ]
    );
}

#[test]
fn a_state_that_cannot_be_left() {
    assert_eq!(
        diagnostics(&format!("{A}\n<state id=\"2\"/>\n")),
        [
            "3:1: error [dead-end]: the state 2 is not final, and no message leads out of it; declare it final, or add a transition"
        ]
    );
    let circle =
        r#"<state id="2"><transition performative="inform" from="P" to="I" target="2"/></state>"#;
    let ends = r#"<state id="1"><transition performative="inform" from="I" to="P" target="3"/>
<transition performative="request" from="I" to="P" target="2"/></state><final id="3"/>"#;
    assert_eq!(
        diagnostics(&format!("{ends}\n{circle}")),
        [
            "4:1: warning [dead-end]: no messages lead from the state 2 to a final one; add a transition, or declare it final if a conversation may end there"
        ]
    );
    assert_eq!(
        diagnostics(&format!("{A}\n{circle}")),
        [
            "1:1: warning [dead-end]: no state is final; declare final=\"yes\" where a conversation may end"
        ]
    );
}

#[test]
fn two_transitions_for_one_message() {
    let state = |first: &str, second: &str| {
        diagnostics(&format!(
            r#"<state id="1"><transition performative="{first}" from="I" to="P" target="2"/>
<transition performative="{second}" from="I" to="P" target="3"/></state><final id="2"/><final id="3"/>"#
        ))
    };
    assert_eq!(
        state("inform|agree", "inform|refuse"),
        [
            "3:1: warning [ambiguous-transition]: in the state 1, inform or refuse leads to 3 here, and to 2 by the transition at 2:15; the first one is taken; let the acts or the roles differ"
        ]
    );
    assert_eq!(state("inform", "inform").len(), 1);
    assert_eq!(state(".*", "inform").len(), 1);
    // By its name first, then all the others.
    assert_eq!(state("failure", ".*"), [""; 0]);
    assert_eq!(state("inform", "agree"), [""; 0]);
}

#[test]
fn a_role_that_nobody_plays() {
    assert_eq!(
        diagnostics(&format!(
            "{A}<f:role name=\"I\"/>\n<f:role name=\"watcher\"/><final id=\"2\"/>"
        )),
        [
            "3:1: warning [unused-role]: no transition is from or to the role watcher; use it, take it out, or name the role that is meant"
        ]
    );
    let sub = r#"<state id="2" final="yes"><subprotocol name=".*" from="broker"/></state>"#;
    assert_eq!(diagnostics(&format!("{A}\n{sub}")).len(), 1);
    // Peers write what is not quite XML in comments, too.
    let anybody = sub.replace("broker", ".*") + "<!-- a -- b -->";
    assert_eq!(diagnostics(&format!("{A}\n{anybody}")), [""; 0]);
}

#[test]
fn elements_and_attributes_that_are_not_of_the_schema() {
    for (states, expected) in [
        (
            r#"<state final="yes"/>"#,
            "2:1: error [syntax]: a <state> has no id; ",
        ),
        (
            r#"<state id="1" final="maybe"/>"#,
            "2:15: error [syntax]: final=\"maybe\" has no meaning; it is yes, ",
        ),
        (
            "<final id=\"1\"/>\n<final id=\"1\"/>",
            "3:1: error [syntax]: the id 1 is that of the state at 2:1 as well; ",
        ),
        (
            r#"<state id="1"><transition performative="inform" from="I" to="P"/></state>"#,
            "2:15: error [syntax]: a <transition> without target; ",
        ),
        (
            r#"<state id="1"><transition performative="inform" from="I" target="1"/></state>"#,
            "2:15: error [syntax]: a <transition> without to; ",
        ),
        (
            r#"<state id="1"><transition performative="inform" to="I" target="1"/></state>"#,
            "2:15: error [syntax]: a <transition> without from; ",
        ),
        (
            r#"<state id="1"><transition from="I" to="P" target="1"/></state>"#,
            "2:15: error [syntax]: a <transition> without performative; ",
        ),
        (
            r#"<state id="1"><transition performative="(" from="I" to="P" target="1"/></state>"#,
            "2:27: error [syntax]: \"(\" is no regular expression: ",
        ),
        (
            r#"<state id="1"><transition performative="infrom" from="I" to="P" target="2"/></state><final id="2"/>"#,
            "2:27: warning [syntax]: \"infrom\" is none of the 22 acts of FIPA; did you mean inform?",
        ),
        (
            r#"<state id="1" final="yes"><trasition performative="inform" from="I" to="P" target="1"/></state>"#,
            "2:27: warning [syntax]: <trasition> is not known; did you mean <transition>? It is ignored",
        ),
        (
            r#"<transition performative="inform" from="I" to="P" target="1"/><final id="1"/>"#,
            "2:1: error [syntax]: <transition> stands outside of a state; ",
        ),
        (
            r#"<parallel id="2"/><final id="1"/>"#,
            "2:1: error [syntax]: <parallel> has no meaning in a conversation; ",
        ),
        (
            r#"<final id="1" f:outcome="great"/>"#,
            "2:15: error [syntax]: outcome=\"great\" has no meaning; ",
        ),
        (
            r#"<final id="1" f:timeout="5"/>"#,
            "2:15: error [syntax]: \"5\" is no time; ",
        ),
        (
            r#"<state id="1" initial="1"><final id="2"/></state>"#,
            "1:8: error [syntax]: entering this state never ends; ",
        ),
        (
            r#"<state id="1"><transition event="inform" tagret="2"/></state><final id="2"/>"#,
            "2:42: warning [syntax]: tagret is no attribute of <transition>; did you mean target? It is ignored",
        ),
        (
            r#"<final id="1" outcome="done"/>"#,
            "2:15: warning [syntax]: outcome is no attribute of <final>; write fipa:outcome, with \
             xmlns:fipa=\"urn:x-fipa:protocol:1\"; it is ignored",
        ),
        ("", "1:1: error [syntax]: <scxml> holds no state; "),
    ] {
        let found = diagnostics(states);
        assert!(
            found.iter().any(|d| d.starts_with(expected)),
            "{states}: {found:#?}"
        );
    }
}

#[test]
fn a_role_that_is_almost_another_one() {
    let wrong = r#"<state id="2"><transition performative="agree" from="partner" to="initiator" target="3"/></state>
<state id="3"><transition performative="inform" from="partner" to="initator" target="4"/></state><final id="4"/>"#;
    let open = r#"<state id="1"><transition performative="request" from="initiator" to="partner" target="2"/></state>"#;
    assert_eq!(
        diagnostics(&format!("{open}\n{wrong}")),
        [
            "4:15: warning [unused-role]: only this transition is from or to the role initator; did you mean initiator?"
        ]
    );
    let numbered = wrong.replace("initator", "partner2");
    assert_eq!(diagnostics(&format!("{open}\n{numbered}")), [""; 0]);
}

#[test]
fn states_that_stand_side_by_side_are_refused_once() {
    let parallel = r#"<parallel id="p"><state id="1"><transition event="request" target="2"/></state></parallel>
<state id="2"><history id="h"><transition target="1"/></history><transition event="inform" target="3"/></state><final id="3"/>"#;
    assert_eq!(
        diagnostics(parallel),
        [
            "2:1: error [syntax]: <parallel> has no meaning in a conversation; use states one after the \
             other; each participant has its own",
            "3:15: error [syntax]: <history> has no meaning in a conversation; use states one after the \
             other; each participant has its own",
        ]
    );
}

#[test]
fn what_is_not_xml_is_refused_with_its_place() {
    for (text, expected) in [
        ("", "1:1: this is not XML: there is no element"),
        (
            "hello",
            "1:1: this is not XML: text outside of the outermost element",
        ),
        (
            "<scxml>\n <state id='1'>",
            "2:16: this is not XML: the end of <state> is missing",
        ),
        ("<scxml>\n</state>", "2:1: this is not XML: "),
        ("<scxml><a x=1/></scxml>", "1:8: this is not XML: "),
        ("<scxml a='1' a='2'/>", "1:1: this is not XML: "),
        (
            "<scxml/>\n<scxml/>",
            "2:1: this is not XML: there is a second outermost element",
        ),
        ("<scxml/> &amp;", "1:10: this is not XML: text outside"),
        (
            "<scxml a='&nosuch;'/>",
            "1:8: this is not XML: &nosuch; stands for nothing that is known",
        ),
        ("<scxml>&nosuch;</scxml>", "1:8: this is not XML: &nosuch; "),
        (
            "<!DOCTYPE a [<!ENTITY b 'c'>]><scxml/>",
            "1:1: a document type with declarations of its own is not read",
        ),
        ("<1/>", "1:1: this is not XML: no tag begins like this"),
    ] {
        assert!(
            refusal(text).starts_with(expected),
            "{text}: {}",
            refusal(text)
        );
    }
    assert_eq!(refusal(b"<a>\n\xff</a>"), "2:1: this is not UTF-8");
}

#[test]
fn what_is_too_much_is_refused() {
    let limits = Limits {
        max_octets: 4_000,
        max_depth: 5,
        max_items: 100,
        max_states: 10,
        max_transitions: 20,
        max_pattern: 1 << 14,
    };
    let refused = |text: &str| load("test", text.as_bytes(), &limits).unwrap_err().what;
    assert_eq!(
        refused(&"<a>".repeat(6)),
        "elements are nested deeper than 5"
    );
    assert_eq!(
        refused(&" ".repeat(5000)),
        "the file is longer than 4000 octets"
    );
    assert_eq!(
        refused(&format!("<s>{}</s>", "<b/>".repeat(101))),
        "there are more than 100 elements and attributes"
    );
    let states: String = (0..11).map(|n| format!("<final id='{n}'/>")).collect();
    assert_eq!(
        refused(&format!("<s>{states}</s>")),
        "there are more than 10 states"
    );
    let inner: String = (0..7).map(|n| format!("<final id='{n}'/>")).collect();
    let many = "<transition event='inform' target='1'/>".repeat(3);
    assert_eq!(
        refused(&format!("<s><state id='x'>{many}{inner}</state></s>")),
        "there are more than 20 transitions"
    );
    let large = r#"<s><state id="1"><transition performative="(a{1000}){100}" from="I" to="P" target="1"/></state></s>"#;
    let loaded = load("test", large.as_bytes(), &limits).unwrap();
    assert!(
        loaded.diagnostics[0].message.contains("is too large"),
        "{loaded:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_octets_make_it_panic(octets in proptest::collection::vec(any::<u8>(), 0..200)) {
        let _ = load("test", &octets, &Limits::default());
    }

    #[test]
    fn no_file_made_of_its_words_makes_it_panic(words in proptest::collection::vec(0_usize..WORDS.len(), 0..40)) {
        let text: String = words.into_iter().map(|word| WORDS[word]).collect();
        let _ = load("test", format!("<scxml>{text}</scxml>").as_bytes(), &Limits::default());
        let _ = load("test", text.as_bytes(), &Limits::default());
    }
}

#[rustfmt::skip]
const WORDS: [&str; 14] = [
    "<state id='1'>", "<state id='2' initial='1'>", "</state>", "</state>", "<final id='3'/>", "<final id='3'>", "</final>",
    "<transition event='a.*' target='1'/>", "<transition event='done.state.2' target='2'/>",
    "<transition performative='.*' from='a' to='b' target='3'/>", "<initial><transition target='1'/></initial>",
    "<subprotocol name='.*' from='a' proxied_to='b'/>", "<transition event='inform'/>", "&amp;",
];
