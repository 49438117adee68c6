//! How connections begin, are watched and end.

use std::time::Duration;

use hiac::station::{Ended, Event, LinkConfig, LinkId, Options, Role, SendError, StationConfig};
use hiac::{Content, Outcome};

use crate::net::{Bench, SECOND, World, address, employer, mask, named};

fn signal() -> Content<'static> {
    Content::Signal {
        number: 3,
        arguments: &[],
    }
}

fn connected(events: &[Event]) -> Vec<(String, String)> {
    let ends = |event: &Event| match event {
        Event::Connected { own, partner, .. } => Some((own.to_string(), partner.to_string())),
        _ => None,
    };
    events.iter().filter_map(ends).collect()
}

#[test]
fn devices_get_the_lowest_free_levels_and_their_signs_of_life_keep_them() {
    let config = employer("20:C4:D2:00", "00:00:00:FF");
    let mut world = World::new([config, named("a"), named("b"), named("c")]);
    let lines: Vec<usize> = (1..4).map(|device| world.employ(0, device)).collect();
    let partners: Vec<String> = connected(&world.take(0))
        .into_iter()
        .map(|ends| ends.1)
        .collect();
    assert_eq!(partners, ["20:C4:D2:01", "20:C4:D2:02", "20:C4:D2:03"]);
    world.pass(60 * SECOND);
    assert_eq!(world.take(0), []);
    world.cut(lines[1]);
    world.take(0);
    world.employ(0, 2);
    assert_eq!(connected(&world.take(0))[0].1, "20:C4:D2:02");
}

#[test]
fn silence_for_a_period_is_the_end_on_both_sides_and_the_workgroup_is_told() {
    let quick = StationConfig {
        period: Duration::from_millis(100),
        ..named("a")
    };
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), quick, named("b")]);
    let line = world.employ(0, 1);
    world.employ(0, 2);
    for station in 0..3 {
        world.take(station);
    }
    world.pass(SECOND);
    assert_eq!(world.take(0), [], "half the smaller period is kept");
    world.mute(line);
    world.pass(Duration::from_millis(101));
    let lost = Event::Disconnected {
        link: LinkId(0),
        role: Role::Employer,
        partner: address("20:C4:D2:01"),
        reason: Ended::Lost,
    };
    assert_eq!(world.take(0), [lost, Event::Close(LinkId(0))]);
    assert!(matches!(
        world.take(1)[..],
        [Event::Disconnected { .. }, Event::Close(_)]
    ));
    let [
        Event::Signal {
            number: 0,
            arguments,
            ..
        },
    ] = &world.take(2)[..]
    else {
        panic!("b is not told");
    };
    assert_eq!(arguments, &[0x20, 0xC4, 0xD2, 0x01]);
}

#[test]
fn on_a_serial_line_the_employer_goes_on_calling() {
    let line = |role| LinkConfig {
        closes: false,
        ..LinkConfig::stream(role)
    };
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), named("a")]);
    let wire = world.join((0, line(Role::Employer)), (1, line(Role::Employee)));
    world.mute(wire);
    world.pass(3 * SECOND);
    world.take(0);
    world.disturb(wire, Box::new(|octets| octets));
    world.pass(SECOND);
    assert_eq!(connected(&world.take(0)).len(), 1);
}

#[test]
fn a_device_with_an_employer_refuses_another_until_it_is_lost() {
    let second = employer("20:C4:D3:00", "00:00:00:FF");
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), second, named("a")]);
    let first = world.employ(0, 2);
    world.employ(1, 2);
    assert!(matches!(
        &world.take(1)[..],
        [Event::ConnectionRefused {
            outcome: Outcome::REFUSED,
            ..
        }]
    ));
    world.cut(first);
    // The refusal ended it on that stream: a new one is opened.
    world.employ(1, 2);
    assert_eq!(world.stations[2].employer(), Some(address("20:C4:D3:00")));
}

