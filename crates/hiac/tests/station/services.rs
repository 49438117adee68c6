//! Semaphores, memory and barriers, and who may do what.

use hiac::content::{BarrierOperation, MessageKind, SemaphoreOperation};
use hiac::station::{
    Direction, Event, Failure, Options, Region, Rights, SendError, StationConfig, Ticket,
};
use hiac::{Address, Content, Outcome};

use crate::net::{SECOND, World, address, employer, named};

fn at(level: u8) -> Address {
    address(&format!("20:C4:D2:{level:02X}"))
}

/// An employer with three devices that keep things, and the lines to them.
fn workshop() -> (World, Vec<usize>) {
    let keeper = |config: StationConfig| StationConfig {
        semaphores: 8,
        memory: vec![Region::new(0x100, 16)],
        ..config
    };
    let mut world = World::new([
        keeper(employer("20:C4:D2:00", "00:00:00:FF")),
        keeper(named("a")),
        keeper(named("b")),
        keeper(named("c")),
    ]);
    let lines = (1..4).map(|device| world.employ(0, device)).collect();
    for station in 0..4 {
        world.take(station);
    }
    (world, lines)
}

fn semaphore(world: &mut World, who: usize, keeper: u8, operation: SemaphoreOperation) -> Ticket {
    let now = world.now;
    let station = &mut world.stations[who];
    let sent = station.semaphore_of(now, at(keeper), operation, 3, Options::CONFIRMED);
    let ticket = sent.unwrap();
    world.settle();
    ticket
}

fn states(world: &mut World, who: usize) -> Vec<SemaphoreOperation> {
    let state = |event: Event| match event {
        Event::Semaphore { state, .. } => Some(state),
        _ => None,
    };
    world.take(who).into_iter().filter_map(state).collect()
}

#[test]
fn a_semaphore_is_granted_in_the_order_of_asking_and_passes_on_when_its_holder_is_lost() {
    use SemaphoreOperation::{Free, Give, Granted, Take, Taken, Test, Waiting};
    let (mut world, lines) = workshop();
    semaphore(&mut world, 1, 0, Test);
    assert_eq!(states(&mut world, 1), [Free]);
    for who in 1..4 {
        semaphore(&mut world, who, 0, Take);
    }
    assert_eq!(states(&mut world, 1), [Granted]);
    assert_eq!(states(&mut world, 2), [Waiting]);
    assert_eq!(states(&mut world, 3), [Waiting]);
    semaphore(&mut world, 2, 0, Take);
    semaphore(&mut world, 1, 0, Test);
    assert_eq!(states(&mut world, 2), [Waiting], "it waits where it was");
    assert_eq!(states(&mut world, 1), [Taken]);
    semaphore(&mut world, 1, 0, Give);
    assert_eq!(states(&mut world, 2), [Granted]);
    world.cut(lines[1]);
    assert_eq!(states(&mut world, 3), [Granted]);
    let ticket = semaphore(&mut world, 1, 0, Give);
    assert_eq!(world.became(1, ticket), ["written", "refused"]);
}

#[test]
fn a_semaphore_of_a_colleague_is_reached_through_the_employer() {
    use SemaphoreOperation::{Granted, Take, Waiting};
    let (mut world, lines) = workshop();
    semaphore(&mut world, 1, 3, Take);
    semaphore(&mut world, 2, 3, Take);
    assert_eq!(states(&mut world, 1), [Granted]);
    assert_eq!(states(&mut world, 2), [Waiting]);
    // The employer tells the keeper that the holder is lost.
    world.mute(lines[0]);
    world.pass(2 * SECOND);
    assert_eq!(states(&mut world, 2), [Granted]);
}

