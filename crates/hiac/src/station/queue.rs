//! What waits to be sent on a link: by priority, and by what is not confirmed yet.

use alloc::collections::{BTreeMap, VecDeque};
use alloc::vec::Vec;
use core::time::Duration;

use super::Purpose;
use super::types::Failure;
use crate::sys::Outcome;
use crate::{Address, Addressing, Check, Fragment, Mask, Numbered, Packet, PacketType, edcp};

/// The most fragments of a message.
const MAX_FRAGMENTS: usize = 128;

/// Packets and messages of a link.
#[derive(Debug, Default)]
pub(super) struct Queue {
    lanes: [VecDeque<Job>; 8],
    flight: Option<(usize, u64)>,
    /// The next number for each source, target and priority.
    numbers: BTreeMap<(Address, Address, usize), u8>,
    last_id: u64,
}

#[derive(Debug)]
struct Job {
    id: u64,
    purpose: Purpose,
    flying: bool,
    form: Form,
}

#[derive(Debug)]
enum Form {
    /// The octets of one packet, from PV to CHK.
    Packet(Vec<u8>),
    Message(Outgoing),
}

/// A message that becomes one packet or several.
#[derive(Debug)]
pub(super) struct Outgoing {
    pub(super) kind: PacketType,
    pub(super) confirm: bool,
    pub(super) numbered: bool,
    pub(super) full: bool,
    pub(super) check: Check,
    pub(super) source: Address,
    pub(super) target: Address,
    pub(super) mask: Option<Mask>,
    pub(super) data: Vec<u8>,
    /// The longest packet.
    pub(super) limit: usize,
    pub(super) progress: Progress,
    /// It waits until the connection with a colleague is there.
    pub(super) held: bool,
}

#[derive(Debug, Default)]
pub(super) struct Progress {
    /// How many octets of the data are done with.
    done: usize,
    index: u8,
    pending: Option<Pending>,
}

/// A packet that was sent and is not done with.
#[derive(Debug)]
struct Pending {
    octets: Vec<u8>,
    psn: u8,
    length: usize,
    last: bool,
    sendings: u32,
    due: Option<Duration>,
    again: bool,
}

/// What came of a job.
#[derive(Debug)]
pub(super) enum Done {
    /// Written, and there will be no confirmation.
    Written(Purpose),
    /// Written, and a confirmation is awaited.
    Awaited(Purpose),
    Confirmed(Purpose),
    Failed(Purpose, Failure),
}

impl Queue {
    pub(super) fn len(&self, priority: u8) -> usize {
        self.lane(priority).map_or(0, VecDeque::len)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.flight.is_none() && self.lanes.iter().all(VecDeque::is_empty)
    }

    pub(super) fn push_packet(&mut self, priority: u8, octets: Vec<u8>, purpose: Purpose) {
        self.push(priority, Form::Packet(octets), purpose);
    }

    pub(super) fn push_message(&mut self, priority: u8, message: Outgoing, purpose: Purpose) {
        self.push(priority, Form::Message(message), purpose);
    }

    fn push(&mut self, priority: u8, form: Form, purpose: Purpose) {
        self.last_id += 1;
        let id = self.last_id;
        if let Some(lane) = self.lanes.get_mut(usize::from(priority)) {
            lane.push_back(Job {
                id,
                purpose,
                flying: false,
                form,
            });
        }
    }

    fn lane(&self, priority: u8) -> Option<&VecDeque<Job>> {
        self.lanes.get(usize::from(priority))
    }

    pub(super) fn in_flight(&self) -> bool {
        self.flight.is_some()
    }

    /// The octets of the next packet on the link, if there is one and none is being written.
    pub(super) fn poll(&mut self) -> Option<Vec<u8>> {
        if self.flight.is_some() {
            return None;
        }
        for (number, lane) in self.lanes.iter_mut().enumerate() {
            let ready = (0..lane.len()).find(|at| is_ready(lane, *at));
            let Some(job) = ready.and_then(|at| lane.get_mut(at)) else {
                continue;
            };
            let octets = match &mut job.form {
                Form::Packet(packet) => edcp::escaped(packet.iter().copied()).collect(),
                Form::Message(message) => message.next_packet(number, &mut self.numbers),
            };
            job.flying = true;
            self.flight = Some((number, job.id));
            return Some(octets);
        }
        None
    }

    /// The packet is written.
    pub(super) fn transmitted(&mut self, now: Duration, patience: Duration) -> Option<Done> {
        let (number, id) = self.flight.take()?;
        let lane = self.lanes.get_mut(number)?;
        let at = lane.iter().position(|job| job.id == id)?;
        let job = lane.get_mut(at)?;
        job.flying = false;
        let Form::Message(message) = &mut job.form else {
            return lane.remove(at).map(|job| Done::Written(job.purpose));
        };
        // It was confirmed before the shell told that it is written.
        let pending = message.progress.pending.as_mut()?;
        if message.confirm {
            pending.sendings += 1;
            pending.due = Some(now + patience);
            let first = pending.last && pending.sendings == 1;
            return first.then(|| Done::Awaited(job.purpose.clone()));
        }
        if message.advance() {
            return lane.remove(at).map(|job| Done::Written(job.purpose));
        }
        None
    }

