//! More than one level: forwarding, subemployees, broadcasts, transfers and take-overs.

use std::time::Duration;

use hiac::content::MessageKind;
use hiac::station::{Ended, Event, LinkConfig, Options, Role, SendError, StationConfig};
use hiac::sys::Checks;
use hiac::{Address, Content};

use crate::net::{SECOND, World, address, employer, mask, named};

const COAST: usize = 0;
const CONTROL: usize = 1;
const SENSOR: usize = 2;
const DRIVE: usize = 3;
const SPARE: usize = 4;

/// A coast station, its control unit with a sensor and a drive, and a spare control unit.
fn rover() -> (World, [usize; 4]) {
    let sum = StationConfig {
        checks: Checks::SUM,
        ..named("drive")
    };
    let mut world = World::new([
        employer("20:C4:00:00", "00:00:FF:00"),
        employer("20:C4:01:00", "00:00:00:FF"),
        named("sensor"),
        sum,
        employer("20:C4:02:00", "00:00:00:FF"),
    ]);
    let control = world.employ(COAST, CONTROL);
    let spare = world.employ(COAST, SPARE);
    let sensor = world.employ(CONTROL, SENSOR);
    let drive = world.employ(CONTROL, DRIVE);
    for station in 0..5 {
        world.take(station);
    }
    for line in [control, spare, sensor, drive] {
        world.log(line);
    }
    (world, [control, spare, sensor, drive])
}

fn drive() -> Address {
    address("20:C4:01:02")
}

fn message(kind: MessageKind, octets: &[u8]) -> Content<'_> {
    Content::Message {
        kind,
        reference: 0,
        octets,
    }
}

fn send(
    world: &mut World,
    who: usize,
    to: Address,
    what: &Content<'_>,
    confirm: bool,
) -> Result<(), SendError> {
    let options = Options {
        confirm,
        ..Options::default()
    };
    let now = world.now;
    let sent = world.stations[who].send(now, None, to, what, options);
    world.settle();
    sent.map(drop)
}

#[test]
fn a_subemployee_is_commanded_one_way_and_the_check_is_adapted() {
    let (mut world, lines) = rover();
    let stop = message(MessageKind::Command, b"stop");
    assert_eq!(
        send(&mut world, COAST, drive(), &stop, true),
        Err(SendError::NotPermitted)
    );
    assert_eq!(
        send(
            &mut world,
            COAST,
            drive(),
            &message(MessageKind::Question, b"?"),
            false
        ),
        Err(SendError::NotPermitted)
    );
    send(&mut world, COAST, drive(), &stop, false).unwrap();
    assert!(world.log(lines[0])[0].starts_with("F8 13 43 20 C4 01 02 20 C4 00 00 06"));
    assert!(world.log(lines[3])[0].starts_with("F8 13 41 20 C4 01 02 20 C4 00 00 06"));
    let events = world.take(DRIVE);
    assert!(
        matches!(
            &events[..],
            [Event::Message {
                kind: MessageKind::Command,
                ..
            }]
        ),
        "{events:?}"
    );
    // Nothing goes up past the employer.
    let warning = message(MessageKind::Warning, b"ice");
    let to = address("20:C4:00:00");
    assert_eq!(
        send(&mut world, DRIVE, to, &warning, false),
        Err(SendError::NotPermitted)
    );
    assert!(world.take(CONTROL).is_empty());
}

#[test]
fn a_broadcast_reaches_the_workgroup_and_its_employer_and_nobody_below() {
    let (mut world, _) = rover();
    let signal = Content::Signal {
        number: 7,
        arguments: &[],
    };
    let now = world.now;
    let all = address("20:C4:01:FF");
    world.stations[SENSOR]
        .send_to_all(now, all, &signal, Options::default())
        .unwrap();
    let heard = |world: &mut World, who: usize| {
        let events = world.take(who);
        events
            .iter()
            .filter(|event| matches!(event, Event::Signal { number: 7, .. }))
            .count()
    };
    let reached: Vec<usize> = (0..5).map(|who| heard(&mut world, who)).collect();
    assert_eq!(reached, [0, 1, 0, 1, 0]);
    let all = address("20:C4:FF:00");
    world.stations[COAST]
        .send_to_all(now, all, &signal, Options::default())
        .unwrap();
    let reached: Vec<usize> = (0..5).map(|who| heard(&mut world, who)).collect();
    assert_eq!(reached, [0, 1, 0, 0, 1]);
}

#[test]
fn a_packet_that_is_too_long_for_the_colleague_is_sent_anew_in_smaller_ones() {
    let small = StationConfig {
        largest: 64,
        ..named("b")
    };
    let mut world = World::new([employer("20:C4:D2:00", "00:00:00:FF"), named("a"), small]);
    world.employ(0, 1);
    let line = world.employ(0, 2);
    let long = vec![5; 300];
    let to = address("20:C4:D2:02");
    send(
        &mut world,
        1,
        to,
        &message(MessageKind::Information, &long),
        true,
    )
    .unwrap();
    world.settle();
    let events = world.take(2);
    let arrived = |event: &Event| matches!(event, Event::Message { octets, .. } if *octets == long);
    assert_eq!(events.iter().filter(|event| arrived(event)).count(), 1);
    // Every packet fits: SPKG and EPKG aside, and with an escape or two.
    let longest = world
        .log(line)
        .iter()
        .map(|packet| packet.split(' ').count())
        .max();
    assert!(longest.unwrap() <= 70, "{longest:?}");
}

