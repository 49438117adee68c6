//! A network of three devices and its neighbour, octet for octet.

use std::time::Duration;

use hiac::content::MessageKind;
use hiac::station::{Event, Failure, LinkConfig, LinkId, Options, Role, StationConfig};
use hiac::sys::{Checks, Types};
use hiac::{Check, Content, Outcome};

use crate::net::{Bench, SECOND, address, employer, mask, named};

const DRIVE_ACCON: &str = "F8 1E 01 20 C4 D2 00 20 C4 D2 05 28 03 01 04 20 C4 D2 05 02 04 00 00 00 FC CF \
                           03 02 03 E8 04 04 00 00 00 40 05 01 03 06 02 40 0A 07 01 02 0A 05 64 72 69 76 65 46 F9";
const DRIVE_INCON: &str = "F8 1E 01 20 C4 D2 05 20 C4 D2 00 21 02 01 04 20 C4 D2 05 02 04 00 00 00 FC CF \
                           03 02 03 E8 04 04 00 01 00 00 05 01 03 06 02 41 3E 07 01 00 09 F9";

fn drive() -> StationConfig {
    StationConfig {
        largest: 64,
        types: Types(0x400A),
        ..named("drive")
    }
}

fn at(level: u8) -> hiac::Address {
    address(&format!("20:C4:D2:{level:02X}"))
}

/// The employer with its three devices, which a hand plays: links 3, 5 and 7.
fn employer_of_three() -> Bench {
    let mut bench = Bench::new(employer("20:C4:D2:00", "00:00:00:FF"));
    for level in [3, 5, 7] {
        let config = LinkConfig {
            address: Some(at(level)),
            ..LinkConfig::stream(Role::Employer)
        };
        let id = LinkId(level.into());
        bench.station.add_link(bench.now, id, config);
        let incon = bench.hear(level.into());
        if level == 5 {
            assert_eq!(incon, [DRIVE_INCON]);
        }
    }
    bench.say(5, DRIVE_ACCON);
    bench.events();
    bench
}

/// Connects the device of a link by an ACCON with these parameters behind 1 and 2.
fn connect(bench: &mut Bench, level: u8, rest: &[u8]) {
    let employer = [0x20, 0xC4, 0xD2, 0];
    let own = [0x20, 0xC4, 0xD2, level];
    let data = [
        &[3, 1, 4][..],
        &own,
        &[2, 4, 0, 0, 0, 0xFF],
        rest,
        &[7, 1, 2],
    ];
    let data = data.concat();
    let packet = hiac::Packet::new(
        hiac::PacketType::SYS,
        0,
        hiac::Addressing::Full {
            target: hiac::Address::from_octets(employer),
            source: hiac::Address::from_octets(own),
        },
        &data,
    );
    let octets: Vec<u8> = hiac::edcp::escaped(packet.encode(None).unwrap().octets()).collect();
    bench
        .station
        .received(bench.now, LinkId(level.into()), &octets);
    let events = bench.events();
    assert!(
        matches!(events[..], [Event::Connected { .. }]),
        "{events:?}"
    );
}

fn network() -> Bench {
    let mut bench = employer_of_three();
    connect(&mut bench, 3, &[5, 1, 3]);
    connect(&mut bench, 7, &[5, 1, 1]);
    bench
}

fn message(kind: MessageKind, octets: &[u8]) -> Content<'_> {
    Content::Message {
        kind,
        reference: 0,
        octets,
    }
}

fn asked_for(priority: u8, confirm: bool, check: Check) -> Options {
    Options {
        priority: Some(priority),
        confirm,
        full: false,
        sum: check == Check::Sum,
    }
}

