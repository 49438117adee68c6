//! What one agent says and does, message by message.

use std::time::Duration;

use fipa_acl::{Message, Performative, Text};
use fipa_locking::{
    Algorithm, Config, FailureReason, LockAgent, LossReason, Output, Record, RequestError,
    list_query, read_list,
};

const H: Duration = Duration::from_secs(5);
const START: Duration = Duration::from_secs(100);
const RA: Algorithm = Algorithm::RicartAgrawalaExtended;
const SK: Algorithm = Algorithm::SuzukiKasamiExtended;

fn agent(name: &str) -> LockAgent {
    LockAgent::new(Config::new(name, 0))
}

fn owner(now: Duration, record: Record) -> LockAgent {
    let mut owner = agent("o");
    owner.own(now, "door", record).unwrap();
    owner
}

fn outputs(agent: &mut LockAgent) -> Vec<Output> {
    std::iter::from_fn(|| agent.poll_output()).collect()
}

fn sent(agent: &mut LockAgent) -> Vec<Message> {
    let sent = outputs(agent)
        .into_iter()
        .filter_map(|output| match output {
            Output::Send(message) => Some(message),
            _ => None,
        });
    sent.collect()
}

fn parameter(message: &Message, name: &str) -> Option<String> {
    let mut all = message.user_defined.iter();
    let found = all.find(|parameter| parameter.name == name)?;
    Some(found.value.to_string())
}

fn message(from: &str, act: Performative, protocol: &str, id: &str, content: &str) -> Message {
    let message = Message::new(act)
        .from_agent(from)
        .to("x")
        .protocol(protocol);
    message.conversation_id(id).content(content.to_owned())
}

fn confirm(from: &str, id: &str) -> Message {
    message(from, Performative::Confirm, RA.protocol(), id, "door").user_defined("X-Fencing", "0")
}

fn probe(from: &str, id: &str) -> Message {
    message(from, Performative::Request, "dlm_probe", id, "")
}

/// An agent that has all grants of the owner `o`, and has told it; the conversation of its request.
fn confirming(now: Duration) -> (LockAgent, Text) {
    let mut waiter = agent("w");
    waiter.request(now, "door", RA, [Text::from("o")]).unwrap();
    outputs(&mut waiter);
    let found = message("o", Performative::Inform, "dlm_discover", "w_0", "door");
    waiter.handle(now, &found);
    let asked = sent(&mut waiter);
    let id = asked[0].conversation_id.as_ref().unwrap().to_string();
    let grant = message("o", Performative::Agree, RA.protocol(), &id, "2\ndoor");
    waiter.handle(now, &grant);
    (waiter, Text::from(id))
}

fn granted(fencing: Option<u64>) -> Output {
    Output::Granted {
        resource: "door".into(),
        fencing,
    }
}

#[test]
fn the_owner_tells_a_number_only_after_it_is_durable_and_only_to_those_that_ask() {
    let mut owner = owner(
        START,
        Record {
            fencing: 6,
            held: false,
        },
    );
    owner.handle(START, &confirm("a", "a_1"));
    let record = Record {
        fencing: 7,
        held: true,
    };
    let persist = Output::Persist {
        resource: "door".into(),
        record,
    };
    assert_eq!(outputs(&mut owner), [persist]);
    owner.persisted(START, "door", 6);
    assert_eq!(outputs(&mut owner), []);
    owner.persisted(START, "door", 7);
    let answer = sent(&mut owner).remove(0);
    assert_eq!(answer.performative, Performative::Inform);
    assert_eq!(parameter(&answer, "Fencing").unwrap(), "7");

    let mut other = self::owner(START, Record::default());
    let plain = message("c", Performative::Confirm, RA.protocol(), "c_1", "door");
    other.handle(START, &plain);
    let said = sent(&mut other);
    assert_eq!(said.len(), 1);
    assert_eq!(said[0].protocol.as_deref(), Some("dlm_probe"));
    assert_eq!(other.owned().next().unwrap().holder, Some("c".into()));
}

