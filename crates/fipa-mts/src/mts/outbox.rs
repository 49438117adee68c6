//! Letters for robots that are known but away: they wait, are stored shortly before their deadline,
//! and are sent when their receiver is there again, under its name, wherever that is.
//!
//! ```text
//!   away ──▶ waits in order ──(deadline is near)──▶ Store ──(durable, deadline)──▶ `timeout: stored …`
//!              │                                      │                               │
//!              ╰─────── the receiver is back: sent in order, a few at a time ◀────────╯
//!                         │ delivered: Unstore                 │ refused, too old, reply-by: dropped,
//!                         ▼                                    ▼ and its sender is told
//! ```
//!
//! Nothing is told to be stored before it is, and what is not stored is not sent again once its
//! sender was told `timeout`. A stored letter is sent until a receipt comes, over a crash of this
//! service too; [`late`](super::late) at the other end keeps it from being delivered again.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_codec::{bit_efficient, decode_payload};
use fipa_directory::{InstanceId, Now, Source, State};
use fipa_link::{Outcome, ReceiverOutcome};
use smallvec::smallvec;

use super::deliveries::{Delivery, Origin, Target};
use super::neighbours::owner_of;
use super::routing::{Route, Terms};
use super::{Mts, Timer};
use crate::machine::{Notice, Output, REPLY_BY, is_full};
use crate::{OutboxConfig, StoredLetter, Urgency};

/// Storing begins so long before the deadline, so that a slow disk is done by then; and for letters
/// that wait shorter, after half of their time.
const AHEAD: Duration = Duration::from_secs(2);

/// How long after its deadline a letter waits for the disk. A program gives its daemon 500 ms more
/// than itself.
const DISK_PATIENCE: Duration = Duration::from_millis(400);

/// Letters for one receiver under way at once. The next ones wait for receipts, so that a robot that
/// comes back is not run over.
const WINDOW: usize = 8;

/// How long the receipt of a stored letter is waited for.
const SENDING: Duration = Duration::from_secs(30);

/// The pause before a letter is tried again that did not arrive though its receiver seemed there.
const PAUSE: Duration = Duration::from_secs(5);

/// What the reason of a `timeout` begins with where the letter is stored.
const STORED: &str = "stored";

/// Letters that wait and are not stored, at most.
const MAX_WAITING: usize = 10_000;

/// The letters for robots that are away.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    /// The greatest key of an earlier run. A letter's key is this and the number of its delivery:
    /// keys are in the order in which letters came.
    base: u64,
    boxes: HashMap<Text, BTreeSet<u64>>,
    items: BTreeMap<u64, Item>,
    /// Letters and octets that are stored, by peer.
    peers: HashMap<Text, (usize, usize)>,
    /// Octets that are stored.
    octets: usize,
    /// Letters that are not stored, and their octets.
    waiting: (usize, usize),
    /// Receivers that may be sent something.
    due: VecDeque<Text>,
    running: bool,
    ticking: bool,
}

/// A letter in the outbox.
#[derive(Debug)]
struct Item {
    to: Text,
    size: usize,
    /// The delivery that waits with it or carries it.
    delivery: Option<u64>,
    /// It is on its way, or queued for a link.
    sending: bool,
    /// It went out, in this run or perhaps in an earlier one, and no receipt came: somebody may have
    /// it.
    went_out: bool,
    /// It is not tried again before.
    not_before: Duration,
    /// What was handed to the disk.
    kept: Option<Kept>,
    /// Why it cannot be stored.
    refusal: Option<Text>,
}

#[derive(Debug)]
struct Kept {
    letter: StoredLetter,
    durable: bool,
    /// Its sender was told that it is stored.
    told: bool,
}

impl Item {
    fn is_told(&self) -> bool {
        self.kept.as_ref().is_some_and(|kept| kept.told)
    }
}

impl Outbox {
    /// Whether letters for this receiver wait.
    pub(super) fn has(&self, name: &Text) -> bool {
        self.boxes.contains_key(name)
    }

