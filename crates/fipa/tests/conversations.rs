//! Conversations between agents: helpers, handlers, and the monitor that watches them.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use fipa::prelude::*;
use fipa::{
    Answer, ConversationError, ConversationEvent, ConversationRule, EventKind, Monitoring, Order,
};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

const PATIENCE: Duration = Duration::from_secs(5);
const SHORT: Duration = Duration::from_millis(300);

async fn robot() -> Platform {
    let builder = Platform::builder().name("robot1").mdns(false);
    builder.start().await.unwrap()
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    let done = tokio::time::timeout(PATIENCE, future).await;
    done.expect("in time")
}

fn order(to: &str, content: &'static str) -> Message {
    Message::new(Performative::Request).to(to).content(content)
}

/// An agent that answers requests with what `handler` says.
async fn server<F, R>(platform: &Platform, name: &str, handler: F) -> JoinHandle<()>
where
    F: Fn(Order) -> R + Send + Sync + 'static,
    R: Future<Output = Result<Answer, ConversationError>> + Send + 'static,
{
    let agent = platform.agent(name).await.unwrap();
    let handler = Arc::new(handler);
    tokio::spawn(async move {
        let (request, query, call) = (handler.clone(), handler.clone(), handler.clone());
        let (subscribe, proposal) = (handler.clone(), handler.clone());
        let responder = agent.respond();
        responder
            .request(move |order| request(order))
            .query(move |order| query(order))
            .subscribe(move |order| subscribe(order))
            .call(move |order| call(order))
            .proposal(move |order| proposal(order))
            .run()
            .await;
    })
}

/// Tells when it is dropped.
struct Dropped(mpsc::UnboundedSender<()>);

impl Drop for Dropped {
    fn drop(&mut self) {
        let _ = self.0.send(());
    }
}

#[tokio::test]
async fn an_order_is_performed_after_it_was_agreed() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let mut violations = arm.violations();
    let _drive = server(&platform, "drive@r", |order| async move {
        order.agree().await?;
        Ok(Answer::inform("at the dock"))
    })
    .await;
    let done = within(arm.perform(order("drive@r", "go"), PATIENCE)).await;
    assert_eq!(done.unwrap().content_str(), Some("at the dock"));
    assert!(arm.try_receive().is_none());
    let none = tokio::time::timeout(SHORT, violations.next()).await;
    assert!(none.is_err(), "{none:?}");
}

#[test]
fn a_program_without_async_has_things_done_as_well() {
    let builder = Platform::builder().name("robot1").mdns(false);
    let platform = fipa::blocking::Platform::start(builder).unwrap();
    let arm = platform.agent("arm@r").unwrap();
    let drive = platform.agent("drive@r").unwrap();
    let serving = std::thread::spawn(move || {
        for act in [
            Performative::Inform,
            Performative::Inform,
            Performative::RejectProposal,
        ] {
            let asked = drive.receive().unwrap();
            if asked.performative == Performative::Request {
                drive.send(asked.reply(Performative::Agree));
            }
            drive.send(asked.reply(act).content("so be it"));
        }
    });
    let done = arm.perform(order("drive@r", "go"), PATIENCE).unwrap();
    assert_eq!(done.content_str(), Some("so be it"));
    let question = Message::new(Performative::QueryIf).to("drive@r");
    let answer = arm.query(question, PATIENCE).unwrap();
    assert_eq!(answer.performative, Performative::Inform);
    let proposal = Message::new(Performative::Propose).to("drive@r");
    let rejected = arm.propose(proposal, PATIENCE).unwrap_err();
    assert!(matches!(rejected, ConversationError::Refused(_)));
    serving.join().unwrap();
}

