//! Platforms and agents in one process: what a robot control program relies on.

use std::sync::Arc;
use std::time::Duration;

use fipa::prelude::*;
use fipa::{Error, ReceiveError, RegisterError, RequestError, blocking};

const PATIENCE: Duration = Duration::from_secs(5);

async fn robot(name: &str) -> Platform {
    let builder = Platform::builder().name(name).mdns(false);
    builder.start().await.unwrap()
}

/// Two platforms that know each other by address.
async fn two_robots() -> (Platform, Platform) {
    let one = robot("robot1").await;
    let two = Platform::builder()
        .name("robot2")
        .mdns(false)
        .peer(one.endpoints()[0].to_string())
        .start()
        .await
        .unwrap();
    (one, two)
}

fn inform(to: &str, content: &'static str) -> Message {
    Message::new(Performative::Inform).to(to).content(content)
}

async fn next(agent: &Agent) -> Message {
    let received = tokio::time::timeout(PATIENCE, agent.receive()).await;
    received.expect("a message in time").unwrap()
}

#[tokio::test]
async fn a_message_crosses_two_platforms_and_its_sender_is_told() {
    let (one, two) = two_robots().await;
    let arm = one.agent("arm@robot1").await.unwrap();
    let drive = two.agent("drive@robot2").await.unwrap();
    tokio::time::timeout(PATIENCE, one.wait_for("drive@robot2"))
        .await
        .unwrap();

    let outcomes = arm.send(inform("drive@robot2", "go")).await;
    assert_eq!(outcomes.len(), 1);
    assert_eq!(outcomes[0].outcome, Outcome::Delivered);
    let message = next(&drive).await;
    assert_eq!(message.content_str(), Some("go"));
    assert_eq!(message.sender, Some("arm@robot1".into()));

    let outcomes = arm.send(inform("nobody@robot2", "go")).await;
    assert_eq!(outcomes[0].outcome, Outcome::Unknown);
    assert_eq!(outcomes[0].to, "nobody@robot2");
}

#[tokio::test]
async fn answers_reach_those_who_wait_for_them_and_nothing_else_does() {
    let platform = robot("robot1").await;
    let arm = Arc::new(platform.agent("arm@robot1").await.unwrap());
    let drive = platform.agent("drive@robot1").await.unwrap();
    // Three requests at once; the answers come in another order, with other mail between.
    let asked: Vec<_> = ["a", "b", "c"]
        .into_iter()
        .map(|what| {
            let arm = Arc::clone(&arm);
            tokio::spawn(async move {
                let request = Message::new(Performative::Request)
                    .to("drive@robot1")
                    .content(what);
                let answer = arm.request(request, PATIENCE).await.unwrap();
                (what, answer.content_str().unwrap().to_owned())
            })
        })
        .collect();
    let mut requests = vec![next(&drive).await, next(&drive).await, next(&drive).await];
    requests.reverse();
    for request in requests {
        drive.send(inform("arm@robot1", "by the way")).await;
        let mut answer = request.reply(Performative::Inform);
        answer.content = request.content;
        drive.send(answer).await;
    }
    for task in asked {
        let (what, answer) = task.await.unwrap();
        assert_eq!(answer, what);
    }
    for _ in 0..3 {
        assert_eq!(next(&arm).await.content_str(), Some("by the way"));
    }
    assert!(arm.try_receive().is_none());
}

#[tokio::test]
async fn a_request_says_why_it_has_no_answer() {
    let platform = robot("robot1").await;
    let arm = platform.agent("arm@robot1").await.unwrap();
    let _mute = platform.agent("mute@robot1").await.unwrap();
    let ask = |to: &str| Message::new(Performative::QueryRef).to(to);
    let short = Duration::from_millis(200);
    match arm.request(ask("nobody@robot1"), short).await {
        Err(RequestError::Undelivered { to, outcome, .. }) => {
            assert_eq!((to.as_str(), outcome), ("nobody@robot1", Outcome::Unknown));
        }
        other => panic!("{other:?}"),
    }
    let unanswered = arm.request(ask("mute@robot1"), short).await;
    assert!(
        matches!(unanswered, Err(RequestError::NoAnswer(_))),
        "{unanswered:?}"
    );
}

#[tokio::test]
async fn nothing_is_lost_when_a_receive_is_given_up() {
    let platform = robot("robot1").await;
    let arm = platform.agent("arm@robot1").await.unwrap();
    for _ in 0..20 {
        let given_up = tokio::time::timeout(Duration::from_millis(1), arm.receive()).await;
        assert!(given_up.is_err());
    }
    arm.send(inform("arm@robot1", "still here")).await;
    assert_eq!(next(&arm).await.content_str(), Some("still here"));
}

#[tokio::test]
async fn names_are_checked_held_and_given_back() {
    let platform = robot("robot1").await;
    for wrong in ["two words", "9lives@robot1", "", "röbot@x"] {
        let error = platform.agent(wrong).await.err().expect("refused");
        assert!(
            matches!(error, Error::Register(RegisterError::Name(_))),
            "{wrong}"
        );
    }
    let arm = platform.agent("arm@robot1").await.unwrap();
    let second = platform.agent("arm@robot1").await.err();
    assert!(matches!(
        second,
        Some(Error::Register(RegisterError::Held(_)))
    ));
    // The refusal has not cost the holder its name, nor its mail.
    arm.send(inform("arm@robot1", "mine")).await;
    assert_eq!(next(&arm).await.content_str(), Some("mine"));
    drop(arm);
    assert!(platform.find("arm@robot1").is_none());
    platform.agent("arm@robot1").await.unwrap();
}

