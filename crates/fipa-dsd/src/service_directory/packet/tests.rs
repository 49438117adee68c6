use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use proptest::prelude::*;

use super::*;
use crate::service_directory::txt;

fn default_type() -> ServiceType {
    ServiceType::of_scope("").unwrap()
}

/// The packets that a robot with `fipa_services` sent, and some of its host's own, in order.
pub(in crate::service_directory) fn recorded() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/vectors/mdns");
    let files = fs::read_dir(folder).unwrap();
    let mut paths: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    paths.sort();
    assert_eq!(paths.len(), 51);
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

fn text(packet: &[u8]) -> Vec<(String, fipa_directory::Entry)> {
    let records = read(packet, &default_type()).unwrap();
    let texts = records.into_iter().filter_map(|record| match record {
        Record::Text { label, strings } => Some((label.clone(), txt::read(&label, &strings).1)),
        _ => None,
    });
    texts.collect()
}

#[test]
fn the_recorded_announcement_is_understood() {
    let packet = &recorded()[11];
    let records = read(packet, &default_type()).unwrap();
    let (label, ttl) = ("agent-a".to_owned(), 4500);
    assert!(records.contains(&Record::Instance { label, ttl }));
    let [(label, entry)] = &text(packet)[..] else {
        panic!("not one text");
    };
    assert_eq!(
        (label.as_str(), entry.name.as_str()),
        ("agent-a", "agent-a")
    );
    assert_eq!(entry.kind, fipa_directory::MESSAGE_TRANSPORT);
    assert_eq!(entry.locations[0].address, "tcp://10.99.0.1:39623");
    assert_eq!(entry.locations.len(), 1);
    assert_eq!(entry.description, "Message client of mts-0");
    assert_eq!(entry.timestamp, 1_795_330_382_938);
}

#[test]
fn a_recorded_locator_in_two_strings_is_read_whole() {
    let [(_, entry)] = &text(&recorded()[44])[..] else {
        panic!("not one text");
    };
    let addresses: Vec<_> = entry.locations.iter().map(|l| l.address.as_str()).collect();
    let expected = [
        "tcp://10.99.0.1:40000",
        "tcp://10.99.0.2:40001",
        "tcp://10.99.0.3:40002",
        "tcp://10.99.0.4:40003",
        "tcp://10.99.0.5:40004",
    ];
    assert_eq!(addresses, expected);
    let signatures = entry.locations.iter().map(|l| &l.signature);
    assert!(
        signatures
            .into_iter()
            .all(|s| *s == fipa_directory::MESSAGE_TRANSPORT)
    );
}

#[test]
fn recorded_questions_are_understood_and_probes_say_nothing() {
    let question = |known: &[&str]| {
        let known = known.iter().map(|label| (*label).to_owned()).collect();
        vec![Record::Question { known }]
    };
    let read = |i: usize| read(&recorded()[i], &default_type()).unwrap();
    assert_eq!(read(5), question(&[]));
    assert_eq!(read(12), question(&["agent-a"]));
    let label = "agent-long".to_owned();
    assert_eq!(read(43), [Record::TextQuestion { label }]);
    assert_eq!(read(7), []);
}

#[test]
fn recorded_goodbyes_are_those_of_all_three() {
    let records = read(&recorded()[49], &default_type()).unwrap();
    let expected = ["da0@192?168?0?1:1099/JADE", "agent-long", "agent-emptydesc"];
    let gone = expected.map(|label| Record::Instance {
        label: label.to_owned(),
        ttl: 0,
    });
    assert_eq!(records, gone);
}

#[test]
fn another_type_says_nothing() {
    let other = ServiceType::of_scope("plant").unwrap();
    for packet in recorded() {
        assert_eq!(read(&packet, &other).unwrap(), []);
    }
}

/// The first question of a packet as (labels, type), and the number of answers.
fn asked(packet: &[u8]) -> (Vec<(String, u16)>, usize, bool) {
    let packet = Packet::parse(packet).unwrap();
    let questions = packet.questions.iter().map(|question| {
        let simple_dns::QTYPE::TYPE(kind) = question.qtype else {
            panic!("an odd question");
        };
        assert!(!question.unicast_response);
        (question.qname.to_string(), kind.into())
    });
    let truncated = packet.has_flags(PacketFlag::TRUNCATION);
    (questions.collect(), packet.answers.len(), truncated)
}

#[test]
fn the_question_for_instances_is_that_of_the_recording() {
    let packets = ask_for_instances(&default_type(), std::iter::empty());
    assert_eq!(packets, [recorded()[5].clone()]);
}

#[test]
fn known_answers_that_do_not_fit_follow() {
    let labels: Vec<String> = (0..100).map(|i| format!("agent-{i}@robot?local")).collect();
    let known = labels.iter().map(|label| (label.as_str(), 4000));
    let packets = ask_for_instances(&default_type(), known);
    assert_eq!(packets.len(), 3);
    let mut answers = 0;
    for (i, packet) in packets.iter().enumerate() {
        assert!(packet.len() <= LONGEST, "{}", packet.len());
        let (questions, known, truncated) = asked(packet);
        assert_eq!(questions.len(), usize::from(i == 0));
        assert_eq!(truncated, i < 2);
        answers += known;
    }
    assert_eq!(answers, 100);
}

#[test]
fn texts_are_asked_for_by_label() {
    let labels = ["a".repeat(63), "which?@robot?1\\2".to_owned()];
    let packets = ask_for_texts(&default_type(), &labels);
    let (questions, _, _) = asked(&packets[0]);
    assert_eq!(questions[0].1, 16);
    let names = Packet::parse(&packets[0]).unwrap();
    let labels_asked = names.questions.iter();
    let labels_asked: Vec<_> = labels_asked
        .map(|question| label_of(&question.qname, &default_type()).unwrap())
        .collect();
    assert_eq!(labels_asked, labels);
    let many: Vec<String> = (0..300).map(|i| format!("{i:063}")).collect();
    let packets = ask_for_texts(&default_type(), &many);
    assert!(packets.iter().all(|packet| packet.len() <= LONGEST));
    let asked_for: usize = packets.iter().map(|packet| asked(packet).0.len()).sum();
    assert_eq!(asked_for, 300);
    assert_eq!(ask_for_texts(&default_type(), &[]), [[0; 0]; 0]);
}

#[test]
fn a_packet_that_promises_more_than_it_holds_is_refused() {
    let mut packet = recorded()[11].clone();
    packet[7] = 0xff;
    assert!(!announces_what_it_holds(&packet));
    assert!(read(&packet, &default_type()).is_err());
    assert!(read(&[], &default_type()).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn damaged_packets_do_no_harm(
        i in 0_usize..51,
        damage in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 0..6),
        length in any::<proptest::sample::Index>(),
    ) {
        static RECORDED: LazyLock<Vec<Vec<u8>>> = LazyLock::new(recorded);
        let mut packet = RECORDED[i].clone();
        for (at, octet) in damage {
            let at = at.index(packet.len());
            packet[at] = octet;
        }
        packet.truncate(length.index(packet.len() * 2).max(1));
        let records = read(&packet, &default_type()).unwrap_or_default();
        prop_assert!(records.len() * 5 <= packet.len());
    }
}