#[test]
fn a_device_accepts_its_employer() {
    let mut device = Bench::new(drive());
    device.link(1, Role::Employee);
    assert!(device.hear(1).is_empty(), "it does not speak first");
    device.say(1, DRIVE_INCON);
    assert_eq!(device.hear(1), [DRIVE_ACCON]);
    assert_eq!(
        device.events(),
        [Event::Connected {
            link: LinkId(1),
            role: Role::Employee,
            own: at(5),
            partner: at(0),
            name: None,
        }]
    );
    device.say(1, "F8 13 4C 00 05 00 07 00 01 00 73 74 6F 70 32 F9");
    assert_eq!(
        device.hear(1),
        ["F8 1E 41 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 00 EB F9"]
    );
    device.say(1, "F8 13 4E 01 05 00 36 80 00 00 41 20 6D 65 73 73 61 67 65 20 6F 66 20 73 69 78 74 79 2D 74 77 6F 20 6F 63 74 65 74 73 20 67 6F 65 73 20 74 6F 20 74 68 65 20 64 72 69 76 65 20 69 6E 20 26 1F 26 47 F9");
    assert_eq!(
        device.hear(1),
        ["F8 1E 43 20 C4 D2 00 20 C4 D2 05 07 01 08 01 01 09 01 00 C9 A5 90 4C F9"]
    );
    device.say(
        1,
        "F8 13 4E 02 05 00 0A 01 74 77 6F 20 70 61 72 74 73 2B 1A 85 BC F9",
    );
    assert_eq!(
        device.hear(1),
        ["F8 1E 43 20 C4 D2 00 20 C4 D2 05 07 01 08 01 02 09 01 00 DB 10 3F A2 F9"]
    );
    let events = device.events();
    let [
        Event::Message { octets: stop, .. },
        Event::Message { octets, .. },
    ] = &events[..]
    else {
        panic!("{events:?}");
    };
    assert_eq!(stop, b"stop");
    assert_eq!(
        octets,
        b"A message of sixty-two octets goes to the drive in two parts"
    );
}

#[test]
fn an_employer_commands_in_one_packet_and_in_two() {
    let mut bench = network();
    let stop = message(MessageKind::Command, b"stop");
    let options = asked_for(4, true, Check::Sum);
    let ticket = bench
        .station
        .send(bench.now, None, at(5), &stop, options)
        .unwrap();
    assert_eq!(
        bench.hear(5),
        ["F8 13 4C 00 05 00 07 00 01 00 73 74 6F 70 32 F9"]
    );
    assert_eq!(bench.events(), [Event::Written(ticket)]);
    bench.say(
        5,
        "F8 1E 41 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 00 EB F9",
    );
    assert_eq!(bench.events(), [Event::Confirmed(ticket)]);

    let long = message(
        MessageKind::Information,
        b"A message of sixty-two octets goes to the drive in two parts",
    );
    let options = asked_for(4, true, Check::Crc32);
    let ticket = bench
        .station
        .send(bench.now, None, at(5), &long, options)
        .unwrap();
    assert_eq!(
        bench.hear(5),
        [
            "F8 13 4E 01 05 00 36 80 00 00 41 20 6D 65 73 73 61 67 65 20 6F 66 20 73 69 78 74 79 2D 74 77 6F 20 6F 63 74 65 74 73 20 67 6F 65 73 20 74 6F 20 74 68 65 20 64 72 69 76 65 20 69 6E 20 26 1F 26 47 F9"
        ]
    );
    assert_eq!(bench.hear(5), [""; 0], "the second waits");
    bench.say(
        5,
        "F8 1E 43 20 C4 D2 00 20 C4 D2 05 07 01 08 01 01 09 01 00 C9 A5 90 4C F9",
    );
    assert_eq!(
        bench.hear(5),
        ["F8 13 4E 02 05 00 0A 01 74 77 6F 20 70 61 72 74 73 2B 1A 85 BC F9"]
    );
    bench.say(
        5,
        "F8 1E 43 20 C4 D2 00 20 C4 D2 05 07 01 08 01 02 09 01 00 DB 10 3F A2 F9",
    );
    assert_eq!(
        bench.events(),
        [Event::Written(ticket), Event::Confirmed(ticket)]
    );
}

