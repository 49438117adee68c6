//! What a station keeps for others: semaphores, memory, barriers.

use alloc::collections::{BTreeMap, VecDeque};
use alloc::vec::Vec;
use core::time::Duration;

use super::rights::Direction;
use super::types::{Event, Options, Rights, Sender};
use super::{Party, Purpose, Station};
use crate::content::{BarrierOperation, SemaphoreOperation};
use crate::sys::Outcome;
use crate::{Address, Content, PacketType};

/// Stations that wait at one semaphore, and barriers that are set up.
const MAX_WAITING: usize = 64;
const MAX_BARRIERS: usize = 256;

/// Those that are taken.
#[derive(Debug, Default)]
pub(super) struct Semaphores {
    taken: BTreeMap<u16, Semaphore>,
    replies: VecDeque<Reply>,
}

#[derive(Debug)]
struct Semaphore {
    holder: Party,
    waiting: VecDeque<Party>,
}

/// Those that are set up.
#[derive(Debug, Default)]
pub(super) struct Barriers(BTreeMap<u16, Barrier>);

#[derive(Debug)]
struct Barrier {
    parties: u8,
    arrived: Vec<Party>,
}

/// What goes out behind the confirmation.
#[derive(Debug)]
struct Reply {
    to: Party,
    kind: PacketType,
    data: Vec<u8>,
    purpose: Purpose,
}

fn party(from: &Sender) -> Party {
    Party {
        link: from.link,
        address: from.address,
        options: from.options,
    }
}

impl Rights {
    /// Whether those to which the station stands in this direction have them.
    fn has(self, direction: Direction) -> bool {
        match direction {
            Direction::Employee => self.employer,
            Direction::Colleague => self.colleagues,
            Direction::Employer => self.employees,
            Direction::Subemployee => false,
        }
    }
}

impl Station {
    fn is_alias(&self, address: Address) -> bool {
        self.config.aliases.contains(&address)
    }

    pub(super) fn semaphore(
        &mut self,
        from: Sender,
        operation: SemaphoreOperation,
        number: u16,
    ) -> Outcome {
        if number >= self.config.semaphores || self.is_alias(from.to) {
            return Outcome::NO_SUCH_TARGET;
        }
        let asker = party(&from);
        match operation {
            SemaphoreOperation::Take => self.take(asker, number),
            SemaphoreOperation::Give => self.give(&asker, number),
            _ => {
                let taken = self.semaphores.taken.contains_key(&number);
                let state = match taken {
                    true => SemaphoreOperation::Taken,
                    false => SemaphoreOperation::Free,
                };
                self.say_semaphore(asker, state, number, Purpose::Reply);
                Outcome::ACCEPTED
            }
        }
    }

    fn take(&mut self, asker: Party, number: u16) -> Outcome {
        let Some(semaphore) = self.semaphores.taken.get_mut(&number) else {
            self.grant(asker, number, VecDeque::new());
            return Outcome::ACCEPTED;
        };
        if semaphore.holder.is(&asker) {
            let grant = Purpose::Grant { number, to: asker };
            self.say_semaphore(asker, SemaphoreOperation::Granted, number, grant);
            return Outcome::ACCEPTED;
        }
        if !semaphore.waiting.iter().any(|other| other.is(&asker)) {
            if semaphore.waiting.len() >= MAX_WAITING {
                return Outcome::REFUSED;
            }
            semaphore.waiting.push_back(asker);
        }
        self.say_semaphore(asker, SemaphoreOperation::Waiting, number, Purpose::Reply);
        Outcome::ACCEPTED
    }

    fn grant(&mut self, holder: Party, number: u16, waiting: VecDeque<Party>) {
        let semaphore = Semaphore { holder, waiting };
        self.semaphores.taken.insert(number, semaphore);
        let grant = Purpose::Grant { number, to: holder };
        self.say_semaphore(holder, SemaphoreOperation::Granted, number, grant);
    }

    fn give(&mut self, asker: &Party, number: u16) -> Outcome {
        let Some(semaphore) = self.semaphores.taken.get_mut(&number) else {
            return Outcome::REFUSED;
        };
        if semaphore.holder.is(asker) {
            self.grant_next(number);
            return Outcome::ACCEPTED;
        }
        let before = semaphore.waiting.len();
        semaphore.waiting.retain(|other| !other.is(asker));
        match semaphore.waiting.len() < before {
            true => Outcome::ACCEPTED,
            false => Outcome::REFUSED,
        }
    }

    fn grant_next(&mut self, number: u16) {
        if let Some(mut semaphore) = self.semaphores.taken.remove(&number)
            && let Some(next) = semaphore.waiting.pop_front()
        {
            self.grant(next, number, semaphore.waiting);
        }
    }

    /// The holder did not confirm its grant.
    pub(super) fn give_up(&mut self, now: Duration, number: u16, holder: &Party) {
        self.take_back(number, holder);
        self.send_replies(now);
    }

    fn take_back(&mut self, number: u16, holder: &Party) {
        let semaphore = self.semaphores.taken.get(&number);
        if semaphore.is_some_and(|semaphore| semaphore.holder.is(holder)) {
            self.grant_next(number);
        }
    }

