//! Two hosts with a bad radio between them.

use std::time::{Duration, Instant};

use crate::load::{Load, receiver};
use crate::losing::History;
use crate::support::daemon::Place;
use crate::support::process::Process;
use crate::support::radio::{Quality, Radio};

#[test]
fn letters_cross_a_radio_that_loses_one_packet_in_twenty_and_their_outcomes_are_true() {
    let quality = Quality {
        loss: 0.05,
        delay: Duration::from_millis(100),
    };
    let Some(radio) = Radio::new(quality, 7) else {
        return;
    };
    let place = Place::new();
    let one = ["--no-mdns", "--listen", "10.0.0.1:0"];
    let one = place.start_in(&radio.one, "robot1", &one);
    let two = [
        "--no-mdns",
        "--listen",
        "10.0.0.2:0",
        "--peer",
        one.endpoint(),
    ];
    let two = place.start_in(&radio.two, "robot2", &two);
    let mut watch = Process::start(one.fipa(&["agents", "--watch", "--json"]));
    let load = Load::begin(&[&one.control, &two.control], Instant::now() + LOADED);
    let counts = load.check();
    println!("{} packets lost, {counts:?}", radio.lost());
    assert!(counts["delivered"] > 0 && radio.lost() > 0, "{counts:?}");

    // The link held: nobody was thought gone before his program ended.
    let (far, mut history) = (receiver(2), History::default());
    history.read_until(&mut watch, "removed", &[&far]);
    let _last = two.attach("listen", "last@robot2");
    history.read_until(&mut watch, "added", &["last@robot2"]);
    assert_eq!(history.of(&far), ["added", "removed"], "{history:?}");
    assert!(!history.flaps(&far), "{history:?}");
}

/// How long the usual test sends.
const LOADED: Duration = Duration::from_secs(8);
