use std::time::Duration;

use fipa::{Address, CallBack, CallBackResult, CalledBack, HeardDaemon};

use super::super::evidence::{Back, Wanted};
use super::*;

fn id(octet: u8) -> InstanceId {
    InstanceId::from_bytes([octet; 16])
}

fn facts() -> Facts {
    Facts {
        instance: id(1),
        name: "robot1".into(),
        scope: "plant".into(),
        endpoints: vec!["tcp://10.0.0.1:4100".into()],
        mdns_port: Some(5353),
        left_out: Vec::new(),
        peers: vec![PeerFacts {
            instance: Some(id(2)),
            name: "robot2".into(),
            addresses: vec!["tcp://10.0.0.2:4100".into()],
            announced: true,
            heard_millis: Some(20),
            error: "".into(),
        }],
    }
}

fn heard(octet: u8, name: &str) -> HeardDaemon {
    HeardDaemon {
        from: IpAddr::from([10, 0, 0, octet]),
        instance: id(octet),
        name: name.to_owned(),
        scope: "plant".to_owned(),
        port: 4100,
        after: Duration::from_millis(12),
    }
}

fn greeting() -> Greeting {
    Greeting {
        address: Address::tcp("10.0.0.2", 4100),
        instance: id(2),
        name: "robot2".into(),
        scope: "plant".into(),
        version: Greeting::VERSION,
        clock_ahead_millis: 3,
    }
}

/// The calls of another daemon to as many addresses.
fn back(results: &[CallBackResult]) -> Back {
    let calls = results.iter().map(|result| CallBack {
        address: "tcp://10.0.0.1:4100".into(),
        result: *result,
        reason: "why".into(),
    });
    Back {
        whom: "robot2".to_owned(),
        answer: Some(CalledBack {
            request: 1,
            refusal: "".into(),
            calls: calls.collect(),
        }),
    }
}

/// Two robots that see each other.
fn healthy() -> Evidence {
    Evidence {
        daemon: Ok(facts()),
        interfaces: Ok(vec![InterfaceProbe {
            name: "wlan0".to_owned(),
            addresses: vec![IpAddr::from([10, 0, 0, 1])],
            loopback: false,
            usable: true,
            multicast: Multicast::Works,
            multicast_v6: Multicast::Works,
            heard: vec![heard(1, "robot1"), heard(2, "robot2")],
        }]),
        doubles: Vec::new(),
        own: Vec::new(),
        calls: vec![Call {
            whom: "robot2".to_owned(),
            addresses: vec!["tcp://10.0.0.2:4100".to_owned()],
            other_make: false,
            result: Ok(greeting()),
        }],
        backs: vec![back(&[CallBackResult::Answered])],
        wanted: None,
    }
}

/// What did not go well after this was changed, as `state check`.
fn after(change: impl FnOnce(&mut Evidence)) -> Vec<String> {
    let mut evidence = healthy();
    change(&mut evidence);
    let checks = examine(&evidence).into_iter();
    let bad = checks.filter(|check| check.state != State::Ok);
    bad.map(|check| {
        assert!(check.advice.is_some(), "{check:?}");
        format!("{} {}", check.state.as_str(), check.check)
    })
    .collect()
}

fn daemon(evidence: &mut Evidence) -> &mut Facts {
    evidence.daemon.as_mut().unwrap()
}

fn wlan(evidence: &mut Evidence) -> &mut InterfaceProbe {
    &mut evidence.interfaces.as_mut().unwrap()[0]
}

#[test]
fn two_robots_that_see_each_other_are_well() {
    assert_eq!(after(|_| {}), [""; 0]);
    assert!(examine(&healthy()).iter().all(|c| c.advice.is_none()));
}

#[test]
fn each_fault_is_named_by_its_check_alone() {
    let call = |error: GreetError| after(move |e| e.calls[0].result = Err(error));
    let unreachable = GreetError::Unreachable("no answer within 3 s".to_owned());
    assert_eq!(call(unreachable), ["failed port"]);
    assert_eq!(call(GreetError::Refused("x".to_owned())), ["failed port"]);
    assert_eq!(call(GreetError::Mute), ["failed port"]);
    assert_eq!(call(GreetError::Keyless), ["failed scope"]);
    assert_eq!(
        call(GreetError::Strange("x".to_owned())),
        ["failed version"]
    );

    let not_sent = Multicast::NotSent("denied".to_owned());
    assert_eq!(
        after(|e| wlan(e).multicast = not_sent),
        ["failed multicast"]
    );
    let eaten = |e: &mut Evidence| wlan(e).multicast = Multicast::NotHeard;
    assert_eq!(after(eaten), ["failed multicast"]);
    let unheard = |e: &mut Evidence| {
        wlan(e).heard.clear();
        daemon(e).peers[0].announced = false;
    };
    assert_eq!(after(unheard), ["warning multicast"]);
    assert_eq!(after(|e| daemon(e).mdns_port = None), ["warning multicast"]);

    let left_out = ("a.long.name".into(), "it is too long".into());
    assert_eq!(
        after(|e| daemon(e).left_out.push(left_out)),
        ["warning names"]
    );
    let twin = |e: &mut Evidence| wlan(e).heard.push(heard(3, "robot1"));
    assert_eq!(after(twin), ["failed duplicate"]);
    let agent = "arm".to_owned();
    assert_eq!(after(|e| e.doubles.push(agent)), ["failed duplicate"]);

    let unlinked = |e: &mut Evidence| daemon(e).peers[0].heard_millis = None;
    assert_eq!(after(unlinked), ["warning link"]);
    let no_daemon = |e: &mut Evidence| e.daemon = Err("no daemon".to_owned());
    assert_eq!(after(no_daemon), ["warning daemon"]);
    let wanted = Wanted {
        name: "robot9".to_owned(),
        known: false,
    };
    assert_eq!(after(|e| e.wanted = Some(wanted)), ["failed peer"]);
}

