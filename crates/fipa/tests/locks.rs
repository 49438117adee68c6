//! Locks among agents on platforms in this process.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use fipa::locks::{self, Algorithm, FailureReason, Forgetful, Keep, LockError, LossReason, Record};
use fipa::{Agent, Message, Performative, Platform, Registration, blocking};

const BOTH: [Algorithm; 2] = [
    Algorithm::RicartAgrawalaExtended,
    Algorithm::SuzukiKasamiExtended,
];
const PATIENCE: Duration = Duration::from_secs(15);

async fn platform(name: &str, peer: Option<&Platform>) -> Platform {
    let mut builder = Platform::builder().name(name).mdns(false);
    if let Some(peer) = peer {
        builder = builder.peer(peer.endpoints()[0].to_string());
    }
    builder.start().await.unwrap()
}

async fn member(platform: &Platform, name: &str) -> Agent {
    let registration = locks::registration(name);
    platform.register(registration).await.unwrap()
}

async fn owner(platform: &Platform, name: &str) -> Agent {
    let owner = member(platform, name).await;
    owner.own("door", Arc::new(Forgetful::new())).await.unwrap();
    owner
}

/// Two platforms, of which the first one has the owner, and who wants the resource on either.
async fn robots() -> (Platform, Platform, Agent, Agent, Agent) {
    let one = platform("robot1", None).await;
    let two = platform("robot2", Some(&one)).await;
    let owner = owner(&one, "locks@robot1").await;
    let (a, b) = (member(&one, "a").await, member(&two, "b").await);
    for (platform, name) in [(&one, "b"), (&two, "locks@robot1")] {
        let found = tokio::time::timeout(PATIENCE, platform.wait_for(name)).await;
        assert!(found.unwrap().is_some());
    }
    (one, two, owner, a, b)
}

#[tokio::test]
async fn one_agent_holds_at_a_time_and_numbers_grow() {
    let (_one, _two, _owner, a, b) = robots().await;
    for algorithm in BOTH {
        let first = a.lock("door").algorithm(algorithm).await.unwrap();
        assert!(first.is_held());
        let second = b.lock("door").algorithm(algorithm);
        let second = tokio::time::timeout(Duration::from_millis(300), second.into_future());
        assert!(second.await.is_err(), "{algorithm}");
        let again = a.lock("door").await.err().unwrap();
        assert!(matches!(again, LockError::Request(_)), "{again}");
        let third = b.lock("door").algorithm(algorithm);
        let third = third.timeout(PATIENCE).into_future();
        let ((), third) = tokio::join!(first.release(), third);
        let third = third.unwrap();
        let fourth = {
            drop(third);
            a.lock("door").algorithm(algorithm).await.unwrap()
        };
        assert!(fourth.fencing() > Some(1_000_000_000_000), "{algorithm}");
        drop(fourth);
    }
}

#[tokio::test]
async fn numbers_grow_from_grant_to_grant() {
    let (_one, _two, _owner, a, b) = robots().await;
    let mut last = None;
    for agent in [&a, &b, &b, &a] {
        let guard = agent.lock("door").await.unwrap();
        assert!(guard.fencing() > last);
        last = guard.fencing();
        guard.release().await;
    }
}

#[tokio::test]
async fn a_holder_that_goes_is_followed_at_once() {
    let (one, two, owner, a, b) = robots().await;
    let held = b.lock("door").await.unwrap();
    let waiting = tokio::spawn(async move {
        let guard = a.lock("door").timeout(Duration::from_secs(4)).await;
        (a, guard.map(|guard| guard.fencing()))
    });
    wait_until_waiting(&b, &owner, "a").await;
    // Its lease would last for fifteen seconds.
    drop(b);
    assert_eq!(held.lost().await, LossReason::Disconnected);
    assert!(!held.is_held());
    let (_a, number) = waiting.await.unwrap();
    assert!(number.unwrap() > held.fencing());
    one.shutdown().await;
    two.shutdown().await;
}