#[tokio::test]
async fn each_bad_end_is_an_error_of_its_own() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let _drive = server(&platform, "drive@r", |order| async move {
        match order.message().content_str() {
            Some("refuse") => Ok(Answer::refuse("busy")),
            Some("fail") => Ok(Answer::failure("blocked")),
            Some("mumble") => Ok(Answer::not_understood("what?")),
            _ => Ok(Answer::nothing()),
        }
    })
    .await;
    let perform = |what| arm.perform(order("drive@r", what), PATIENCE);
    let refused = within(perform("refuse")).await.unwrap_err();
    assert_eq!(refused.to_string(), "refused by drive@r: busy");
    assert!(matches!(refused, ConversationError::Refused(_)));
    let failed = within(perform("fail")).await.unwrap_err();
    assert!(matches!(failed, ConversationError::Failed(_)), "{failed}");
    let not = within(perform("mumble")).await.unwrap_err();
    assert!(matches!(not, ConversationError::NotUnderstood(_)), "{not}");
    let silent = within(arm.perform(order("drive@r", "?"), SHORT)).await;
    let silent = silent.unwrap_err();
    assert!(matches!(silent, ConversationError::NoAnswer(_)), "{silent}");
    let unknown = within(arm.perform(order("nobody@r", "go"), SHORT)).await;
    let unknown = unknown.unwrap_err();
    assert!(
        matches!(unknown, ConversationError::Undelivered { .. }),
        "{unknown}"
    );
}

#[tokio::test]
async fn questions_and_proposals_are_answered() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let _drive = server(&platform, "drive@r", |order| async move {
        match order.message().performative {
            Performative::QueryRef => Ok(Answer::inform("3 m")),
            _ => Ok(Answer::accept()),
        }
    })
    .await;
    let question = Message::new(Performative::QueryRef).to("drive@r");
    let answer = within(arm.query(question, PATIENCE)).await.unwrap();
    assert_eq!(answer.content_str(), Some("3 m"));
    let proposal = Message::new(Performative::Propose).to("drive@r");
    let answer = within(arm.propose(proposal, PATIENCE)).await.unwrap();
    assert_eq!(answer.performative, Performative::AcceptProposal);
}

#[tokio::test]
async fn whoever_stops_waiting_cancels_what_the_other_one_does() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let mut violations = arm.violations();
    let (sender, mut dropped) = mpsc::unbounded_channel();
    let _drive = server(&platform, "drive@r", move |order| {
        let guard = Dropped(sender.clone());
        async move {
            order.agree().await?;
            let _guard = guard;
            std::future::pending().await
        }
    })
    .await;
    let dropped_future = tokio::time::timeout(SHORT, arm.perform(order("drive@r", "go"), PATIENCE));
    assert!(dropped_future.await.is_err());
    within(dropped.recv()).await.unwrap();
    // A deadline is no different.
    let late = arm.perform(order("drive@r", "go"), SHORT).await;
    assert!(matches!(late, Err(ConversationError::NoAnswer(_))));
    within(dropped.recv()).await.unwrap();
    // The confirmation is nobody's business any more, and all was by the protocol.
    let nothing = tokio::time::timeout(SHORT, arm.receive()).await;
    assert!(nothing.is_err(), "{nothing:?}");
    let none = tokio::time::timeout(SHORT, violations.next()).await;
    assert!(none.is_err(), "{none:?}");
}

#[tokio::test]
async fn a_subscription_tells_news_until_it_is_dropped() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let (sender, mut dropped) = mpsc::unbounded_channel();
    let _drive = server(&platform, "drive@r", move |order| {
        let guard = Dropped(sender.clone());
        async move {
            let _guard = guard;
            for number in 0.. {
                order.inform(format!("{number} m")).await?;
            }
            Ok(Answer::nothing())
        }
    })
    .await;
    let subscription = Message::new(Performative::Subscribe).to("drive@r");
    let mut news = within(arm.subscribe(subscription.clone(), PATIENCE))
        .await
        .unwrap();
    for number in 0..3 {
        let told = within(news.next()).await.unwrap().unwrap();
        assert_eq!(told.content_str(), Some(&*format!("{number} m")));
    }
    drop(news);
    within(dropped.recv()).await.unwrap();
    let news = within(arm.subscribe(subscription, PATIENCE)).await.unwrap();
    within(news.cancel(PATIENCE)).await.unwrap();
    within(dropped.recv()).await.unwrap();
    assert!(arm.try_receive().is_none());
}

#[tokio::test]
async fn a_subscription_ends_with_the_failure_of_the_other_one() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let _drive = server(&platform, "drive@r", |order| async move {
        order.agree().await?;
        order.inform("1 m").await?;
        Ok(Answer::failure("no sight"))
    })
    .await;
    let subscription = Message::new(Performative::Subscribe).to("drive@r");
    let mut news = within(arm.subscribe(subscription, PATIENCE)).await.unwrap();
    assert!(within(news.next()).await.unwrap().is_ok());
    let end = within(news.next()).await.unwrap().unwrap_err();
    assert_eq!(end.to_string(), "failed by drive@r: no sight");
    assert!(within(news.next()).await.is_none());
}

