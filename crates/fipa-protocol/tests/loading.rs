//! The dialect of fipa_acl and the standard SCXML mean the same.

use std::time::Duration;

use fipa_protocol::{Keeping, Limits, Outcome, Party, Protocol, Rules, load};

fn protocol(file: &str, text: &str) -> Protocol {
    let loaded = load(file, text.as_bytes(), &Limits::default()).unwrap();
    assert_eq!(loaded.diagnostics, [], "{text}");
    loaded.protocol.unwrap()
}

/// `state[!] act from>to target`, a line each.
fn shown(protocol: &Protocol) -> Vec<String> {
    let mut lines = Vec::new();
    for (_, state) in protocol.states() {
        let mark = if state.is_final() { "!" } else { "" };
        lines.push(format!("{}{mark}", state.id()));
        for t in state.transitions() {
            let (from, to) = (protocol.party_name(t.from()), protocol.party_name(t.to()));
            let target = protocol.state(t.target()).id();
            lines.push(format!("  {} {from}>{to} {target}", t.performatives()));
        }
    }
    lines
}

const DIALECT: &str = r#"<scxml version="1.0" initial="1">
    <state id="1">
        <!-- the question -->
        <transition performative="request" from="initiator" to="participant" target="2"/>
    </state>
    <state id="2" final="no">
        <transition performative="refuse" from="participant" to="initiator" target="3"/>
        <transition performative="agree|confirm" from="participant" to="initiator" target="4"/>
    </state>
    <state id="3" final="yes"/>
    <state id="4">
        <transition performative="inform" from="participant" to="initiator" target="5"/>
    </state>
    <state id="5" final="1"></state>
</scxml>"#;

#[test]
fn the_dialect_and_standard_scxml_mean_the_same() {
    let standard = r#"<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE scxml>
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="null">
  <datamodel><data id="state"><state>not one</state></data></datamodel>
  <initial><transition target="1"/></initial>
  <state id="1"><transition event="request" target="2"/></state>
  <state id="2">
    <onentry><log expr="'asked'"/></onentry>
    <transition event="refuse" from="participant" to="initiator" target="3"/>
    <transition event="agree confirm" from="participant" to="initiator" target="4"/>
  </state>
  <final id="3"><donedata/></final>
  <state id="4"><transition event="inform" from="participant" to="initiator" target="5"/></state>
  <final id="5"/>
</scxml>"#;
    let dialect = protocol("configuration/protocols/request", DIALECT);
    assert_eq!(dialect.name(), "request");
    assert_eq!(shown(&dialect), shown(&protocol("request.scxml", standard)));
    assert_eq!(
        shown(&dialect),
        [
            "1",
            "  request initiator>participant 2",
            "2",
            "  refuse participant>initiator 3",
            "  agree or confirm participant>initiator 4",
            "3!",
            "4",
            "  inform participant>initiator 5",
            "5!",
        ]
    );
}

#[test]
fn events_without_roles_are_taken_from_any_agent_of_the_conversation() {
    let plain = protocol(
        "plain.scxml",
        r#"<scxml initial="a"><state id="a"><transition event="query-ref" target="b"/></state>
           <state id="b"><transition event="agree"/><transition event="*" target="c"/></state><final id="c"/></scxml>"#,
    );
    assert_eq!(
        shown(&plain),
        [
            "a",
            "  query-ref initiator>participant b",
            "b",
            "  agree anybody>anybody b",
            "  any act anybody>anybody c",
            "c!"
        ]
    );
}

#[test]
fn nested_states_inherit_and_complete() {
    let nested = protocol(
        "nested.scxml",
        r#"<scxml name="nested">
  <state id="work" initial="asked">
    <transition event="failure" target="failed"/>
    <transition event="done.state.work" target="over"/>
    <state id="asked"><transition event="request" target="agreed"/></state>
    <state id="agreed"><transition event="inform" target="ready"/></state>
    <final id="ready"/>
  </state>
  <state id="over"><transition event="confirm" target="end"/></state>
  <final id="end"/>
  <final id="failed"/>
</scxml>"#,
    );
    assert_eq!(
        shown(&nested)[..8],
        [
            "asked",
            "  request initiator>participant agreed",
            "  failure initiator>participant failed",
            "agreed",
            "  inform anybody>anybody over",
            "  failure anybody>anybody failed",
            "over",
            "  confirm anybody>anybody end",
        ]
    );
}

