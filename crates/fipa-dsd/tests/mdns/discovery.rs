//! Daemons find and lose each other.
use std::net::UdpSocket;
use std::time::{Duration, Instant};

use fipa_dsd::{DiscoveryEvent, InterfaceSelector, Mdns, MdnsError};

use crate::support::namespace::{Namespace, can_unshare};
use crate::support::{config, event, found, id, on_loopback, peer, two_hosts};

const SOON: Duration = Duration::from_secs(3);

fn start(n: u8, endpoints: &[&str]) -> Mdns {
    Mdns::start(config(n, endpoints)).unwrap()
}

#[test]
fn two_daemons_find_and_lose_each_other() {
    on_loopback(
        "discovery::two_daemons_find_and_lose_each_other",
        || async {
            let begun = Instant::now();
            let (mut one, mut two) = (start(1, &["127.0.0.1:7001"]), start(2, &["127.0.0.1:7002"]));
            let peer = found(&mut one, SOON).await;
            println!("found after {:?}", begun.elapsed());
            assert_eq!((peer.instance, peer.name.as_str()), (id(2), "robot 2"));
            // The host has ::1 as well, but nobody listens there.
            assert_eq!(peer.addresses, ["127.0.0.1:7002".parse().unwrap()]);
            let peer = found(&mut two, SOON).await;
            println!("found by the second after {:?}", begun.elapsed());
            assert_eq!(peer.instance, id(1));

            let begun = Instant::now();
            two.shutdown().await;
            println!("shutdown took {:?}", begun.elapsed());
            assert_eq!(
                event(&mut one, SOON).await,
                Some(DiscoveryEvent::Lost(id(2)))
            );
            println!("lost after {:?}", begun.elapsed());
        },
    );
}

#[test]
fn a_late_comer_finds_all() {
    on_loopback("discovery::a_late_comer_finds_all", || async {
        let mut there: Vec<_> = (1..=8).map(|n| start(n, &["0.0.0.0:7000"])).collect();
        for mdns in &mut there {
            for _ in 1..8 {
                found(mdns, SOON).await;
            }
        }
        // The same record is not sent twice within a second; let the first announcements pass.
        tokio::time::sleep(SOON).await;
        let begun = Instant::now();
        let mut late = start(9, &["0.0.0.0:7000"]);
        let mut seen = Vec::new();
        while seen.len() < 8 {
            seen.push(found(&mut late, SOON).await.instance);
        }
        println!("all found after {:?}", begun.elapsed());
        seen.sort();
        assert_eq!(seen, (1..=8).map(id).collect::<Vec<_>>());
    });
}

#[test]
fn another_scope_is_not_seen() {
    on_loopback("discovery::another_scope_is_not_seen", || async {
        let mut one = start(1, &["127.0.0.1:7001"]);
        let mut stranger = config(2, &["127.0.0.1:7002"]);
        stranger.scope = "elsewhere".to_owned();
        let mut stranger = Mdns::start(stranger).unwrap();
        assert_eq!(event(&mut one, SOON).await, None);
        assert_eq!(event(&mut stranger, SOON).await, None);
        stranger.shutdown().await;
        assert_eq!(event(&mut one, SOON).await, None);
    });
}

#[test]
fn a_goodbye_is_that_of_one() {
    on_loopback("discovery::a_goodbye_is_that_of_one", || async {
        let mut one = start(1, &["127.0.0.1:7001"]);
        let (two, mut three) = (start(2, &["127.0.0.1:7002"]), start(3, &["127.0.0.1:7003"]));
        found(&mut one, SOON).await;
        found(&mut one, SOON).await;
        two.shutdown().await;
        assert_eq!(
            event(&mut one, SOON).await,
            Some(DiscoveryEvent::Lost(id(2)))
        );
        assert_eq!(event(&mut one, SOON).await, None);
        // The third one is there and may be asked for.
        one.verify(id(3)).unwrap();
        assert_eq!(event(&mut one, Duration::from_secs(5)).await, None);
        while let Some(event) = event(&mut three, Duration::from_millis(10)).await {
            assert_ne!(event, DiscoveryEvent::Lost(id(1)));
        }
    });
}

#[test]
fn a_restarted_daemon_is_found_anew() {
    on_loopback("discovery::a_restarted_daemon_is_found_anew", || async {
        let mut one = start(1, &["127.0.0.1:7001"]);
        let before = start(2, &["127.0.0.1:7002"]);
        assert_eq!(found(&mut one, SOON).await.instance, id(2));
        before.shutdown().await;
        let mut again = config(3, &["127.0.0.1:7002"]);
        again.name = "robot 2".to_owned();
        let _again = Mdns::start(again).unwrap();
        let events = [event(&mut one, SOON).await, event(&mut one, SOON).await];
        assert!(
            events.contains(&Some(DiscoveryEvent::Lost(id(2)))),
            "{events:?}"
        );
        let anew = |e: &Option<DiscoveryEvent>| matches!(e, Some(DiscoveryEvent::Found(p)) if p.instance == id(3));
        assert!(events.iter().any(anew), "{events:?}");
    });
}