#[tokio::test]
async fn the_best_proposal_is_accepted_and_the_others_rejected() {
    let platform = robot().await;
    let master = platform.agent("master@r").await.unwrap();
    let mut violations = master.violations();
    let rejected = Arc::new(AtomicUsize::new(0));
    for (name, price) in [("a@r", "3"), ("b@r", "1"), ("c@r", "2"), ("d@r", "no")] {
        let rejected = Arc::clone(&rejected);
        server(&platform, name, move |mut order| {
            let rejected = Arc::clone(&rejected);
            async move {
                if price == "no" {
                    return Ok(Answer::refuse("busy"));
                }
                match order.propose(price).await? {
                    Some(_) => Ok(Answer::inform("carried")),
                    None => {
                        rejected.fetch_add(1, Ordering::Relaxed);
                        Ok(Answer::nothing())
                    }
                }
            }
        })
        .await;
    }
    let _silent = platform.agent("silent@r").await.unwrap();
    let call = Message::new(Performative::Cfp).content("carry");
    let bidders = ["a@r", "b@r", "c@r", "d@r", "silent@r", "nobody@r"];
    let cheapest = |proposals: &[Message]| {
        let price = |place: &usize| proposals[*place].content_str().map(str::to_owned);
        (0..proposals.len()).min_by_key(price).into_iter().collect()
    };
    let contracts = within(master.contract_net(call, bidders, SHORT, cheapest)).await;
    let contracts = contracts.unwrap();
    assert_eq!(contracts.accepted()[0].sender, Some("b@r".into()));
    assert_eq!(contracts.rejected().len(), 2);
    let mut without: Vec<String> = contracts
        .without_proposal()
        .iter()
        .map(|(name, why)| format!("{name}: {why}"))
        .collect();
    without.sort();
    assert_eq!(without[0], "d@r: refused by d@r: busy");
    assert!(without[1].starts_with("nobody@r: "), "{without:?}");
    assert_eq!(without[2], "silent@r: no answer came within 300ms");
    let results = within(contracts.results(PATIENCE)).await;
    assert_eq!(results.len(), 1);
    assert_eq!(results[0].0, "b@r");
    let report = results[0].1.as_ref().unwrap();
    assert_eq!(report.content_str(), Some("carried"));
    let all_rejected = async {
        while rejected.load(Ordering::Relaxed) < 2 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    within(all_rejected).await;
    let none = tokio::time::timeout(SHORT, violations.next()).await;
    assert!(none.is_err(), "{none:?}");
}

#[tokio::test]
async fn a_contractor_that_is_lost_has_no_result() {
    let platform = robot().await;
    let master = platform.agent("master@r").await.unwrap();
    let worker = platform.agent("worker@r").await.unwrap();
    let working = tokio::spawn(async move {
        let call = worker.receive().await.unwrap();
        worker
            .send(call.reply(Performative::Propose).content("1"))
            .await;
        worker.receive().await.unwrap().performative
    });
    let call = Message::new(Performative::Cfp);
    let all = |proposals: &[Message]| (0..proposals.len()).collect();
    let contracts = within(master.contract_net(call, ["worker@r"], PATIENCE, all)).await;
    let results = within(contracts.unwrap().results(PATIENCE)).await;
    assert_eq!(working.await.unwrap(), Performative::AcceptProposal);
    let lost = results[0].1.as_ref().unwrap_err();
    assert!(matches!(lost, ConversationError::PeerLost(_)), "{lost}");
}

#[tokio::test]
async fn nobody_waits_for_an_agent_that_is_gone() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let mut events = arm.conversation_events();
    let drive = platform.agent("drive@r").await.unwrap();
    let leaving = tokio::spawn(async move {
        let order = drive.receive().await.unwrap();
        drive.send(order.reply(Performative::Agree)).await;
    });
    let lost = within(arm.perform(order("drive@r", "go"), PATIENCE)).await;
    let lost = lost.unwrap_err();
    assert!(matches!(&lost, ConversationError::PeerLost(name) if *name == "drive@r"));
    leaving.await.unwrap();
    let ended = async {
        loop {
            let event = events.next().await.unwrap();
            if let ConversationEvent::Progress(event) = event
                && let EventKind::Ended { outcome } = event.kind
            {
                return outcome.as_str();
            }
        }
    };
    assert_eq!(within(ended).await, "peer-lost");
}

