//! One address is enough: services tell each other whom they know.
mod support;

use std::collections::BTreeSet;

use bytes::BytesMut;
use fipa_acl::Text;
use fipa_directory::{Address, InstanceId};
use fipa_link::{Frame, Hello, KnownPlatform, Link, LinkConfig, Outcome, Role};
use fipa_mts::{ConnId, Connected, Ended, Machine, Output};
use fipa_sim::{NodeId, Sim};

use support::{Raw, millis, outcome, secs};

/// Daemons with an agent each, of which all but the first know the address of the first.
fn joined_by_the_first(sim: &mut Sim, daemons: usize) -> Vec<NodeId> {
    let nodes: Vec<NodeId> = (0..daemons).map(|n| sim.daemon(&format!("d{n}"))).collect();
    for (n, node) in nodes.iter().enumerate() {
        sim.register(*node, &format!("agent{n}"));
        if n > 0 {
            let first = sim.address(nodes[0]);
            sim.add_peer(*node, first);
        }
    }
    nodes
}

fn all_linked(sim: &Sim, nodes: &[NodeId]) -> bool {
    nodes.iter().all(|one| {
        let others = nodes.iter().filter(|two| *two != one);
        others.into_iter().all(|two| {
            sim.mts(*one).is_linked(sim.instance_of(*two)) && sim.streams(*one, *two) == 1
        })
    })
}

#[test]
fn five_daemons_with_one_address_know_all_agents_and_do_not_need_the_first_afterwards() {
    let mut sim = Sim::new(1);
    let nodes = joined_by_the_first(&mut sim, 5);
    sim.run_for(secs(2));
    assert!(all_linked(&sim, &nodes));
    for node in &nodes {
        assert_eq!(sim.names(*node).len(), 5);
    }
    sim.crash(nodes[0]);
    sim.run_for(secs(600));
    for node in &nodes[1..] {
        assert_eq!(sim.names(*node).len(), 4);
    }
    for (from, to) in [(1, 2), (2, 4), (4, 1)] {
        let (sender, receiver) = (format!("agent{from}"), format!("agent{to}"));
        let ticket = sim.send(nodes[from], &sender, &[&receiver], "");
        sim.run_for(millis(100));
        assert_eq!(outcome(&sim, nodes[from], ticket), Outcome::Delivered);
    }
    // Who joins later needs the address of any of them.
    let late = sim.daemon("late");
    let address = sim.address(nodes[3]);
    sim.add_peer(late, address);
    sim.run_for(secs(2));
    assert_eq!(sim.names(late).len(), 4);
    assert!(sim.mts(nodes[1]).is_linked(sim.instance_of(late)));
}

#[test]
fn a_chain_of_addresses_joins_all() {
    let mut sim = Sim::new(1);
    let nodes: Vec<NodeId> = (0..6).map(|n| sim.daemon(&format!("d{n}"))).collect();
    for pair in nodes.windows(2) {
        let next = sim.address(pair[1]);
        sim.add_peer(pair[0], next);
    }
    sim.run_for(secs(3));
    assert!(all_linked(&sim, &nodes));
}

#[test]
fn a_fleet_that_joins_at_once_calms_down_and_its_traffic_stays_small() {
    let mut sim = Sim::new(1);
    let nodes = joined_by_the_first(&mut sim, 30);
    sim.run_for(secs(5));
    assert!(all_linked(&sim, &nodes));
    nodes.iter().for_each(|node| sim.forget(*node));
    sim.run_for(secs(120));
    for node in &nodes {
        assert_eq!(sim.collected(*node).dials, []);
    }
    let octets = |sim: &Sim| nodes.iter().map(|n| sim.collected(*n).octets).sum::<u64>();
    let before = octets(&sim);
    sim.run_for(secs(60));
    // Heartbeats: 26 octets, each way, six times a minute, over each of 435 links.
    let heartbeats = 435 * 6 * 2 * 26;
    assert!(octets(&sim) - before <= heartbeats);
    let before = octets(&sim);
    let late = sim.daemon("late");
    let address = sim.address(nodes[7]);
    sim.add_peer(late, address);
    sim.run_for(secs(2));
    assert!(sim.mts(nodes[29]).is_linked(sim.instance_of(late)));
    let a_platform = (octets(&sim) - before) / 30;
    assert!(a_platform < 5_000, "{a_platform} octets a platform");
}

