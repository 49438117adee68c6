//! What agents say to each other about locks is what the files of the protocols have.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_conversation::{Config as Watching, Monitor, Verdict};
use fipa_directory::Now;
use fipa_locking::{Algorithm, Config, LockAgent, Output, Record, list_query, read_list};
use fipa_protocol::Library;

const RESOURCE: &str = "gripper";
const NAMES: [&str; 3] = ["a", "b", "c"];

/// Three agents, of which the first owns the resource, and one who watches what they say.
struct Watched {
    now: Duration,
    agents: BTreeMap<&'static str, LockAgent>,
    under_way: VecDeque<Message>,
    monitor: Monitor,
    protocols: BTreeSet<String>,
    performatives: BTreeSet<String>,
    holder: Option<&'static str>,
    failed: usize,
    /// Whether numbers of grants can be kept.
    keeps: bool,
}

impl Watched {
    fn new() -> Watched {
        let now = Duration::from_secs(100);
        let agents = NAMES.map(|name| (name, LockAgent::new(Config::new(name, 0))));
        let mut watched = Watched {
            now,
            agents: agents.into(),
            under_way: VecDeque::new(),
            monitor: Monitor::new(Arc::new(Library::builtin()), None, Watching::default()),
            protocols: BTreeSet::new(),
            performatives: BTreeSet::new(),
            holder: None,
            failed: 0,
            keeps: true,
        };
        let owner = watched.agent("a");
        owner.own(now, RESOURCE, Record::default()).unwrap();
        watched
    }

    fn agent(&mut self, name: &str) -> &mut LockAgent {
        self.agents.get_mut(name).unwrap()
    }

    fn ask(&mut self, name: &str, algorithm: Algorithm) {
        let now = self.now;
        let agent = self.agent(name);
        let asked = agent.request(now, RESOURCE, algorithm, NAMES.map(Text::from));
        asked.unwrap();
        self.collect();
    }

    fn release(&mut self, name: &str) {
        let now = self.now;
        self.agent(name).release(now, RESOURCE);
        if self.holder == Some(name) {
            self.holder = None;
        }
        self.collect();
    }

    fn collect(&mut self) {
        let now = self.now;
        for (name, agent) in &mut self.agents {
            while let Some(output) = agent.poll_output() {
                match output {
                    Output::Send(message) => self.under_way.push_back(message),
                    Output::Granted { .. } => self.holder = Some(name),
                    Output::Failed { .. } => self.failed += 1,
                    Output::Persist { resource, record } if self.keeps => {
                        agent.persisted(now, &resource, record.fencing);
                    }
                    Output::Persist { resource, record } => {
                        agent.persist_failed(now, &resource, record.fencing);
                    }
                    Output::Lost { .. } => panic!("{name} has lost it"),
                }
            }
        }
    }

    /// Everything arrives, watched.
    fn arrive(&mut self) {
        while let Some(message) = self.under_way.pop_front() {
            self.watch(&message);
            for receiver in &message.receiver {
                let now = self.now;
                self.agent(&receiver.name).handle(now, &message);
            }
            self.collect();
        }
    }

    fn watch(&mut self, message: &Message) {
        let now = Now {
            mono: self.now,
            ..Now::default()
        };
        let verdict = self.monitor.observe(now, message);
        let accepted = matches!(verdict, Verdict::Accepted { .. });
        assert!(accepted, "{message:?}: {verdict:?}");
        self.protocols
            .extend(message.protocol.as_ref().map(Text::to_string));
        self.performatives.insert(message.performative.to_string());
    }

    fn waits_for(&mut self, span: Duration) {
        let until = self.now + span;
        loop {
            let due = self.agents.values().filter_map(LockAgent::poll_timeout);
            let Some(at) = due.min().filter(|at| *at <= until) else {
                break;
            };
            self.now = self.now.max(at);
            let now = self.now;
            for agent in self.agents.values_mut() {
                agent.handle_timeout(now);
            }
            self.collect();
            self.arrive();
        }
        self.now = until;
    }
}

#[test]
fn agents_that_contend_say_only_what_the_protocols_have() {
    for algorithm in Algorithm::ALL {
        let mut watched = Watched::new();
        for name in NAMES {
            watched.ask(name, algorithm);
        }
        let mut entries = 0;
        for _ in 0..20 {
            watched.arrive();
            // Long enough that the others say their requests again.
            watched.waits_for(Duration::from_secs(22));
            if let Some(holder) = watched.holder {
                entries += 1;
                watched.release(holder);
            }
        }
        assert_eq!(entries, 3, "{algorithm}");
        assert!(watched.protocols.contains(algorithm.protocol()));
        assert!(watched.protocols.contains("dlm_discover"));
        // The owner probes a holder that has told it so, in the plain algorithm as well.
        let probed = watched.protocols.contains("dlm_probe");
        assert_eq!(probed, algorithm != Algorithm::SuzukiKasami, "{algorithm}");
    }
}

#[test]
fn an_owner_that_cannot_keep_its_numbers_refuses_as_the_protocols_have_it() {
    for algorithm in Algorithm::ALL.into_iter().filter(|a| a.is_extended()) {
        let mut watched = Watched::new();
        watched.keeps = false;
        watched.ask("b", algorithm);
        watched.arrive();
        assert_eq!(watched.failed, 1, "{algorithm}");
        assert!(watched.performatives.contains("refuse"), "{algorithm}");
    }
}

#[test]
fn a_number_that_comes_when_the_lock_is_not_wanted_any_more_is_given_back_as_the_protocols_have_it()
{
    let mut watched = Watched::new();
    watched.ask("b", Algorithm::RicartAgrawalaExtended);
    let is_number = |message: &Message| {
        let inform = message.performative == fipa_acl::Performative::Inform;
        inform && message.protocol.as_deref() == Some("ricart_agrawala_extended")
    };
    let number = loop {
        let message = watched.under_way.pop_front().unwrap();
        if is_number(&message) {
            break message;
        }
        watched.watch(&message);
        for receiver in &message.receiver {
            let now = watched.now;
            watched.agent(&receiver.name).handle(now, &message);
        }
        watched.collect();
    };
    watched.release("b");
    watched.under_way.push_back(number);
    watched.arrive();
    let views: Vec<_> = watched.agent("a").owned().collect();
    assert_eq!(views[0].holder, None);
}

#[test]
fn a_listing_is_a_conversation_of_its_protocol() {
    let mut watched = Watched::new();
    watched.ask("b", Algorithm::RicartAgrawalaExtended);
    watched.arrive();
    let query = list_query("a").from_agent("x").conversation_id("x_1");
    watched.watch(&query);
    let now = watched.now;
    assert!(watched.agent("a").handle(now, &query));
    watched.collect();
    let answer = watched.under_way.pop_front().unwrap();
    watched.watch(&answer);
    let listed = read_list(&answer).unwrap();
    assert_eq!(listed[0].holder.as_deref(), Some("b"));
    let id = query.conversation_id.unwrap();
    let conversation = watched.monitor.conversation(&id).unwrap();
    assert!(conversation.is_complete());
}
