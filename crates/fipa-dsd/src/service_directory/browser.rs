//! The search for instances of a service type: what is there, by what was heard of it.
//!
//! Only the pointers and the TXT records count. A lost or withdrawn address of a host says nothing
//! about the agents there, whose locations stand in their TXT records; and what is not needed need
//! not be asked for again every two minutes, once for each agent and by each robot.
use std::collections::{HashMap, VecDeque};
use std::time::{Duration, Instant};

use fipa_directory::{Address, InstanceId};

use super::packet::{self, Record};
use super::txt::TxtString;
use super::{ServiceType, key, txt};
use crate::{DiscoveredAgent, DiscoveryEvent};

/// The pauses between the first questions. Announcements are sent twice, and what is lost of them
/// and of the answers is lost at the beginning, when all speak at once.
const PAUSES: [Duration; 3] = [
    Duration::from_secs(1),
    Duration::from_secs(3),
    Duration::from_secs(9),
];
/// The pause between questions later on. Whoever was out of reach is found then, at the latest.
const LONG_PAUSE: Duration = Duration::from_secs(600);
/// The first question waits as long as this and up to five times as long, because many robots may
/// be switched on at once (RFC 6762 section 5.2).
const BEFORE_FIRST: Duration = Duration::from_millis(20);
/// How long an instance is kept after its goodbye (RFC 6762 section 10.1): another announcement
/// calls it back.
const GOODBYE: Duration = Duration::from_secs(1);
/// When a missing TXT record is asked for at the earliest, and how much longer each time, and how
/// often. It may be in the next packet.
const TEXT_PAUSE: Duration = Duration::from_millis(100);
const TEXT_FACTOR: u32 = 4;
const TEXT_TIMES: u32 = 5;
/// How long an instance has to answer when it is verified, and when it is asked once more.
const VERIFY_FOR: Duration = Duration::from_secs(2);
const VERIFY_AGAIN: Duration = Duration::from_secs(1);
/// The longest lifetime that is believed, which is twice the usual one.
const LONGEST_LIFE: u32 = 9000;
/// How many instances are remembered. More than a network holds, fewer than could fill the memory.
const MOST_KNOWN: usize = 10_000;

/// What is known of the instances of a service type.
#[derive(Debug)]
pub(crate) struct Browser {
    service_type: ServiceType,
    own: InstanceId,
    /// The instances, by what makes their labels the same.
    known: HashMap<String, Known>,
    ask_at: Instant,
    /// When the question was asked last, by us or by somebody else.
    asked: Option<Instant>,
    /// How many questions of the first series were asked.
    questions: usize,
    /// Whether an instance was heard for the first time since the last question.
    news: bool,
    /// Not later than anything is due.
    wake: Instant,
    random: fastrand::Rng,
    full: bool,
    outputs: VecDeque<Output>,
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Output {
    /// To be sent to the multicast group on all interfaces.
    Packet(Vec<u8>),
    /// To be reported.
    Event(DiscoveryEvent),
}

#[derive(Debug)]
struct Known {
    label: String,
    expires: Instant,
    /// When it is asked for again, lest it expires.
    refresh: Instant,
    life: Duration,
    /// When it is given up for its goodbye.
    leaves: Option<Instant>,
    strings: Vec<TxtString>,
    on_loopback: bool,
    /// When the TXT record is asked for, and how often that was done.
    ask_text: Option<(Instant, u32)>,
    verify: Option<Verify>,
    reported: Option<DiscoveredAgent>,
}

#[derive(Debug)]
struct Verify {
    ask: Option<Instant>,
    until: Instant,
}

impl Browser {
    /// A search that begins now, and leaves out what the daemon `own` announces.
    pub(crate) fn new(
        service_type: ServiceType,
        own: InstanceId,
        seed: u64,
        now: Instant,
    ) -> Browser {
        let mut random = fastrand::Rng::with_seed(seed);
        let ask_at = now + BEFORE_FIRST * random.u32(1..=5);
        Browser {
            service_type,
            own,
            known: HashMap::new(),
            ask_at,
            asked: None,
            questions: 0,
            news: false,
            wake: ask_at,
            random,
            full: false,
            outputs: VecDeque::new(),
        }
    }

    /// Takes in a packet; tells whether it was one of DNS.
    pub(crate) fn handle_packet(&mut self, now: Instant, packet: &[u8], on_loopback: bool) -> bool {
        let Ok(mut records) = packet::read(packet, &self.service_type) else {
            return false;
        };
        // An answer may hold the text before the pointer that says whose text it is.
        records.sort_by_key(|record| matches!(record, Record::Text { .. }));
        for record in records {
            match record {
                Record::Instance { label, ttl: 0 } => self.on_goodbye(now, &label),
                Record::Instance { label, ttl } => self.on_instance(now, label, ttl),
                Record::Text { label, strings } => self.on_text(&label, strings, on_loopback),
                Record::Question { known } => self.on_question(now, &known),
                Record::TextQuestion { label } => self.on_text_question(now, &label),
            }
        }
        true
    }

