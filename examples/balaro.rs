//! Balaro, the rover on the ice of a lake: a coast station, a control unit, and below it a sensor, a
//! GPS receiver and a drive. The stations run in one program, on lines and a clock of its own, so
//! that every run is the same; `hiac::links` puts the same stations on sockets and serial lines.

use std::time::Duration;

use hiac::content::MessageKind;
use hiac::station::{Event, LinkConfig, LinkId, Options, Role, Station, StationConfig, Workgroup};
use hiac::{Address, Content, Mask};

type Outcome<T = ()> = Result<T, Box<dyn std::error::Error>>;

const COAST: usize = 0;
const CONTROL: usize = 1;
const SENSOR: usize = 2;
const GPS: usize = 3;
const DRIVE: usize = 4;
const SPARE: usize = 5;
const NAMES: [&str; 6] = ["coast", "control", "sensor", "gps", "drive", "spare"];

/// The stations and the lines between them: employer, employee, and whether it still carries.
struct Balaro {
    now: Duration,
    stations: Vec<Station>,
    lines: Vec<(usize, usize, bool)>,
}

fn main() -> Outcome {
    let mut balaro = Balaro::new()?;
    println!("The coast station employs the control unit, and that its three devices:");
    balaro.employ(COAST, CONTROL);
    for device in [SENSOR, GPS, DRIVE] {
        balaro.employ(CONTROL, device);
    }
    balaro.settle();

    println!("Colleagues talk through their employer, which does not care what they say:");
    balaro.tell(SENSOR, DRIVE, MessageKind::Warning, "thin ice ahead")?;
    let gps = balaro.address(GPS)?;
    let now = balaro.now;
    let sensor = &mut balaro.stations[SENSOR];
    sensor.question(now, None, gps, b"where are we?", Options::CONFIRMED)?;
    balaro.settle();

    println!("The coast station commands a subemployee, one way:");
    balaro.tell(COAST, DRIVE, MessageKind::Command, "stop")?;
    let drive = balaro.address(DRIVE)?;
    let coast = &mut balaro.stations[COAST];
    let refused = coast.question(now, None, drive, b"did you?", Options::default());
    if let Err(error) = refused {
        println!("  coast may not ask the drive: {error}");
    }

    println!("The control unit fails; a spare one takes over:");
    balaro.employ(COAST, SPARE);
    balaro.silence(CONTROL);
    balaro.pass(Duration::from_secs(2));
    for device in [SENSOR, GPS, DRIVE] {
        balaro.employ(SPARE, device);
    }
    balaro.tell(SPARE, DRIVE, MessageKind::Command, "go on")?;

    println!("The control unit is repaired, and the coast station has it given its workgroup:");
    balaro.stations[CONTROL] = Station::new(control("20:C4:01:00")?);
    balaro.employ(COAST, CONTROL);
    let (spare, control) = (balaro.address(SPARE)?, balaro.address(CONTROL)?);
    let group = balaro.stations[SPARE].workgroups()[0];
    let now = balaro.now;
    let coast = &mut balaro.stations[COAST];
    coast.request_workgroup(now, spare, group.address, group.mask, control)?;
    balaro.settle();
    for device in [SENSOR, GPS, DRIVE] {
        balaro.employ(CONTROL, device);
    }
    balaro.tell(SENSOR, DRIVE, MessageKind::Information, "the ice is thick")?;
    Ok(())
}

/// An employer with the workgroup under this mask.
fn employer(address: &str, mask: u32) -> Outcome<StationConfig> {
    let address: Address = address.parse()?;
    let mask = Mask::new(mask)?;
    Ok(StationConfig {
        address: Some(address),
        workgroups: vec![Workgroup { address, mask }],
        listens: true,
        ..StationConfig::default()
    })
}

fn control(address: &str) -> Outcome<StationConfig> {
    employer(address, 0x0000_00FF)
}