#[test]
fn memory_is_read_by_all_and_written_by_the_employer() {
    let (mut world, _) = workshop();
    let write = |address| Content::Write {
        address,
        octets: b"four",
    };
    let now = world.now;
    let send = |world: &mut World, who: usize, to: u8, content: &Content<'_>| {
        let sent = world.stations[who].send(now, None, at(to), content, Options::CONFIRMED);
        let ticket = sent.unwrap();
        world.settle();
        world.became(who, ticket).pop().unwrap()
    };
    assert_eq!(send(&mut world, 0, 1, &write(0x104)), "confirmed");
    let forbidden = Outcome::NOT_PERMITTED.to_string();
    assert_eq!(send(&mut world, 2, 1, &write(0x104)), forbidden);
    assert_eq!(send(&mut world, 1, 0, &write(0x104)), forbidden);
    // The object comes before the right, and a range is written whole or not at all.
    let nothing = Outcome::NO_SUCH_TARGET.to_string();
    assert_eq!(send(&mut world, 2, 1, &write(0x10D)), nothing);
    let ticket = world.stations[2]
        .read(now, at(1), 0x102, 8, Options::CONFIRMED)
        .unwrap();
    let again = world.stations[2].read(now, at(1), 0x100, 1, Options::CONFIRMED);
    assert_eq!(again, Err(SendError::Open));
    let read = Event::Memory {
        ticket,
        octets: b"\0\0four\0\0".to_vec(),
    };
    assert!(world.take(2).contains(&read));
}

#[test]
fn a_barrier_is_set_up_by_the_employer_and_releases_all_at_once() {
    let (mut world, _) = workshop();
    let now = world.now;
    let arrive = |world: &mut World, who: usize, parties| {
        let station = &mut world.stations[who];
        let arrive = BarrierOperation::Arrive;
        let sent = station.barrier_of(now, at(1), arrive, 7, parties, Options::CONFIRMED);
        world.settle();
        sent
    };
    let ticket = arrive(&mut world, 2, 0).unwrap();
    let nothing = Failure::Refused(Outcome::NO_SUCH_TARGET, None);
    assert!(world.take(2).contains(&Event::Failed(ticket, nothing)));
    arrive(&mut world, 0, 3).unwrap();
    arrive(&mut world, 2, 3).unwrap();
    arrive(&mut world, 2, 0).unwrap();
    let other = arrive(&mut world, 3, 2).unwrap();
    assert_eq!(world.became(3, other).pop().unwrap(), "refused");
    let released = |events: Vec<Event>| {
        let released = |event: &Event| matches!(event, Event::Released { number: 7, .. });
        events.iter().any(released)
    };
    assert!(!released(world.take(2)), "arriving twice counts once");
    arrive(&mut world, 3, 0).unwrap();
    for who in [0, 2, 3] {
        assert!(released(world.take(who)), "{who}");
    }
    // To its employer a device may not say how many.
    let station = &mut world.stations[1];
    let arrive = BarrierOperation::Arrive;
    let sent = station.barrier_of(now, at(0), arrive, 7, 3, Options::CONFIRMED);
    assert_eq!(sent, Err(SendError::NotPermitted));
}

#[test]
fn questions_are_answered_commands_come_from_above_alone_and_silence_is_told() {
    let (mut world, _) = workshop();
    let now = world.now;
    let ticket = world.stations[2]
        .question(now, None, at(1), b"where?", Options::CONFIRMED)
        .unwrap();
    let events = world.take(1);
    let Some(Event::Message {
        from,
        kind: MessageKind::Question,
        reference,
        octets,
    }) = events.last()
    else {
        panic!("{events:?}");
    };
    assert_eq!(
        (from.direction, &octets[..]),
        (Direction::Colleague, &b"where?"[..])
    );
    world.stations[1]
        .reply(now, from, MessageKind::Answer, *reference, b"here")
        .unwrap();
    assert_eq!(world.became(2, ticket), ["written", "confirmed", "here"]);

    let command = Content::Message {
        kind: MessageKind::Command,
        reference: 0,
        octets: b"stop",
    };
    for (who, to) in [(2, 1), (2, 0)] {
        let sent = world.stations[who].send(now, None, at(to), &command, Options::CONFIRMED);
        assert_eq!(sent, Err(SendError::NotPermitted));
    }
    let ticket = world.stations[0]
        .question(now, None, at(1), b"who?", Options::default())
        .unwrap();
    world.pass(5 * SECOND);
    assert_eq!(
        world.became(0, ticket),
        ["written", "confirmed", "no answer came in time"]
    );
}