    fn add(&mut self, key: u64, item: Item) {
        self.boxes.entry(item.to.clone()).or_default().insert(key);
        self.waiting.0 += 1;
        self.waiting.1 += item.size;
        self.items.insert(key, item);
    }

    /// Counts a letter as stored.
    fn keep(&mut self, key: u64, kept: Kept) {
        let Some(item) = self.items.get_mut(&key) else {
            return;
        };
        let (letters, octets) = self.peers.entry(kept.letter.peer.clone()).or_default();
        *letters += 1;
        *octets += item.size;
        self.octets += item.size;
        self.waiting.0 -= 1;
        self.waiting.1 -= item.size;
        item.kept = Some(kept);
    }

    /// Counts a letter as not stored any more.
    fn unkeep(&mut self, key: u64) -> Option<Kept> {
        let item = self.items.get_mut(&key)?;
        let kept = item.kept.take()?;
        let peer = &kept.letter.peer;
        if let Some((letters, octets)) = self.peers.get_mut(peer) {
            *letters -= 1;
            *octets -= item.size;
            if *letters == 0 {
                self.peers.remove(peer);
            }
        }
        self.octets -= item.size;
        self.waiting.0 += 1;
        self.waiting.1 += item.size;
        Some(kept)
    }

    fn remove(&mut self, key: u64) -> Option<(Text, Option<Kept>)> {
        let kept = self.unkeep(key);
        let item = self.items.remove(&key)?;
        self.waiting.0 -= 1;
        self.waiting.1 -= item.size;
        if let Some(letters) = self.boxes.get_mut(&item.to) {
            letters.remove(&key);
            if letters.is_empty() {
                self.boxes.remove(&item.to);
            }
        }
        Some((item.to, kept))
    }

    /// Why a letter of this size for this peer is not stored.
    fn refusal(&self, config: &OutboxConfig, peer: &Text, size: usize) -> Option<String> {
        let (letters, octets) = self.peers.get(peer).copied().unwrap_or_default();
        if letters >= config.letters {
            Some(format!(
                "{letters} letters for its robot are stored already"
            ))
        } else if octets + size > config.octets {
            Some(format!("{octets} octets for its robot are stored already"))
        } else if self.octets + size > config.total_octets {
            Some(format!("{} octets are stored already", self.octets))
        } else {
            None
        }
    }

    /// The first letter for a receiver that may be sent now.
    fn next(&self, now: Now, name: &Text) -> Option<u64> {
        let mut under_way = 0;
        for key in self.boxes.get(name)? {
            let item = self.items.get(key)?;
            if item.sending {
                under_way += 1;
            } else {
                return (under_way < WINDOW && item.not_before <= now.mono).then_some(*key);
            }
        }
        None
    }
}

impl Mts {
    /// How many letters wait in the store, or are on their way out of it.
    pub fn letters_stored(&self) -> usize {
        let items = self.outbox.items.values();
        items.filter(|item| item.is_told()).count()
    }

    /// What an earlier run has stored. To be called before anything else is.
    pub fn restore(&mut self, now: Now, letters: Vec<StoredLetter>) {
        for letter in letters {
            let (key, to) = (letter.key, letter.to.clone());
            self.outbox.base = self.outbox.base.max(key);
            let item = Item {
                to,
                size: letter.octets.len(),
                delivery: None,
                sending: false,
                went_out: true,
                not_before: Duration::ZERO,
                kept: None,
                refusal: None,
            };
            self.outbox.add(key, item);
            let kept = Kept {
                letter,
                durable: true,
                told: true,
            };
            self.outbox.keep(key, kept);
        }
        self.outbox_timeout(now);
    }

    /// A letter of [`Output::Store`] is safe now, or cannot be stored, and why.
    pub fn stored(&mut self, now: Now, key: u64, result: Result<(), Text>) {
        let Some(item) = self.outbox.items.get_mut(&key) else {
            return;
        };
        let delivery = item.delivery;
        match (result, &mut item.kept) {
            (Ok(()), Some(kept)) => kept.durable = true,
            (Ok(()), None) => return,
            (Err(reason), _) => {
                let to = item.to.clone();
                item.refusal = Some(reason.clone());
                self.outbox.unkeep(key);
                self.notice(Notice::NotStored { to, reason });
            }
        }
        let late = |id: &u64| {
            let delivery = self.deliveries.get(id);
            delivery.is_some_and(|delivery| delivery.deadline <= now.mono)
        };
        if let Some(id) = delivery.filter(late) {
            self.delivery_timeout(now, id);
        }
    }

