use super::*;

fn id(n: u8) -> InstanceId {
    InstanceId::from_bytes([n; 16])
}

fn peers() -> Peers {
    Peers::new(id(0), "plant".to_owned())
}

fn announcement(n: u8, addresses: &[&str]) -> Heard {
    Heard {
        fullname: format!("robot-{n}._fipa._tcp.local."),
        id: Some(id(n).to_string()),
        name: format!("robot {n}"),
        scope: "plant".to_owned(),
        version: "1".to_owned(),
        quic: None,
        addresses: addresses
            .iter()
            .map(|address| address.parse().unwrap())
            .collect(),
    }
}

/// The addresses of the one peer found.
fn found(events: &[DiscoveryEvent]) -> Vec<String> {
    match events {
        [DiscoveryEvent::Found(peer)] => peer.addresses.iter().map(ToString::to_string).collect(),
        other => panic!("not one peer found: {other:?}"),
    }
}

#[test]
fn a_peer_is_reported_again_only_when_it_changed() {
    let (mut peers, now) = (peers(), Instant::now());
    let v4 = announcement(1, &["10.0.0.1:7000"]);
    assert_eq!(found(&peers.heard(v4.clone(), now)), ["10.0.0.1:7000"]);
    assert!(peers.heard(v4, now).is_empty());
    let both = announcement(1, &["[fd00::1]:7000", "10.0.0.1:7000"]);
    assert_eq!(
        found(&peers.heard(both, now)),
        ["10.0.0.1:7000", "[fd00::1]:7000"]
    );
    let mut renamed = announcement(1, &["10.0.0.1:7000"]);
    renamed.name = "arm".to_owned();
    assert_eq!(found(&peers.heard(renamed, now)).len(), 2);
}

#[test]
fn addresses_come_in_the_order_of_trying() {
    let addresses = [
        "[fe80::1%2]:1",
        "[fd00::1]:1",
        "169.254.0.1:1",
        "10.0.0.1:1",
        "[::1]:1",
        "127.0.0.1:1",
    ];
    let events = peers().heard(announcement(1, &addresses), Instant::now());
    let expected: Vec<_> = addresses.iter().rev().collect();
    assert_eq!(found(&events).iter().collect::<Vec<_>>(), expected);
}

#[test]
fn an_address_outlives_its_record_for_a_while() {
    let (mut peers, start) = (peers(), Instant::now());
    let first = announcement(1, &["10.0.0.1:7000", "10.0.0.2:7000"]);
    peers.heard(first, start);
    let second = announcement(1, &["10.0.0.2:7000"]);
    assert!(
        peers
            .heard(second.clone(), start + Duration::from_secs(900))
            .is_empty()
    );
    let later = start + Duration::from_secs(900) + ADDRESS_GRACE;
    assert_eq!(found(&peers.heard(second, later)), ["10.0.0.2:7000"]);
    let moved = announcement(1, &["10.0.0.2:7001"]);
    assert_eq!(found(&peers.heard(moved, later)), ["10.0.0.2:7001"]);
}

#[test]
fn ourselves_strangers_and_the_unresolved_are_ignored() {
    let (mut peers, now) = (peers(), Instant::now());
    let mut stranger = announcement(1, &["10.0.0.1:1"]);
    stranger.scope = "other".to_owned();
    let mut unresolved = announcement(2, &["10.0.0.1:1"]);
    unresolved.id = None;
    let mut no_id = announcement(3, &["10.0.0.1:1"]);
    no_id.id = Some("xyz".to_owned());
    for heard in [
        announcement(0, &["10.0.0.1:1"]),
        stranger,
        unresolved,
        no_id,
    ] {
        let fullname = heard.fullname.clone();
        assert!(peers.heard(heard, now).is_empty());
        assert_eq!(peers.removed(&fullname), None);
    }
}

#[test]
fn another_version_is_warned_of_once() {
    let (mut peers, now) = (peers(), Instant::now());
    let mut newer = announcement(1, &["10.0.0.1:1"]);
    newer.version = "2".to_owned();
    let warning = peers.heard(newer.clone(), now);
    assert!(matches!(&warning[..], [DiscoveryEvent::Warning(text)] if text.contains("`2`")));
    assert!(peers.heard(newer.clone(), now).is_empty());
    assert_eq!(peers.removed(&newer.fullname), None);
    assert_eq!(peers.heard(newer, now).len(), 1);
}

#[test]
fn a_loss_means_only_the_one_who_is_gone() {
    let (mut peers, now) = (peers(), Instant::now());
    let (one, two) = (
        announcement(1, &["10.0.0.1:1"]),
        announcement(2, &["10.0.0.1:2"]),
    );
    peers.heard(one.clone(), now);
    peers.heard(two, now);
    assert_eq!(
        peers.removed(&one.fullname),
        Some(DiscoveryEvent::Lost(id(1)))
    );
    assert_eq!(peers.removed(&one.fullname), None);
    assert_eq!(peers.fullnames(id(1)).count(), 0);
    assert_eq!(
        peers.fullnames(id(2)).collect::<Vec<_>>(),
        ["robot-2._fipa._tcp.local."]
    );
    assert_eq!(found(&peers.heard(one, now)), ["10.0.0.1:1"]);
}

#[test]
fn a_peer_without_usable_address_is_neither_found_nor_lost() {
    let (mut peers, now) = (peers(), Instant::now());
    let mute = announcement(1, &[]);
    assert!(peers.heard(mute.clone(), now).is_empty());
    assert_eq!(peers.removed(&mute.fullname), None);
}

#[test]
fn an_instance_name_may_pass_to_another_id() {
    let (mut peers, now) = (peers(), Instant::now());
    peers.heard(announcement(1, &["10.0.0.1:1"]), now);
    let mut heir = announcement(2, &["10.0.0.1:2"]);
    heir.fullname = announcement(1, &[]).fullname;
    let events = peers.heard(heir, now);
    assert_eq!(events[0], DiscoveryEvent::Lost(id(1)));
    assert_eq!(found(&events[1..]), ["10.0.0.1:2"]);
}

#[test]
fn a_peer_with_two_instance_names_is_lost_with_the_last() {
    let (mut peers, now) = (peers(), Instant::now());
    let first = announcement(1, &["10.0.0.1:1"]);
    let mut second = first.clone();
    second.fullname = "alias._fipa._tcp.local.".to_owned();
    peers.heard(first.clone(), now);
    assert!(peers.heard(second.clone(), now).is_empty());
    assert_eq!(peers.removed(&first.fullname), None);
    assert_eq!(
        peers.removed(&second.fullname),
        Some(DiscoveryEvent::Lost(id(1)))
    );
}

#[test]
fn those_who_stay_in_doubt_are_given_up() {
    let (mut peers, now) = (peers(), Instant::now());
    let (one, two) = (
        announcement(1, &["10.0.0.1:1"]),
        announcement(2, &["10.0.0.1:2"]),
    );
    peers.heard(one.clone(), now);
    peers.heard(two, now);
    peers.doubt_all();
    assert!(peers.heard(one, now).is_empty());
    assert_eq!(peers.drop_doubtful(), [DiscoveryEvent::Lost(id(2))]);
    assert!(peers.drop_doubtful().is_empty());
}
