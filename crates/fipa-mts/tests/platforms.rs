//! Agents that the AMS of another platform lists, and names that are reached and not listed.

use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Representation, Slots, Text};
use fipa_directory::{Entry, InstanceId, Location, Now, Source};
use fipa_link::Outcome;
use fipa_mts::{Config, Machine, Mts, Output, RegisterError, Submission};

const NOW: Now = Now {
    mono: Duration::from_secs(100),
    unix_millis: 1_795_341_600_000,
};
const PLATFORM: Text = Text::from_static("platA");

fn service() -> Mts {
    Mts::new(Config::new(InstanceId::from_bytes([7; 16]), "robot1"))
}

fn entry(name: &'static str) -> Entry {
    Entry {
        locations: vec![Location {
            address: "http://10.0.0.9:7778/acc".into(),
            signature: "fipa.mts.mtp.http.std".into(),
        }],
        ..Entry::new(name)
    }
}

/// The outcomes that are known at once, and the addresses that were posted to.
fn send(mts: &mut Mts, to: &'static str) -> (Vec<Outcome>, Vec<String>) {
    let envelope = Envelope::new(Slots {
        to: vec![AgentId::new(to)],
        acl_representation: Some(Representation::String),
        date: Some(FipaTime::from_unix_millis(0)),
        ..Slots::default()
    });
    let payload = Bytes::from_static(b"(inform)");
    let letter = Letter { envelope, payload };
    mts.submit(NOW, Submission::new(1, letter, Duration::from_secs(10)));
    let (mut told, mut posted) = (Vec::new(), Vec::new());
    while let Some(output) = mts.poll_output() {
        match output {
            Output::Outcome { outcomes, .. } => told.extend(outcomes.iter().map(|o| o.outcome)),
            Output::Post(letter) => posted.push(letter.address.to_string()),
            _ => {}
        }
    }
    (told, posted)
}

#[test]
fn a_listed_agent_is_found_and_reached_by_name_and_pattern_until_it_is_not_listed() {
    let mut mts = service();
    mts.agent_listed(NOW, &PLATFORM, entry("ping@platA"));
    assert_eq!(
        mts.directory().find("ping@platA").unwrap().source,
        Source::Ams
    );
    let url = vec!["http://10.0.0.9:7778/acc".to_owned()];
    assert_eq!(send(&mut mts, "ping@platA"), (vec![], url.clone()));
    let mut mts = service();
    mts.agent_listed(NOW, &PLATFORM, entry("ping@platA"));
    assert_eq!(send(&mut mts, "p.*@plat."), (vec![], url));
    assert_eq!(mts.listed_by("platA"), ["ping@platA"]);
    mts.agent_unlisted(NOW, "ping@platA");
    assert!(mts.directory().find("ping@platA").is_none());
}

#[test]
fn the_management_of_another_platform_is_reached_by_its_name_alone() {
    let mut mts = service();
    mts.agent_listed(NOW, &PLATFORM, entry("df@platA"));
    assert!(mts.directory().is_empty());
    assert_eq!(send(&mut mts, ".*@platA").0, [Outcome::Unknown]);
    assert_eq!(send(&mut mts, "df@platA").1.len(), 1);
}

#[test]
fn a_hosted_agent_has_a_mailbox_and_is_listed_nowhere() {
    let mut mts = service();
    let name = Text::from_static("ams@robot1");
    mts.host(&name).unwrap();
    assert_eq!(mts.host(&name), Err(RegisterError::Held(name)));
    assert!(mts.directory().is_empty());
    assert_eq!(send(&mut mts, ".*").0, [Outcome::Unknown]);
    assert_eq!(send(&mut mts, "ams@robot1").0, [Outcome::Delivered]);
    assert!(mts.take_mail("ams@robot1").is_some());
}

#[test]
fn what_mdns_has_found_stays_what_it_is() {
    let mut mts = service();
    mts.neighbour_found(NOW, entry("ping@platA"));
    mts.agent_listed(NOW, &PLATFORM, entry("ping@platA"));
    assert_eq!(
        mts.directory().find("ping@platA").unwrap().source,
        Source::Mdns
    );
    mts.agent_unlisted(NOW, "ping@platA");
    assert!(mts.directory().find("ping@platA").is_some());
    // And the other way round.
    mts.agent_listed(NOW, &PLATFORM, entry("pong@platA"));
    mts.neighbour_gone(NOW, "pong@platA");
    assert!(mts.directory().find("pong@platA").is_some());
}