    /// Whether a letter for this name is for a robot that is known but away.
    pub(super) fn is_away(&self, now: Now, name: &Text) -> bool {
        if self.config.outbox.is_none() {
            return false;
        }
        match self.route_to(name) {
            Some(Route::Peer(instance)) => !self.is_there(instance),
            Some(_) => false,
            None => {
                let gone = self.directory.tombstone(now, name);
                let of_peer = gone.is_some_and(|gone| {
                    gone.source != Source::Local && gone.owner != owner_of(name)
                });
                of_peer || self.outbox.has(name)
            }
        }
    }

    fn is_there(&self, instance: InstanceId) -> bool {
        let peer = self.peers.get(instance);
        peer.is_some_and(|peer| peer.state == State::Alive && !peer.links.is_empty())
    }

    /// When a copy with this deadline is looked at first.
    pub(super) fn first_look(&self, deadline: Duration, timeout: Duration) -> Duration {
        match self.config.outbox {
            Some(_) => deadline - AHEAD.min(timeout / 2),
            None => deadline,
        }
    }

    /// Puts a copy behind those that wait for the same receiver.
    pub(super) fn wait_for_robot(&mut self, now: Now, id: u64) {
        let Some((to, size)) = self.receiver_of(id) else {
            return;
        };
        let (letters, octets) = self.outbox.waiting;
        let full = letters >= MAX_WAITING || octets + size > self.config.queue_octets;
        let is_new = !self.outbox.items.contains_key(&(self.outbox.base + id));
        if is_new && full {
            let reason = Text::from(format!("{to} is away, and too many letters wait"));
            self.finish(now, id, Outcome::Refused, reason);
            return;
        }
        self.put_into_outbox(id, false);
        self.run_outbox(now, &to);
    }

    fn put_into_outbox(&mut self, id: u64, sending: bool) {
        let key = self.outbox.base + id;
        let delivery = self.deliveries.get(&id);
        let went_out = delivery.is_some_and(Delivery::was_written);
        if let Some(item) = self.outbox.items.get_mut(&key) {
            item.sending = sending;
            item.went_out |= went_out;
        } else if let Some((to, size)) = self.receiver_of(id) {
            let item = Item {
                to,
                size,
                delivery: Some(id),
                sending,
                went_out,
                not_before: Duration::ZERO,
                kept: None,
                refusal: None,
            };
            self.outbox.add(key, item);
        }
        if let Some(delivery) = self.deliveries.get_mut(&id)
            && !sending
        {
            delivery.take_back();
            delivery.target = Target::Away;
        }
    }

    /// A copy has no way to its receiver. It waits if that one is away; else this is its outcome.
    pub(super) fn wait_or_finish(&mut self, now: Now, id: u64, outcome: Outcome, reason: Text) {
        if self.may_wait(now, id) {
            self.wait_for_robot(now, id);
        } else {
            self.finish(now, id, outcome, reason);
        }
    }

    /// Whether a copy is one for a robot that is away, and may be sent again. One that was written
    /// and is not wanted after its deadline may not: nobody could say that it has expired.
    pub(super) fn may_wait(&self, now: Now, id: u64) -> bool {
        let delivery = self.deliveries.get(&id);
        let once = delivery.is_none_or(|d| d.expires && d.was_written());
        let name = self.receiver_of(id).map(|(name, _)| name);
        !once && !self.is_from_outbox(id) && name.is_some_and(|name| self.is_away(now, &name))
    }

    /// The deadline of a copy is near: it is stored if its receiver is away.
    pub(super) fn look_ahead(&mut self, now: Now, id: u64) {
        let Some(delivery) = self.deliveries.get(&id) else {
            return;
        };
        let deadline = delivery.deadline;
        self.set_timer_of(id, deadline);
        self.store(now, id);
    }

