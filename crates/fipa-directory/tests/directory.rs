//! Entries, search and changes.

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

#[test]
fn a_name_that_two_living_platforms_hold_is_a_conflict_and_both_stay() {
    let mut directory = Directory::new();
    directory.put(Now::default(), A, Source::Mdns, Entry::new("a@x"));
    directory.set_state(A, State::Suspect);
    directory.put(Now::default(), B, Source::Mdns, Entry::new("a@x"));
    assert!(
        !kinds(&mut directory)
            .iter()
            .any(|(k, _)| *k == ChangeKind::Conflict)
    );
    assert_eq!(
        directory.find("a@x").unwrap().owner,
        B,
        "the living one is found"
    );

    directory.set_state(A, State::Alive);
    directory.put(Now::default(), B, Source::Mdns, Entry::new("b@x"));
    directory.put(Now::default(), A, Source::Local, Entry::new("b@x"));
    assert!(kinds(&mut directory).contains(&(ChangeKind::Conflict, "b@x".into())));
    assert_eq!(
        directory.find("b@x").unwrap().owner,
        A,
        "the local one is found"
    );
    assert_eq!(directory.iter().count(), 4);
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
    directory.remove_owner(A);
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
fn addresses_are_read_strictly() {
    for (text, shown) in [
        ("tcp://10.0.0.1:4100", "tcp://10.0.0.1:4100"),
        ("localhost:0", "tcp://localhost:0"),
        ("[fe80::1]:9", "tcp://[fe80::1]:9"),
        ("unix:///run/x.sock", "unix:///run/x.sock"),
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
        "udt://h:1",
        "tcp://h/x:1",
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