#[test]
fn what_cannot_work_is_told_at_the_start() {
    on_loopback(
        "discovery::what_cannot_work_is_told_at_the_start",
        || async {
            let mut nowhere = config(1, &["127.0.0.1:7001"]);
            nowhere.interfaces = vec![InterfaceSelector::Name("wlan9".to_owned())];
            let error = Mdns::start(nowhere).err().unwrap().to_string();
            assert!(
                error.contains("`wlan9`") && error.contains("lo (127.0.0.1"),
                "{error}"
            );

            let error = Mdns::start(config(1, &["10.1.2.3:7001"])).err().unwrap();
            assert!(matches!(error, MdnsError::NotAnnounced { .. }), "{error}");

            let taken = UdpSocket::bind("0.0.0.0:0").unwrap();
            let mut late = config(1, &["127.0.0.1:7001"]);
            late.port = taken.local_addr().unwrap().port();
            let error = Mdns::start(late).err().unwrap();
            assert!(matches!(error, MdnsError::Socket { .. }), "{error}");
        },
    );
}

#[test]
fn hosts_find_each_other_by_the_address_of_the_cable() {
    if !can_unshare() {
        return;
    }
    let (a, b) = two_hosts();
    let mut one = peer(&a, 1, "0.0.0.0:7001");
    let mut neighbour = peer(&a, 3, "0.0.0.0:7003");
    let mut two = peer(&b, 2, "0.0.0.0:7002");
    let (_, line) = one.expect("found 2", SOON);
    assert_eq!(line, "found 2 10.77.0.2:7002");
    let (_, line) = two.expect("found 1", SOON);
    assert_eq!(line, "found 1 10.77.0.1:7001");
    // Who is on the same host has both addresses, loopback first, after one report or two.
    neighbour.expect("found 1 127.0.0.1:7001 10.77.0.1:7001", SOON);

    two.tell("quit");
    let (time, _) = one.expect("lost 2", SOON);
    println!("lost over the cable after {time:?}");
    // A loopback address of the other host does not turn up later either.
    while let Some(line) = one.line(Duration::from_millis(500)) {
        assert!(!line.starts_with("found 2"), "{line}");
    }
}

#[test]
fn link_local_addresses_carry_the_scope() {
    if !can_unshare() {
        return;
    }
    let (a, b) = two_hosts();
    let mut one = peer(&a, 1, "0.0.0.0:7001 [::]:7001");
    let _two = peer(&b, 2, "0.0.0.0:7002 [::]:7002");
    // Link-local addresses take about two seconds to be valid, and are looked for every five.
    let (_, line) = one.expect("found 2 10.77.0.2:7002 [fe80:", Duration::from_secs(15));
    assert!(line.contains('%') && line.ends_with("]:7002"), "{line}");
    assert!(!line.contains("::1]"), "{line}");
}

#[test]
fn a_crash_is_noticed_when_asked_for() {
    if !can_unshare() {
        return;
    }
    let (a, b) = two_hosts();
    let mut one = peer(&a, 1, "10.77.0.1:7001");
    let two = peer(&b, 2, "10.77.0.2:7002");
    one.expect("found 2", SOON);
    drop(two);
    one.tell("verify 2");
    let (time, _) = one.expect("lost 2", Duration::from_secs(6));
    println!("lost {time:?} after verify");
}

#[test]
fn a_host_that_was_out_of_reach_is_found_again() {
    if !can_unshare() {
        return;
    }
    // The cables end in a switch, so that pulling one out does not take the link away.
    let (a, b, switch) = (Namespace::new(), Namespace::new(), Namespace::new());
    switch.ip("link add name switch type bridge mcast_snooping 0");
    switch.ip("link set switch up");
    for (host, port, address) in [
        (&a, "port-a", "10.77.0.1/24"),
        (&b, "port-b", "10.77.0.2/24"),
    ] {
        host.connect("cable", &switch, port);
        host.ip(&format!("addr add {address} dev cable"));
        switch.ip(&format!("link set {port} master switch"));
    }
    let mut one = peer(&a, 1, "0.0.0.0:7001");
    let _two = peer(&b, 2, "0.0.0.0:7002");
    one.expect("found 2", SOON);
    switch.ip("link set port-b nomaster");
    one.tell("verify 2");
    one.expect("lost 2", Duration::from_secs(6));
    assert_eq!(one.line(SOON), None);
    switch.ip("link set port-b master switch");
    let (time, _) = one.expect("found 2", Duration::from_secs(6));
    println!("found again after {time:?}");
}