    /// When something is due.
    pub(crate) fn poll_timeout(&self) -> Instant {
        self.wake
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, now: Instant) {
        if now < self.wake {
            return;
        }
        let gone = self.known.iter().filter(|(_, known)| known.is_over(now));
        let gone: Vec<_> = gone.map(|(key, _)| key.clone()).collect();
        for key in gone {
            self.give_up(now, &key);
        }
        let mut texts = Vec::new();
        let mut ask = self.ask_at <= now;
        if ask {
            self.asked(now);
        }
        for known in self.known.values_mut() {
            ask |= known.refresh_due(now);
            if known.text_due(now) {
                texts.push(known.label.clone());
            }
        }
        if ask {
            self.ask_for_instances(now);
        }
        let texts = packet::ask_for_texts(&self.service_type, &texts);
        self.outputs.extend(texts.into_iter().map(Output::Packet));
        let dues = self.known.values().map(Known::due);
        self.wake = dues.fold(self.ask_at, Instant::min);
    }

    /// The next thing to be done.
    pub(crate) fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    /// Asks whether an agent is still announced; if nobody answers within 2 s, it is gone. False if
    /// no such agent is known.
    pub(crate) fn verify(&mut self, now: Instant, name: &str) -> bool {
        let named = |known: &&mut Known| {
            let reported = known.reported.as_ref();
            reported.is_some_and(|agent| agent.entry.name == name)
        };
        let Some(known) = self.known.values_mut().find(named) else {
            return false;
        };
        known.verify.get_or_insert(Verify {
            ask: Some(now),
            until: now + VERIFY_FOR,
        });
        self.wake = now;
        true
    }

    /// Begins to ask who is there anew, not before `at`: somebody may not have been heard.
    pub(crate) fn ask_anew(&mut self, at: Instant) {
        self.questions = 0;
        let at = at + BEFORE_FIRST * self.random.u32(1..=5);
        self.ask_at = self.ask_at.min(at);
        self.wake = self.wake.min(self.ask_at);
    }

    /// A daemon is gone, and with it all that it announced. If it comes back it is found by other
    /// means.
    pub(crate) fn forget(&mut self, instance: InstanceId) {
        let its = |known: &Known| {
            let reported = known.reported.as_ref();
            reported.is_some_and(|agent| agent.instance == Some(instance))
        };
        let its = self.known.iter().filter(|(_, known)| its(known));
        let its: Vec<_> = its.map(|(key, _)| key.clone()).collect();
        for key in its {
            let known = self.known.remove(&key);
            let reported = known.and_then(|known| known.reported);
            self.outputs.extend(reported.as_ref().map(gone));
        }
    }

    /// Somebody else has asked, and the answers will be heard by all: if we are about to ask as
    /// well, that is enough (RFC 6762 section 7.3), unless answers that we need are not asked for.
    fn on_question(&mut self, now: Instant, known: &[String]) {
        let about_to_ask = self.asked.is_none_or(|asked| {
            let pause = self.ask_at.saturating_duration_since(asked);
            now.saturating_duration_since(asked) > pause / 2
        });
        let nothing_missing = || {
            known
                .iter()
                .all(|label| self.known.contains_key(&key(label)))
        };
        if about_to_ask && nothing_missing() {
            self.asked(now);
        }
    }

    /// Somebody else has asked for a TXT record, and the answer will be heard by all.
    fn on_text_question(&mut self, now: Instant, label: &str) {
        let known = self.known.get_mut(&key(label));
        if let Some((at, times)) = known.and_then(|known| known.ask_text.as_mut()) {
            *at = (*at).max(now + TEXT_PAUSE * TEXT_FACTOR.pow(*times));
        }
    }

    /// The question was asked; the next one is due after a pause.
    fn asked(&mut self, now: Instant) {
        // Where the second question brought nothing new, the third would not either.
        let settled = self.questions > 1 && !self.news;
        let pause = PAUSES.get(self.questions).filter(|_| !settled);
        let pause = pause.copied().unwrap_or(LONG_PAUSE);
        self.questions += 1;
        self.news = false;
        self.asked = Some(now);
        self.ask_at = now + pause * self.random.u32(100..125) / 100;
    }

    fn on_goodbye(&mut self, now: Instant, label: &str) {
        if let Some(known) = self.known.get_mut(&key(label)) {
            let leaves = *known.leaves.get_or_insert(now + GOODBYE);
            self.wake = self.wake.min(leaves);
        }
    }

