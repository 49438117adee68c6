//! Recorded requests to a DF, ours in the place of JADE's.

mod support;

use std::time::Duration;

use fipa_acl::{Expression, FipaTime, Message, Performative};
use fipa_directory::Now;
use fipa_management::client::{self, AnswerError, notification, search_result};
use fipa_management::{Df, DfAgentDescription, DfConfig, Origin, Reason, ServiceDescription};
use support::{Town, only, recorded, sent, sorted};

const NOW: Now = Now {
    mono: Duration::from_secs(100),
    unix_millis: 1_795_341_600_000,
};

fn plat_a() -> Town {
    Town::new("platA", "http://127.0.0.1:7778/acc")
}

fn df() -> Df {
    Df::new(DfConfig::new("df@platA", "u"))
}

fn ask(df: &mut Df, message: &Message) -> Message {
    df.handle(NOW, Origin::Foreign, message, &plat_a());
    only(df)
}

/// Registers a description, as its own agent does.
fn register(df: &mut Df, description: &DfAgentDescription) -> Vec<Message> {
    let agent = description.name.clone().unwrap();
    let request = client::df_register_request(&"df@platA".into(), description).from_agent(agent);
    df.handle(NOW, Origin::Foreign, &request, &plat_a());
    let mut messages = sent(df);
    client::done(&messages.pop().unwrap()).unwrap();
    messages
}

fn same_head(answer: &Message, theirs: &Message) {
    assert_eq!(answer.performative, theirs.performative);
    assert_eq!(answer.receiver, theirs.receiver);
    assert_eq!(answer.in_reply_to, theirs.in_reply_to);
    assert_eq!(answer.conversation_id, theirs.conversation_id);
    assert_eq!(answer.language, theirs.language);
    assert_eq!(answer.ontology, theirs.ontology);
    assert_eq!(answer.protocol, theirs.protocol);
    assert_eq!(answer.user_defined, theirs.user_defined);
    let names = [answer, theirs].map(|message| &message.sender.as_ref().unwrap().name);
    assert_eq!(names[0], names[1]);
}

/// Answers as JADE did, the order of parameters and its own reply-with aside.
fn answers_as_recorded(df: &mut Df, case: &str) {
    let answer = ask(df, &recorded(&format!("{case}.req.http")));
    let theirs = recorded(&format!("{case}.reply.acl"));
    assert_eq!(sorted(&answer), sorted(&theirs), "{case}");
    same_head(&answer, &theirs);
}

/// The reason of a refusal or failure, which stands behind the action.
fn reason(answer: &Message) -> Reason {
    Reason::from(&sorted(answer).pop().unwrap())
}

#[test]
fn registering_is_answered_as_jade_does() {
    let mut df = df();
    answers_as_recorded(&mut df, "in_df-register-noname");
    answers_as_recorded(&mut df, "in_df-register");
    let again = ask(&mut df, &recorded("in_df-register.req.http"));
    assert_eq!((again.performative.clone(), reason(&again)), {
        (Performative::Failure, Reason::AlreadyRegistered)
    });
    answers_as_recorded(&mut df, "in_df-deregister");
    answers_as_recorded(&mut df, "in_df-register-lease");
    assert_eq!(df.len(), 1);
    let gone = ask(&mut df, &recorded("in_df-deregister.req.http"));
    assert_eq!(gone.performative, Performative::Inform);
    let again = ask(&mut df, &recorded("in_df-deregister.req.http"));
    assert_eq!((again.performative.clone(), reason(&again)), {
        (Performative::Failure, Reason::NotRegistered)
    });
}

#[test]
fn searching_is_answered_as_jade_does() {
    for case in [
        "in_df-search-type",
        "in_df-search-depth",
        "in_df-search-none",
        "in_df-lower-ontology",
        "in_df-no-protocol",
    ] {
        let mut df = df();
        for known in search_result(&recorded(&format!("{case}.reply.acl"))).unwrap() {
            register(&mut df, &known);
        }
        answers_as_recorded(&mut df, case);
    }
}

#[test]
fn what_an_agent_of_jade_registers_is_found_by_its_search() {
    let mut df = Df::new(DfConfig::new("df@pyplat", "u"));
    let granted = ask(&mut df, &recorded("out_string_df-register.acl"));
    let registered = client::registered(&granted).unwrap();
    let lease: FipaTime = "2031-02-03T04:05:06.789Z".parse().unwrap();
    assert_eq!(registered.lease_time, Some(lease));
    for case in ["df-search", "df-search-empty-template"] {
        let answer = ask(&mut df, &recorded(&format!("out_string_{case}.acl")));
        assert_eq!(
            search_result(&answer).unwrap(),
            std::slice::from_ref(&registered),
            "{case}"
        );
    }
    let told = ask(&mut df, &recorded("out_string_df-subscribe.acl"));
    assert_eq!(notification(&told).unwrap(), [registered]);
    // It cancels in another conversation, and names the first in the content.
    df.handle(
        NOW,
        Origin::Foreign,
        &recorded("out_string_df-cancel.acl"),
        &plat_a(),
    );
    assert_eq!(sent(&mut df), []);
    let done = ask(&mut df, &recorded("out_string_df-deregister.acl"));
    assert_eq!(client::done(&done), Ok(()));
}