    /// Begins to store a copy; whether that is under way.
    fn store(&mut self, now: Now, id: u64) -> bool {
        let Some(config) = self.config.outbox.clone() else {
            return false;
        };
        let Some(delivery) = self.deliveries.get(&id) else {
            return false;
        };
        let queued = matches!(delivery.target, Target::Peer(_));
        let waits = queued || delivery.target == Target::Away;
        if delivery.expires || !waits || !self.may_wait(now, id) {
            return false;
        }
        let octets = Bytes::from(delivery.parts.concat());
        self.put_into_outbox(id, queued);
        let key = self.outbox.base + id;
        let Some(item) = self.outbox.items.get_mut(&key) else {
            return false;
        };
        if item.kept.is_some() || item.refusal.is_some() {
            return item.kept.is_some();
        }
        let to = item.to.detached();
        let peer = self.platform_of(now, &to);
        if let Some(reason) = self.outbox.refusal(&config, &peer, octets.len()) {
            if let Some(item) = self.outbox.items.get_mut(&key) {
                item.refusal = Some(Text::from(reason));
            }
            return false;
        }
        let reply_by = self.reply_by(now, &octets);
        let letter = StoredLetter {
            key,
            to,
            peer,
            since: now.unix_millis,
            reply_by,
            octets,
        };
        self.outputs.push_back(Output::Store(letter.clone()));
        let kept = Kept {
            letter,
            durable: false,
            told: false,
        };
        self.outbox.keep(key, kept);
        self.tick_outbox(now);
        true
    }

    /// The name of the platform that a receiver was on last.
    fn platform_of(&self, now: Now, name: &Text) -> Text {
        let record = self.directory.find(name);
        let record = record.or_else(|| self.directory.tombstone(now, name));
        match record {
            Some(record) => self.peer_name(record.owner).detached(),
            None => {
                let stored = self.outbox.boxes.get(name).into_iter().flatten();
                let mut kept = stored.filter_map(|key| self.outbox.items.get(key)?.kept.as_ref());
                let peer = kept.next().map(|kept| kept.letter.peer.clone());
                peer.unwrap_or_else(|| name.clone())
            }
        }
    }

    /// Until when a letter is wanted, as its message says.
    fn reply_by(&self, now: Now, octets: &Bytes) -> Option<i64> {
        let limits = &self.config.limits;
        let (envelope, at) = bit_efficient::decode_envelope(octets, limits).ok()?;
        let message = decode_payload(&envelope, &octets.slice(at..), limits).ok()?;
        Some(message.reply_by?.resolve(now.unix_millis))
    }

    /// The deadline of a copy has passed: whether its sender is told that it is stored, now or as
    /// soon as it is.
    pub(super) fn is_kept_for_later(&mut self, now: Now, id: u64) -> bool {
        let Some(deadline) = self.deliveries.get(&id).map(|delivery| delivery.deadline) else {
            return false;
        };
        let key = self.outbox.base + id;
        let item = self.outbox.items.get(&key);
        match item.and_then(|item| item.kept.as_ref()) {
            Some(kept) if kept.told => return false,
            Some(kept) if kept.durable => {
                self.tell_stored(now, id, key);
                return true;
            }
            Some(_) => {}
            None => {
                if !self.store(now, id) {
                    return false;
                }
            }
        }
        let patience = deadline + DISK_PATIENCE;
        if now.mono < patience {
            self.set_timer_of(id, patience);
            return true;
        }
        if let Some(item) = self.outbox.items.get_mut(&key) {
            item.refusal = Some(Text::from_static("the disk is too slow"));
        }
        false
    }

