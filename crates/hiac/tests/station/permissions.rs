//! Who may say what: every kind of content in every direction.

use hiac::content::{BarrierOperation, MessageKind, SemaphoreOperation};
use hiac::station::{Direction, Options, SendError};
use hiac::sys::{Parameters, Subtype};
use hiac::{Address, Content};

use crate::net::{World, address, employer, named};

const COAST: usize = 0;
const CONTROL: usize = 1;
const SENSOR: usize = 2;

/// A coast station with two control units, the first of which has a sensor.
fn rover() -> World {
    let mut world = World::new([
        employer("20:C4:00:00", "00:00:FF:00"),
        employer("20:C4:01:00", "00:00:00:FF"),
        named("sensor"),
        employer("20:C4:02:00", "00:00:00:FF"),
    ]);
    world.employ(COAST, CONTROL);
    world.employ(COAST, 3);
    world.employ(CONTROL, SENSOR);
    world
}

fn message(kind: MessageKind, reference: u8) -> Content<'static> {
    Content::Message {
        kind,
        reference,
        octets: b"x",
    }
}

fn barrier(operation: BarrierOperation, parties: u8) -> Content<'static> {
    Content::Barrier {
        operation,
        number: 1,
        parties,
    }
}

fn system(subtype: Subtype) -> Content<'static> {
    Content::System {
        subtype,
        parameters: Parameters::default(),
    }
}

/// Each content, and whether it may go to the employer, a colleague, an employee, a subemployee,
/// and whoever is above the employer or beside it.
fn table() -> Vec<(Content<'static>, [bool; 5])> {
    let (yes, no) = (true, false);
    let free = [yes, yes, yes, no, no];
    let down = [no, no, yes, no, no];
    let aside = [no, yes, yes, no, no];
    let signal = Content::Signal {
        number: 1,
        arguments: &[],
    };
    let semaphore = Content::Semaphore {
        operation: SemaphoreOperation::Take,
        number: 0,
    };
    let write = Content::Write {
        address: 0,
        octets: b"x",
    };
    let read = Content::Read {
        address: 0,
        length: 1,
    };
    vec![
        (message(MessageKind::Information, 0), free),
        (message(MessageKind::Command, 0), [no, no, yes, yes, no]),
        (message(MessageKind::Command, 1), down),
        (message(MessageKind::Question, 1), free),
        (message(MessageKind::Answer, 1), free),
        (message(MessageKind::Warning, 0), free),
        (signal, [yes, yes, yes, yes, no]),
        (semaphore, free),
        (write, free),
        (read, free),
        (barrier(BarrierOperation::Arrive, 0), free),
        (barrier(BarrierOperation::Arrive, 2), aside),
        (barrier(BarrierOperation::Leave, 0), free),
        (system(Subtype::EmployeeTransfer), aside),
        (system(Subtype::WorkgroupTransfer), aside),
        (system(Subtype::EmployeeRequest), down),
        (system(Subtype::WorkgroupRequest), down),
        (system(Subtype::Initialize), aside),
        (system(Subtype::Reinitialize), down),
    ]
}

/// Whether it is sent; nothing but the hierarchy stands against it.
fn goes(from: usize, to: &str, content: &Content<'_>, confirm: bool) -> bool {
    let mut world = rover();
    let options = Options {
        confirm,
        ..Options::default()
    };
    let now = world.now;
    match world.stations[from].send(now, None, address(to), content, options) {
        Ok(_) => true,
        Err(SendError::NotPermitted) => false,
        Err(error) => panic!("{content:?} from {from} to {to}: {error}"),
    }
}

#[test]
fn each_content_goes_where_the_hierarchy_lets_it() {
    let ways: [(usize, &str, Option<Direction>); 5] = [
        (CONTROL, "20:C4:00:00", Some(Direction::Employer)),
        (CONTROL, "20:C4:02:00", Some(Direction::Colleague)),
        (CONTROL, "20:C4:01:01", Some(Direction::Employee)),
        (COAST, "20:C4:01:01", Some(Direction::Subemployee)),
        (SENSOR, "20:C4:00:00", None),
    ];
    let world = rover();
    for (from, to, direction) in ways {
        let to: Address = address(to);
        assert_eq!(world.stations[from].direction(to), direction);
    }
    for (content, permitted) in table() {
        for ((from, to, direction), permitted) in ways.into_iter().zip(permitted) {
            let went = goes(from, to, &content, false);
            assert_eq!(went, permitted, "{content:?} to {direction:?}");
        }
        // Nobody below an employee is asked to confirm, and nobody reaches an uncle.
        assert!(!goes(COAST, "20:C4:01:01", &content, true), "{content:?}");
        assert!(!goes(SENSOR, "20:C4:02:00", &content, false), "{content:?}");
    }
}
