use std::net::{Ipv4Addr, Ipv6Addr};

use fipa_directory::InstanceId;
use if_addrs::{IfAddr, IfOperStatus, Ifv4Addr, Ifv6Addr};

use super::*;

fn interface(name: &str, index: u32, ip: &str) -> Interface {
    let addr = match ip.parse().unwrap() {
        IpAddr::V4(ip) => {
            let netmask = Ipv4Addr::new(255, 255, 255, 0);
            IfAddr::V4(Ifv4Addr {
                ip,
                netmask,
                prefixlen: 24,
                broadcast: None,
            })
        }
        IpAddr::V6(ip) => {
            let netmask = Ipv6Addr::from_bits(u128::MAX << 64);
            IfAddr::V6(Ifv6Addr {
                ip,
                netmask,
                prefixlen: 64,
                broadcast: None,
            })
        }
    };
    let name = name.to_owned();
    let oper_status = IfOperStatus::Up;
    Interface {
        name,
        addr,
        index: Some(index),
        oper_status,
        is_p2p: false,
    }
}

fn host() -> Vec<Interface> {
    vec![
        interface("lo", 1, "127.0.0.1"),
        interface("lo", 1, "::1"),
        interface("wlan0", 2, "10.0.0.7"),
        interface("wlan0", 2, "fe80::7"),
        interface("eth0", 3, "192.168.1.7"),
        interface("eth0", 3, "fe80::7"),
    ]
}

fn rule(endpoints: &[&str], selectors: &[&str]) -> Result<Rule, MdnsError> {
    let config = MdnsConfig {
        instance: InstanceId::from_bytes([1; 16]),
        name: String::new(),
        scope: String::new(),
        endpoints: endpoints.iter().map(|e| e.parse().unwrap()).collect(),
        quic: None,
        interfaces: selectors.iter().map(|s| s.parse().unwrap()).collect(),
        agents: crate::DEFAULT_AGENTS,
        port: 5353,
    };
    Rule::new(&config, &host())
}

fn chosen(rule: &Rule, by: impl Fn(&Rule, &Interface) -> bool) -> Vec<String> {
    let host = host();
    let chosen = host.iter().filter(|interface| by(rule, interface));
    chosen.map(|i| format!("{} {}", i.name, i.ip())).collect()
}

#[test]
fn loopback_endpoints_keep_mdns_on_loopback() {
    let rule = rule(&["127.0.0.1:7000"], &[]).unwrap();
    assert_eq!(chosen(&rule, Rule::speaks_on), ["lo 127.0.0.1", "lo ::1"]);
    assert_eq!(chosen(&rule, Rule::announces), ["lo 127.0.0.1"]);
}

#[test]
fn an_address_brings_in_its_interface_and_loopback() {
    let rule = rule(&["10.0.0.7:7000"], &[]).unwrap();
    let spoken = ["lo 127.0.0.1", "lo ::1", "wlan0 10.0.0.7", "wlan0 fe80::7"];
    assert_eq!(chosen(&rule, Rule::speaks_on), spoken);
    assert_eq!(chosen(&rule, Rule::announces), ["wlan0 10.0.0.7"]);
}

#[test]
fn an_unspecified_address_means_its_own_family_everywhere() {
    let rule = rule(&["0.0.0.0:7000"], &[]).unwrap();
    assert_eq!(chosen(&rule, Rule::speaks_on).len(), 6);
    let announced = ["lo 127.0.0.1", "wlan0 10.0.0.7", "eth0 192.168.1.7"];
    assert_eq!(chosen(&rule, Rule::announces), announced);
}

#[test]
fn selectors_narrow_the_choice() {
    let rule = rule(&["0.0.0.0:7000", "[::]:7000"], &["10.0.0.0/8", "eth0"]).unwrap();
    let announced = ["wlan0 10.0.0.7", "eth0 192.168.1.7", "eth0 fe80::7"];
    assert_eq!(chosen(&rule, Rule::announces), announced);
}

#[test]
fn a_selector_without_interface_is_an_error_that_tells_the_choice() {
    let error = rule(&["0.0.0.0:7000"], &["eth0", "wlan9"])
        .unwrap_err()
        .to_string();
    assert!(error.contains("`wlan9`"), "{error}");
    assert!(error.contains("wlan0 (10.0.0.7, fe80::7)"), "{error}");
}

#[test]
fn the_scope_id_tells_apart_equal_link_local_addresses() {
    let rule = rule(&["[fe80::7%3]:7000"], &[]).unwrap();
    assert_eq!(chosen(&rule, Rule::announces), ["eth0 fe80::7"]);
}

#[test]
fn the_port_that_others_can_use_is_announced() {
    let rule = rule(
        &["127.0.0.1:7000", "10.0.0.7:7001", "192.168.1.7:7002"],
        &[],
    )
    .unwrap();
    assert_eq!(rule.port(), 7001);
    assert_eq!(chosen(&rule, Rule::announces), ["wlan0 10.0.0.7"]);
}

#[test]
fn loopback_is_told_only_where_mdns_is_spoken_nowhere_else() {
    let shown = |reach: &Reach| {
        reach
            .hosts
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
    };
    let reach = rule(&["127.0.0.1:7000"], &[]).unwrap().reach(&host());
    assert!(reach.loopback);
    assert_eq!(shown(&reach), ["127.0.0.1", "::1"]);
    let everywhere = rule(&["0.0.0.0:7000"], &["lo", "wlan0"]).unwrap();
    let reach = everywhere.reach(&host());
    assert!(!reach.loopback);
    assert_eq!(shown(&reach), ["10.0.0.7", "fe80::7"]);
    // While nothing but loopback is up.
    assert!(everywhere.reach(&host()[..2]).loopback);
}

#[test]
fn every_spoken_interface_is_listened_to_once() {
    let mut host = host();
    host.push(interface("wlan0", 2, "10.0.0.8"));
    let rule = rule(&["0.0.0.0:7000"], &["lo", "wlan0"]).unwrap();
    let posts = rule.listening_posts(&host);
    let posts = posts
        .iter()
        .map(|post| (post.address.to_string(), post.on_loopback));
    let expected = [("127.0.0.1", true), ("10.0.0.7", false)];
    assert_eq!(
        posts.collect::<Vec<_>>(),
        expected.map(|(address, on)| (address.to_owned(), on))
    );
}

#[test]
fn endpoints_are_checked() {
    assert!(matches!(rule(&[], &[]), Err(MdnsError::NoEndpoint)));
    let error = rule(&["10.0.0.7:0"], &[]).unwrap_err();
    assert!(
        matches!(error, MdnsError::EndpointWithoutPort(_)),
        "{error}"
    );
}

#[test]
fn networks_of_any_width() {
    let ip = |text: &str| text.parse::<IpAddr>().unwrap();
    assert!(within(ip("10.1.2.3"), ip("0.0.0.0"), 0));
    assert!(within(ip("10.1.2.3"), ip("10.1.2.3"), 32));
    assert!(!within(ip("10.1.2.3"), ip("10.1.2.2"), 32));
    assert!(within(ip("fe80::1"), ip("fe80::"), 10));
    assert!(!within(ip("fd00::1"), ip("fe80::"), 10));
    assert!(!within(ip("10.1.2.3"), ip("::"), 0));
    assert!(!within(ip("10.1.2.3"), ip("10.1.2.3"), 33));
}