#[test]
fn two_that_know_each_other_by_gossip_only_find_each_other_again() {
    for seconds in [30, 300, 1800] {
        let mut sim = Sim::new(seconds);
        let nodes = joined_by_the_first(&mut sim, 3);
        sim.run_for(secs(2));
        sim.crash(nodes[0]);
        sim.run_for(secs(10));
        sim.isolate(nodes[1]);
        sim.run_for(secs(seconds));
        sim.mend(nodes[1]);
        sim.run_for(secs(35));
        for node in &nodes[1..] {
            assert_eq!(sim.names(*node), ["agent1", "agent2"], "after {seconds} s");
        }
    }
}

#[test]
fn a_dead_platform_is_looked_for_at_times_for_an_hour_and_then_forgotten_by_all() {
    let mut sim = Sim::new(1);
    let nodes = joined_by_the_first(&mut sim, 4);
    sim.run_for(secs(2));
    sim.power_off(nodes[3]);
    sim.run_for(secs(90));
    nodes.iter().for_each(|node| sim.forget(*node));
    let dead = sim.address(nodes[3]);
    sim.run_for(secs(3600));
    for node in &nodes[..3] {
        let dials = &sim.collected(*node).dials;
        assert!(
            dials.iter().all(|(_, to)| *to == [dead.clone()]),
            "{dials:?}"
        );
        assert!((100..260).contains(&dials.len()), "{} dials", dials.len());
        sim.forget(*node);
    }
    sim.run_for(secs(3600 * 3));
    for node in &nodes[..3] {
        assert_eq!(sim.collected(*node).dials, []);
    }
}

#[test]
fn a_platform_that_said_goodbye_is_not_looked_for() {
    let mut sim = Sim::new(1);
    let nodes = joined_by_the_first(&mut sim, 4);
    sim.run_for(secs(2));
    nodes.iter().for_each(|node| sim.forget(*node));
    sim.shutdown(nodes[3]);
    sim.run_for(secs(7200));
    for node in &nodes[..3] {
        assert_eq!(sim.collected(*node).dials, []);
    }
}

#[test]
fn addresses_of_use_to_one_host_only_are_not_told_to_another() {
    let mut sim = Sim::new(1);
    let hub = sim.daemon("hub");
    let private: Vec<Address> = [
        "tcp://127.0.0.1:5000",
        "tcp://169.254.9.9:5000",
        "tcp://[fe80::9]:5000",
    ]
    .iter()
    .map(|address| address.parse().unwrap())
    .collect();
    let public = Address::tcp("robot", 5000);
    let all: Vec<Address> = private.iter().chain([&public]).cloned().collect();
    let robot = sim.daemon_with("robot", |config| config.endpoints = all);
    sim.register(robot, "agent");
    let other = sim.daemon("other");
    // The hub itself has reached it at an address that is of no use to others.
    sim.add_peer(hub, private[1].clone());
    sim.add_peer(other, sim.address(hub));
    sim.run_for(secs(2));
    assert!(sim.mts(other).is_linked(sim.instance_of(robot)));
    let dials = sim.collected(other).dials.iter().flat_map(|(_, to)| to);
    assert!(dials.into_iter().all(|to| !private.contains(to)));
    for node in [hub, other] {
        let locations = &sim.directory(node).find("agent").unwrap().entry.locations;
        let told: Vec<&Text> = locations.iter().map(|l| &l.address).collect();
        assert_eq!(told, [&public.to_text()]);
    }
}

fn platform(n: u16, scope: &str) -> KnownPlatform {
    let mut id = [7; 16];
    id[..2].copy_from_slice(&n.to_be_bytes());
    KnownPlatform {
        instance: InstanceId::from_bytes(id),
        name: Text::from(format!("p{n}")),
        scope: Text::from(scope),
        addresses: vec![Text::from(format!("tcp://10.0.0.1:{n}"))],
        age_millis: 0,
    }
}