#[test]
fn an_employer_forwards_between_devices_of_different_ability() {
    let mut bench = network();
    bench.say(3, "F8 11 00 05 03 01 01 1B F9");
    assert_eq!(bench.hear(5), ["F8 11 00 05 03 01 01 1B F9"]);
    bench.say(3, "F8 11 00 05 03 02 01 FC C9 15 F9");
    assert_eq!(bench.hear(5), ["F8 11 00 05 03 02 01 FC C9 15 F9"]);
    bench.say(3, "F8 13 12 07 03 05 04 00 69 63 65 07 4B 41 81 F9");
    assert_eq!(bench.hear(7), ["F8 13 10 07 03 05 04 00 69 63 65 67 F9"]);
    bench.say(3, "F8 13 4C 00 09 03 05 00 00 00 68 69 41 F9");
    assert_eq!(
        bench.hear(3),
        ["F8 1E 41 20 C4 D2 03 20 C4 D2 00 0D 01 01 04 20 C4 D2 09 08 01 00 09 01 05 B8 F9"]
    );
    assert_eq!(bench.events(), []);
}

#[test]
fn the_drive_passes_over_to_a_neighbour() {
    // The hand plays the employer of both employers, and the drive.
    let mut giver = network();
    giver.link(100, Role::Employee);
    incon_from_above(&mut giver, "20:C4:D2:00");
    giver
        .station
        .transfer_employee(giver.now, at(5), address("20:C4:D3:00"), None)
        .unwrap();
    // The neighbour is met first.
    let heard = giver.hear(100);
    assert_eq!(heard.len(), 1, "{heard:?}");
    assert!(
        heard[0].starts_with("F8 1E 01 20 C4 D3 00 20 C4 D2 00"),
        "{heard:?}"
    );
    accon_of_colleague(&mut giver, "20:C4:D3:00", "20:C4:D2:00");
    assert_eq!(
        giver.hear(100),
        [
            "F8 1E 0C 00 13 12 14 00 06 01 04 20 C4 D2 05 02 04 00 00 00 FC CF 0D 04 20 C4 D3 00 F6 F9"
        ]
    );
    giver.say(
        100,
        "F8 1E 01 20 C4 D2 00 20 C4 D3 00 07 01 08 01 00 09 01 00 A7 F9",
    );
    let farewell = giver.hear(5);
    assert_eq!(farewell.len(), 1);
    // The drive has both checks: CRC-32 stands where the sum is asked for here.
    assert!(
        farewell[0].starts_with("F8 1E 0E 00 05 00 0E 00 06 01 04 20 C4 D2 05 0D 04 20 C4 D3 00"),
        "{farewell:?}"
    );
    giver.say(
        5,
        "F8 1E 01 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 00 AB F9",
    );
    let events = giver.events();
    assert!(events.contains(&Event::Close(LinkId(5))), "{events:?}");
    assert!(
        events.contains(&Event::Transferred {
            employee: at(5),
            to: address("20:C4:D3:00"),
            result: Ok(()),
        }),
        "{events:?}"
    );
}

/// An employer above gives the station this address under 00:00:3F:00; it can the sum alone.
fn incon_from_above(bench: &mut Bench, given: &str) {
    let parameters = hiac::sys::Parameters {
        address: Some(address(given)),
        mask: Some(mask("00:00:3F:00")),
        checks: Some(Checks::SUM),
        role: Some(0),
        ..hiac::sys::Parameters::default()
    };
    say_system(
        bench,
        100,
        (given, "20:C4:C0:00"),
        hiac::sys::Subtype::Initialize,
        parameters,
    );
    let heard = bench.hear(100);
    assert_eq!(heard.len(), 1, "{heard:?}");
    bench.events();
}

fn accon_of_colleague(bench: &mut Bench, from: &str, to: &str) {
    let parameters = hiac::sys::Parameters {
        checks: Some(Checks::BOTH),
        role: Some(1),
        ..hiac::sys::Parameters::default()
    };
    say_system(
        bench,
        100,
        (to, from),
        hiac::sys::Subtype::Accept,
        parameters,
    );
}