#[test]
fn a_number_that_cannot_be_kept_is_refused_and_never_told() {
    let mut owner = owner(START, Record::default());
    owner.handle(START, &confirm("a", "a_1"));
    outputs(&mut owner);
    owner.persist_failed(START, "door", 1);
    let said = sent(&mut owner);
    assert_eq!(said[0].performative, Performative::Refuse);

    let (mut waiter, id) = confirming(START);
    outputs(&mut waiter);
    let refusal = message("o", Performative::Refuse, RA.protocol(), &id, "no room");
    waiter.handle(START, &refusal);
    let reason = FailureReason::Refused("no room".into());
    let failed = Output::Failed {
        resource: "door".into(),
        reason,
    };
    assert!(outputs(&mut waiter).contains(&failed));
}

#[test]
fn two_claims_are_answered_one_after_the_other() {
    let mut owner = owner(START, Record::default());
    owner.handle(START, &confirm("a", "a_1"));
    owner.persisted(START, "door", 1);
    owner.handle(START, &confirm("b", "b_1"));
    outputs(&mut owner);
    let view = owner.owned().next().unwrap();
    assert_eq!(
        (view.holder, view.waiting),
        (Some("a".into()), vec!["b".into()])
    );
    let back = message("a", Performative::Disconfirm, RA.protocol(), "a_1", "door");
    owner.handle(START, &back);
    owner.persisted(START, "door", 2);
    let view = owner.owned().next().unwrap();
    assert_eq!((view.holder, view.fencing), (Some("b".into()), Some(2)));
    // What comes late claims nothing.
    owner.handle(START, &confirm("a", "a_1"));
    assert_eq!(owner.owned().next().unwrap().waiting, ["b"; 0]);
}

#[test]
fn probes_are_answered_with_the_holder() {
    let mut owner = owner(START, Record::default());
    owner.handle(START, &probe("a", "a_7"));
    let answer = sent(&mut owner).remove(0);
    assert_eq!(answer.performative, Performative::Confirm);
    assert_eq!(
        answer.conversation_id.as_ref().unwrap().as_str(),
        Some("a_7")
    );
    assert_eq!(parameter(&answer, "Holder").unwrap(), "-");
    owner.handle(START, &confirm("b", "b_1"));
    owner.persisted(START, "door", 1);
    outputs(&mut owner);
    owner.handle(START, &probe("a", "a_8"));
    assert_eq!(parameter(&sent(&mut owner)[0], "Holder").unwrap(), "b");
}

#[test]
fn the_lease_ends_after_three_heartbeats_here_and_after_four_at_the_owner() {
    let (mut holder, id) = confirming(START);
    outputs(&mut holder);
    let number = message("o", Performative::Inform, RA.protocol(), &id, "door");
    holder.handle(START + H, &number.user_defined("X-Fencing", "1"));
    assert_eq!(outputs(&mut holder), [granted(Some(1))]);
    // It counts from when the owner was asked.
    let end = START + H * 3;
    holder.handle_timeout(end - Duration::from_millis(1));
    assert!(holder.holds(end - Duration::from_millis(1), "door"));
    assert!(!holder.holds(end, "door"));
    holder.handle_timeout(end);
    let reason = LossReason::LeaseExpired;
    let lost = Output::Lost {
        resource: "door".into(),
        reason,
    };
    assert!(outputs(&mut holder).contains(&lost));

    let mut owner = owner(START, Record::default());
    owner.handle(START, &confirm("w", &id));
    owner.persisted(START, "door", 1);
    let end = START + H * 4;
    owner.handle_timeout(end - Duration::from_millis(1));
    assert_eq!(owner.owned().next().unwrap().holder, Some("w".into()));
    owner.handle_timeout(end);
    assert_eq!(owner.owned().next().unwrap().holder, None);
}

#[test]
fn a_late_number_is_not_believed_before_the_owner_confirms_it() {
    let (mut holder, id) = confirming(START);
    outputs(&mut holder);
    let late = START + H * 3;
    let number = message("o", Performative::Inform, RA.protocol(), &id, "door");
    holder.handle(late, &number.user_defined("X-Fencing", "1"));
    let asked = sent(&mut holder);
    assert!(!holder.holds(late, "door"));
    assert_eq!(parameter(&asked[0], "Fencing").unwrap(), "1");
    let answer = asked[0].reply(Performative::Confirm).from_agent("o");
    let answer = answer
        .user_defined("X-Holder", "w")
        .user_defined("X-Fencing", "1");
    holder.handle(late, &answer);
    assert_eq!(outputs(&mut holder), [granted(Some(1))]);
}