#[test]
fn who_asks_first_is_granted_first_whatever_the_priority_and_who_waits_may_leave() {
    use SemaphoreOperation::{Free, Give, Granted, Take, Test};
    let (mut world, _) = workshop();
    let take = |world: &mut World, who: usize, priority| {
        let options = Options {
            priority: Some(priority),
            ..Options::CONFIRMED
        };
        let now = world.now;
        let station = &mut world.stations[who];
        station.semaphore_of(now, at(0), Take, 3, options).unwrap();
        world.settle();
    };
    take(&mut world, 1, 4);
    take(&mut world, 2, 7);
    take(&mut world, 3, 0);
    for who in 1..4 {
        states(&mut world, who);
    }
    semaphore(&mut world, 1, 0, Give);
    assert_eq!(states(&mut world, 2), [Granted], "it was first");
    assert_eq!(states(&mut world, 3), []);
    semaphore(&mut world, 3, 0, Give);
    semaphore(&mut world, 2, 0, Give);
    assert_eq!(states(&mut world, 3), [], "it waits no more");
    semaphore(&mut world, 1, 0, Test);
    assert_eq!(states(&mut world, 1), [Free]);
}

#[test]
fn rights_are_those_of_the_region_and_the_direction() {
    let nobody = Rights {
        employer: false,
        colleagues: false,
        employees: false,
    };
    let secret = Region {
        read: nobody,
        write: Rights {
            employees: true,
            ..nobody
        },
        ..Region::new(0, 4)
    };
    let keeper = StationConfig {
        memory: vec![secret, Region::new(0x100, 4)],
        ..employer("20:C4:D2:00", "00:00:00:FF")
    };
    let mut world = World::new([keeper, named("a")]);
    world.employ(0, 1);
    let write = |world: &mut World, address| {
        let content = Content::Write {
            address,
            octets: b"x",
        };
        let now = world.now;
        let station = &mut world.stations[1];
        let sent = station.send(now, None, at(0), &content, Options::CONFIRMED);
        let ticket = sent.unwrap();
        world.became(1, ticket).pop().unwrap()
    };
    let forbidden = Outcome::NOT_PERMITTED.to_string();
    assert_eq!(write(&mut world, 3), "confirmed");
    assert_eq!(write(&mut world, 0x100), forbidden);
    assert_eq!(world.stations[0].memory()[0].octets, b"\0\0\0x");
    let now = world.now;
    let read = world.stations[1].read(now, at(0), 3, 1, Options::CONFIRMED);
    assert_eq!(world.became(1, read.unwrap()).pop().unwrap(), forbidden);
}

#[test]
fn a_party_that_leaves_or_is_lost_has_not_arrived() {
    let (mut world, lines) = workshop();
    let say = |world: &mut World, who: usize, operation, parties| {
        let now = world.now;
        let station = &mut world.stations[who];
        let sent = station.barrier_of(now, at(3), operation, 7, parties, Options::CONFIRMED);
        let ticket = sent.unwrap();
        world.became(who, ticket).pop().unwrap()
    };
    let (arrive, leave) = (BarrierOperation::Arrive, BarrierOperation::Leave);
    let released = |world: &mut World, who: usize| {
        let events = world.take(who);
        let released = |event: &Event| matches!(event, Event::Released { number: 7, .. });
        events.iter().filter(|event| released(event)).count()
    };
    assert_eq!(say(&mut world, 1, arrive, 2), "confirmed");
    assert_eq!(say(&mut world, 1, leave, 0), "confirmed");
    assert_eq!(say(&mut world, 2, arrive, 2), "confirmed");
    assert_eq!(released(&mut world, 2), 0);
    world.cut(lines[1]);
    assert_eq!(say(&mut world, 0, arrive, 2), "confirmed");
    assert_eq!(released(&mut world, 0), 0, "the second is lost");
    assert_eq!(say(&mut world, 1, arrive, 2), "confirmed");
    assert_eq!(released(&mut world, 0), 1);
    assert_eq!(released(&mut world, 1), 1);
    // It stands empty for as many again.
    assert_eq!(say(&mut world, 1, arrive, 3), "refused");
    assert_eq!(say(&mut world, 1, arrive, 2), "confirmed");
    assert_eq!(released(&mut world, 1), 0);
}
