//! Fleets with outboxes in which daemons crash, at random, before and after their disks have
//! written.
//!
//! A long run: `FIPA_SEEDS=10000 cargo test --release -p fipa-mts --test outbox_random`; one seed
//! again: `FIPA_FIRST_SEED=… FIPA_SEEDS=1`.
mod support;

use std::collections::BTreeMap;
use std::time::Duration;

use fipa_acl::{Message, Performative, Representation};
use fipa_codec::{Limits, Output as Encoded, decode_payload, encode_message};
use fipa_link::Outcome;
use fipa_mts::{DeliveryFailure, Notice, OutboxConfig};
use fipa_sim::{Network, NodeId, Sim};

use support::{millis, secs, seeds};

const SEEDS: u64 = 40;

/// Agents live in programs, which survive the crashes of their daemons, and in daemons.
struct Fleet {
    sim: Sim,
    daemons: Vec<NodeId>,
    programs: Vec<NodeId>,
    runs: Vec<u64>,
    sent: Vec<Sent>,
    /// What agents of a daemon had got when it crashed.
    before: Vec<BTreeMap<(String, String), usize>>,
}

struct Sent {
    node: NodeId,
    from: String,
    to: String,
    content: String,
    ticket: u64,
    /// The run of the daemon at which it was submitted; a program's tickets are always told.
    run: Option<(usize, u64)>,
}

fn in_daemon(n: usize) -> String {
    format!("daemon{n}")
}

fn in_program(n: usize) -> String {
    format!("program{n}")
}

impl Fleet {
    fn new(seed: u64) -> Fleet {
        let mut sim = Sim::new(seed);
        let latency = millis(sim.random().u64(1..15));
        let jitter = millis(sim.random().u64(0..30));
        sim.set_network(Network {
            latency,
            jitter,
            split: seed.is_multiple_of(2),
            octets_per_second: None,
        });
        let limits = OutboxConfig {
            letters: 30,
            age: secs(if seed.is_multiple_of(3) { 20 } else { 3600 }),
            ..OutboxConfig::default()
        };
        // Most fleets are small, so that many can be tried.
        let count = match seed % 8 {
            7 => sim.random().usize(9..=20),
            _ => sim.random().usize(5..9),
        };
        let daemon = |n: usize| {
            let limits = limits.clone();
            sim.daemon_with(&format!("d{n}"), |c| c.outbox = Some(limits))
        };
        let daemons: Vec<NodeId> = (0..count).map(daemon).collect();
        sim.run_for(millis(10));
        let program = |n: usize| {
            let set = |c: &mut fipa_mts::ProgramConfig| c.patience = secs(1_000_000);
            sim.program_with(&format!("p{n}"), daemons[n], set)
        };
        let programs: Vec<NodeId> = (0..count).map(program).collect();
        for n in 0..count {
            sim.register(daemons[n], &in_daemon(n));
            sim.register(programs[n], &in_program(n));
        }
        sim.discover_all();
        sim.run_for(secs(1));
        Fleet {
            sim,
            daemons,
            programs,
            runs: vec![0; count],
            sent: Vec::new(),
            before: vec![BTreeMap::new(); count],
        }
    }

    fn count(&self) -> usize {
        self.daemons.len()
    }

    fn send(&mut self) {
        let count = self.count();
        let n = self.sim.random().usize(0..count);
        let (node, from, run) = match self.sim.random().bool() {
            true => (self.programs[n], in_program(n), None),
            false => (self.daemons[n], in_daemon(n), Some((n, self.runs[n]))),
        };
        if !self.sim.is_up(node) {
            return;
        }
        let other = self.sim.random().usize(0..count);
        let to = match self.sim.random().bool() {
            true => in_program(other),
            false => in_daemon(other),
        };
        let content = format!("letter {}", self.sent.len());
        let timeout = millis(self.sim.random().u64(500..12_000));
        let reply_by = self.sim.random().u8(0..5) == 0;
        let message = Message::new(Performative::Inform)
            .from_agent(from.as_str())
            .to(to.as_str())
            .conversation_id(content.as_str())
            .content(content.clone());
        let mut payload = Encoded::new();
        encode_message(&Representation::BitEfficient, &message, &mut payload).unwrap();
        let payload = payload.take_bytes();
        let letter = self.sim.letter(&from, vec![to.as_str().into()], payload);
        let at = self.sim.now().plus(timeout / 2).unix_millis;
        let ticket = self.sim.submit_with(node, letter, timeout, |submission| {
            submission.reply_by = reply_by.then_some(at);
        });
        self.sent.push(Sent {
            node,
            from,
            to,
            content,
            ticket,
            run,
        });
    }

