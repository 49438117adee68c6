use fipa_directory::MESSAGE_TRANSPORT;
use proptest::prelude::*;

use super::*;

fn id() -> InstanceId {
    InstanceId::from_bytes([7; 16])
}

fn location(address: &str) -> Location {
    Location {
        address: address.into(),
        signature: MESSAGE_TRANSPORT.into(),
    }
}

fn entry(name: &str, addresses: &[&str]) -> Entry {
    let mut entry = Entry::new(name);
    entry.locations = addresses.iter().map(|address| location(address)).collect();
    entry.description = "Message client of mts-0".into();
    entry.timestamp = 1_795_330_382_938;
    entry
}

/// The strings as they are on the wire.
fn shown(strings: &[TxtString]) -> Vec<String> {
    let shown = strings.iter();
    shown
        .map(|(key, value)| format!("{key}={}", String::from_utf8_lossy(value)))
        .collect()
}

fn parsed(shown: &[&str]) -> Vec<TxtString> {
    let pairs = shown.iter().map(|string| string.split_once('=').unwrap());
    pairs
        .map(|(key, value)| (key.to_owned(), value.as_bytes().to_vec()))
        .collect()
}

#[test]
fn the_strings_are_those_of_fipa_services_and_then_ours() {
    let written = write(&entry("agent-a", &["tcp://10.99.0.1:39623"]), id()).unwrap();
    assert!(!written.shortened);
    let expected = [
        "TYPE=fipa::services::transports::MessageTransport",
        "LOCATOR=tcp://10.99.0.1:39623 fipa::services::transports::MessageTransport;",
        "DESCRIPTION=Message client of mts-0",
        "TIMESTAMP=20261122-06:53:02:938000",
        "ID=07070707070707070707070707070707",
    ];
    assert_eq!(shown(&written.strings), expected);
}

#[test]
fn a_long_value_is_cut_where_a_cpp_robot_cuts_it() {
    // The same locator as in the recorded announcement of agent-long.
    let addresses = ["1:40000", "2:40001", "3:40002", "4:40003", "5:40004"];
    let addresses = addresses.map(|end| format!("tcp://10.99.0.{end}"));
    let addresses: Vec<&str> = addresses.iter().map(String::as_str).collect();
    let written = write(&entry("agent-long", &addresses), id()).unwrap();
    let shown = shown(&written.strings);
    assert_eq!(shown[1].len(), "LOCATOR=".len() + 192);
    assert!(shown[1].ends_with(":40002 fipa::services::transports::MessageT"));
    assert!(shown[2].starts_with("LOCATOR=ransport;tcp://10.99.0.4:40003 "));
    assert!(shown[3].starts_with("DESCRIPTION="));
}

#[test]
fn a_true_name_is_told_where_the_label_would_be_misread() {
    let written = write(&entry("which?@robot.1", &["tcp://10.0.0.1:1"]), id()).unwrap();
    assert!(shown(&written.strings).contains(&"NAME=which?@robot.1".to_owned()));
    let (_, read) = read("which?@robot?1", &written.strings);
    assert_eq!(read.name, "which?@robot.1");
}

#[test]
fn a_name_that_is_not_that_of_the_label_is_not_believed() {
    let strings = parsed(&["TYPE=t", "NAME=somebody.else"]);
    assert_eq!(read("agent?1", &strings).1.name, "agent.1");
}

#[test]
fn nothing_empty_is_written() {
    let mut bare = entry("agent", &["tcp://10.0.0.1:1"]);
    bare.description = Text::default();
    bare.kind = Text::default();
    let written = write(&bare, id()).unwrap();
    let keys: Vec<_> = written.strings.iter().map(|(key, _)| key).collect();
    assert_eq!(keys, ["LOCATOR", "TIMESTAMP", "ID"]);
}

#[test]
fn the_announcement_of_the_jade_bridge_is_read() {
    let strings = parsed(&[
        "TYPE=mts_client",
        "LOCATOR=tcp://10.99.0.1:6789 JadeProxyAgent",
        "DESCRIPTION=Message proxy",
        "TIMESTAMP=20261122-06:53:05:919000",
    ]);
    let (instance, read) = read("da0@192?168?0?1:1099/JADE", &strings);
    assert_eq!(instance, None);
    assert_eq!(read.name, "da0@192.168.0.1:1099/JADE");
    assert_eq!(read.kind, "mts_client");
    let expected = Location {
        address: "tcp://10.99.0.1:6789".into(),
        signature: "JadeProxyAgent".into(),
    };
    assert_eq!(read.locations, [expected]);
    assert_eq!(read.timestamp, 1_795_330_385_919);
}