#[test]
fn the_daemon_is_missed_where_somebody_is_heard_whom_it_does_not_reach() {
    let elsewhere = |e: &mut Evidence| {
        daemon(e).endpoints = vec!["tcp://127.0.0.1:4100".into()];
        daemon(e).peers.clear();
    };
    assert_eq!(after(elsewhere), ["failed interface"]);
    // Of another fleet nobody is missed.
    let other_fleet = |e: &mut Evidence| {
        elsewhere(e);
        e.calls.clear();
        wlan(e).heard.iter_mut().for_each(|h| h.scope.clear());
    };
    assert_eq!(after(other_fleet), [""; 0]);
}

#[test]
fn clocks_may_differ_by_a_second_and_are_wrong_from_half_a_minute_on() {
    for (millis, expected) in [
        (1_000, &[][..]),
        (-1_000, &[]),
        (1_001, &["warning clock"]),
        (-30_000, &["warning clock"]),
        (30_001, &["failed clock"]),
        (-3_600_000, &["failed clock"]),
        (i64::MIN, &["failed clock"]),
    ] {
        let result = Ok(Greeting {
            clock_ahead_millis: millis,
            ..greeting()
        });
        assert_eq!(after(|e| e.calls[0].result = result), expected, "{millis}");
    }
}

#[test]
fn a_robot_of_another_make_need_not_greet() {
    let mute = |e: &mut Evidence| {
        e.calls[0].other_make = true;
        e.calls[0].result = Err(GreetError::Mute);
    };
    assert_eq!(after(mute), [""; 0]);
}

#[test]
fn another_version_and_another_scope_are_told_of() {
    let version = Ok(Greeting {
        version: Greeting::VERSION + 1,
        ..greeting()
    });
    let version = after(|e| e.calls[0].result = version);
    assert_eq!(version, ["warning version"]);
    let scope = Ok(Greeting {
        scope: "lab".into(),
        ..greeting()
    });
    assert_eq!(after(|e| e.calls[0].result = scope), ["failed scope"]);
}

#[test]
fn a_daemon_that_another_does_not_reach_is_told_of_unless_it_reaches_it_elsewhere() {
    use CallBackResult::{Answered, NotReached, Refused, Stranger, Untried};
    let calls = |results: &[CallBackResult]| after(|e| e.backs = vec![back(results)]);
    for result in [NotReached, Refused, Stranger] {
        assert_eq!(calls(&[result]), ["failed port"]);
        assert_eq!(calls(&[result, Untried]).len(), 2);
        assert_eq!(calls(&[result, Answered]), ["warning port"]);
    }
    assert_eq!(calls(&[Untried, Answered]), [""; 0]);
    assert_eq!(calls(&[Untried]), ["warning port"]);
    assert_eq!(calls(&[]), ["warning port"]);
    let silent = after(|e| e.backs[0].answer = None);
    assert_eq!(silent, ["warning port"]);
    let refused = |e: &mut Evidence| {
        let answer = e.backs[0].answer.as_mut().unwrap();
        answer.refusal = "too often".into();
    };
    assert_eq!(after(refused), ["warning port"]);
}

#[test]
fn multicast_over_ipv6_is_missed_more_where_there_is_none_over_ipv4() {
    let eaten = |e: &mut Evidence| wlan(e).multicast_v6 = Multicast::NotHeard;
    assert_eq!(after(eaten), ["warning multicast"]);
    let not_sent = |e: &mut Evidence| {
        wlan(e).multicast_v6 = Multicast::NotSent("denied".to_owned());
        wlan(e).multicast = Multicast::Untried;
    };
    assert_eq!(after(not_sent), ["failed multicast"]);
    let untried = |e: &mut Evidence| wlan(e).multicast_v6 = Multicast::Untried;
    assert_eq!(after(untried), [""; 0]);
}