    /// Somebody is lost: it has given what it held, and waits nowhere.
    pub(super) fn forget_party(&mut self, now: Duration, lost: impl Fn(&Party) -> bool) {
        let mut free = Vec::new();
        for (number, semaphore) in &mut self.semaphores.taken {
            semaphore.waiting.retain(|party| !lost(party));
            if lost(&semaphore.holder) {
                free.push(*number);
            }
        }
        for number in free {
            self.grant_next(number);
        }
        for barrier in self.barriers.0.values_mut() {
            barrier.arrived.retain(|party| !lost(party));
        }
        self.send_replies(now);
    }

    fn say_semaphore(
        &mut self,
        to: Party,
        operation: SemaphoreOperation,
        number: u16,
        purpose: Purpose,
    ) {
        self.answer(to, &Content::Semaphore { operation, number }, purpose);
    }

    fn answer(&mut self, to: Party, content: &Content<'_>, purpose: Purpose) {
        if let Some(data) = Self::data_of(content) {
            self.semaphores.replies.push_back(Reply {
                to,
                kind: content.kind(),
                data,
                purpose,
            });
        }
    }

    /// Sends what waits behind a confirmation.
    pub(super) fn send_replies(&mut self, now: Duration) {
        while let Some(reply) = self.semaphores.replies.pop_front() {
            let Reply {
                to,
                kind,
                data,
                purpose,
            } = reply;
            let ends = (None, to.address);
            let grant = purpose.clone();
            let sent = self.send_data(now, ends, kind, data, to.options, purpose);
            if let (Err(_), Purpose::Grant { number, to }) = (sent, grant) {
                self.take_back(number, &to);
            }
        }
        self.begin_transfer(now);
    }

    /// The region that holds all of a range, and where the range is in it.
    fn region(&self, address: u32, length: usize) -> Option<(usize, core::ops::Range<usize>)> {
        let found = |(at, region): (usize, &super::Region)| {
            let offset = usize::try_from(address.checked_sub(region.address)?).ok()?;
            let end = offset.checked_add(length)?;
            (end <= region.octets.len()).then_some((at, offset..end))
        };
        self.config.memory.iter().enumerate().find_map(found)
    }

    pub(super) fn read_memory(&mut self, from: Sender, address: u32, length: u16) -> Outcome {
        let place = self.region(address, length.into());
        let Some((at, range)) = place.filter(|_| !self.is_alias(from.to)) else {
            return Outcome::NO_SUCH_TARGET;
        };
        let Some(region) = self.config.memory.get(at) else {
            return Outcome::NO_SUCH_TARGET;
        };
        if !region.read.has(from.direction) {
            return Outcome::NOT_PERMITTED;
        }
        let octets = region.octets.get(range).unwrap_or_default().to_vec();
        let octets = &octets;
        self.answer(
            party(&from),
            &Content::Write { address, octets },
            Purpose::Reply,
        );
        Outcome::ACCEPTED
    }

    pub(super) fn write_memory(&mut self, from: Sender, address: u32, octets: &[u8]) -> Outcome {
        let place = self.region(address, octets.len());
        let Some((at, range)) = place.filter(|_| !self.is_alias(from.to)) else {
            return Outcome::NO_SUCH_TARGET;
        };
        let Some(region) = self.config.memory.get_mut(at) else {
            return Outcome::NO_SUCH_TARGET;
        };
        if !region.write.has(from.direction) {
            return Outcome::NOT_PERMITTED;
        }
        if let Some(place) = region.octets.get_mut(range) {
            place.copy_from_slice(octets);
        }
        self.events.push_back(Event::MemoryWritten {
            by: from.address,
            address,
            length: octets.len(),
        });
        Outcome::ACCEPTED
    }

    pub(super) fn barrier(
        &mut self,
        from: Sender,
        operation: BarrierOperation,
        number: u16,
        parties: u8,
    ) -> Outcome {
        if self.is_alias(from.to) {
            return Outcome::NO_SUCH_TARGET;
        }
        let asker = party(&from);
        let barriers = &mut self.barriers.0;
        if operation == BarrierOperation::Leave {
            return match barriers.get_mut(&number) {
                Some(barrier) => {
                    barrier.arrived.retain(|other| !other.is(&asker));
                    Outcome::ACCEPTED
                }
                None => Outcome::NO_SUCH_TARGET,
            };
        }
        let room = barriers.len() < MAX_BARRIERS;
        let barrier = match (parties, barriers.get_mut(&number)) {
            (1, _) => return Outcome::MALFORMED,
            (0, None) => return Outcome::NO_SUCH_TARGET,
            (0, Some(barrier)) => barrier,
            (parties, Some(barrier)) if parties == barrier.parties => barrier,
            (_, Some(_)) => return Outcome::REFUSED,
            (_, None) if !room => return Outcome::REFUSED,
            (parties, None) => barriers.entry(number).or_insert(Barrier {
                parties,
                arrived: Vec::new(),
            }),
        };
        if !barrier.arrived.iter().any(|other| other.is(&asker)) {
            barrier.arrived.push(asker);
        }
        if barrier.arrived.len() < usize::from(barrier.parties) {
            return Outcome::ACCEPTED;
        }
        let (parties, arrived) = (barrier.parties, core::mem::take(&mut barrier.arrived));
        let release = Content::Barrier {
            operation: BarrierOperation::Release,
            number,
            parties,
        };
        for party in arrived {
            let options = Options {
                confirm: true,
                ..party.options
            };
            self.answer(Party { options, ..party }, &release, Purpose::Reply);
        }
        Outcome::ACCEPTED
    }
}
