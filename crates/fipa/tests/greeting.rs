//! Who answers at an address, and what a platform tells of itself.

use std::io::Write;
use std::net::TcpListener;

use fipa::{Address, CallBackResult, GreetError, Greeting, InstanceId, Platform, greet};

fn nobody() -> (TcpListener, Address) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    (listener, address.parse().unwrap())
}

#[tokio::test]
async fn a_platform_says_who_it_is_and_takes_nobody_for_a_peer_by_that() {
    let builder = Platform::builder().name("here").scope("plant").mdns(false);
    let platform = builder.start().await.unwrap();
    let endpoint = platform.endpoints()[0].clone();
    let greeting = greet(std::slice::from_ref(&endpoint)).await.unwrap();
    assert_eq!(greeting.name, "here");
    assert_eq!(greeting.scope, "plant");
    assert_eq!(greeting.address, endpoint);
    assert_eq!(greeting.version, Greeting::VERSION);
    assert!(greeting.clock_ahead_millis.abs() < 1_000);
    let facts = platform.facts().await.unwrap();
    assert_eq!(facts.instance, greeting.instance);
    assert_eq!(facts.mdns_port, None);
    assert_eq!(facts.endpoints, [endpoint.to_string().as_str()]);
    assert!(facts.peers.is_empty());
    platform.shutdown().await;
}

#[tokio::test]
async fn a_program_asks_its_daemon_for_the_facts() {
    let folder = tempfile::tempdir().unwrap();
    let control = folder.path().join("daemon.sock");
    let builder = Platform::builder().name("here").mdns(false);
    let daemon = builder.control(&control).start().await.unwrap();
    let program = Platform::attach_to(&control).await.unwrap();
    assert_eq!(program.facts().await, daemon.facts().await);
}

#[tokio::test]
async fn nobody_a_mute_one_and_a_stranger_are_told_apart() {
    let (listener, address) = nobody();
    drop(listener);
    let refused = greet(&[address]).await.unwrap_err();
    assert!(matches!(refused, GreetError::Refused(_)), "{refused:?}");

    let (listener, address) = nobody();
    assert_eq!(greet(&[address]).await, Err(GreetError::Mute));
    drop(listener);

    let (listener, address) = nobody();
    let stranger = std::thread::spawn(move || {
        let (mut caller, _) = listener.accept().unwrap();
        caller
            .write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            .unwrap();
    });
    let strange = greet(&[address]).await.unwrap_err();
    assert!(matches!(strange, GreetError::Strange(_)), "{strange:?}");
    stranger.join().unwrap();
}

#[tokio::test]
async fn a_platform_that_is_linked_says_whether_it_reaches_this_one() {
    let folder = tempfile::tempdir().unwrap();
    let control = folder.path().join("daemon.sock");
    let one = Platform::builder().name("one").mdns(false);
    let one = one.start().await.unwrap();
    let endpoint = one.endpoints()[0].to_string();
    let two = Platform::builder().name("two").mdns(false).peer(endpoint);
    let two = two.control(&control).start().await.unwrap();
    let _echo = one.agent("echo").await.unwrap();
    two.wait_for("echo").await;
    let program = Platform::attach_to(&control).await.unwrap();
    let instance = one.facts().await.unwrap().instance;
    for asking in [&two, &program] {
        let called = asking.call_back(instance).await.unwrap();
        assert_eq!(called.refusal, "");
        let [call] = &called.calls[..] else {
            panic!("{called:?}");
        };
        assert_eq!(call.address, two.endpoints()[0].to_string().as_str());
        assert_eq!(call.result, CallBackResult::Answered, "{call:?}");
        let nobody = InstanceId::from_bytes([9; 16]);
        let called = asking.call_back(nobody).await.unwrap();
        assert_eq!(called.refusal, "there is no link with it");
    }
}