#[test]
fn without_numbers_a_grant_is_believed_after_one_heartbeat() {
    let (mut holder, _) = confirming(START);
    let probes = sent(&mut holder);
    assert!(
        probes
            .iter()
            .any(|probe| parameter(probe, "Fencing").as_deref() == Some("0"))
    );
    let mut waiter = agent("w");
    waiter
        .request(START, "door", RA, [Text::from("o")])
        .unwrap();
    outputs(&mut waiter);
    let found = message("o", Performative::Inform, "dlm_discover", "w_0", "door");
    waiter.handle(START, &found);
    let said = sent(&mut waiter);
    let bare = said[1].reply(Performative::Confirm).from_agent("o");
    waiter.handle(START, &bare);
    let id = said[0].conversation_id.as_ref().unwrap().to_string();
    let grant = message("o", Performative::Agree, RA.protocol(), &id, "2\ndoor");
    waiter.handle(START, &grant);
    waiter.handle_timeout(START + H - Duration::from_millis(1));
    assert!(!waiter.holds(START + H, "door"));
    waiter.handle_timeout(START + H);
    assert!(outputs(&mut waiter).contains(&granted(None)));
}

#[test]
fn a_holder_that_is_dead_for_certain_is_replaced_at_once() {
    let mut owner = owner(START, Record::default());
    owner.handle(START, &confirm("a", "a_1"));
    owner.persisted(START, "door", 1);
    owner.agent_gone(START, "a");
    assert_eq!(owner.owned().next().unwrap().holder, None);
}

#[test]
fn an_owner_that_starts_again_waits_for_the_lease_of_an_earlier_holder_or_finds_it() {
    let record = Record {
        fencing: 3,
        held: true,
    };
    let mut owner = owner(START, record);
    owner.handle(START, &confirm("a", "a_1"));
    assert_eq!(outputs(&mut owner), []);
    let renewal = probe("b", "b_9").user_defined("X-Resource", "door");
    owner.handle(START + H, &renewal.user_defined("X-Fencing", "3"));
    assert_eq!(owner.owned().next().unwrap().holder, Some("b".into()));

    let mut owner = self::owner(START, record);
    let late = START + H * 3;
    owner.handle(late, &confirm("a", "a_1"));
    owner.handle_timeout(START + H * 4);
    owner.persisted(START + H * 4, "door", 4);
    assert_eq!(owner.owned().next().unwrap().holder, Some("a".into()));
}

#[test]
fn whoever_cannot_get_it_is_told_why() {
    let mut alone = agent("w");
    alone.request(START, "door", SK, [Text::from("x")]).unwrap();
    alone.handle_timeout(START + H * 4);
    let failed = |reason| Output::Failed {
        resource: "door".into(),
        reason,
    };
    assert!(outputs(&mut alone).contains(&failed(FailureReason::NoOwner)));

    let (mut waiter, _) = confirming(START);
    waiter.handle_timeout(START + H * 4);
    assert!(outputs(&mut waiter).contains(&failed(FailureReason::OwnerSilent)));

    let (mut waiter, _) = confirming(START);
    waiter.agent_gone(START, "o");
    assert!(outputs(&mut waiter).contains(&failed(FailureReason::OwnerGone)));

    let (mut waiter, _) = confirming(START);
    waiter.disconnected();
    assert!(outputs(&mut waiter).contains(&failed(FailureReason::Disconnected)));
}

#[test]
fn who_joins_while_we_wait_is_asked_and_who_is_gone_is_not_waited_for() {
    let mut waiter = agent("w");
    let both = ["o", "b"].map(Text::from);
    waiter.request(START, "door", RA, both.clone()).unwrap();
    outputs(&mut waiter);
    let found = message("o", Performative::Inform, "dlm_discover", "w_0", "door");
    waiter.handle(START, &found);
    let request = sent(&mut waiter).remove(0);
    let id = request.conversation_id.clone().unwrap();
    let three = ["o", "b", "c"].map(Text::from);
    waiter.set_participants(START, "door", three);
    let asked = sent(&mut waiter);
    assert_eq!(asked[0].receiver[0].name, "c");
    assert_eq!(asked[0].content, request.content);
    assert_eq!(asked[0].conversation_id, Some(id.clone()));
    for from in ["o", "b"] {
        let id = id.to_string();
        waiter.handle(
            START,
            &message(from, Performative::Agree, RA.protocol(), &id, "2\ndoor"),
        );
    }
    assert_eq!(outputs(&mut waiter), []);
    waiter.agent_gone(START, "c");
    assert_eq!(sent(&mut waiter)[0].performative, Performative::Confirm);
}