#[test]
fn an_agent_of_another_platform_speaks_for_itself_only() {
    let mut df = df();
    for case in [
        "in2_df-reg0",
        "in2_df-dereg-post",
        "in2_df-fed-register",
        "in_df-unfederate",
        "mini_fed-register",
        "in_df-deregister-notify",
    ] {
        let answer = ask(&mut df, &recorded(&format!("{case}.req.http")));
        assert_eq!(answer.performative, Performative::Refuse, "{case}");
        assert_eq!(reason(&answer), Reason::Unauthorised, "{case}");
    }
    assert!(df.is_empty());
}

#[test]
fn one_of_ours_may_speak_for_others_and_is_answered_as_jade_does() {
    let (mut df, town) = (df(), plat_a());
    for case in [
        "in2_df-reg0",
        "in2_df-dereg-pre",
        "in2_df-fed-register",
        "in2_df-fed-deregister",
    ] {
        df.handle(
            NOW,
            Origin::Local,
            &recorded(&format!("{case}.req.http")),
            &town,
        );
        let (answer, theirs) = (only(&mut df), recorded(&format!("{case}.reply.acl")));
        assert_eq!(sorted(&answer), sorted(&theirs), "{case}");
        same_head(&answer, &theirs);
    }
}

#[test]
fn a_subscriber_is_told_what_is_there_as_jade_does() {
    let mut df = df();
    for known in notification(&recorded("in2_df-subscribe-existing.reply.acl")).unwrap() {
        register(&mut df, &known);
    }
    answers_as_recorded(&mut df, "in2_df-subscribe-existing");
    let post = DfAgentDescription::of("post@pyplat").service(ServiceDescription::new("p", "sport"));
    let told = register(&mut df, &post);
    assert_eq!(notification(&told[0]).unwrap(), std::slice::from_ref(&post));
    // The CANCEL has a reply-with, and is confirmed.
    let done = ask(&mut df, &recorded("in2_df-cancel-jade-style.req.http"));
    assert_eq!(done.performative, Performative::Inform);
    let bye = client::df_deregister_request(&"df@platA".into(), &"post@pyplat".into());
    assert_eq!(
        ask(&mut df, &bye.from_agent("post@pyplat")).performative,
        Performative::Inform
    );
    let again = ask(&mut df, &recorded("in2_df-cancel-jade-style.req.http"));
    assert_eq!(again.performative, Performative::Failure);
}

#[test]
fn a_subscriber_is_told_what_comes_and_goes_as_jade_does() {
    let (mut df, town) = (df(), plat_a());
    df.handle(
        NOW,
        Origin::Foreign,
        &recorded("in_df-subscribe.req.http"),
        &town,
    );
    assert_eq!(sent(&mut df), []);
    let gone = recorded("in_df-deregister-notify.reply.acl");
    let other = notification(&gone).unwrap().remove(0);
    let mut news = other.clone();
    news.services.push(ServiceDescription::new("n", "news"));
    assert_eq!(notification(&register(&mut df, &news)[0]).unwrap(), [news]);
    df.handle(
        NOW,
        Origin::Local,
        &recorded("in_df-deregister-notify.req.http"),
        &town,
    );
    let [told, done] = <[_; 2]>::try_from(sent(&mut df)).unwrap();
    assert_eq!(sorted(&told), sorted(&gone));
    same_head(&told, &gone);
    let theirs = recorded("in_df-deregister-notify.reply_2.acl");
    assert_eq!(sorted(&done), sorted(&theirs));
    same_head(&done, &theirs);
    ask(&mut df, &recorded("in_df-cancel.req.http"));
    assert_eq!(register(&mut df, &other), []);
}