    /// The messages that an agent of a node has got, over all its runs.
    fn messages(&self, node: NodeId, agent: &str) -> Vec<Message> {
        let mail = self.sim.collected(node).mail.get(agent);
        let limits = Limits::default();
        mail.into_iter()
            .flatten()
            .map(|letter| decode_payload(&letter.envelope, &letter.payload, &limits).unwrap())
            .collect()
    }

    /// How often it has got each letter.
    fn got(&self, node: NodeId, agent: String) -> BTreeMap<(String, String), usize> {
        let mut got = BTreeMap::new();
        for message in self.messages(node, &agent) {
            if DeliveryFailure::of(&message).is_none() {
                let content = message.content_str().unwrap().to_owned();
                *got.entry((agent.clone(), content)).or_default() += 1;
            }
        }
        got
    }

    /// What agents were told of letters that failed: the letter, and why.
    fn failures(&self) -> BTreeMap<String, String> {
        let mut told = BTreeMap::new();
        for n in 0..self.count() {
            let places = [
                (self.daemons[n], in_daemon(n)),
                (self.programs[n], in_program(n)),
            ];
            for (node, agent) in places {
                for message in self.messages(node, &agent) {
                    if let Some(failure) = DeliveryFailure::of(&message) {
                        let about = message.conversation_id.unwrap().to_string();
                        told.insert(
                            about.trim_matches('"').to_owned(),
                            failure.reason.to_string(),
                        );
                    }
                }
            }
        }
        told
    }

    /// Whether a daemon gave up looking for this agent with a notice for it.
    fn could_not_be_told(&self, agent: &str) -> bool {
        let given_up = |notice: &Notice| match notice {
            Notice::LinkFailed { with, reason } => {
                with.as_str() == agent && reason.contains("could not be told")
            }
            _ => false,
        };
        self.daemons.iter().any(|node| {
            let notices = &self.sim.collected(*node).notices;
            notices.iter().any(|(_, notice)| given_up(notice))
        })
    }

    /// An agent gets a letter once in a run of its daemon.
    fn check_run(&mut self, n: usize, seed: u64) {
        let got = self.got(self.daemons[n], in_daemon(n));
        for (letter, times) in &got {
            let before = self.before[n].get(letter).copied().unwrap_or_default();
            assert!(times - before <= 1, "seed {seed}: {letter:?} came twice");
        }
        self.before[n] = got;
    }

    fn restart(&mut self, n: usize, seed: u64) {
        self.check_run(n, seed);
        self.sim.restart(self.daemons[n]);
        self.runs[n] += 1;
        self.sim.register(self.daemons[n], &in_daemon(n));
        self.sim.discover_all();
    }

    fn fault(&mut self, seed: u64) {
        let count = self.count();
        let n = self.sim.random().usize(0..count);
        let other = self.sim.random().usize(0..count);
        let (one, two) = (self.daemons[n], self.daemons[other]);
        let full = self.sim.random().u8(0..4) == 0;
        match self.sim.random().u8(0..17) {
            0 | 1 => self.sim.reset(one, two),
            2 => self.sim.lose(one, two),
            3 | 4 => self.sim.crash(one),
            5 => self.sim.power_off(one),
            6 => self.sim.freeze(one),
            7 => self.sim.cut(one, two),
            8 => (0..count).for_each(|n| self.sim.thaw(self.daemons[n])),
            9 => self.sim.mend(one),
            10 => self.sim.set_disk_full(one, full),
            11 => self.sim.shutdown(one),
            _ if !self.sim.is_up(one) => self.restart(n, seed),
            12 | 13 => self.sim.corrupt(one, two),
            _ => self.sim.discover_badly(),
        }
    }

    fn calm_down(&mut self, seed: u64) {
        for node in self.daemons.clone() {
            self.sim.mend(node);
            self.sim.thaw(node);
            self.sim.set_disk_full(node, false);
        }
        self.sim.run_for(secs(1));
        for n in 0..self.count() {
            if !self.sim.is_up(self.daemons[n]) {
                self.restart(n, seed);
            }
        }
        for _ in 0..30 {
            self.sim.discover_all();
            self.sim.run_for(secs(10));
        }
    }