#[test]
fn what_cannot_be_read_is_not_understood_and_nothing_panics() {
    let protocols = Algorithm::ALL.map(Algorithm::protocol);
    for protocol in protocols.into_iter().chain(["dlm_discover", "dlm_probe"]) {
        for act in Performative::STANDARD {
            for content in ["", "1", "x\ny", "door\n99999999999999999999", "1\n"] {
                let mut owner = owner(START, Record::default());
                let bad = message("a", act.clone(), protocol, "a_1", content);
                assert!(owner.handle(START, &bad));
                assert!(owner.handle(
                    START,
                    &Message {
                        conversation_id: None,
                        ..bad
                    }
                ));
            }
        }
    }
    let mut owner = owner(START, Record::default());
    let bad = message("a", Performative::Request, RA.protocol(), "a_1", "door");
    owner.handle(START, &bad);
    assert_eq!(
        sent(&mut owner)[0].performative,
        Performative::NotUnderstood
    );
    let other = message("a", Performative::Request, "fipa-request", "a_1", "door");
    assert!(!owner.handle(START, &other));
}

#[test]
fn a_name_with_a_line_break_and_a_second_request_are_refused() {
    let mut agent = agent("w");
    let name = RequestError::Name("a\nb".into());
    assert_eq!(agent.request(START, "a\nb", RA, []), Err(name));
    agent.request(START, "door", RA, []).unwrap();
    let again = RequestError::Requested("door".into());
    assert_eq!(agent.request(START, "door", RA, []), Err(again));
}

#[test]
fn a_token_that_was_lent_for_an_earlier_request_is_returned_and_the_next_one_is_waited_for() {
    let mut waiter = agent("w");
    waiter
        .request(START, "door", SK, [Text::from("o")])
        .unwrap();
    outputs(&mut waiter);
    let found = message("o", Performative::Inform, "dlm_discover", "w_0", "door");
    waiter.handle(START, &found);
    let id = sent(&mut waiter)[0]
        .conversation_id
        .as_ref()
        .unwrap()
        .to_string();
    let token = "22 serialization::archive 18 4 door 0 0 0 0 0 0 0 0 0 0";
    let lent = |id: &str, number: &str| {
        let token = message("o", Performative::Propagate, SK.protocol(), id, token);
        token.user_defined("X-Fencing", number)
    };
    waiter.handle(START, &lent("w_earlier", "1"));
    let returned = sent(&mut waiter);
    assert_eq!(returned.len(), 1);
    assert_eq!(returned[0].performative, Performative::Propagate);
    assert_eq!(parameter(&returned[0], "Fencing").unwrap(), "1");
    waiter.handle(START, &lent(&id, "2"));
    assert_eq!(outputs(&mut waiter), [granted(Some(2))]);
}

#[test]
fn a_renewed_lease_counts_from_when_the_owner_was_asked() {
    let (mut holder, id) = confirming(START);
    let number = message("o", Performative::Inform, RA.protocol(), &id, "door");
    holder.handle(START, &number.user_defined("X-Fencing", "1"));
    outputs(&mut holder);
    holder.handle_timeout(START + H);
    let asked = sent(&mut holder).remove(0);
    let answer = asked.reply(Performative::Confirm).from_agent("o");
    let answer = answer
        .user_defined("X-Holder", "w")
        .user_defined("X-Fencing", "1");
    holder.handle(START + H * 2, &answer);
    assert!(holder.holds(START + H * 4 - Duration::from_millis(1), "door"));
    assert!(!holder.holds(START + H * 4, "door"));
}

