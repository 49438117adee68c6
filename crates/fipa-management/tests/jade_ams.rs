//! Recorded requests to an AMS, ours in the place of JADE's.

mod support;

use fipa_acl::{Message, Performative};
use fipa_management::client::agents_result;
use fipa_management::{Ams, AmsConfig, Origin, Reason, client};
use support::{Town, recorded, sorted};

const JADE: &str = "http://127.0.0.1:7778/acc";

fn plat_a() -> Town {
    Town::new("platA", JADE)
        .with("ams@platA", "ams", true)
        .with("df@platA", "df", true)
        .with("echo@platA", "echo", true)
        .with("elsewhere@platB", "echo", false)
}

fn ams(allow_foreign: bool) -> Ams {
    Ams::new(AmsConfig {
        allow_foreign,
        ..AmsConfig::new("ams@platA")
    })
}

fn ask(ams: &mut Ams, town: &mut Town, file: &str) -> Message {
    ams.handle(Origin::Foreign, &recorded(file), town).unwrap()
}

/// Answers as JADE did, the order of parameters and its own reply-with aside.
fn answers_as_recorded(ams: &mut Ams, town: &mut Town, case: &str) {
    let answer = ask(ams, town, &format!("{case}.req.http"));
    let theirs = recorded(&format!("{case}.reply.acl"));
    assert_eq!(sorted(&answer), sorted(&theirs), "{case}");
    same_head(&answer, &theirs);
}

fn same_head(answer: &Message, theirs: &Message) {
    assert_eq!(answer.performative, theirs.performative);
    assert_eq!(answer.receiver, theirs.receiver);
    assert_eq!(answer.in_reply_to, theirs.in_reply_to);
    assert_eq!(answer.conversation_id, theirs.conversation_id);
    assert_eq!(answer.language, theirs.language);
    assert_eq!(answer.ontology, theirs.ontology);
    assert_eq!(answer.protocol, theirs.protocol);
    let names = [answer, theirs].map(|message| &message.sender.as_ref().unwrap().name);
    assert_eq!(names[0], names[1]);
}

#[test]
fn registering_and_deregistering_is_answered_as_jade_does_where_strangers_may() {
    let (mut ams, mut town) = (ams(true), plat_a());
    answers_as_recorded(&mut ams, &mut town, "in_ams-register");
    assert!(town.agents["pyagent@pyplat"].1);
    assert_eq!(
        town.addresses["pyagent@pyplat"],
        ["http://127.0.0.1:9991/acc"]
    );
    let again = ask(&mut ams, &mut town, "in_ams-register.req.http");
    assert_eq!(again.performative, Performative::Failure);
    assert_eq!(
        client::done(&again),
        Err(client::AnswerError::Failed(Reason::AlreadyRegistered))
    );
    answers_as_recorded(&mut ams, &mut town, "in_ams-deregister");
    assert!(!town.agents.contains_key("pyagent@pyplat"));
    answers_as_recorded(&mut ams, &mut town, "in_ams-deregister-again");
}

#[test]
fn strangers_are_refused_unless_they_are_allowed() {
    let (mut ams, mut town) = (ams(false), plat_a());
    for file in [
        "in_ams-register.req.http",
        "out_string_ams-register.acl",
        "out_string_ams-deregister.acl",
        "in_ams-deregister.req.http",
    ] {
        let answer = ask(&mut ams, &mut town, file);
        assert_eq!(answer.performative, Performative::Refuse, "{file}");
        let [action, reason] = <[_; 2]>::try_from(sorted(&answer)).unwrap();
        assert_eq!(Reason::from(&reason), Reason::Unauthorised);
        assert_eq!(vec![action], sorted(&recorded(file)), "{file}");
    }
    assert_eq!(town.agents.len(), 4);
}

#[test]
fn a_search_lists_the_agents_of_the_platform_with_their_addresses() {
    let (mut ams, mut town) = (ams(true), plat_a());
    ask(&mut ams, &mut town, "in_ams-register.req.http");
    let names = |answer: &Message| {
        let agents = agents_result(answer).unwrap().into_iter();
        let mut names: Vec<_> = agents.map(|agent| agent.name.unwrap().name).collect();
        names.sort();
        names
    };
    for case in ["in_ams-search-name", "in_ams-search-after-register"] {
        let answer = ask(&mut ams, &mut town, &format!("{case}.req.http"));
        let theirs = recorded(&format!("{case}.reply.acl"));
        same_head(&answer, &theirs);
        assert_eq!(names(&answer), names(&theirs), "{case}");
    }
    let answer = ask(&mut ams, &mut town, "in_ams-search-after-register.req.http");
    let agents = agents_result(&answer).unwrap();
    assert!(
        agents
            .iter()
            .all(|agent| agent.state.as_ref().unwrap().as_str() == "active")
    );
    let of = |name: &str| {
        let mut agents = agents.iter();
        agents
            .find(|agent| agent.name.as_ref().unwrap().name == name)
            .unwrap()
    };
    assert_eq!(of("echo@platA").name.as_ref().unwrap().addresses, [JADE]);
    let stranger = of("pyagent@pyplat");
    assert_eq!(stranger.ownership.as_ref().unwrap(), &"me");
    assert_eq!(
        stranger.name.as_ref().unwrap().addresses,
        ["http://127.0.0.1:9991/acc"]
    );
}

#[test]
fn the_management_console_is_told_what_the_platform_is() {
    let mut town = Town::new("pyplat", "http://127.0.0.1:9994/acc");
    town.service = "http-mtp".to_owned();
    let mut ams = Ams::new(AmsConfig::new("ams@pyplat"));
    let answer = ask(&mut ams, &mut town, "rma_get-description.req.http");
    let theirs = recorded("rma_get-description.answer_inform.http");
    assert_eq!(sorted(&answer), sorted(&theirs));
    same_head(&answer, &theirs);
}

#[test]
fn a_function_that_nobody_has_is_refused() {
    // JADE calls it not understood; the standard has a reason for it.
    let (mut ams, mut town) = (ams(true), plat_a());
    let answer = ask(&mut ams, &mut town, "in_ams-unknown-action.req.http");
    assert_eq!(answer.performative, Performative::Refuse);
    let reason = sorted(&answer).pop().unwrap();
    assert_eq!(
        Reason::from(&reason),
        Reason::UnsupportedFunction("frobnicate".into())
    );
}

#[test]
fn nobody_creates_agents_here_or_asks_for_containers() {
    let (mut ams, mut town) = (ams(true), plat_a());
    for case in [
        "fed_create-agent",
        "fed_query-agents",
        "fed_query-platform",
        "fed_deregister-from",
    ] {
        let answer = ask(&mut ams, &mut town, &format!("{case}.req.http"));
        assert_eq!(answer.performative, Performative::NotUnderstood, "{case}");
        let reason = sorted(&answer).pop().unwrap();
        assert_eq!(
            Reason::from(&reason),
            Reason::UnsupportedValue("ontology".into())
        );
    }
    assert_eq!(town.agents.len(), 4);
}