impl Balaro {
    fn new() -> Outcome<Balaro> {
        let device = |name: &str| StationConfig {
            name: Some(name.to_owned()),
            ..StationConfig::default()
        };
        let configs = [
            employer("20:C4:00:00", 0x0000_FF00)?,
            control("20:C4:01:00")?,
            device("sensor"),
            device("gps"),
            device("drive"),
            control("20:C4:02:00")?,
        ];
        Ok(Balaro {
            now: Duration::ZERO,
            stations: configs.into_iter().map(Station::new).collect(),
            lines: Vec::new(),
        })
    }

    /// Opens a stream on which one station employs the other.
    fn employ(&mut self, employer: usize, employee: usize) {
        let id = LinkId(self.lines.len() as u64);
        self.lines.push((employer, employee, true));
        let ends = [(employee, Role::Employee), (employer, Role::Employer)];
        for (station, role) in ends {
            self.stations[station].add_link(self.now, id, LinkConfig::stream(role));
        }
        self.settle();
    }

    fn tell(&mut self, from: usize, to: usize, kind: MessageKind, text: &str) -> Outcome {
        let target = self.address(to)?;
        let content = Content::Message {
            kind,
            reference: 0,
            octets: text.as_bytes(),
        };
        let now = self.now;
        self.stations[from].send(now, None, target, &content, Options::default())?;
        self.settle();
        Ok(())
    }

    fn address(&self, station: usize) -> Outcome<Address> {
        let address = self.stations[station].address();
        address.ok_or_else(|| format!("{} has no address", NAMES[station]).into())
    }

    /// A station falls silent: none of its lines carries anything.
    fn silence(&mut self, station: usize) {
        for line in &mut self.lines {
            if line.0 == station || line.1 == station {
                line.2 = false;
            }
        }
    }

    /// Lets time pass.
    fn pass(&mut self, time: Duration) {
        let end = self.now + time;
        loop {
            self.settle();
            let next = self.stations.iter().filter_map(Station::poll_timeout).min();
            let Some(next) = next.filter(|next| *next <= end) else {
                break;
            };
            self.now = self.now.max(next);
            for station in &mut self.stations {
                station.handle_timeout(self.now);
            }
        }
        self.now = end;
    }

    /// Carries everything that is to be carried now.
    fn settle(&mut self) {
        let mut moved = true;
        while moved {
            moved = false;
            for (at, (one, other, carries)) in self.lines.clone().into_iter().enumerate() {
                let id = LinkId(at as u64);
                for (from, to) in [(one, other), (other, one)] {
                    let Some(octets) = self.stations[from].poll_transmit(id) else {
                        continue;
                    };
                    moved = true;
                    self.stations[from].transmitted(self.now, id);
                    if carries {
                        self.stations[to].received(self.now, id, &octets);
                    }
                }
            }
            for station in 0..self.stations.len() {
                while let Some(event) = self.stations[station].poll_event() {
                    self.happened(station, &event);
                }
            }
        }
    }

    fn happened(&mut self, station: usize, event: &Event) {
        let name = NAMES[station];
        match event {
            Event::Connected {
                role: Role::Employee,
                own,
                partner,
                ..
            } => println!("  {name} is {own}, employed by {partner}"),
            Event::Disconnected {
                role: Role::Employee,
                reason,
                ..
            } => println!("  {name} has no employer any more: {reason:?}"),
            Event::Message {
                from,
                kind,
                reference,
                octets,
            } => {
                let text = String::from_utf8_lossy(octets);
                println!("  {name} hears from {}: {kind:?} {text:?}", from.address);
                if *kind == MessageKind::Question {
                    let (answer, place) = (MessageKind::Answer, b"46.9 N 17.9 E");
                    let now = self.now;
                    let replied =
                        self.stations[station].reply(now, from, answer, *reference, place);
                    if let Err(error) = replied {
                        println!("  {name} cannot answer: {error}");
                    }
                }
            }
            Event::Answered { octets, .. } => {
                println!(
                    "  {name} is answered: {:?}",
                    String::from_utf8_lossy(octets)
                );
            }
            // What the stations want done with their streams.
            Event::Close(id) => {
                if let Some(line) = self.lines.get_mut(id.0 as usize) {
                    let (one, other, _) = *line;
                    line.2 = false;
                    for end in [one, other] {
                        self.stations[end].remove_link(self.now, *id);
                    }
                }
            }
            _ => {}
        }
    }
}