/// The ports that a service wanted to dial so far. Nobody answers there.
fn dialled(raw: &mut Raw) -> Vec<u16> {
    let mut ports = Vec::new();
    for output in std::mem::take(&mut raw.outputs) {
        if let Output::Dial {
            dial, addresses, ..
        } = output
        {
            ports.extend(addresses.iter().map(|address| match address {
                Address::Tcp { port, .. } => *port,
                other => panic!("{other}"),
            }));
            raw.mts.dial_failed(raw.now, dial, "connection refused");
        }
    }
    ports
}

/// Another peer of a service.
struct Second {
    conn: ConnId,
    link: Link,
    unread: BytesMut,
}

impl Second {
    const ID: InstanceId = InstanceId::from_bytes([8; 16]);

    fn call(raw: &mut Raw, endpoints: &[&str]) -> Second {
        Second::call_with(raw, ConnId(2), Second::ID, ("second", endpoints))
    }

    fn call_as(raw: &mut Raw, conn: ConnId, instance: InstanceId) -> Second {
        Second::call_with(raw, conn, instance, ("third", &[]))
    }

    fn call_with(
        raw: &mut Raw,
        conn: ConnId,
        instance: InstanceId,
        (name, endpoints): (&str, &[&str]),
    ) -> Second {
        let hello = Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance,
            name: Text::from(name),
            scope: Text::default(),
            endpoints: endpoints.iter().copied().map(Text::from).collect(),
            max_letter: 1 << 20,
            unix_millis: raw.now.unix_millis,
            checks: false,
        };
        let connected = Connected {
            conn,
            dialled: None,
            control: false,
            same_host: true,
            remote: Text::from("tcp://second:1"),
            identity: None,
            lanes: false,
        };
        raw.mts.connected(raw.now, connected);
        let mut second = Second {
            conn,
            link: Link::new(LinkConfig::new(hello), raw.now),
            unread: BytesMut::new(),
        };
        second.write(raw);
        second
    }

    fn say(&mut self, raw: &mut Raw, frame: Frame) {
        self.link.send(raw.now, frame);
        self.write(raw);
    }

    fn write(&mut self, raw: &mut Raw) {
        while let Some(part) = self.link.poll_transmit() {
            self.unread.extend_from_slice(&part);
        }
        let now = raw.now;
        raw.mts.received(now, self.conn, &mut self.unread);
        raw.exchange();
    }
}

fn wait(raw: &mut Raw) {
    raw.now = raw.now.plus(secs(1));
    raw.mts.handle_timeout(raw.now);
    raw.exchange();
}

#[test]
fn a_partner_on_another_host_is_told_less_than_one_on_this() {
    let public = "tcp://10.0.0.9:1";
    let private = [
        "tcp://169.254.1.1:1",
        "tcp://[fe80::1%2]:1",
        "tcp://127.0.0.1:1",
    ];
    let all = [&private[..], &[public]].concat();
    for (same_host, expected) in [(true, &all[..]), (false, &[public])] {
        let mut raw = Raw::at(Role::Daemon, same_host);
        Second::call(&mut raw, &all);
        wait(&mut raw);
        let heard = raw.heard.iter().filter_map(|frame| match frame {
            Frame::Platforms(platforms) => Some(platforms),
            _ => None,
        });
        let heard: Vec<&KnownPlatform> = heard.flatten().collect();
        assert_eq!(heard.len(), 1);
        assert_eq!((heard[0].instance, &*heard[0].name), (Second::ID, "second"));
        assert_eq!(heard[0].addresses, expected);
    }
    // Nothing is left to be told.
    let mut raw = Raw::at(Role::Daemon, false);
    Second::call(&mut raw, &private);
    wait(&mut raw);
    let told = |frame: &Frame| matches!(frame, Frame::Platforms(_));
    assert!(!raw.heard.iter().any(told));
}

#[test]
fn what_is_still_said_of_a_platform_that_took_its_leave_is_late() {
    for takes_leave in [false, true] {
        let mut raw = Raw::new(Role::Daemon);
        let mut second = Second::call(&mut raw, &[]);
        if takes_leave {
            second.say(&mut raw, Frame::Goodbye(Text::from("the service ends")));
        } else {
            let now = raw.now;
            let ended = Ended {
                reason: "connection reset by peer",
                orderly: false,
                all_written: true,
            };
            raw.mts.closed(now, second.conn, ended);
        }
        raw.say(Frame::Platforms(vec![KnownPlatform {
            instance: Second::ID,
            ..platform(7, "")
        }]));
        wait(&mut raw);
        let dials = if takes_leave { 0 } else { 1 };
        assert_eq!(dialled(&mut raw).len(), dials);
    }
}