/// Waits until the owner knows that an agent waits for the resource.
async fn wait_until_waiting(asker: &Agent, owner: &Agent, name: &str) {
    loop {
        let query = locks::list_query(owner.name().clone());
        let answer = asker.request(query, PATIENCE).await.unwrap();
        let views = locks::read_list(&answer).unwrap();
        if views[0].waiting.iter().any(|waiting| waiting == name) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test]
async fn a_holder_whose_platform_ends_has_lost_it() {
    let (_one, two, _owner, _a, b) = robots().await;
    let held = b.lock("door").await.unwrap();
    two.shutdown().await;
    assert_eq!(held.lost().await, LossReason::Disconnected);
    assert!(matches!(
        b.lock("door").await.err(),
        Some(LockError::Platform(_))
    ));
}

#[tokio::test]
async fn a_holder_that_does_not_hear_its_owner_loses_it_by_its_own_clock() {
    let (one, two, owner, _a, b) = robots().await;
    let heartbeat = Duration::from_millis(100);
    let held = b.lock("door").heartbeat(heartbeat).await.unwrap();
    // The agent stays where it is and answers nothing more.
    std::mem::forget(owner_without_driver(owner, &one).await);
    let reason = tokio::time::timeout(PATIENCE, held.lost()).await.unwrap();
    assert!(matches!(reason, LossReason::LeaseExpired), "{reason}");
    drop(two);
}

/// The owner's name, held by an agent that takes part in nothing.
async fn owner_without_driver(owner: Agent, platform: &Platform) -> Agent {
    let name = owner.name().clone();
    drop(owner);
    platform.register(Registration::new(name)).await.unwrap()
}

#[tokio::test]
async fn what_is_not_granted_says_why() {
    let (_one, _two, _owner, a, b) = robots().await;
    let nobody = a.lock("window").heartbeat(Duration::from_millis(20)).await;
    let Err(LockError::Failed(reason)) = nobody else {
        panic!("nobody owns it");
    };
    assert_eq!(reason, FailureReason::NoOwner);
    let _held = b.lock("door").await.unwrap();
    let timeout = Duration::from_millis(50);
    let late = a.lock("door").timeout(timeout).await;
    assert!(matches!(late, Err(LockError::Timeout(t)) if t == timeout));
    for heartbeat in [Duration::ZERO, Duration::from_secs(4000)] {
        let error = a.lock("door").heartbeat(heartbeat).await.err();
        assert!(matches!(error, Some(LockError::Heartbeat(h)) if h == heartbeat));
    }
}

#[tokio::test]
async fn other_messages_of_an_agent_with_locks_reach_it() {
    let (_one, _two, _owner, a, b) = robots().await;
    let _guard = a.lock("door").await.unwrap();
    let hello = Message::new(Performative::Inform).to("a").content("hello");
    assert!(b.send(hello).await[0].outcome.is_success());
    let received = tokio::time::timeout(PATIENCE, a.receive()).await;
    assert_eq!(received.unwrap().unwrap().content_str(), Some("hello"));
    let question = Message::new(Performative::QueryRef).to("a");
    let (answer, asked) = tokio::join!(b.request(question, PATIENCE), async {
        let asked = a.receive().await.unwrap();
        a.send(asked.reply(Performative::Inform)).await
    });
    assert!(asked[0].outcome.is_success());
    assert_eq!(answer.unwrap().performative, Performative::Inform);
    assert!(a.try_receive().is_none());
}

#[tokio::test]
async fn mail_that_the_user_does_not_take_stays_in_bounds() {
    let (_one, _two, owner, a, _b) = robots().await;
    let flood = Message::new(Performative::Inform).to("locks@robot1");
    for _ in 0..1500 {
        assert!(a.send(flood.clone()).await[0].outcome.is_success());
    }
    let mut taken = 0;
    while owner.try_receive().is_some() {
        taken += 1;
    }
    assert_eq!(taken, 1500);
    let _guard = a.lock("door").timeout(PATIENCE).await.unwrap();
}

/// Remembers the last record, and may refuse to.
#[derive(Default)]
struct Memory {
    record: Mutex<Record>,
    full: bool,
}

impl Keep for Memory {
    fn recall(&self, _resource: &str) -> io::Result<Record> {
        Ok(*self.record.lock().unwrap())
    }

    fn keep(&self, _resource: &str, record: Record) -> io::Result<()> {
        if self.full {
            return Err(io::Error::other("no room"));
        }
        *self.record.lock().unwrap() = record;
        Ok(())
    }
}

#[tokio::test]
async fn numbers_go_on_where_they_were_kept_and_none_is_told_that_is_not() {
    let platform = platform("robot1", None).await;
    let memory = Arc::new(Memory::default());
    for number in [1, 2] {
        let owner = member(&platform, "locks@robot1").await;
        owner.own("door", Arc::clone(&memory) as _).await.unwrap();
        let arm = member(&platform, "arm").await;
        let guard = arm.lock("door").await.unwrap();
        assert_eq!(guard.fencing(), Some(number));
        assert_eq!(memory.record.lock().unwrap().fencing, number);
        guard.release().await;
        tokio::time::timeout(PATIENCE, async {
            while memory.record.lock().unwrap().held {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        })
        .await
        .unwrap();
    }
    let owner = member(&platform, "locks@robot1").await;
    let full = Memory {
        full: true,
        ..Memory::default()
    };
    owner.own("door", Arc::new(full)).await.unwrap();
    let arm = member(&platform, "arm").await;
    let refused = arm.lock("door").await.err();
    assert!(
        matches!(&refused, Some(LockError::Failed(FailureReason::Refused(_)))),
        "{refused:?}"
    );
}

#[tokio::test]
async fn participants_can_be_named() {
    let platform = platform("robot1", None).await;
    let owner = platform.agent("cpp.owner").await.unwrap();
    owner.own("door", Arc::new(Forgetful::new())).await.unwrap();
    let arm = platform.agent("arm").await.unwrap();
    let heartbeat = Duration::from_millis(20);
    let by_type = arm.lock("door").heartbeat(heartbeat).await;
    assert!(matches!(
        by_type,
        Err(LockError::Failed(FailureReason::NoOwner))
    ));
    let named = fipa::Pattern::new("cpp.*").unwrap();
    let guard = arm.lock("door").with(named).await.unwrap();
    assert!(guard.is_held());
}

#[test]
fn a_control_loop_holds_and_gives_back_without_async() {
    let platform = Platform::builder().name("robot1").mdns(false);
    let platform = blocking::Platform::start(platform).unwrap();
    let member = |name: &str| platform.register(locks::registration(name)).unwrap();
    let owner = member("locks@robot1");
    owner.own("door", Arc::new(Forgetful::new())).unwrap();
    let (a, b) = (member("a"), member("b"));
    for algorithm in BOTH {
        let first = a.lock("door").algorithm(algorithm).acquire().unwrap();
        assert!(first.is_held());
        assert_eq!(first.resource(), "door");
        assert_eq!(first.lost_within(Duration::from_millis(10)), None);
        let soon = Duration::from_millis(200);
        let refused = b.lock("door").algorithm(algorithm).timeout(soon).acquire();
        assert!(matches!(refused, Err(LockError::Timeout(_))));
        let number = first.fencing().unwrap();
        std::thread::scope(|scope| {
            let second = b.lock("door").algorithm(algorithm).timeout(PATIENCE);
            let second = scope.spawn(|| second.acquire().unwrap());
            first.release();
            assert!(second.join().unwrap().fencing().unwrap() > number);
        });
    }
    let held = a.lock("door").acquire().unwrap();
    drop(a);
    assert_eq!(held.lost(), LossReason::Disconnected);
    assert!(!held.is_held());
    platform.shutdown();
}