fn say_system(
    bench: &mut Bench,
    link: u64,
    (to, from): (&str, &str),
    subtype: hiac::sys::Subtype,
    parameters: hiac::sys::Parameters<'_>,
) {
    let content = Content::System {
        subtype,
        parameters,
    };
    let mut data = hiac::Growing::new(1000);
    assert!(content.encode(&mut data));
    let addressing = hiac::Addressing::Full {
        target: address(to),
        source: address(from),
    };
    let data = hiac::Buffer::octets(&data);
    let packet = hiac::Packet::new(hiac::PacketType::SYS, 0, addressing, data);
    let octets: Vec<u8> = hiac::edcp::escaped(packet.encode(None).unwrap().octets()).collect();
    bench.station.received(bench.now, LinkId(link), &octets);
}

#[test]
fn the_neighbour_takes_the_drive_over() {
    let mut taker = Bench::new(employer("20:C4:D3:00", "00:00:00:FF"));
    taker.link(100, Role::Employee);
    incon_from_above(&mut taker, "20:C4:D3:00");
    taker.say(
        100,
        "F8 1E 0C 00 13 12 14 00 06 01 04 20 C4 D2 05 02 04 00 00 00 FC CF 0D 04 20 C4 D3 00 F6 F9",
    );
    assert_eq!(
        taker.hear(100),
        ["F8 1E 01 20 C4 D2 00 20 C4 D3 00 07 01 08 01 00 09 01 00 A7 F9"]
    );
    assert_eq!(
        taker.events(),
        [Event::Expect {
            employee: at(5),
            place: None,
        }]
    );
    taker.link(6, Role::Employer);
    assert_eq!(
        taker.hear(6),
        [
            "F8 1E 01 20 C4 D3 05 20 C4 D3 00 21 02 01 04 20 C4 D3 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 01 00 00 05 01 03 06 02 41 3E 07 01 00 0C F9"
        ]
    );
    taker.say(6, "F8 1E 01 20 C4 D3 00 20 C4 D3 05 28 03 01 04 20 C4 D3 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 00 00 40 05 01 03 06 02 40 0A 07 01 02 0A 05 64 72 69 76 65 49 F9");
    assert_eq!(
        taker.events(),
        [Event::Connected {
            link: LinkId(6),
            role: Role::Employer,
            own: address("20:C4:D3:00"),
            partner: address("20:C4:D3:05"),
            name: Some("drive".to_owned()),
        }]
    );
}

#[test]
fn the_drive_takes_its_new_employer_alone() {
    let mut device = Bench::new(drive());
    device.link(1, Role::Employee);
    device.say(1, DRIVE_INCON);
    device.hear(1);
    device.say(
        1,
        "F8 1E 0C 00 05 00 0E 00 06 01 04 20 C4 D2 05 0D 04 20 C4 D3 00 CB F9",
    );
    assert_eq!(
        device.hear(1),
        ["F8 1E 01 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 00 AB F9"]
    );
    assert!(device.events().contains(&Event::PassOver {
        employer: address("20:C4:D3:00"),
        place: None,
    }));
    device.say(1, DRIVE_INCON);
    let refused = device.hear(1);
    assert_eq!(refused.len(), 1);
    assert!(
        refused[0].starts_with("F8 1E 01 20 C4 D2 00 20 C4 D2 05")
            && refused[0].contains(" 04 09 01 01 0B "),
        "{refused:?}"
    );
    device.link(2, Role::Employee);
    let incon = "F8 1E 01 20 C4 D3 05 20 C4 D3 00 21 02 01 04 20 C4 D3 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 01 00 00 05 01 03 06 02 41 3E 07 01 00 0C F9";
    device.say(2, incon);
    assert_eq!(
        device.hear(2),
        [
            "F8 1E 01 20 C4 D3 00 20 C4 D3 05 28 03 01 04 20 C4 D3 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 00 00 40 05 01 03 06 02 40 0A 07 01 02 0A 05 64 72 69 76 65 49 F9"
        ]
    );
    // After ten seconds anybody would have done.
    let mut device = Bench::new(drive());
    device.link(1, Role::Employee);
    device.say(1, DRIVE_INCON);
    device.say(
        1,
        "F8 1E 0C 00 05 00 0E 00 06 01 04 20 C4 D2 05 0D 04 20 C4 D3 00 CB F9",
    );
    device.hear(1);
    device.pass(10 * SECOND);
    device.say(1, DRIVE_INCON);
    assert_eq!(device.hear(1), [DRIVE_ACCON]);
}