    /// A confirmation came. `None` if it belongs to nothing, or more is to be sent.
    pub(super) fn confirmed(
        &mut self,
        from: (Address, Address, u8),
        psn: u8,
        outcome: Outcome,
        limit: Option<u32>,
        reason: Option<&str>,
    ) -> Result<Option<Done>, ()> {
        let (source, target, priority) = from;
        let lane = self.lanes.get_mut(usize::from(priority)).ok_or(())?;
        let is_it = |job: &Job| match &job.form {
            Form::Packet(_) => false,
            Form::Message(message) => {
                let pending = message.progress.pending.as_ref();
                message.confirm
                    && (message.source, message.target) == (source, target)
                    && pending.is_some_and(|pending| pending.psn == psn)
            }
        };
        let at = lane.iter().position(is_it).ok_or(())?;
        let Some(Job {
            form: Form::Message(message),
            ..
        }) = lane.get_mut(at)
        else {
            return Err(());
        };
        if outcome == Outcome::ACCEPTED {
            if !message.advance() {
                return Ok(None);
            }
            return Ok(lane.remove(at).map(|job| Done::Confirmed(job.purpose)));
        }
        let smaller = limit
            .filter(|_| outcome == Outcome::TOO_LONG)
            .and_then(|limit| usize::try_from(limit).ok());
        if smaller.is_some_and(|limit| message.begin_anew(limit)) {
            return Ok(None);
        }
        let failure = Failure::Refused(outcome, reason.map(Into::into));
        Ok(lane
            .remove(at)
            .map(|job| Done::Failed(job.purpose, failure)))
    }

    pub(super) fn next_timeout(&self) -> Option<Duration> {
        let pending = self.lanes.iter().flatten().filter_map(Job::pending);
        pending.filter_map(|pending| pending.due).min()
    }

    /// Sends again what was not confirmed in time, or gives it up.
    pub(super) fn handle_timeout(&mut self, now: Duration, sendings: u32) -> Vec<Done> {
        let mut given_up = Vec::new();
        for lane in &mut self.lanes {
            lane.retain_mut(|job| {
                let Some(pending) = job.pending_mut() else {
                    return true;
                };
                if pending.due.is_none_or(|due| due > now) {
                    return true;
                }
                pending.due = None;
                pending.again = true;
                let keep = pending.sendings < sendings;
                if !keep {
                    let purpose = job.purpose.clone();
                    given_up.push(Done::Failed(purpose, Failure::Unconfirmed));
                }
                keep
            });
        }
        given_up
    }

    /// Lets go, or gives up, what waits for the connection with a colleague.
    pub(super) fn release(&mut self, colleague: Address, limit: usize) -> Vec<Done> {
        self.take(|message| {
            if message.held && message.target == colleague {
                message.held = false;
                message.limit = limit;
                return !message.fits();
            }
            false
        })
        .into_iter()
        .map(|purpose| {
            let failure = Failure::Refused(Outcome::TOO_LONG, None);
            Done::Failed(purpose, failure)
        })
        .collect()
    }

    /// What was sent to this station, or waits for it, has failed.
    pub(super) fn fail_to(
        &mut self,
        target: Address,
        unconfirmed_only: bool,
        failure: &Failure,
    ) -> Vec<Done> {
        let taken = self.take(|message| {
            let sent = message.progress.pending.is_some() && message.confirm;
            message.target == target && (sent || !unconfirmed_only)
        });
        let failed = |purpose| Done::Failed(purpose, failure.clone());
        taken.into_iter().map(failed).collect()
    }

    fn take(&mut self, mut which: impl FnMut(&mut Outgoing) -> bool) -> Vec<Purpose> {
        let mut taken = Vec::new();
        for lane in &mut self.lanes {
            lane.retain_mut(|job| {
                let take = match &mut job.form {
                    Form::Packet(_) => false,
                    Form::Message(message) => which(message),
                };
                if take {
                    taken.push(job.purpose.clone());
                }
                !take
            });
        }
        taken
    }

    /// Everything goes, with the numbers; single packets stay where what they say holds beyond
    /// the connection.
    pub(super) fn clear(&mut self, keep_packets: bool) -> Vec<Purpose> {
        self.numbers.clear();
        if !keep_packets {
            // Who is lost may never take the rest of it.
            self.flight = None;
        }
        let mut gone = Vec::new();
        for lane in &mut self.lanes {
            lane.retain(|job| {
                let keep = keep_packets && matches!(job.form, Form::Packet(_));
                if !keep {
                    gone.push(job.purpose.clone());
                }
                keep
            });
        }
        gone
    }
}