    fn tell_stored(&mut self, now: Now, id: u64, key: u64) {
        let Some(item) = self.outbox.items.get_mut(&key) else {
            return;
        };
        let to = item.to.clone();
        if let Some(kept) = &mut item.kept {
            kept.told = true;
        }
        let age = self.config.outbox.as_ref().map_or(0, |o| o.age.as_secs());
        let reason = Text::from(format!(
            "{STORED}: {to} is away; the letter is sent when it is there again, within {age} s"
        ));
        let goes_on = self.deliveries.get(&id).map(|delivery| delivery.target);
        let goes_on = matches!(goes_on, Some(Target::Peer(_) | Target::Program(_)));
        let new = goes_on.then(|| self.open_pending(Origin::Outbox(key), &[to], Text::clone));
        let Some(delivery) = self.deliveries.get_mut(&id) else {
            return;
        };
        let (pending, slot, via) = (delivery.pending, delivery.slot, delivery.via.clone());
        if let Some(new) = new {
            // A link has it already, in its place among the others.
            (delivery.pending, delivery.slot) = (new, 0);
            delivery.deadline = now.mono + SENDING;
            self.set_timer_of(id, now.mono + SENDING);
        } else {
            let ended = self.deliveries.remove(&id);
            if let Some(ended) = ended {
                self.forget_waiting(now, id, &ended);
            }
            if let Some(item) = self.outbox.items.get_mut(&key) {
                item.delivery = None;
            }
        }
        self.settle(now, pending, slot, Outcome::Timeout, via, reason);
    }

    /// Whether a receiver gets the letter later, or its sender will be told that it does not.
    pub(super) fn is_stored(told: &ReceiverOutcome) -> bool {
        told.outcome == Outcome::Timeout && told.reason.starts_with(STORED)
    }

    /// Why a letter that waited for a robot was not stored.
    pub(super) fn away_reason(&self, id: u64) -> String {
        let item = self.outbox.items.get(&(self.outbox.base + id));
        let to = item.map(|item| item.to.as_str()).unwrap_or_default();
        match item.and_then(|item| item.refusal.as_ref()) {
            Some(refusal) => format!("{to} is away, and the letter could not be stored: {refusal}"),
            None => format!("{to} is away"),
        }
    }

    /// A copy has its outcome, which its sender is told: it is not kept any longer.
    pub(super) fn outbox_forgets(&mut self, now: Now, id: u64) {
        let key = self.outbox.base + id;
        let item = self.outbox.items.get(&key);
        if item.is_none_or(Item::is_told) {
            return;
        }
        self.remove_from_outbox(now, key);
    }

    fn remove_from_outbox(&mut self, now: Now, key: u64) {
        let Some((to, kept)) = self.outbox.remove(key) else {
            return;
        };
        if kept.is_some() {
            self.outputs.push_back(Output::Unstore(key));
        }
        self.run_outbox(now, &to);
    }

    /// What became of a letter that was sent out of the store.
    pub(super) fn outbox_told(&mut self, now: Now, key: u64, outcomes: &[ReceiverOutcome]) {
        let Some(item) = self.outbox.items.get_mut(&key) else {
            return;
        };
        (item.delivery, item.sending) = (None, false);
        item.not_before = now.mono + PAUSE;
        let Some(told) = outcomes.first() else {
            return;
        };
        match told.outcome {
            Outcome::Delivered | Outcome::Sent => {
                self.remove_from_outbox(now, key);
            }
            // Its receiver does not read; it may yet.
            Outcome::Refused if is_full(told) => self.tick_outbox(now),
            Outcome::Refused | Outcome::Expired => self.drop_stored(now, key, &told.reason),
            // It was away again before it said that it has it.
            Outcome::Timeout => {
                item.went_out = true;
                self.tick_outbox(now);
            }
            Outcome::Unknown => self.tick_outbox(now),
        }
    }

    /// Gives a stored letter up, and says so.
    fn drop_stored(&mut self, now: Now, key: u64, reason: &str) {
        let item = self.outbox.items.get(&key);
        let outcome = match item.is_some_and(|item| item.went_out) {
            true => Outcome::Timeout,
            false => Outcome::Refused,
        };
        let Some((to, Some(kept))) = self.outbox.remove(key) else {
            return;
        };
        self.stored_letter_dropped(now, kept.letter, outcome, Text::from(reason));
        self.run_outbox(now, &to);
    }

