//! Stations, the lines between them, and a hand that writes octets.

use std::time::Duration;

use hiac::station::{Event, LinkConfig, LinkId, Role, Station, StationConfig, Ticket, Workgroup};
use hiac::{Address, Mask, edcp};

pub(crate) const SECOND: Duration = Duration::from_secs(1);

pub(crate) fn address(text: &str) -> Address {
    text.parse().unwrap()
}

pub(crate) fn mask(text: &str) -> Mask {
    Mask::new(address(text).0).unwrap()
}

/// An employer at this address, with the workgroup under this mask.
pub(crate) fn employer(own: &str, under: &str) -> StationConfig {
    StationConfig {
        address: Some(address(own)),
        workgroups: vec![Workgroup {
            address: address(own),
            mask: mask(under),
        }],
        listens: true,
        ..StationConfig::default()
    }
}

pub(crate) fn named(name: &str) -> StationConfig {
    StationConfig {
        name: Some(name.to_owned()),
        ..StationConfig::default()
    }
}

pub(crate) fn octets(hex: &str) -> Vec<u8> {
    let digits: Vec<char> = hex.chars().filter(|c| !c.is_whitespace()).collect();
    let pairs = digits.chunks(2);
    pairs
        .map(|pair| u8::from_str_radix(&pair.iter().collect::<String>(), 16).unwrap())
        .collect()
}

pub(crate) fn hex(octets: &[u8]) -> String {
    let hex: Vec<String> = octets.iter().map(|octet| format!("{octet:02X}")).collect();
    hex.join(" ")
}

/// What a line does to octets.
pub(crate) type Noise = Box<dyn FnMut(Vec<u8>) -> Vec<u8>>;

struct Line {
    ends: [(usize, LinkId); 2],
    open: bool,
    noise: Option<Noise>,
    /// What went over it, without the signs of life: from which end, and the octets.
    log: Vec<(usize, Vec<u8>)>,
}

/// Stations and lines.
pub(crate) struct World {
    pub(crate) now: Duration,
    pub(crate) stations: Vec<Station>,
    pub(crate) events: Vec<Vec<Event>>,
    lines: Vec<Line>,
}

impl World {
    pub(crate) fn new(stations: impl IntoIterator<Item = StationConfig>) -> World {
        let stations: Vec<Station> = stations.into_iter().map(Station::new).collect();
        World {
            now: Duration::ZERO,
            events: vec![Vec::new(); stations.len()],
            stations,
            lines: Vec::new(),
        }
    }

    /// A stream on which one employs the other. The number of the line, and of its links.
    pub(crate) fn employ(&mut self, employer: usize, employee: usize) -> usize {
        let config = LinkConfig::stream(Role::Employer);
        self.join(
            (employer, config),
            (employee, LinkConfig::stream(Role::Employee)),
        )
    }

    pub(crate) fn join(&mut self, one: (usize, LinkConfig), other: (usize, LinkConfig)) -> usize {
        let line = self.lines.len();
        let id = LinkId(line as u64);
        self.lines.push(Line {
            ends: [(one.0, id), (other.0, id)],
            open: true,
            noise: None,
            log: Vec::new(),
        });
        for (station, config) in [other, one] {
            self.stations[station].add_link(self.now, id, config);
        }
        self.settle();
        line
    }

    pub(crate) fn disturb(&mut self, line: usize, noise: Noise) {
        self.lines[line].noise = Some(noise);
    }

    /// The line goes, and both ends notice.
    pub(crate) fn cut(&mut self, line: usize) {
        self.lines[line].open = false;
        for (station, id) in self.lines[line].ends {
            self.stations[station].remove_link(self.now, id);
        }
        self.settle();
    }

    /// The line carries nothing any more, and nobody is told.
    pub(crate) fn mute(&mut self, line: usize) {
        self.disturb(line, Box::new(|_| Vec::new()));
    }