#[test]
fn what_is_told_is_dialled_and_not_believed() {
    let mut raw = Raw::new(Role::Daemon);
    raw.say(Frame::Platforms(vec![
        platform(1, ""),
        platform(2, "another fleet"),
        KnownPlatform {
            age_millis: 3_600_000,
            ..platform(3, "")
        },
        KnownPlatform {
            age_millis: u64::MAX,
            ..platform(4, "")
        },
        KnownPlatform {
            addresses: vec!["no address".into()],
            ..platform(5, "")
        },
        KnownPlatform {
            instance: InstanceId::from_bytes([1; 16]),
            ..platform(6, "")
        },
    ]));
    assert!(raw.mts.directory().is_empty());
    let mut ports = Vec::new();
    let until = raw.now.mono + secs(7200);
    while raw.now.mono < until {
        ports.extend(dialled(&mut raw));
        raw.now = raw.now.plus(millis(500));
        raw.mts.handle_timeout(raw.now);
        raw.exchange();
    }
    assert!(ports.iter().all(|port| *port == 1), "{ports:?}");
    assert!((120..300).contains(&ports.len()), "{}", ports.len());
    assert!(raw.mts.directory().is_empty());
}

#[test]
fn a_peer_that_tells_of_ever_more_platforms_does_not_make_us_dial_ever_more() {
    let mut raw = Raw::new(Role::Daemon);
    for n in 0..40 {
        let told = (n * 250..(n + 1) * 250).map(|n| platform(n, ""));
        raw.say(Frame::Platforms(told.collect()));
    }
    let mut ports = BTreeSet::new();
    let mut dials = Vec::new();
    for _ in 0..600 {
        let tried = dialled(&mut raw);
        dials.push(tried.len());
        ports.extend(tried);
        raw.now = raw.now.plus(secs(1));
        raw.mts.handle_timeout(raw.now);
        raw.exchange();
    }
    assert_eq!(ports.len(), 1024);
    // At first they are tried more often; in the end each once in two minutes, about.
    assert!(dials.iter().all(|dials| *dials <= 1200), "{dials:?}");
    let last: usize = dials[300..].iter().sum();
    assert!((1500..6000).contains(&last), "{last} dials in 300 s");
}

/// The names of the platforms that the partner was told of since this was asked last.
fn told(raw: &mut Raw) -> Vec<Text> {
    let heard = std::mem::take(&mut raw.heard).into_iter();
    let platforms = heard.filter_map(|frame| match frame {
        Frame::Platforms(platforms) => Some(platforms),
        _ => None,
    });
    platforms.flatten().map(|platform| platform.name).collect()
}

#[test]
fn two_that_a_third_one_with_a_smaller_id_has_told_of_are_left_to_it() {
    for (teller, left_to_it) in [([0; 16], true), ([0xff; 16], false)] {
        let mut raw = Raw::new(Role::Daemon);
        Second::call(&mut raw, &["tcp://10.0.0.9:1"]);
        let mut third = Second::call_as(&mut raw, ConnId(3), InstanceId::from_bytes(teller));
        let known = |instance: InstanceId| KnownPlatform {
            instance,
            ..platform(7, "")
        };
        let both = vec![known(support::PARTNER), known(Second::ID)];
        third.say(&mut raw, Frame::Platforms(both));
        wait(&mut raw);
        let hears_of_second = told(&mut raw).contains(&Text::from("second"));
        assert_eq!(hears_of_second, !left_to_it, "{teller:?}");
        // When the third one is gone, nobody is left to tell them.
        let now = raw.now;
        let ended = Ended {
            reason: "connection reset by peer",
            orderly: false,
            all_written: true,
        };
        raw.mts.closed(now, third.conn, ended);
        wait(&mut raw);
        let hears_of_second = told(&mut raw).contains(&Text::from("second"));
        assert_eq!(hears_of_second, left_to_it, "{teller:?}");
    }
}
