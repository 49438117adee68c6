//! Entries, search and changes.

use std::time::Duration;

use fipa_directory::*;
use proptest::prelude::*;

const A: InstanceId = InstanceId::from_bytes([1; 16]);
const B: InstanceId = InstanceId::from_bytes([2; 16]);

fn kinds(directory: &mut Directory) -> Vec<(ChangeKind, String)> {
    std::iter::from_fn(|| directory.poll_change())
        .map(|c| (c.kind, c.record.entry.name.to_string()))
        .collect()
}

#[test]
fn putting_the_same_entry_again_reports_nothing() {
    let mut directory = Directory::new();
    directory.put(Now::default(), A, Source::Mdns, Entry::new("a@x"));
    assert_eq!(kinds(&mut directory), [(ChangeKind::Added, "a@x".into())]);
    directory.put(Now::default(), A, Source::Mdns, Entry::new("a@x"));
    assert_eq!(kinds(&mut directory), []);
    let mut entry = Entry::new("a@x");
    entry.description = "moved".into();
    directory.put(Now::default(), A, Source::Mdns, entry);
    assert_eq!(kinds(&mut directory), [(ChangeKind::Changed, "a@x".into())]);
}

fn conflicts(directory: &mut Directory) -> Vec<String> {
    let kinds = kinds(directory).into_iter();
    let conflicts = kinds.filter(|(kind, _)| *kind == ChangeKind::Conflict);
    conflicts.map(|(_, name)| name).collect()
}

fn after(millis: u64) -> Now {
    Now::default().plus(Duration::from_millis(millis))
}

#[test]
fn a_name_that_two_living_platforms_hold_for_a_second_is_a_conflict_and_both_stay() {
    let mut directory = Directory::new();
    directory.put(Now::default(), A, Source::Mdns, Entry::new("a@x"));
    directory.set_state(Now::default(), A, State::Suspect);
    directory.put(after(10), B, Source::Mdns, Entry::new("a@x"));
    assert_eq!(directory.poll_timeout(), None);
    let found = directory.find("a@x").unwrap();
    assert_eq!(found.owner, B, "the living one is found");

    directory.set_state(after(20), A, State::Alive);
    directory.put(after(20), A, Source::Local, Entry::new("b@x"));
    directory.put(after(30), B, Source::Mdns, Entry::new("b@x"));
    let found = directory.find("b@x").unwrap();
    assert_eq!(found.owner, A, "the local one is found");
    directory.handle_timeout(after(1019));
    assert_eq!(conflicts(&mut directory), [""; 0]);
    assert_eq!(directory.poll_timeout(), Some(after(1020).mono));
    directory.handle_timeout(after(5000));
    assert_eq!(conflicts(&mut directory), ["a@x", "b@x"]);
    // Once is enough.
    directory.put(after(6000), B, Source::Peer, Entry::new("b@x"));
    assert_eq!(directory.poll_timeout(), None);
    assert_eq!(directory.iter().count(), 4);
}

#[test]
fn an_agent_that_moves_is_no_conflict_in_whichever_order_its_platforms_tell() {
    let mut directory = Directory::new();
    directory.put(Now::default(), A, Source::Mdns, Entry::new("a@x"));
    directory.put(after(10), B, Source::Mdns, Entry::new("a@x"));
    assert_eq!(directory.find("a@x").unwrap().owner, A, "until it has left");
    directory.remove(after(900), A, "a@x");
    assert_eq!(directory.find("a@x").unwrap().owner, B);
    assert!(directory.tombstone(after(900), "a@x").is_none());
    assert_eq!(directory.poll_timeout(), None);
    directory.handle_timeout(after(5000));
    assert_eq!(conflicts(&mut directory), [""; 0]);
}