#[test]
fn a_holder_that_the_owner_does_not_name_has_lost_it() {
    let (mut holder, id) = confirming(START);
    let number = message("o", Performative::Inform, RA.protocol(), &id, "door");
    holder.handle(START, &number.user_defined("X-Fencing", "1"));
    outputs(&mut holder);
    holder.handle_timeout(START + H);
    let asked = sent(&mut holder).remove(0);
    let answer = asked.reply(Performative::Confirm).from_agent("o");
    holder.handle(START + H, &answer.user_defined("X-Holder", "b"));
    let reason = LossReason::TakenBack;
    assert_eq!(
        outputs(&mut holder),
        [Output::Lost {
            resource: "door".into(),
            reason
        }]
    );
}

#[test]
fn the_earlier_request_goes_first_and_of_two_at_once_that_of_the_smaller_name() {
    let mut waiter = agent("w");
    waiter
        .request(START, "door", RA, ["o", "a", "z"].map(Text::from))
        .unwrap();
    let found = message("o", Performative::Inform, "dlm_discover", "w_0", "door");
    waiter.handle(START, &found);
    outputs(&mut waiter);
    let asks = |from, stamp: u64| {
        let content = format!("{stamp}\ndoor");
        message(from, Performative::Request, RA.protocol(), "id", &content)
    };
    // Ours has the stamp 1.
    waiter.handle(START, &asks("z", 1));
    waiter.handle(START, &asks("b", 2));
    let deferred = sent(&mut waiter);
    assert!(
        deferred
            .iter()
            .all(|said| said.performative != Performative::Agree)
    );
    waiter.handle(START, &asks("a", 1));
    let granted = sent(&mut waiter);
    assert_eq!(granted[0].performative, Performative::Agree);
    assert_eq!(granted[0].receiver[0].name, "a");
    waiter.release(START, "door");
    assert_eq!(sent(&mut waiter).len(), 2);
}

#[test]
fn whoever_asks_is_told_what_is_owned_and_who_holds_and_waits() {
    let mut owner = owner(START, Record::default());
    owner.own(START, "the gripper", Record::default()).unwrap();
    owner.handle(START, &confirm("a", "a_1"));
    owner.persisted(START, "door", 1);
    owner.handle(START, &confirm("b", "b_1"));
    let plain = message(
        "c",
        Performative::Confirm,
        RA.protocol(),
        "c_1",
        "the gripper",
    );
    owner.handle(START, &plain);
    outputs(&mut owner);
    let query = list_query("o").from_agent("x").reply_with("tag");
    assert!(owner.handle(START, &query));
    let answer = sent(&mut owner).remove(0);
    assert_eq!(answer.receiver[0].name, "x");
    assert_eq!(answer.in_reply_to, Some("tag".into()));
    assert_eq!(
        answer.content_str(),
        Some("1 a 1 b door\n- c 0 the gripper")
    );
    let views: Vec<_> = owner.owned().collect();
    assert_eq!(read_list(&answer), Ok(views));
    // The answer is for whoever has asked, not for its own locks.
    assert!(!owner.handle(START, &answer));

    let mut nobody = agent("n");
    nobody.handle(START, &query);
    let answer = sent(&mut nobody).remove(0);
    assert_eq!(read_list(&answer), Ok(Vec::new()));
}

#[test]
fn an_agent_that_asks_again_before_it_gave_back_gets_it_again() {
    for algorithm in [RA, SK] {
        let mut owner = owner(START, Record::default());
        let ask = |id: &str, sequence: u64| match algorithm {
            RA => confirm("a", id),
            _ => message(
                "a",
                Performative::Request,
                SK.protocol(),
                id,
                &format!("door\n{sequence}"),
            )
            .user_defined("X-Heartbeat", "5000"),
        };
        owner.handle(START, &ask("a_1", 1));
        owner.persisted(START, "door", 1);
        let lent = sent(&mut owner).remove(0);
        owner.handle(START, &ask("a_2", 2));
        let back = match algorithm {
            RA => message("a", Performative::Disconfirm, RA.protocol(), "a_1", "door"),
            _ => {
                let token = lent.content_str().unwrap();
                message("a", Performative::Propagate, SK.protocol(), "a_1", token)
                    .language("suzuki_kasami::Token")
                    .user_defined("X-Fencing", "1")
            }
        };
        owner.handle(START, &back);
        let view = owner.owned().next().unwrap();
        let held = (view.holder, view.fencing);
        assert_eq!(held, (Some("a".into()), Some(2)), "{algorithm}");
    }
}