    fn check(&mut self, seed: u64) -> [usize; 4] {
        (0..self.count()).for_each(|n| self.check_run(n, seed));
        let mut got = BTreeMap::new();
        for n in 0..self.count() {
            got.extend(self.got(self.daemons[n], in_daemon(n)));
            for (letter, times) in self.got(self.programs[n], in_program(n)) {
                assert_eq!(times, 1, "seed {seed}: {letter:?} came again");
                got.insert(letter, times);
            }
        }
        let mut dropped: BTreeMap<(String, String, usize), usize> = BTreeMap::new();
        for node in &self.daemons {
            for (_, notice) in &self.sim.collected(*node).notices {
                if let Notice::StoredLetterDropped { from, to, .. } = notice {
                    let key = (from.to_string(), to.to_string(), 0);
                    *dropped.entry(key).or_default() += 1;
                }
            }
        }
        let failures = self.failures();
        let [mut delivered, mut stored, mut lost, mut told_of] = [0; 4];
        for sent in &self.sent {
            let arrived = got.contains_key(&(sent.to.clone(), sent.content.clone()));
            let failure = failures.get(&sent.content);
            assert!(
                !arrived || failure.is_none_or(|why| why.starts_with("timeout")),
                "seed {seed}: {} has arrived: {failure:?}",
                sent.content
            );
            let Some(outcomes) = self.sim.told(sent.node, sent.ticket) else {
                let ended = sent.run.is_some_and(|(n, run)| self.runs[n] > run);
                assert!(ended, "seed {seed}: {} was never told of", sent.content);
                continue;
            };
            assert_eq!(outcomes.len(), 1);
            let told = &outcomes[0];
            match told.outcome {
                Outcome::Delivered => {
                    delivered += 1;
                    assert!(arrived, "seed {seed}: {} did not arrive", sent.content);
                }
                Outcome::Timeout if told.reason.starts_with("stored") => {
                    stored += 1;
                    if !arrived {
                        let key = (sent.from.clone(), sent.to.clone(), 0);
                        let notices = dropped.get_mut(&key).filter(|left| **left > 0);
                        let left = notices.unwrap_or_else(|| {
                            panic!("seed {seed}: {} is lost and nobody was told", sent.content)
                        });
                        *left -= 1;
                        lost += 1;
                        let heard = failures.contains_key(&sent.content);
                        told_of += usize::from(heard);
                        assert!(
                            heard || self.could_not_be_told(&sent.from),
                            "seed {seed}: nobody tells {} that {} is lost",
                            sent.from,
                            sent.content
                        );
                    }
                }
                Outcome::Expired | Outcome::Unknown | Outcome::Refused => {
                    assert!(!arrived, "seed {seed}: {}: {told:?}", sent.content);
                }
                _ => {}
            }
        }
        for node in &self.daemons {
            assert_eq!(self.sim.letters_on_disk(*node), 0, "seed {seed}: {node:?}");
            assert_eq!(self.sim.mts(*node).letters_stored(), 0, "seed {seed}");
            assert_eq!(self.sim.mts(*node).letters_under_way(), 0, "seed {seed}");
        }
        [delivered, stored, lost, told_of]
    }
}

fn run(seed: u64) -> [usize; 4] {
    let mut fleet = Fleet::new(seed);
    for _ in 0..fleet.sim.random().usize(50..150) {
        let pause: Duration = millis(fleet.sim.random().u64(0..600));
        fleet.sim.run_for(pause);
        for _ in 0..fleet.sim.random().u8(0..6) {
            fleet.send();
        }
        if fleet.sim.random().u8(0..3) == 0 {
            fleet.fault(seed);
        }
    }
    fleet.calm_down(seed);
    fleet.check(seed)
}

#[test]
fn every_stored_letter_arrives_once_or_its_loss_is_told_whatever_crashes() {
    let mut all = [0; 4];
    for seed in seeds(SEEDS) {
        let counts = run(seed);
        (0..4).for_each(|n| all[n] += counts[n]);
    }
    let [delivered, stored, dropped, told] = all;
    println!(
        "{delivered} delivered at once, {stored} stored, {dropped} of these dropped, {told} with a notice"
    );
    // The faults are no excuse, and the outbox was used.
    assert!(
        delivered > stored && stored > 5 * dropped && dropped > 0 && told > 0,
        "{all:?}"
    );
}

#[test]
fn notices_are_true_and_wait_for_their_senders_in_runs_that_once_failed() {
    for seed in [993, 1254, 2112, 3657, 5277] {
        run(seed);
    }
}