#[test]
fn an_employee_that_is_asked_for_passes_over_and_obeys_its_new_employer() {
    let (mut world, lines) = rover();
    let now = world.now;
    let (control, spare) = (address("20:C4:01:00"), address("20:C4:02:00"));
    world.stations[COAST]
        .request_employee(now, control, drive(), spare, None)
        .unwrap();
    world.settle();
    let events = world.take(SPARE);
    let expects =
        |event: &Event| matches!(event, Event::Expect { employee, .. } if *employee == drive());
    assert!(events.iter().any(expects), "{events:?}");
    let events = world.take(DRIVE);
    assert!(
        events
            .iter()
            .any(|event| matches!(event, Event::PassOver { employer, .. } if *employer == spare)),
        "{events:?}"
    );
    world.cut(lines[3]);
    world.employ(SPARE, DRIVE);
    assert_eq!(world.stations[DRIVE].employer(), Some(spare));
    assert_eq!(
        world.stations[DRIVE].address(),
        Some(address("20:C4:02:02")),
        "it keeps its level"
    );
    let stop = message(MessageKind::Command, b"stop");
    assert_eq!(
        send(&mut world, CONTROL, drive(), &stop, false),
        Err(SendError::NoSuchTarget)
    );
    send(&mut world, SPARE, address("20:C4:02:02"), &stop, true).unwrap();
    assert!(
        world
            .take(DRIVE)
            .iter()
            .any(|event| matches!(event, Event::Message { .. }))
    );
}

#[test]
fn a_workgroup_passes_over_member_by_member() {
    let (mut world, lines) = rover();
    let now = world.now;
    let (control, spare) = (address("20:C4:01:00"), address("20:C4:02:00"));
    world.stations[COAST]
        .request_workgroup(now, control, control, mask("00:00:00:FF"), spare)
        .unwrap();
    world.settle();
    let moved: Vec<Address> = world
        .take(CONTROL)
        .into_iter()
        .filter_map(|event| match event {
            Event::Transferred {
                employee,
                result: Ok(()),
                ..
            } => Some(employee),
            _ => None,
        })
        .collect();
    assert_eq!(moved, [address("20:C4:01:01"), drive()]);
    world.cut(lines[2]);
    world.cut(lines[3]);
    world.employ(SPARE, SENSOR);
    world.employ(SPARE, DRIVE);
    for (who, own) in [(SENSOR, "20:C4:02:01"), (DRIVE, "20:C4:02:02")] {
        assert_eq!(world.stations[who].address(), Some(address(own)));
    }
}

#[test]
fn a_transfer_that_nobody_takes_leaves_the_employee_where_it_is() {
    let (mut world, _) = rover();
    let now = world.now;
    world.stations[CONTROL]
        .transfer_employee(now, drive(), address("20:C4:03:00"), None)
        .unwrap();
    world.pass(10 * SECOND);
    let events = world.take(CONTROL);
    let failed = |event: &Event| matches!(event, Event::Transferred { result: Err(_), .. });
    assert!(events.iter().any(failed), "{events:?}");
    assert_eq!(
        world.stations[DRIVE].employer(),
        Some(address("20:C4:01:00"))
    );
}

#[test]
fn after_the_employer_failed_another_takes_over_and_the_old_one_finds_it_taken() {
    let (mut world, lines) = rover();
    world.employ(SPARE, DRIVE);
    assert_eq!(
        world.stations[DRIVE].employer(),
        Some(address("20:C4:01:00"))
    );
    world.mute(lines[3]);
    world.pass(2 * SECOND);
    let lost = |event: &Event| {
        matches!(
            event,
            Event::Disconnected {
                reason: Ended::Lost,
                ..
            }
        )
    };
    assert!(world.take(DRIVE).iter().any(lost));
    world.employ(SPARE, DRIVE);
    assert_eq!(
        world.stations[DRIVE].employer(),
        Some(address("20:C4:02:00"))
    );
    world.take(CONTROL);
    world.employ(CONTROL, DRIVE);
    let refused = |event: &Event| matches!(event, Event::ConnectionRefused { .. });
    assert!(world.take(CONTROL).iter().any(refused));
}

#[test]
fn a_device_asks_an_alias_of_its_employer_as_a_colleague() {
    let alias = address("20:C4:D2:20");
    let config = StationConfig {
        aliases: vec![alias],
        ..employer("20:C4:D2:00", "00:00:00:FF")
    };
    let mut world = World::new([config, named("a")]);
    world.join(
        (0, LinkConfig::stream(Role::Employer)),
        (1, LinkConfig::stream(Role::Employee)),
    );
    let now = world.now;
    let ticket = world.stations[1]
        .question(now, None, alias, b"may I?", Options::CONFIRMED)
        .unwrap();
    let events = world.take(0);
    let Some(Event::Message {
        from, reference, ..
    }) = events.last()
    else {
        panic!("{events:?}");
    };
    assert_eq!(from.to, alias);
    world.stations[0]
        .reply(now, from, MessageKind::Answer, *reference, b"yes")
        .unwrap();
    assert_eq!(world.became(1, ticket).last().unwrap(), "yes");
    let command = message(MessageKind::Command, b"stop");
    let refused = world.stations[0].send(
        now,
        Some(alias),
        address("20:C4:D2:01"),
        &command,
        Options::CONFIRMED,
    );
    assert_eq!(refused, Err(SendError::NotPermitted));
    world.pass(Duration::from_secs(1));
}