    /// Sends what waits for a receiver, if that is there.
    pub(super) fn run_outbox(&mut self, now: Now, name: &Text) {
        if !self.outbox.has(name) {
            return;
        }
        self.outbox.due.push_back(name.clone());
        if std::mem::replace(&mut self.outbox.running, true) {
            return;
        }
        while let Some(name) = self.outbox.due.pop_front() {
            while self.send_next(now, &name) {}
        }
        self.outbox.running = false;
    }

    /// A peer is there again: sends what waits for its agents.
    pub(super) fn run_whole_outbox(&mut self, now: Now) {
        let mut names: Vec<Text> = self.outbox.boxes.keys().cloned().collect();
        names.sort();
        names.iter().for_each(|name| self.run_outbox(now, name));
    }

    fn send_next(&mut self, now: Now, name: &Text) -> bool {
        let there = match self.route_to(name) {
            Some(Route::Peer(instance)) => self.is_there(instance),
            Some(Route::Program(_) | Route::Mailbox) => true,
            _ => false,
        };
        if !there || self.closing {
            return false;
        }
        let Some(key) = self.outbox.next(now, name) else {
            return false;
        };
        let Some(item) = self.outbox.items.get_mut(&key) else {
            return false;
        };
        item.sending = true;
        item.went_out |= item.delivery.is_some();
        match (item.delivery, &item.kept) {
            (Some(id), _) => self.reroute(now, id),
            (None, Some(kept)) => {
                let letter = kept.letter.clone();
                self.send_stored(now, key, letter);
            }
            (None, None) => {}
        }
        true
    }

    fn send_stored(&mut self, now: Now, key: u64, letter: StoredLetter) {
        let left = letter.reply_by.map(|at| at - now.unix_millis);
        let Ok(left) = left.map(u64::try_from).transpose() else {
            return self.drop_stored(now, key, REPLY_BY);
        };
        let left = left.map(Duration::from_millis);
        let envelope = bit_efficient::decode_envelope(&letter.octets, &self.config.limits);
        let envelope = envelope.map(|(envelope, _)| envelope).unwrap_or_default();
        let terms = Terms {
            expires: left.is_some_and(|left| left <= SENDING),
            sender: envelope
                .from()
                .map(|from| from.name.detached())
                .unwrap_or_default(),
            urgency: Urgency::of(&envelope),
            ..Terms::within(left.unwrap_or(SENDING).min(SENDING))
        };
        let pending = self.open_pending(Origin::Outbox(key), &[letter.to], Text::clone);
        let id = self.id();
        let parts = smallvec![letter.octets];
        self.add_delivery(now, (id, pending, 0), Target::Away, parts, None, &terms);
        if let Some(item) = self.outbox.items.get_mut(&key) {
            item.delivery = Some(id);
            item.went_out = true;
        }
        self.reroute(now, id);
    }

    pub(super) fn tick_outbox(&mut self, now: Now) {
        if !std::mem::replace(&mut self.outbox.ticking, true) {
            self.timer(now.mono + PAUSE, Timer::Outbox);
        }
    }

    /// Drops what nobody wants any more, and tries again what did not arrive.
    pub(super) fn outbox_timeout(&mut self, now: Now) {
        self.outbox.ticking = false;
        let age = self.config.outbox.as_ref().map(|outbox| outbox.age);
        let age = age.map_or(0, |age| i64::try_from(age.as_millis()).unwrap_or(i64::MAX));
        let mut overdue = Vec::new();
        for (key, item) in &self.outbox.items {
            let Some(kept) = item.kept.as_ref().filter(|k| k.told && !item.sending) else {
                continue;
            };
            let StoredLetter {
                since, reply_by, ..
            } = kept.letter;
            if reply_by.is_some_and(|at| at <= now.unix_millis) {
                overdue.push((*key, REPLY_BY.to_owned()));
            } else if since.saturating_add(age) <= now.unix_millis {
                let reason = format!("{} was away for longer than {} s", item.to, age / 1000);
                overdue.push((*key, reason));
            }
        }
        for (key, reason) in overdue {
            self.drop_stored(now, key, &reason);
        }
        self.tell_all_dropped(now);
        self.run_whole_outbox(now);
        if !self.outbox.items.is_empty() {
            self.tick_outbox(now);
        }
    }
}