#[test]
fn a_search_goes_on_to_federated_dfs_as_jade_does() {
    let mut df = df();
    let forwarded = recorded("in_df-search-federated.reply.acl");
    let child = forwarded.receiver[0].clone();
    let service = ServiceDescription::new("pydf", "fipa-df");
    register(
        &mut df,
        &DfAgentDescription::of(child.clone()).service(service),
    );
    let asked = ask(&mut df, &recorded("in_df-search-federated.req.http"));
    assert_eq!(sorted(&asked), sorted(&forwarded));
    assert_eq!(asked.receiver, forwarded.receiver);
    assert_eq!(asked.protocol, forwarded.protocol);
    assert_eq!(asked.language, forwarded.language);
    assert!(asked.reply_by.is_some() && asked.reply_with == asked.conversation_id);

    let mut found = recorded("in2_df-fed-child-answer.req.http");
    found.sender = Some(child);
    found.in_reply_to = asked.reply_with.clone();
    found.conversation_id = asked.conversation_id.clone();
    let answer = ask(&mut df, &found);
    assert_eq!(
        answer.conversation_id,
        Some("in-df-search-federated".into())
    );
    assert_eq!(
        search_result(&answer).unwrap(),
        search_result(&found).unwrap()
    );

    let mut again = recorded("in2_df-fed-search-same-id.req.http");
    ask(&mut df, &again);
    let theirs = recorded("in2_df-fed-search-same-id.reply.acl");
    again.reply_with = Some("rw-df-fed-search-same-id".into());
    let refused = ask(&mut df, &again);
    assert_eq!(sorted(&refused), sorted(&theirs));
    same_head(&refused, &theirs);
}

#[test]
fn what_cannot_be_read_is_not_understood_as_jade_says_it() {
    for case in ["in_df-bad-content", "in2_df-subscribe-bad"] {
        let answer = ask(&mut df(), &recorded(&format!("{case}.req.http")));
        let theirs = recorded(&format!("{case}.reply.acl"));
        assert_eq!(answer.performative, theirs.performative);
        assert_eq!(answer.conversation_id, theirs.conversation_id);
        assert_eq!(answer.in_reply_to, theirs.in_reply_to);
        assert_eq!(reason(&answer), Reason::UnrecognisedValue("content".into()));
    }
}

#[test]
fn a_function_of_the_ams_is_refused_as_jade_does() {
    let answer = ask(&mut df(), &recorded("in_df-unknown-action.req.http"));
    let theirs = recorded("in_df-unknown-action.reply.acl");
    same_head(&answer, &theirs);
    assert_eq!(sorted(&answer)[0], sorted(&theirs)[0]);
    // JADE does not say which function it is.
    assert_eq!(
        reason(&answer),
        Reason::UnsupportedFunction("get-description".into())
    );
}

#[test]
fn where_the_standard_has_an_answer_and_jade_none_the_standard_counts() {
    let answer = ask(&mut df(), &recorded("in_df-query-ref.req.http"));
    assert_eq!(answer.performative, Performative::NotUnderstood);
    assert_eq!(reason(&answer), Reason::UnsupportedAct("query-ref".into()));

    let answer = ask(
        &mut df(),
        &recorded("in_df-search-no-constraints-arg.req.http"),
    );
    assert_eq!(answer.performative, Performative::Refuse);
    assert_eq!(
        reason(&answer),
        Reason::MissingArgument("search-constraints".into())
    );

    let mut kif = recorded("in_df-search-type.req.http");
    kif.language = Some(Expression::from("kif"));
    let answer = ask(&mut df(), &kif);
    assert_eq!(answer.performative, Performative::NotUnderstood);
    assert_eq!(reason(&answer), Reason::UnsupportedValue("language".into()));
    assert_eq!(answer.language, Some("fipa-sl0".into()));
}

#[test]
fn answers_of_jade_are_read() {
    let found = search_result(&recorded("in_df-search-type.reply.acl")).unwrap();
    let [weather] = <[_; 1]>::try_from(found).unwrap();
    assert_eq!(weather.name.as_ref().unwrap().name, "pyagent@pyplat");
    let service = &weather.services[0];
    assert_eq!(service.kind.as_ref().unwrap(), &"climate");
    assert_eq!(service.properties[0].name, "country");
    assert_eq!(weather.languages, ["fipa-sl0"]);

    let failed = |file: &str| client::done(&recorded(file)).unwrap_err();
    assert_eq!(
        failed("in_ams-deregister-again.reply.acl"),
        AnswerError::Failed(Reason::NotRegistered)
    );
    assert_eq!(
        failed("in2_df-fed-search-same-id.reply.acl"),
        AnswerError::Failed(Reason::InternalError("search-id already served".into()))
    );
    assert_eq!(
        failed("in_df-register-noname.reply.acl").to_string(),
        "refused: the df-agent-description needs a parameter :name"
    );
    assert_eq!(
        failed("in_df-bad-content.reply.acl"),
        AnswerError::NotUnderstood(Reason::UnrecognisedValue("content".into()))
    );
    let AnswerError::NotUnderstood(Reason::InternalError(words)) =
        failed("in2_df-subscribe-bad.reply.acl")
    else {
        panic!("another answer");
    };
    assert!(words.starts_with("Parse exception"));
    let AnswerError::Failed(Reason::InternalError(words)) = failed("in_unknown-agent.reply.acl")
    else {
        panic!("another answer");
    };
    assert!(words.starts_with("Agent not found"), "{words}");
    assert_eq!(
        client::description_result(&recorded("rma_get-description.answer_agree.http")),
        Err(AnswerError::NotYet)
    );
}