#[tokio::test]
async fn a_letter_that_would_come_too_late_is_not_sent() {
    let platform = robot("robot1").await;
    let arm = platform.agent("arm@robot1").await.unwrap();
    let past = "2001-01-01T00:00:00.000Z"
        .parse::<fipa::FipaTime>()
        .unwrap();
    let outcomes = arm.send(inform("arm@robot1", "late").reply_by(past)).await;
    assert_eq!(outcomes[0].outcome, Outcome::Expired);
    assert!(arm.try_receive().is_none());
    // A span is told as the point in time that it means.
    let soon = "+PT60S".parse::<fipa::FipaTime>().unwrap();
    arm.send(inform("arm@robot1", "soon").reply_by(soon)).await;
    assert!(next(&arm).await.reply_by.unwrap().unix_millis().is_some());
}

#[tokio::test]
async fn what_cannot_be_written_is_refused_with_the_reason() {
    let platform = robot("robot1").await;
    let arm = platform.agent("arm@robot1").await.unwrap();
    let outcomes = arm
        .send(inform("arm@robot1", "x").protocol("two words"))
        .await;
    assert_eq!(outcomes[0].outcome, Outcome::Refused);
    assert!(
        outcomes[0].reason.contains("protocol"),
        "{}",
        outcomes[0].reason
    );
    let outcomes = arm.send(Message::new(Performative::Inform)).await;
    assert_eq!(outcomes[0].outcome, Outcome::Unknown);
}

#[tokio::test]
async fn an_agent_attached_to_a_daemon_behaves_like_one_in_the_process() {
    let folder = tempfile::tempdir().unwrap();
    let control = folder.path().join("fipad.sock");
    let daemon = Platform::builder()
        .name("robot1")
        .mdns(false)
        .control(&control)
        .start()
        .await
        .unwrap();
    let inside = daemon.agent("inside@robot1").await.unwrap();
    let program = Platform::attach_to(&control).await.unwrap();
    assert_eq!(program.name(), "robot1");
    assert!(
        program.find("inside@robot1").is_some(),
        "the directory is there at once"
    );
    let outside = program.agent("outside@robot1").await.unwrap();

    let answer = async {
        let request = next(&inside).await;
        inside.send(request.reply(Performative::Agree)).await;
    };
    let request = Message::new(Performative::Request).to("inside@robot1");
    let (answer, ()) = tokio::join!(outside.request(request, PATIENCE), answer);
    assert_eq!(answer.unwrap().performative, Performative::Agree);

    let taken = program.agent("inside@robot1").await.err().expect("refused");
    assert!(taken.to_string().contains("held"), "{taken}");
    drop(program);
    drop(outside);
    let mut changes = daemon.watch();
    while daemon.find("outside@robot1").is_some() {
        tokio::time::timeout(PATIENCE, changes.next())
            .await
            .unwrap();
    }
}

#[tokio::test]
async fn whoever_waits_is_told_when_the_platform_ends() {
    let platform = robot("robot1").await;
    let arm = Arc::new(platform.agent("arm@robot1").await.unwrap());
    let waiting = tokio::spawn({
        let arm = Arc::clone(&arm);
        async move { arm.receive().await }
    });
    tokio::task::yield_now().await;
    platform.shutdown().await;
    let received = tokio::time::timeout(PATIENCE, waiting)
        .await
        .unwrap()
        .unwrap();
    assert!(matches!(received, Err(ReceiveError::Ended)));
}

#[tokio::test]
async fn a_missing_daemon_and_a_second_one_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let control = folder.path().join("fipad.sock");
    let missing = Platform::attach_to(&control)
        .await
        .err()
        .expect("nobody there");
    assert!(matches!(missing, Error::NoDaemon { .. }), "{missing}");
    let builder = || Platform::builder().mdns(false).control(&control);
    let first = builder().name("robot1").start().await.unwrap();
    let second = builder()
        .name("robot2")
        .start()
        .await
        .err()
        .expect("refused");
    assert!(matches!(second, Error::ControlInUse(_)), "{second}");
    first.shutdown().await;
    assert!(!control.exists());
    // A dead file is replaced.
    drop(std::os::unix::net::UnixListener::bind(&control).unwrap());
    assert!(control.exists());
    builder().name("robot3").start().await.unwrap();
}

#[test]
fn a_control_loop_needs_no_async() {
    let robot1 = blocking::Platform::start(fipa::Platform::builder().name("robot1").mdns(false));
    let robot1 = robot1.unwrap();
    let drive = robot1.agent("drive@robot1").unwrap();
    let server = std::thread::spawn(move || {
        let request = drive.receive().unwrap();
        drive.send(request.reply(Performative::Inform).content("done"))
    });
    let arm = robot1.agent("arm@robot1").unwrap();
    let request = Message::new(Performative::Request).to("drive@robot1");
    let answer = arm.request(request, PATIENCE).unwrap();
    assert_eq!(answer.content_str(), Some("done"));
    assert!(server.join().unwrap()[0].outcome.is_success());
    assert!(arm.try_receive().is_none());
    robot1.shutdown();
}