    /// What has gone over a line since it was last asked, as hexadecimal.
    pub(crate) fn log(&mut self, line: usize) -> Vec<String> {
        let log = std::mem::take(&mut self.lines[line].log);
        log.iter().map(|(_, octets)| hex(octets)).collect()
    }

    /// Carries everything that is to be carried now.
    pub(crate) fn settle(&mut self) {
        loop {
            let mut moved = false;
            for line in &mut self.lines {
                for (from, to) in [(0, 1), (1, 0)] {
                    let (sender, id) = line.ends[from];
                    let (receiver, there) = line.ends[to];
                    let Some(octets) = self.stations[sender].poll_transmit(id) else {
                        continue;
                    };
                    moved = true;
                    if octets != edcp::ALIVE {
                        line.log.push((sender, octets.clone()));
                    }
                    self.stations[sender].transmitted(self.now, id);
                    let octets = match &mut line.noise {
                        Some(noise) => noise(octets),
                        None => octets,
                    };
                    if line.open {
                        self.stations[receiver].received(self.now, there, &octets);
                    }
                }
            }
            for (station, events) in self.stations.iter_mut().zip(&mut self.events) {
                while let Some(event) = station.poll_event() {
                    events.push(event);
                }
            }
            if !moved {
                return;
            }
        }
    }

    /// Lets time pass.
    pub(crate) fn pass(&mut self, time: Duration) {
        let end = self.now + time;
        self.settle();
        loop {
            let next = self.stations.iter().filter_map(Station::poll_timeout).min();
            let Some(next) = next.filter(|next| *next <= end) else {
                break;
            };
            self.now = self.now.max(next);
            for station in &mut self.stations {
                station.handle_timeout(self.now);
            }
            self.settle();
        }
        self.now = end;
    }

    /// The events of a station since it was last asked.
    pub(crate) fn take(&mut self, station: usize) -> Vec<Event> {
        self.settle();
        std::mem::take(&mut self.events[station])
    }

    /// What became of something that was sent.
    pub(crate) fn became(&mut self, station: usize, ticket: Ticket) -> Vec<String> {
        self.settle();
        let what = |event: &Event| match event {
            Event::Written(known) if *known == ticket => Some("written".to_owned()),
            Event::Confirmed(known) if *known == ticket => Some("confirmed".to_owned()),
            Event::Failed(known, why) if *known == ticket => Some(why.to_string()),
            Event::Answered {
                ticket: known,
                octets,
                ..
            } if *known == ticket => Some(String::from_utf8_lossy(octets).into_owned()),
            _ => None,
        };
        self.events[station].iter().filter_map(what).collect()
    }
}

/// One station, and a hand at the other ends of its links.
pub(crate) struct Bench {
    pub(crate) now: Duration,
    pub(crate) station: Station,
}

impl Bench {
    pub(crate) fn new(config: StationConfig) -> Bench {
        Bench {
            now: Duration::ZERO,
            station: Station::new(config),
        }
    }

    pub(crate) fn link(&mut self, id: u64, role: Role) {
        let config = LinkConfig::stream(role);
        self.station.add_link(self.now, LinkId(id), config);
    }

    /// The next packets on a link.
    pub(crate) fn hear(&mut self, id: u64) -> Vec<String> {
        let mut heard = Vec::new();
        while let Some(octets) = self.station.poll_transmit(LinkId(id)) {
            heard.push(hex(&octets));
            self.station.transmitted(self.now, LinkId(id));
        }
        heard
    }

    pub(crate) fn say(&mut self, id: u64, text: &str) {
        self.station.received(self.now, LinkId(id), &octets(text));
    }

    pub(crate) fn pass(&mut self, time: Duration) {
        self.now += time;
        self.station.handle_timeout(self.now);
    }

    pub(crate) fn events(&mut self) -> Vec<Event> {
        std::iter::from_fn(|| self.station.poll_event()).collect()
    }
}
