//! The packets of HIAC links, for those who watch what passes.

use std::fmt;

use fipa::{Inside, Platform, Text};
use fipa_json::hiac_to_json;
use hiac::Mask;
use hiac::edcp::Event;
use hiac::links::Watcher;

/// Shows the packets of a station to those who watch the daemon. Empty ones, which only tell that
/// the other end is there, are left out.
pub(crate) struct Packets(pub(crate) Platform);

impl Watcher for Packets {
    fn is_watching(&self) -> bool {
        self.0.is_watched()
    }

    fn passed(&mut self, incoming: bool, place: &str, packet: Event<'_>, mask: Option<Mask>) {
        if packet == Event::Alive {
            return;
        }
        self.0.passed_inside(|| {
            let (form, _) = hiac_to_json(packet, mask);
            Inside {
                protocol: Text::from_static("hiac"),
                incoming,
                place: Text::from(place),
                form: Text::from(form.to_string()),
            }
        });
    }
}

impl fmt::Debug for Packets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Packets")
    }
}