#[test]
fn a_refusal_is_a_failure_with_its_result() {
    let mut bench = network();
    let stop = message(MessageKind::Command, b"stop");
    let options = asked_for(4, true, Check::Sum);
    let ticket = bench
        .station
        .send(bench.now, None, at(5), &stop, options)
        .unwrap();
    bench.hear(5);
    bench.events();
    bench.say(
        5,
        "F8 1E 41 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 04 EF F9",
    );
    let failure = Failure::Refused(Outcome::NOT_PERMITTED, None);
    assert_eq!(bench.events(), [Event::Failed(ticket, failure)]);
}

/// A packet of 3, with a confirmation by CRC-32.
fn warns(bench: &mut Bench, psn: u8, fragment: u8, to: u8) -> Vec<String> {
    let data = [fragment, 4, 0, b'i', b'c', b'e'];
    let packet = hiac::Packet {
        numbered: Some(hiac::Numbered {
            psn,
            fragment: hiac::Fragment {
                index: fragment & 0x7F,
                more: fragment & 0x80 != 0,
            },
        }),
        confirm: true,
        check: Check::Crc32,
        ..hiac::Packet::new(
            hiac::PacketType::MSG,
            1,
            hiac::Addressing::Level {
                target: to.into(),
                source: 3,
            },
            &data[1..],
        )
    };
    let mask = hiac::Mask::new(0xFF).ok();
    let octets: Vec<u8> = hiac::edcp::escaped(packet.encode(mask).unwrap().octets()).collect();
    bench.station.received(bench.now, LinkId(3), &octets);
    bench.hear(to.into())
}

#[test]
fn for_a_device_without_numbers_the_employer_takes_them_away_and_confirms_itself() {
    let mut bench = employer_of_three();
    connect(&mut bench, 3, &[5, 1, 3]);
    // Of 12, its abilities, behind 7, its role.
    connect(&mut bench, 7, &[5, 1, 1, 12, 1, 0]);
    // Without the octets for MP and CR, the number and the fragment, and with a sum.
    let forwarded = warns(&mut bench, 0, 0, 7);
    assert_eq!(forwarded, ["F8 13 10 07 03 05 04 00 69 63 65 67 F9"]);
    let confirmed = bench.hear(3);
    assert_eq!(confirmed.len(), 1);
    assert!(
        confirmed[0].starts_with(
            "F8 1E 13 20 C4 D2 03 20 C4 D2 00 0D 01 01 04 20 C4 D2 07 08 01 00 09 01 00"
        ),
        "{confirmed:?}"
    );
    assert_eq!(warns(&mut bench, 1, 0x80, 7), [""; 0]);
    let refused = bench.hear(3);
    assert!(refused[0].contains("08 01 01 09 01 06"), "{refused:?}");
}

#[test]
fn a_grant_that_is_not_confirmed_is_given_back() {
    let mut bench = Bench::new(StationConfig {
        semaphores: 1,
        sendings: 3,
        ..employer("20:C4:D2:00", "00:00:00:FF")
    });
    bench.link(1, Role::Employer);
    bench.hear(1);
    connect(&mut bench, 1, &[5, 1, 1]);
    // Take, to be confirmed; the reply is as well, and stays without an answer.
    bench.say(1, "F8 12 4C 00 00 01 04 00 00 00 00 63 F9");
    let heard = bench.hear(1);
    assert_eq!(heard.len(), 2, "PKGCNF and the grant: {heard:?}");
    let mut grants = 1;
    for _ in 0..6 {
        bench.say(1, "F8 F9");
        bench.pass(Duration::from_millis(250));
        let again = bench.hear(1);
        grants += again.iter().filter(|packet| **packet == heard[1]).count();
    }
    assert_eq!(grants, 3, "it was sent three times");
    // Test, without confirmation: it is free.
    bench.say(1, "F8 12 40 00 01 03 02 00 00 58 F9");
    let state = bench.hear(1);
    assert!(
        state.iter().any(|packet| packet.contains("03 82 00 00")),
        "{state:?}"
    );
}