#[tokio::test]
async fn an_answer_counts_though_its_sender_is_gone() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    arm.set_monitoring(Monitoring::Enforcing);
    let drive = platform.agent("drive@r").await.unwrap();
    let leaving = tokio::spawn(async move {
        let order = drive.receive().await.unwrap();
        let outcomes = drive.send(order.reply(Performative::Inform)).await;
        assert!(outcomes[0].outcome.is_success());
    });
    let done = within(arm.perform(order("drive@r", "go"), PATIENCE)).await;
    assert_eq!(done.unwrap().performative, Performative::Inform);
    leaving.await.unwrap();
}

#[tokio::test]
async fn a_violation_is_told_and_handed_on_by_an_advisory_agent() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let drive = platform.agent("drive@r").await.unwrap();
    let mut violations = arm.violations();
    let request = order("drive@r", "go")
        .protocol("fipa-request")
        .conversation_id("c-1");
    arm.send(request).await;
    let order = within(drive.receive()).await.unwrap();
    drive.send(order.reply(Performative::Propose)).await;
    let proposal = within(arm.receive()).await.unwrap();
    assert_eq!(proposal.performative, Performative::Propose);
    let violated = within(violations.next()).await.unwrap();
    assert!(!violated.is_outgoing);
    assert_eq!(violated.message, proposal);
    assert_eq!(violated.violation.rule, ConversationRule::Performative);
    assert_eq!(
        violated.violation.text,
        "drive@r may not send propose in the state requested of fipa-request; expected: \
         refuse, agree, inform or failure from participant (drive@r) to initiator (arm@r)"
    );
}

#[tokio::test]
async fn an_enforcing_agent_neither_takes_nor_sends_a_violation() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let drive = platform.agent("drive@r").await.unwrap();
    drive.set_monitoring(Monitoring::Off);
    arm.set_monitoring(Monitoring::Enforcing);
    let request = order("drive@r", "go")
        .protocol("fipa-request")
        .conversation_id("c-1");
    assert!(arm.send(request).await[0].outcome.is_success());
    let order = within(drive.receive()).await.unwrap();
    drive.send(order.reply(Performative::Propose)).await;
    drive
        .send(order.reply(Performative::Inform).content("done"))
        .await;
    let taken = within(arm.receive()).await.unwrap();
    assert_eq!(taken.performative, Performative::Inform);
    let answer = within(drive.receive()).await.unwrap();
    assert_eq!(answer.performative, Performative::NotUnderstood);
    let reason = answer.content_str().unwrap();
    assert!(
        reason.starts_with("((unexpected-act propose) \"drive@r may not send"),
        "{reason}"
    );

    let more = Message::new(Performative::AcceptProposal)
        .to("drive@r")
        .protocol("fipa-request")
        .conversation_id("c-1");
    let refused = arm.send(more).await;
    assert_eq!(refused[0].outcome, fipa::Outcome::Refused);
    assert_eq!(refused[0].to, "drive@r");
    assert_eq!(
        &*refused[0].reason,
        "accept-proposal of arm@r came after the end in the state done of fipa-request; \
         expected: nothing more"
    );
    assert!(drive.try_receive().is_none());
}

#[tokio::test]
async fn a_late_answer_ends_the_conversation_while_somebody_watches() {
    let platform = robot().await;
    let arm = platform.agent("arm@r").await.unwrap();
    let _drive = platform.agent("drive@r").await.unwrap();
    let mut events = arm.conversation_events();
    let by = fipa::FipaTime::from_unix_millis(platform.now().unix_millis + 200);
    let request = order("drive@r", "go")
        .protocol("fipa-request")
        .conversation_id("c-1")
        .reply_by(by);
    arm.send(request).await;
    let mut seen = Vec::new();
    while seen.len() < 3 {
        let ConversationEvent::Progress(event) = within(events.next()).await.unwrap() else {
            panic!("no violation")
        };
        seen.push(match event.kind {
            EventKind::Started { protocol, .. } => protocol.to_string(),
            EventKind::Updated { state } => state.to_string(),
            EventKind::Ended { outcome } => outcome.as_str().to_owned(),
            other => panic!("{other:?}"),
        });
    }
    assert_eq!(seen, ["fipa-request", "timed-out", "timed-out"]);
}
