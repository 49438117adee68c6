//! Agents on nodes: registered, sending, receiving.

use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Representation, Slots, Text};
use fipa_directory::Directory;
use fipa_link::ReceiverOutcome;
use fipa_mts::{Machine, Output, Registration, Submission};

use crate::node::NodeId;
use crate::sim::Sim;

/// How long the outcome of a letter is waited for, unless a test says otherwise.
const TIMEOUT: Duration = Duration::from_secs(10);

impl Sim {
    /// Registers an agent; the ticket of the answer.
    pub fn register(&mut self, node: NodeId, name: &str) -> u64 {
        let ticket = self.ticket();
        let registration = Registration::new(name);
        self.with(node, |machine, now| {
            machine.register(now, ticket, registration);
        });
        ticket
    }

    /// Takes an agent away.
    pub fn deregister(&mut self, node: NodeId, name: &str) {
        self.with(node, |machine, now| machine.deregister(now, name));
    }

    /// Takes an agent away and takes its mail out.
    pub fn leave(&mut self, node: NodeId, name: &str) {
        let ticket = self.ticket();
        self.with(node, |machine, now| machine.leave(now, ticket, name));
    }

    /// Sends a letter; the ticket of its outcome.
    pub fn send(&mut self, node: NodeId, from: &str, to: &[&str], content: &str) -> u64 {
        self.send_within(node, from, to, content, TIMEOUT)
    }

    /// Sends a letter whose outcome is waited for so long.
    pub fn send_within(
        &mut self,
        node: NodeId,
        from: &str,
        to: &[&str],
        content: &str,
        timeout: Duration,
    ) -> u64 {
        let to = to.iter().map(|name| AgentId::new(*name)).collect();
        let payload = Bytes::copy_from_slice(content.as_bytes());
        let letter = self.letter(from, to, payload);
        self.submit(node, letter, timeout)
    }

    /// A letter with these octets.
    pub fn letter(&self, from: &str, to: Vec<AgentId>, payload: Bytes) -> Letter {
        let base = Slots {
            to,
            from: Some(AgentId::new(from)),
            acl_representation: Some(Representation::BitEfficient),
            payload_length: Some(payload.len() as u64),
            date: Some(FipaTime::from_unix_millis(self.now.unix_millis)),
            ..Slots::default()
        };
        Letter {
            envelope: Envelope::new(base),
            payload,
        }
    }

    /// Submits a letter; the ticket of its outcome.
    pub fn submit(&mut self, node: NodeId, letter: Letter, timeout: Duration) -> u64 {
        self.submit_with(node, letter, timeout, |_| ())
    }

    /// Submits a letter with other wishes than the usual ones; the ticket of its outcome.
    pub fn submit_with(
        &mut self,
        node: NodeId,
        letter: Letter,
        timeout: Duration,
        set: impl FnOnce(&mut Submission),
    ) -> u64 {
        let ticket = self.ticket();
        let mut submission = Submission::new(ticket, letter, timeout);
        set(&mut submission);
        if self.is_up(node) {
            self.open_tickets += 1;
            self.nodes[node.0].submitted.push(ticket);
        }
        self.with(node, |machine, now| machine.submit(now, submission));
        ticket
    }

    fn ticket(&mut self) -> u64 {
        self.next_ticket += 1;
        self.next_ticket
    }

    /// Letters of a run that ends now whose outcomes nobody will hear.
    pub(crate) fn unanswered(&mut self, node: NodeId) -> usize {
        let ended = &mut self.nodes[node.0];
        let submitted = std::mem::take(&mut ended.submitted);
        let open = |ticket: &&u64| !ended.collected.outcomes.contains_key(ticket);
        submitted.iter().filter(open).count()
    }

    /// What became of a letter, if that is known.
    pub fn told(&self, node: NodeId, ticket: u64) -> Option<&[ReceiverOutcome]> {
        let told = self.nodes[node.0].collected.outcomes.get(&ticket);
        told.map(|told| told.outcomes.as_slice())
    }

    /// What became of a letter.
    ///
    /// # Panics
    ///
    /// When that is not known yet.
    pub fn outcomes(&self, node: NodeId, ticket: u64) -> &[ReceiverOutcome] {
        self.told(node, ticket).expect("a letter that was told of")
    }

    /// The letters that an agent of a node has got, as text.
    pub fn contents(&self, node: NodeId, agent: &str) -> Vec<String> {
        let mail = self.nodes[node.0].collected.mail.get(agent);
        let letters = mail.into_iter().flatten();
        letters
            .map(|letter| String::from_utf8_lossy(&letter.payload).into_owned())
            .collect()
    }

    /// Lets a node watch what passes its service, or ends that.
    pub fn sniff(&mut self, node: NodeId, on: bool) {
        self.with(node, |machine, now| machine.sniff(now, on));
    }

    /// Sets whether the agents of a node take their mail as soon as it comes. What waits is taken
    /// when they begin.
    pub fn set_reading(&mut self, node: NodeId, reading: bool) {
        self.nodes[node.0].reading = reading;
        let records = self.nodes[node.0].machine().map(Machine::directory);
        let records = records.into_iter().flat_map(Directory::iter);
        let names: Vec<Text> = records.map(|record| record.entry.name.clone()).collect();
        for name in names.iter().filter(|_| reading) {
            self.read_mail(node, name);
        }
    }

    pub(crate) fn collect(&mut self, node: NodeId, output: Output) {
        let at = self.now.mono;
        let telling = &mut self.nodes[node.0];
        match output {
            Output::Registered { ticket, result } => {
                let before = telling.collected.registrations.insert(ticket, result);
                assert!(before.is_none(), "{node:?}: ticket {ticket} was told twice");
            }
            Output::Sniffed(sniffed) => telling.collected.sniffed.push(*sniffed),
            Output::Notice(notice) => telling.collected.notices.push((at, notice)),
            Output::Directory(change) => telling.collected.changes.push((at, change)),
            Output::Left { name, letters, .. } => {
                let mail = telling.collected.mail.entry(name);
                mail.or_default().extend(letters);
            }
            Output::Mail(name) if telling.reading => self.read_mail(node, &name),
            _ => {}
        }
    }

    fn read_mail(&mut self, node: NodeId, name: &Text) {
        let reading = &mut self.nodes[node.0];
        while let Some(letter) = reading.machine_mut().and_then(|m| m.take_mail(name)) {
            let mail = reading.collected.mail.entry(name.clone());
            mail.or_default().push(letter);
        }
    }
}