    fn on_instance(&mut self, now: Instant, label: String, ttl: u32) {
        let key = key(&label);
        if !self.known.contains_key(&key) && self.known.len() >= MOST_KNOWN {
            self.warn_full();
            return;
        }
        self.news |= !self.known.contains_key(&key);
        let life = Duration::from_secs(ttl.min(LONGEST_LIFE).into());
        let known = self.known.entry(key).or_insert_with(|| Known {
            label,
            expires: now,
            refresh: now,
            life,
            leaves: None,
            strings: Vec::new(),
            on_loopback: false,
            ask_text: None,
            verify: None,
            reported: None,
        });
        known.life = life;
        known.expires = now + life;
        // Each robot asks at a moment of its own: the answer to the first is heard by all.
        known.refresh = now + life * self.random.u32(80..90) / 100;
        known.leaves = None;
        known.verify = None;
        if known.strings.is_empty() && known.ask_text.is_none() {
            // Where the answers are lost to many, the first to ask shall do it for all.
            known.ask_text = Some((now + TEXT_PAUSE * self.random.u32(100..500) / 100, 0));
        }
        self.wake = self.wake.min(known.due());
    }

    fn on_text(&mut self, label: &str, strings: Vec<TxtString>, on_loopback: bool) {
        let Some(known) = self.known.get_mut(&key(label)) else {
            return;
        };
        known.verify = None;
        known.ask_text = None;
        known.on_loopback |= on_loopback;
        known.strings = strings;
        let agent = known.agent();
        let before = known.reported.take();
        let own = agent.instance == Some(self.own);
        if !own {
            known.reported = Some(agent.clone());
        }
        let renamed = before
            .as_ref()
            .filter(|before| own || before.entry.name != agent.entry.name);
        if let Some(before) = renamed {
            self.outputs.push_back(gone(before));
        }
        if !own && before.as_ref() != Some(&agent) {
            let found = DiscoveryEvent::AgentFound(agent);
            self.outputs.push_back(Output::Event(found));
        }
    }

    /// Forgets an instance. Who did not say goodbye may be there all the same, and is asked for
    /// soon.
    fn give_up(&mut self, now: Instant, key: &str) {
        let Some(known) = self.known.remove(key) else {
            return;
        };
        if known.leaves.is_none() {
            self.ask_anew(now + PAUSES[0]);
        }
        self.outputs.extend(known.reported.as_ref().map(gone));
    }

    /// Asks who is there, and tells who need not answer (RFC 6762 section 7.1).
    fn ask_for_instances(&mut self, now: Instant) {
        let known = self.known.values().filter_map(|known| {
            let left = known.expires.saturating_duration_since(now);
            let seconds = u32::try_from(left.as_secs()).ok()?;
            (left > known.life / 2).then_some((known.label.as_str(), seconds))
        });
        let packets = packet::ask_for_instances(&self.service_type, known);
        self.outputs.extend(packets.into_iter().map(Output::Packet));
    }

    fn warn_full(&mut self) {
        if !std::mem::replace(&mut self.full, true) {
            let text = format!("more than {MOST_KNOWN} agents are announced; the rest is ignored");
            let warning = DiscoveryEvent::Warning(text);
            self.outputs.push_back(Output::Event(warning));
        }
    }
}

impl Known {
    fn is_over(&self, now: Instant) -> bool {
        let verify = self.verify.as_ref().map(|verify| verify.until);
        let ends = [Some(self.expires), self.leaves, verify];
        ends.into_iter().flatten().any(|end| end <= now)
    }

    /// When something is to be done about it.
    fn due(&self) -> Instant {
        let verify = self.verify.as_ref();
        let dues = [
            self.leaves,
            self.ask_text.map(|(at, _)| at),
            verify.and_then(|verify| verify.ask),
            verify.map(|verify| verify.until),
        ];
        let first = self.expires.min(self.refresh);
        dues.into_iter().flatten().fold(first, Instant::min)
    }

    /// Whether the question for all instances is due for its sake; if so, it is due again later.
    fn refresh_due(&mut self, now: Instant) -> bool {
        let due = self.refresh <= now;
        if due {
            self.refresh = now + (self.life / 20).max(Duration::from_secs(1));
        }
        due
    }

    /// Whether its TXT record is to be asked for now; if so, that is noted.
    fn text_due(&mut self, now: Instant) -> bool {
        let mut due = false;
        if let Some((at, times)) = self.ask_text
            && at <= now
        {
            due = true;
            let pause = TEXT_PAUSE * TEXT_FACTOR.pow(times + 1);
            self.ask_text = (times + 1 < TEXT_TIMES).then_some((now + pause, times + 1));
        }
        if let Some(verify) = &mut self.verify
            && verify.ask.is_some_and(|at| at <= now)
        {
            due = true;
            let again = now + VERIFY_AGAIN;
            verify.ask = (again < verify.until).then_some(again);
        }
        due
    }

    /// What its TXT record says to this host.
    fn agent(&self) -> DiscoveredAgent {
        let (instance, mut entry) = txt::read(&self.label, &self.strings);
        // Heard from another host, a loopback address would lead astray, to ourselves.
        entry.locations.retain(|location| {
            let address = location.address.parse::<Address>();
            self.on_loopback || !address.is_ok_and(|address| address.is_loopback())
        });
        DiscoveredAgent { instance, entry }
    }
}

fn gone(agent: &DiscoveredAgent) -> Output {
    Output::Event(DiscoveryEvent::AgentGone {
        name: agent.entry.name.clone(),
        instance: agent.instance,
    })
}

#[cfg(test)]
mod tests;