#[test]
fn what_went_is_remembered_for_a_day_unless_it_is_back() {
    let mut directory = Directory::new();
    for name in ["a@x", "b@x"] {
        directory.put(Now::default(), A, Source::Mdns, Entry::new(name));
    }
    kinds(&mut directory);
    directory.remove_owner(after(500), A);
    let removed = directory.poll_change().unwrap();
    assert_eq!(removed.kind, ChangeKind::Removed);
    assert_eq!(removed.record.state, State::Gone);
    let gone = directory.tombstone(after(600), "a@x").unwrap();
    assert_eq!((gone.state, gone.since), (State::Gone, after(500).mono));
    assert!(directory.find("a@x").is_none() && directory.is_empty());

    directory.put(after(700), B, Source::Mdns, Entry::new("a@x"));
    let names = |directory: &Directory, now| {
        let gone = directory.tombstones(now);
        gone.map(|r| r.entry.name.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(names(&directory, after(700)), ["b@x"]);
    let day = 24 * 3600 * 1000;
    assert_eq!(names(&directory, after(day + 499)), ["b@x"]);
    assert_eq!(names(&directory, after(day + 500)), [""; 0]);
}

#[test]
fn of_many_that_went_the_last_are_remembered() {
    let mut directory = Directory::new();
    for n in 0..3000 {
        let name = format!("a{n}");
        directory.put(after(n), A, Source::Mdns, Entry::new(name.as_str()));
        directory.remove(after(n), A, &name);
    }
    assert_eq!(directory.tombstones(after(3000)).count(), 1000);
    assert!(directory.tombstone(after(3000), "a2000").is_some());
    assert!(directory.tombstone(after(3000), "a1999").is_none());
    // One that another directory tells of is older than all of them.
    let record = Record {
        entry: Entry::new("old"),
        owner: B,
        source: Source::Mdns,
        state: State::Gone,
        since: Duration::ZERO,
    };
    kinds(&mut directory);
    directory.put_record(after(3000), record);
    assert!(directory.tombstone(after(3000), "old").is_none());
    assert_eq!(kinds(&mut directory), [], "nothing of it is a change");
}

#[test]
fn replacing_what_an_owner_vouches_for_reports_only_the_difference() {
    let mut directory = Directory::new();
    let entries = |names: &[&str]| names.iter().map(|n| Entry::new(*n)).collect::<Vec<_>>();
    directory.replace(Now::default(), A, Source::Peer, entries(&["a@x", "b@x"]));
    directory.put(Now::default(), B, Source::Peer, Entry::new("c@y"));
    kinds(&mut directory);
    directory.replace(Now::default(), A, Source::Peer, entries(&["b@x", "d@x"]));
    assert_eq!(
        kinds(&mut directory),
        [
            (ChangeKind::Removed, "a@x".into()),
            (ChangeKind::Added, "d@x".into())
        ]
    );
    directory.remove_owner(Now::default(), A);
    let left: Vec<_> = directory.iter().map(|r| r.entry.name.to_string()).collect();
    assert_eq!(left, ["c@y"]);
}

#[test]
fn search_is_anchored_and_looks_at_the_field_asked_for() {
    let mut directory = Directory::new();
    for name in ["arm@robot1", "arm@robot10", "drive@robot1"] {
        let mut entry = Entry::new(name);
        entry.description = name.split('@').next().unwrap().into();
        directory.put(Now::default(), A, Source::Local, entry);
    }
    let count = |pattern: &str, field| {
        directory
            .search(&Pattern::new(pattern).unwrap(), field)
            .count()
    };
    assert_eq!(count("arm@robot1", Field::Name), 1);
    assert_eq!(count("arm@.*", Field::Name), 2);
    assert_eq!(count("arm|drive", Field::Description), 3);
    assert_eq!(count("arm|drive", Field::Name), 0);
}

#[test]
fn patterns_meant_to_blow_up_are_refused_and_errors_are_one_line() {
    assert!(
        Pattern::new("(a{1000}){1000}")
            .unwrap_err()
            .to_string()
            .contains("too large")
    );
    for (pattern, cost) in [
        ("arm@.*", 25..26),
        ("a|b|cd", 3..20),
        ("x{100}", 100..101),
        ("x{7,100}", 100..101),
        ("(x{20}){20}", 400..500),
        (r"\w", 500..1000),
        ("(a*)*b", 6..20),
    ] {
        let real = Pattern::new(pattern).unwrap().cost();
        assert!(cost.contains(&real), "{pattern}: {real}");
    }
    let end = Pattern::new("(?x) a # as if there were no more").unwrap_err();
    assert!(end.to_string().ends_with("it has no end"), "{end}");
    let error = Pattern::new("a(").unwrap_err().to_string();
    assert!(
        error.contains("unclosed group") && !error.contains('\n'),
        "{error}"
    );
    assert!(
        Pattern::new("a)|(b").is_err(),
        "it would break out of the anchors"
    );
    let slow = Pattern::new("(a*)*b").unwrap();
    assert!(!slow.matches(&"a".repeat(100_000)));
}

#[test]
fn what_only_this_host_or_its_link_can_reach_is_not_for_others() {
    for (address, for_others) in [
        ("tcp://10.0.0.1:1", true),
        ("tcp://robot1.local:1", true),
        ("tcp://[2001:db8::1]:1", true),
        ("tcp://127.0.0.2:1", false),
        ("tcp://[::1]:1", false),
        ("tcp://localhost:1", false),
        ("tcp://169.254.7.7:1", false),
        ("tcp://[fe80::1]:1", false),
        ("tcp://[fe80::1%2]:1", false),
        ("udt://10.0.0.1:1", true),
        ("udt://127.0.0.1:1", false),
        ("unix:///run/x.sock", false),
    ] {
        let address: Address = address.parse().unwrap();
        assert_eq!(address.is_for_others(), for_others, "{address}");
    }
}

#[test]
fn links_are_opened_over_tcp_and_unix_sockets_only() {
    for (address, is_link) in [
        ("tcp://h:1", true),
        ("unix:///run/x.sock", true),
        ("http://h/acc", false),
        ("udt://h:1", false),
    ] {
        assert_eq!(address.parse::<Address>().unwrap().is_link(), is_link);
    }
}

#[test]
fn addresses_are_read_strictly() {
    for (text, shown) in [
        ("tcp://10.0.0.1:4100", "tcp://10.0.0.1:4100"),
        ("localhost:0", "tcp://localhost:0"),
        ("[fe80::1]:9", "tcp://[fe80::1]:9"),
        ("unix:///run/x.sock", "unix:///run/x.sock"),
        ("quic://[::1]:4100", "quic://[::1]:4100"),
        ("quic://robot1:0", "quic://robot1:0"),
        ("http://robot1:7778/acc", "http://robot1:7778/acc"),
        ("HTTP://robot1", "http://robot1:80/"),
        ("http://[::1]/acc?a=b#c", "http://[::1]:80/acc?a=b"),
        ("http://10.0.0.1:1", "http://10.0.0.1:1/"),
        ("udt://10.0.0.1:4100", "udt://10.0.0.1:4100"),
        ("x-1.y+z://[::1]:0", "x-1.y+z://[::1]:0"),
    ] {
        assert_eq!(text.parse::<Address>().unwrap().to_string(), shown);
    }
    for wrong in [
        "",
        "host",
        "tcp://",
        "tcp://h",
        "tcp://h:99999",
        "h:+1",
        "::1:9",
        "udt://h",
        "udt://:1",
        "Udt://h:1",
        "1u://h:1",
        "tcp://h/x:1",
        "quic://robot1",
        "quic://",
        "http://",
        "http://u@h/acc",
        "http://h:x/acc",
        "http://h/a c",
        "http://h/a\r\nHost: x",
        "https://h/acc",
    ] {
        assert!(wrong.parse::<Address>().is_err(), "{wrong}");
    }
}

proptest! {
    #[test]
    fn instance_ids_read_back(octets: [u8; 16]) {
        let id = InstanceId::from_bytes(octets);
        prop_assert_eq!(id.to_string().parse(), Ok(id));
    }
}