/// Whether the job at this place of its lane can be sent now.
fn is_ready(lane: &VecDeque<Job>, at: usize) -> bool {
    let Some(job) = lane.get(at) else {
        return false;
    };
    let Form::Message(message) = &job.form else {
        return true;
    };
    let pending = message.progress.pending.as_ref();
    if message.held || pending.is_some_and(|pending| !pending.again) {
        return false;
    }
    // What is numbered keeps its order.
    let before = lane.iter().take(at);
    !message.numbered
        || !before
            .filter_map(Job::numbered_to)
            .any(|to| to == message.ends())
}

impl Job {
    fn numbered_to(&self) -> Option<(Address, Address)> {
        match &self.form {
            Form::Message(message) if message.numbered => Some(message.ends()),
            _ => None,
        }
    }

    fn pending(&self) -> Option<&Pending> {
        match &self.form {
            Form::Message(message) => message.progress.pending.as_ref(),
            Form::Packet(_) => None,
        }
    }

    fn pending_mut(&mut self) -> Option<&mut Pending> {
        match &mut self.form {
            Form::Message(message) => message.progress.pending.as_mut(),
            Form::Packet(_) => None,
        }
    }
}

impl Outgoing {
    fn ends(&self) -> (Address, Address) {
        (self.source, self.target)
    }

    fn head(&self) -> usize {
        let address = match (self.full, self.mask) {
            (false, Some(mask)) => mask.level_octets(),
            _ => 4,
        };
        2 + usize::from(self.numbered) + 2 * address + self.check.octets()
    }

    /// How many octets of data a packet takes, its fragment octet aside.
    fn room(&self) -> usize {
        let rest = self.limit.saturating_sub(self.head());
        // LNG is longer for longer data; it counts the fragment octet.
        let lengths = [(1, 0x7F), (2, 0x3FFF), (3, 0x1F_FFFF)];
        let length = lengths.map(|(octets, longest)| rest.saturating_sub(octets).min(longest));
        let length = length.into_iter().max().unwrap_or(0);
        length.saturating_sub(usize::from(self.numbered))
    }

    /// Makes it numbered if it needs several packets. Whether it can be sent so.
    pub(super) fn divide(&mut self, fragments: bool) -> bool {
        self.numbered |= self.confirm;
        if self.data.len() <= self.room() {
            return true;
        }
        self.numbered = true;
        fragments && self.fits()
    }

    fn fits(&self) -> bool {
        let room = self.room();
        room > 0 && self.data.len() <= room * MAX_FRAGMENTS
    }

    fn next_packet(
        &mut self,
        lane: usize,
        numbers: &mut BTreeMap<(Address, Address, usize), u8>,
    ) -> Vec<u8> {
        if let Some(pending) = &mut self.progress.pending {
            pending.again = false;
            return pending.octets.clone();
        }
        let rest = self.data.get(self.progress.done..).unwrap_or_default();
        let length = rest.len().min(self.room());
        let last = length == rest.len();
        let psn = match self.numbered {
            true => {
                let next = numbers.entry((self.source, self.target, lane)).or_default();
                let psn = *next;
                *next = next.wrapping_add(1);
                psn
            }
            false => 0,
        };
        let packet = Packet {
            kind: self.kind,
            priority: lane as u8,
            confirm: self.confirm,
            check: self.check,
            numbered: self.numbered.then_some(Numbered {
                psn,
                fragment: Fragment {
                    index: self.progress.index,
                    more: !last,
                },
            }),
            addressing: addressing(self.target, self.source, self.mask, self.full),
            data: rest.get(..length).unwrap_or_default(),
        };
        // What cannot be written was refused when it was handed over.
        let octets: Vec<u8> = match packet.encode(self.mask) {
            Ok(encoded) => edcp::escaped(encoded.octets()).collect(),
            Err(_) => edcp::ALIVE.to_vec(),
        };
        self.progress.pending = Some(Pending {
            octets: octets.clone(),
            psn,
            length,
            last,
            sendings: 0,
            due: None,
            again: false,
        });
        octets
    }

    /// The packet is done with. Whether it was the last.
    fn advance(&mut self) -> bool {
        let Some(pending) = self.progress.pending.take() else {
            return false;
        };
        self.progress.done += pending.length;
        self.progress.index += 1;
        pending.last
    }

    /// In smaller packets. Whether they are smaller, and not too many.
    fn begin_anew(&mut self, limit: usize) -> bool {
        if limit >= self.limit {
            return false;
        }
        self.limit = limit;
        self.progress = Progress::default();
        self.fits()
    }
}

/// Levels within the subnetwork, unless whole addresses are wanted.
pub(super) fn addressing(
    target: Address,
    source: Address,
    mask: Option<Mask>,
    full: bool,
) -> Addressing {
    match mask {
        Some(mask) if !full => Addressing::Level {
            target: mask.level(target),
            source: mask.level(source),
        },
        _ => Addressing::Full { target, source },
    }
}