#[test]
fn prefixes_are_those_of_their_namespaces() {
    let prefixed = protocol(
        "p",
        r#"<sc:scxml xmlns:sc="http://www.w3.org/2005/07/scxml" xmlns:q="urn:q" xmlns:own="urn:x-fipa:protocol:1" initial="a"
                own:aliases="short other" own:match="in-reply-to ontology" own:states="conversation" q:states="what">
             <own:role name="B"/><q:state id="not read"/>
             <sc:state id="a" own:timeout="1.5s" own:on-timeout="z" q:final="yes"><q:x/>
               <sc:transition own:performative="inform" own:from="A" own:to="B" target="z"/></sc:state>
             <sc:final id="z" own:outcome="refused"/>
           </sc:scxml>"#,
    );
    assert_eq!(prefixed.aliases(), ["short", "other"]);
    assert_eq!(prefixed.keeping(), Keeping::ByConversation);
    let matching = prefixed.matching();
    assert!(matching.in_reply_to && matching.ontology && !matching.language);
    let (_, a) = prefixed.states().next().unwrap();
    assert_eq!(a.timeout(), Some(Duration::from_millis(1500)));
    let z = prefixed.state(a.on_timeout().unwrap());
    assert_eq!(z.outcome(), Some(Outcome::Refused));
}

#[test]
fn the_rules_of_fipa_acl_generate_its_default_transitions() {
    let text = r#"<scxml initial="1" xmlns:f="urn:x-fipa:protocol:1" f:rules="fipa-acl">
      <state id="1"><transition performative="request" from="A" to="B" target="2"/></state>
      <state id="2">
        <transition performative="cancel" from="A" to="B" target="3"/>
        <transition performative="not-.*" from="B" to="A" target="3"/>
      </state>
      <state id="3" final="yes"/>
    </scxml>"#;
    let protocol = protocol("acl", text);
    assert_eq!(
        (protocol.rules(), protocol.keeping()),
        (Rules::FipaAcl, Keeping::ByConversation)
    );
    assert_eq!(
        shown(&protocol),
        [
            "1",
            "  request A>B 2",
            "  not-understood A>B not-understood",
            "  not-understood B>A not-understood",
            "  cancel A>B cancelling",
            "  cancel B>A cancelling",
            "  failure anybody>__self__ failed",
            "2",
            "  cancel A>B 3",
            "  not-understood B>A 3",
            // The declared cancel stops behind not-understood; the declared not-understood at once.
            "  not-understood A>B not-understood",
            "  not-understood B>A not-understood",
            "3!",
            "not-understood!",
            "cancelling",
            "  inform anybody>anybody cancelled",
            "  failure anybody>anybody cancel-failed",
            "cancelled!",
            "cancel-failed!",
            "failed!",
        ]
    );
    let plain = load("plain", DIALECT.as_bytes(), &Limits::default())
        .unwrap()
        .protocol
        .unwrap();
    assert_eq!(
        (plain.rules(), plain.keeping()),
        (Rules::Fipa, Keeping::ByParticipant)
    );
}

#[test]
fn subprotocols_of_every_age_of_the_dialect_are_read() {
    let text = r#"<scxml initial="1"><state id="1"><transition performative="proxy" from="I" to="B" target="2"/></state>
      <state id="2" final="yes"><transition performative=".*" from="B" to="I" target="2"/>
        <subprotocol name="request|inform" from="B" proxied_to="I"/>
        <subprotocol file="request" multiple="yes" from="B"><mapping from="B" to="I"/></subprotocol>
      </state></scxml>"#;
    let protocol = protocol("brokering", text);
    let (_, state) = protocol.states().nth(1).unwrap();
    let [first, second] = state.subprotocols() else {
        panic!()
    };
    assert!(first.name().matches("request") && !first.name().matches("query"));
    assert!(second.name().matches("query"));
    assert_eq!(protocol.party_name(first.proxied_to().unwrap()), "I");
    assert!(matches!(first.from(), Party::Role(_)) && second.proxied_to().is_none());
}
