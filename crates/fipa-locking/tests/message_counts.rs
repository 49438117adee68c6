//! Messages per entry into the critical section, against what the papers say.

mod message_picture;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_locking::{Algorithm, Config, LockAgent, Output, Record};

const RESOURCE: &str = "gripper";
const NOW: Duration = Duration::from_secs(100);
/// Entries that are counted, one after the other by different agents, and then each again.
const ENTRIES: usize = 20;

/// Messages by what they are for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    /// Requests, grants and tokens.
    algorithm: usize,
    /// What the owner is told, and tells: who has it, with which number.
    owner: usize,
    probes: usize,
    discovery: usize,
}

struct Group {
    algorithm: Algorithm,
    names: Vec<Text>,
    agents: BTreeMap<Text, LockAgent>,
    under_way: VecDeque<Message>,
    counts: Counts,
}

impl Group {
    fn new(agents: usize, algorithm: Algorithm) -> Group {
        let names: Vec<Text> = (0..agents)
            .map(|n| Text::from(format!("agent{n:02}")))
            .collect();
        let made = names
            .iter()
            .map(|name| (name.clone(), LockAgent::new(Config::new(name, 0))));
        let mut group = Group {
            algorithm,
            agents: made.collect(),
            names,
            under_way: VecDeque::new(),
            counts: Counts::default(),
        };
        let owner = group.agents.get_mut("agent00").unwrap();
        owner.own(NOW, RESOURCE, Record::default()).unwrap();
        group
    }

    /// One entry; the messages that it took, one for each receiver.
    fn enter(&mut self, name: &Text) -> Counts {
        self.counts = Counts::default();
        let (all, algorithm) = (self.names.clone(), self.algorithm);
        let agent = self.agents.get_mut(name).unwrap();
        agent.request(NOW, RESOURCE, algorithm, all).unwrap();
        self.settle();
        let agent = self.agents.get_mut(name).unwrap();
        assert!(agent.holds(NOW, RESOURCE), "{name}");
        agent.release(NOW, RESOURCE);
        self.settle();
        self.counts
    }

    fn settle(&mut self) {
        loop {
            for agent in self.agents.values_mut() {
                while let Some(output) = agent.poll_output() {
                    match output {
                        Output::Send(message) => self.under_way.push_back(message),
                        Output::Persist { record, .. } => {
                            agent.persisted(NOW, RESOURCE, record.fencing);
                        }
                        _ => {}
                    }
                }
            }
            let Some(message) = self.under_way.pop_front() else {
                return;
            };
            self.count(&message);
            for receiver in &message.receiver {
                let agent = self.agents.get_mut(&receiver.name).unwrap();
                assert!(agent.handle(NOW, &message));
            }
        }
    }

    fn count(&mut self, message: &Message) {
        let counts = &mut self.counts;
        let kind = match (message.protocol.as_deref(), message.performative.as_str()) {
            (Some("dlm_probe"), _) => &mut counts.probes,
            (Some("dlm_discover"), _) => &mut counts.discovery,
            (_, "confirm" | "disconfirm" | "inform") => &mut counts.owner,
            _ => &mut counts.algorithm,
        };
        *kind += message.receiver.len();
    }
}

/// The counts of entries by agents that know the owner, each different from the one before.
fn measure(n: usize, algorithm: Algorithm) -> Vec<Counts> {
    let mut group = Group::new(n, algorithm);
    for name in group.names.clone() {
        group.enter(&name);
    }
    let names = group.names[1..].to_vec();
    let entries = names.iter().cycle().take(ENTRIES);
    entries.map(|name| group.enter(name)).collect()
}

#[test]
fn ricart_agrawala_takes_two_messages_for_each_other_agent() {
    for n in [3, 10, 50] {
        for counts in measure(n, Algorithm::RicartAgrawala) {
            assert_eq!(counts.algorithm, 2 * (n - 1));
            assert_eq!(counts.owner, 2);
        }
    }
}

#[test]
fn suzuki_kasami_takes_as_many_messages_as_there_are_agents_or_none() {
    for n in [3, 10, 50] {
        for counts in measure(n, Algorithm::SuzukiKasami) {
            let none = Counts::default();
            assert_eq!(
                counts,
                Counts {
                    algorithm: n,
                    ..none
                }
            );
        }
        let mut group = Group::new(n, Algorithm::SuzukiKasami);
        let last = group.names[n - 1].clone();
        group.enter(&last);
        assert_eq!(group.enter(&last), Counts::default());
    }
}

#[test]
fn the_extended_variants_add_what_they_tell_the_owner_and_their_probes() {
    for n in [3, 10, 50] {
        for counts in measure(n, Algorithm::RicartAgrawalaExtended) {
            assert_eq!(counts.algorithm, 2 * (n - 1));
            // Confirmed, numbered, given back.
            assert_eq!(counts.owner, 3);
            // One to each other agent and one from the owner, all answered.
            assert_eq!(counts.probes, 2 * (n - 1) + 2);
        }
        for counts in measure(n, Algorithm::SuzukiKasamiExtended) {
            // The token comes from the owner and returns to it.
            assert_eq!(counts.algorithm, n - 1 + 2);
            assert_eq!(counts.owner, 0);
            assert_eq!(counts.probes, 4);
        }
    }
}

#[test]
fn the_owner_is_found_by_one_query_and_one_broadcast_answer() {
    for n in [3, 10, 50] {
        for algorithm in Algorithm::ALL {
            let mut group = Group::new(n, algorithm);
            let last = group.names[n - 1].clone();
            assert_eq!(group.enter(&last).discovery, 2 * (n - 1));
            assert_eq!(group.enter(&last).discovery, 0);
        }
    }
}

/// What the papers say of an entry: by the agreement of all, or by the token of another one.
fn theory(n: usize, algorithm: Algorithm) -> usize {
    if algorithm.has_token() {
        n
    } else {
        2 * (n - 1)
    }
}

/// After a change: `FIPA_DRAW=1 cargo test -p fipa-locking --test message_counts`.
#[test]
fn the_picture_of_the_documentation_shows_what_is_measured() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/src/messages.svg");
    let drawn = message_picture::draw();
    if std::env::var_os("FIPA_DRAW").is_some() {
        std::fs::write(file, &drawn).unwrap();
    }
    let committed = std::fs::read_to_string(file).unwrap();
    assert!(committed == drawn, "{file} shows something else");
}

#[test]
fn the_documentation_shows_what_is_measured() {
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/src/lib.rs");
    let source = std::fs::read_to_string(source).unwrap();
    let shown: Vec<&str> = source
        .lines()
        .filter_map(|line| line.strip_prefix("//! "))
        .collect();
    let mut rows = shown.iter().filter_map(|line| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        // The columns for n = 3, 10 and 50 are the last ones.
        let [.., three, ten, fifty, _] = cells[..] else {
            return None;
        };
        let counted = three.starts_with(|c: char| c.is_ascii_digit());
        counted.then_some([three, ten, fifty])
    });
    for algorithm in Algorithm::ALL {
        let counts = [3, 10, 50].map(|n| measure(n, algorithm)[0]);
        let row = counts.map(|counts| match algorithm {
            Algorithm::SuzukiKasami => counts.algorithm.to_string(),
            _ => format!("{}+{}+{}", counts.algorithm, counts.owner, counts.probes),
        });
        assert_eq!(rows.next().unwrap(), row, "{algorithm}");
    }
    assert_eq!(rows.next(), None);
}
