//! What the tests share.
#![allow(dead_code)] // Each test takes what it needs.

use std::ops::Range;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{ChangeKind, Entry, InstanceId, Location, Now};
use fipa_link::{Event, Frame, Hello, LetterFrame, Link, LinkConfig, Outcome, Role};
use fipa_mts::{Config, ConnId, Connected, Machine, Mts, Notice, Output};
use fipa_sim::{NodeId, Sim};

pub(crate) const fn secs(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

pub(crate) const fn millis(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// The seeds that are tried: so many, or what `FIPA_SEEDS` says, from `FIPA_FIRST_SEED` on.
pub(crate) fn seeds(usual: u64) -> Range<u64> {
    let given = |name: &str| {
        let number = std::env::var(name).ok();
        number.map(|number| number.parse::<u64>().expect("a number"))
    };
    let first = given("FIPA_FIRST_SEED").unwrap_or_default();
    first..first + given("FIPA_SEEDS").unwrap_or(usual)
}

/// Daemons named `d0`, `d1`, … that have discovered each other.
pub(crate) fn fleet(sim: &mut Sim, daemons: usize) -> Vec<NodeId> {
    let nodes = (0..daemons).map(|n| sim.daemon(&format!("d{n}"))).collect();
    sim.discover_all();
    sim.run_for(secs(1));
    nodes
}

/// Two daemons that know each other, with the agents `a` and `b`.
pub(crate) fn pair(sim: &mut Sim) -> (NodeId, NodeId) {
    let nodes = fleet(sim, 2);
    sim.register(nodes[0], "a");
    sim.register(nodes[1], "b");
    sim.run_for(millis(100));
    sim.forget(nodes[0]);
    sim.forget(nodes[1]);
    (nodes[0], nodes[1])
}

/// The only outcome of a letter.
pub(crate) fn outcome(sim: &Sim, node: NodeId, ticket: u64) -> Outcome {
    let outcomes = sim.outcomes(node, ticket);
    assert_eq!(outcomes.len(), 1, "{outcomes:?}");
    outcomes[0].outcome
}

/// Why the only receiver of a letter did not get it.
pub(crate) fn reason(sim: &Sim, node: NodeId, ticket: u64) -> String {
    sim.outcomes(node, ticket)[0].reason.to_string()
}

/// How often the directory of a node told of such a change of a name.
pub(crate) fn changes(sim: &Sim, node: NodeId, kind: ChangeKind, name: &str) -> usize {
    let changes = sim.collected(node).changes.iter();
    changes
        .filter(|(_, change)| change.kind == kind && change.record.entry.name == name)
        .count()
}

/// One service, and a partner at the other end of a link who says whatever it likes.
pub(crate) struct Raw {
    pub(crate) mts: Mts,
    pub(crate) now: Now,
    pub(crate) outputs: Vec<Output>,
    pub(crate) heard: Vec<Frame>,
    pub(crate) closed: bool,
    link: Link,
    unread: BytesMut,
    inbox: BytesMut,
}

/// The id of the partner in [`Raw`].
pub(crate) const PARTNER: InstanceId = InstanceId::from_bytes([9; 16]);

const CONN: ConnId = ConnId(1);

impl Raw {
    /// A service named `here`, and a partner on the same host that has greeted it.
    pub(crate) fn new(role: Role) -> Raw {
        Raw::at(role, true)
    }

    /// A service, and a partner on the same host or on another.
    pub(crate) fn at(role: Role, same_host: bool) -> Raw {
        let config = Config::new(InstanceId::from_bytes([1; 16]), "here");
        Raw::with(config, role, same_host, "tcp://partner:1")
    }

    /// A service with this configuration, and where its partner is.
    pub(crate) fn with(config: Config, role: Role, same_host: bool, remote: &'static str) -> Raw {
        let now = Now {
            mono: secs(1000),
            unix_millis: 1_795_341_600_000,
        };
        let hello = Hello {
            version: Hello::VERSION,
            role,
            instance: PARTNER,
            name: Text::from("partner"),
            scope: Text::default(),
            endpoints: Vec::new(),
            max_letter: 1 << 20,
            unix_millis: now.unix_millis,
            checks: role == Role::Daemon,
        };
        let mut raw = Raw {
            mts: Mts::new(config),
            now,
            outputs: Vec::new(),
            heard: Vec::new(),
            closed: false,
            link: Link::new(LinkConfig::new(hello), now),
            unread: BytesMut::new(),
            inbox: BytesMut::new(),
        };
        let connected = Connected {
            conn: CONN,
            dialled: None,
            control: role == Role::Program,
            same_host,
            remote: Text::from_static(remote),
            identity: None,
            lanes: false,
        };
        raw.mts.connected(now, connected);
        raw.exchange();
        raw
    }

    /// Says something, and hears the answers.
    pub(crate) fn say(&mut self, frame: Frame) {
        self.link.send(self.now, frame);
        self.exchange();
    }

    /// Says a letter with these octets.
    pub(crate) fn letter(&mut self, id: u64, octets: impl Into<Bytes>) {
        self.say(Frame::Letter(LetterFrame {
            id,
            ttl_millis: 10_000,
            parts: octets.into().into(),
        }));
    }

    /// The outcomes in the receipt of a letter.
    pub(crate) fn receipt(&self, letter: u64) -> Vec<(String, Outcome, String)> {
        let receipts = self.heard.iter().filter_map(|frame| match frame {
            Frame::Receipt { id, outcomes } if *id == letter => Some(outcomes),
            _ => None,
        });
        receipts
            .flat_map(|outcomes| outcomes.iter())
            .map(|o| (o.to.to_string(), o.outcome, o.reason.to_string()))
            .collect()
    }

    pub(crate) fn exchange(&mut self) {
        loop {
            let mut moved = false;
            while let Some(part) = self.link.poll_transmit() {
                moved = true;
                self.unread.extend_from_slice(&part);
            }
            self.mts.received(self.now, CONN, &mut self.unread);
            while let Some(output) = self.mts.poll_output() {
                self.closed |= matches!(output, Output::Close(_));
                self.outputs.push(output);
            }
            while let Some(part) = self.mts.poll_transmit(self.now, CONN) {
                moved = true;
                self.inbox.extend_from_slice(&part);
            }
            while let Some(event) = self.link.receive(self.now, &mut self.inbox).unwrap() {
                if let Event::Frame(frame) = event {
                    self.heard.push(frame);
                }
            }
            if !moved {
                return;
            }
        }
    }
}

/// The letters that `fipa_services` and the bridge to JADE were recorded to write.
pub(crate) fn recorded(name: &str) -> Bytes {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/vectors/");
    Bytes::from(std::fs::read(format!("{folder}{name}")).unwrap())
}

/// The notices of letters that a node has lost, as text.
pub(crate) fn lost(sim: &Sim, node: NodeId) -> Vec<String> {
    let notices = sim.collected(node).notices.iter();
    let lost = notices.filter(|(_, notice)| matches!(notice, Notice::LetterLost { .. }));
    lost.map(|(_, notice)| notice.to_string()).collect()
}

/// An agent of a robot, with its locations: addresses and what is spoken there.
pub(crate) fn entry(name: &str, locations: &[(&str, &str)]) -> Entry {
    let location = |(address, signature): &(&str, &str)| Location {
        address: Text::from(*address),
        signature: Text::from(*signature),
    };
    Entry {
        locations: locations.iter().map(location).collect(),
        ..Entry::new(name)
    }
}