#[test]
fn what_is_missing_or_malformed_is_empty() {
    let strings = parsed(&[
        "LOCATOR=;; tcp://10.0.0.1:1  sig.type svc.sig ;;tcp://10.0.0.2:2;",
        "TIMESTAMP=yesterday",
        "ID=7",
    ]);
    let (instance, read) = read("a", &strings);
    assert_eq!(instance, None);
    assert_eq!(read.kind, "");
    assert_eq!(read.timestamp, 0);
    let locations = read.locations.iter();
    let locations: Vec<_> = locations
        .map(|l| (l.address.as_str(), l.signature.as_str()))
        .collect();
    let expected = [("tcp://10.0.0.1:1", "sig.type"), ("tcp://10.0.0.2:2", "")];
    assert_eq!(locations, expected);
}

#[test]
fn what_is_too_long_is_shortened_and_said_so() {
    let addresses: Vec<String> = (0..40).map(|i| format!("tcp://10.0.0.{i}:40000")).collect();
    let addresses: Vec<&str> = addresses.iter().map(String::as_str).collect();
    let long = entry("agent", &addresses);
    let written = write(&long, id()).unwrap();
    assert!(written.shortened);
    let (_, read) = read("agent", &written.strings);
    assert!(read.locations.len() > 10);
    assert_eq!(read.locations, long.locations[..read.locations.len()]);

    let mut talkative = entry("agent", &addresses[..1]);
    talkative.description = "ö".repeat(1000).into();
    let written = write(&talkative, id()).unwrap();
    assert!(written.shortened);
    let (_, read) = super::read("agent", &written.strings);
    assert!(read.description.len() > 900 && talkative.description.starts_with(&*read.description));

    let mut hopeless = entry("agent", &addresses[..1]);
    hopeless.kind = "t".repeat(1300).into();
    assert_eq!(write(&hopeless, id()), None);
}

#[test]
fn a_location_that_would_be_misread_is_left_out() {
    let written = write(&entry("a", &["tcp://a;b:1", "tcp://10.0.0.1:1"]), id()).unwrap();
    assert!(written.shortened);
    let (_, read) = read("a", &written.strings);
    assert_eq!(read.locations, [location("tcp://10.0.0.1:1")]);
}

fn octets(strings: &[TxtString]) -> usize {
    let lengths = strings.iter().map(|(key, value)| key.len() + value.len());
    lengths.map(|length| length + 2).sum()
}

fn any_location() -> impl Strategy<Value = Location> {
    ("[a-z]{1,5}://[!-:<-~]{1,40}", "[!-:<-~]{1,50}").prop_map(|(address, signature)| Location {
        address: address.into(),
        signature: signature.into(),
    })
}

prop_compose! {
    fn any_entry()(
        name in "[^\\p{Cc}\\s]{1,21}",
        kind in ".{0,80}",
        locations in proptest::collection::vec(any_location(), 0..20),
        description in ".{0,400}",
        seconds in 0_i64..253_000_000_000,
    ) -> Entry {
        let (name, kind, description) = (Text::from(name), kind.into(), description.into());
        Entry { name, kind, locations, description, timestamp: seconds * 1000 + seconds % 1000 }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn any_entry_is_read_as_it_was_written(entry in any_entry()) {
        let written = write(&entry, id()).unwrap();
        prop_assert!(octets(&written.strings) <= MOST);
        for (key, value) in &written.strings {
            prop_assert!(key.len() + 1 + value.len() <= 200);
            prop_assert!(!value.is_empty());
        }
        let (instance, read) = read(&label(&entry.name).unwrap(), &written.strings);
        prop_assert_eq!(instance, Some(id()));
        prop_assert_eq!((&read.name, &read.kind), (&entry.name, &entry.kind));
        prop_assert_eq!(read.timestamp, entry.timestamp);
        if written.shortened {
            prop_assert!(entry.description.starts_with(&*read.description));
            prop_assert!(read.locations.len() <= entry.locations.len());
        } else {
            prop_assert_eq!(read, entry);
        }
    }

    #[test]
    fn any_strings_are_read(
        label in ".{0,30}",
        strings in proptest::collection::vec(
            ("TYPE|LOCATOR|locator|TIMESTAMP|NAME|ID|x", proptest::collection::vec(any::<u8>(), 0..60)),
            0..8,
        ),
    ) {
        let (_, entry) = read(&label, &strings);
        for location in &entry.locations {
            prop_assert!(!location.address.is_empty());
        }
    }
}
