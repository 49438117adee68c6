//! Agents that move between platforms while letters come.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use fipa::Incoming;
use fipa::prelude::*;

const PATIENCE: Duration = Duration::from_secs(5);

/// Letters that are sent, one a millisecond.
const LETTERS: usize = 3000;

async fn robot(name: &str, peer: Option<&Platform>, control: Option<&Path>) -> Platform {
    let mut builder = Platform::builder().name(name).mdns(false);
    if let Some(peer) = peer {
        builder = builder.peer(peer.endpoints()[0].to_string());
    }
    if let Some(control) = control {
        builder = builder.control(control);
    }
    builder.start().await.unwrap()
}

fn content((_, message): Incoming) -> String {
    message.unwrap().content_str().unwrap().to_owned()
}

/// Lives on one platform after the other, for so long on each; what it has received there.
async fn wander(places: [Platform; 2], stay: Duration, ended: Arc<AtomicBool>) -> Vec<String> {
    let mut received = Vec::new();
    let mut home = places[0].agent("payload").await.unwrap();
    let mut moves = 0;
    while !ended.load(Ordering::Relaxed) {
        let stay = tokio::time::sleep(stay);
        tokio::pin!(stay);
        loop {
            tokio::select! {
                () = &mut stay => break,
                letter = home.receive_letter() => received.push(content(letter.unwrap())),
            }
        }
        moves += 1;
        let next = &places[moves % 2];
        // Both orders are right.
        if moves % 4 < 2 {
            let arrived = next.agent("payload").await.unwrap();
            let left = std::mem::replace(&mut home, arrived).leave().await;
            received.extend(left.into_iter().map(content));
        } else {
            received.extend(home.leave().await.into_iter().map(content));
            home = next.agent("payload").await.unwrap();
        }
    }
    assert!(moves > 4, "{moves} moves");
    received.extend(home.leave().await.into_iter().map(content));
    received
}

/// Sends letters to an agent that moves to and fro between two platforms.
async fn move_under_load(places: [Platform; 2], from: &Platform) {
    let sender = Arc::new(from.agent("sender").await.unwrap());
    let ended = Arc::new(AtomicBool::new(false));
    let wanderer = wander(places, Duration::from_millis(150), Arc::clone(&ended));
    let wanderer = tokio::spawn(wanderer);
    tokio::time::timeout(PATIENCE, from.wait_for("payload"))
        .await
        .unwrap();
    let mut pace = tokio::time::interval(Duration::from_millis(1));
    let mut under_way = Vec::new();
    for n in 0..LETTERS {
        pace.tick().await;
        let sender = Arc::clone(&sender);
        under_way.push(tokio::spawn(async move {
            let message = Message::new(Performative::Inform).to("payload");
            let outcomes = sender.send(message.content(n.to_string())).await;
            assert_eq!(outcomes.len(), 1);
            (n.to_string(), outcomes[0].clone())
        }));
    }
    let mut told = Vec::new();
    for letter in under_way {
        told.push(letter.await.unwrap());
    }
    ended.store(true, Ordering::Relaxed);
    let received = wanderer.await.unwrap();
    let distinct: BTreeSet<&String> = received.iter().collect();
    assert_eq!(distinct.len(), received.len(), "a letter came twice");
    for (content, told) in &told {
        let came = distinct.contains(content);
        assert_eq!(
            came,
            told.outcome == Outcome::Delivered,
            "{content}: {told:?}"
        );
        assert!(came || !told.reason.is_empty());
    }
    // A busy machine may keep it away for longer than letters wait, at times.
    let came = received.len();
    assert!(came * 2 > LETTERS, "{came} came");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_agent_moves_between_platforms_under_a_thousand_letters_a_second() {
    let one = robot("robot1", None, None).await;
    let two = robot("robot2", Some(&one), None).await;
    let three = robot("robot3", Some(&one), None).await;
    move_under_load([one, two], &three).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_agent_of_programs_moves_between_daemons_under_a_thousand_letters_a_second() {
    let folder = tempfile::tempdir().unwrap();
    let controls = ["1.sock", "2.sock", "3.sock"].map(|name| folder.path().join(name));
    let one = robot("robot1", None, Some(&controls[0])).await;
    let _two = robot("robot2", Some(&one), Some(&controls[1])).await;
    let _three = robot("robot3", Some(&one), Some(&controls[2])).await;
    let mut programs = Vec::new();
    for control in &controls {
        programs.push(Platform::attach_to(control).await.unwrap());
    }
    let places = [programs[0].clone(), programs[1].clone()];
    move_under_load(places, &programs[2]).await;
}

#[tokio::test]
async fn whoever_leaves_gets_what_was_delivered_and_nothing_after_it() {
    let platform = robot("robot1", None, None).await;
    let arm = platform.agent("arm").await.unwrap();
    let drive = platform.agent("drive").await.unwrap();
    for content in ["one", "two"] {
        let message = Message::new(Performative::Inform)
            .to("arm")
            .content(content);
        assert!(drive.send(message).await[0].outcome.is_success());
    }
    let left: Vec<String> = arm.leave().await.into_iter().map(content).collect();
    assert_eq!(left, ["one", "two"]);
    assert!(platform.find("arm").is_none());
    assert_eq!(
        platform
            .search_gone("arm", fipa::Field::Name)
            .unwrap()
            .len(),
        1
    );
    let message = Message::new(Performative::Inform)
        .to("arm")
        .content("three");
    let told = drive.send(message).await;
    assert_eq!(told[0].outcome, Outcome::Unknown, "{told:?}");
    // The name is free.
    platform.agent("arm").await.unwrap();
}