#[test]
fn an_incon_that_does_not_fit_is_refused_with_the_reason() {
    let head = |given: &str, source: &str, bits: &str, rest: &str| {
        let packet = format!("1E 01 {given} {source} LL 02 01 04 {given} 02 04 {bits} {rest}");
        let data = packet.split("LL").nth(1).unwrap();
        let count = crate::net::octets(data).len();
        let packet = crate::net::octets(&packet.replace("LL", &format!("{count:02X}")));
        let sum = packet
            .iter()
            .fold(0_u8, |sum, octet| sum.wrapping_add(*octet));
        let octets: Vec<u8> = hiac::edcp::escaped(packet.into_iter().chain([sum])).collect();
        crate::net::hex(&octets)
    };
    let ff = "00 00 00 FF";
    let (five, zero) = ("20 C4 D2 05", "20 C4 D2 00");
    for (incon, result) in [
        (head(five, zero, ff, "05 01 03"), None),
        (head(five, zero, ff, "05 02 03 03"), Some("09 01 07")),
        (head(zero, zero, ff, "05 01 03"), Some("09 01 07")),
        (head("20 C4 D2 FF", zero, ff, "05 01 03"), Some("09 01 07")),
        (head(five, "20 C4 D2 01", ff, "05 01 03"), Some("09 01 07")),
        (
            head(five, zero, "00 00 00 01", "05 01 03"),
            Some("09 01 07"),
        ),
        (head(five, zero, ff, "05 01 04"), Some("09 01 06")),
        (head(five, zero, ff, "03 02 00 13"), Some("09 01 06")),
    ] {
        let mut device = Bench::new(named("a"));
        device.link(1, Role::Employee);
        device.say(1, &incon);
        let answer = device.hear(1);
        assert_eq!(answer.len(), 1, "{incon}");
        match result {
            None => assert!(answer[0].contains(" 03 01 04 20 C4 D2 05"), "{answer:?}"),
            Some(result) => assert!(
                answer[0].contains(&format!(" 04 {result} 0B")),
                "{answer:?}"
            ),
        }
    }
}

#[test]
fn nothing_is_said_before_the_connection() {
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), named("a")]);
    let now = world.now;
    let to = address("20:C4:D2:00");
    let sent = world.stations[1].send(now, None, to, &signal(), Options::default());
    assert_eq!(sent, Err(SendError::NotPermitted));
    let mut employer = Bench::new(employer("20:C4:D2:00", "00:00:00:FF"));
    employer.link(1, Role::Employer);
    employer.events();
    employer.say(1, "F8 11 10 00 01 01 03 26 F9");
    assert_eq!(employer.events(), []);
    assert_eq!(employer.station.drops().unconnected, 1);
}

#[test]
fn of_two_that_call_each_other_the_one_whose_block_holds_the_other_stays() {
    let coast = employer("20:C4:00:00", "00:00:FF:00");
    let mut world = World::new([coast, employer("20:C4:D2:00", "00:00:00:FF")]);
    world.join(
        (0, LinkConfig::stream(Role::Employer)),
        (1, LinkConfig::stream(Role::Employer)),
    );
    world.pass(3 * SECOND);
    assert_eq!(world.stations[1].employer(), Some(address("20:C4:00:00")));
    assert_eq!(world.stations[0].employer(), None);
    // Neither holds the other.
    let other = employer("30:C4:D2:00", "00:00:00:FF");
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), other]);
    world.join(
        (0, LinkConfig::stream(Role::Employer)),
        (1, LinkConfig::stream(Role::Employer)),
    );
    world.pass(3 * SECOND);
    for station in 0..2 {
        assert!(world.take(station).iter().any(|event| matches!(
            event,
            Event::ConnectionRefused {
                outcome: Outcome::NOT_PERMITTED,
                ..
            }
        )));
    }
}

#[test]
fn who_is_moved_moves_its_workgroup_which_keeps_its_levels() {
    let coast = employer("20:C4:00:00", "00:00:FF:00");
    let control = employer("10:00:00:00", "00:00:00:FF");
    let mut world = World::new([coast, control, named("a")]);
    world.employ(1, 2);
    world.employ(0, 1);
    world.pass(SECOND);
    assert_eq!(world.stations[1].address(), Some(address("20:C4:01:00")));
    assert_eq!(world.stations[2].address(), Some(address("20:C4:01:01")));
    assert_eq!(world.stations[2].employer(), Some(address("20:C4:01:00")));
    let group = world.stations[1].workgroups()[0];
    assert_eq!(
        (group.address, group.mask),
        (address("20:C4:01:00"), mask("00:00:00:FF"))
    );
    // What is said there goes by the new addresses.
    let now = world.now;
    let to = address("20:C4:01:01");
    world.stations[0]
        .send(now, None, to, &signal(), Options::default())
        .unwrap();
    let events = world.take(2);
    assert!(
        matches!(events.last(), Some(Event::Signal { number: 3, .. })),
        "{events:?}"
    );
}

#[test]
fn an_employee_that_is_removed_is_free() {
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), named("a")]);
    world.employ(0, 1);
    world.take(1);
    let now = world.now;
    world.stations[0].remove(now, LinkId(0));
    let events = world.take(1);
    assert!(
        matches!(
            events[..],
            [Event::Disconnected {
                reason: Ended::Removed,
                ..
            }]
        ),
        "{events:?}"
    );
    assert_eq!(world.stations[1].employer(), None);
}
