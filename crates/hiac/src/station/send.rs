//! What the program sends.

use alloc::vec::Vec;
use core::time::Duration;

use super::queue::{Outgoing, Progress};
use super::rights::{self, Direction, SHORT};
use super::types::{LinkId, Options, Role, SendError, Sender, Ticket, Workgroup};
use super::{Purpose, Question, Reading, Station};
use crate::content::{BarrierOperation, MessageKind, SemaphoreOperation};
use crate::{Address, Check, Content, PacketType};

/// A way to a station.
struct Way {
    link: LinkId,
    direction: Direction,
    source: Address,
}

impl Station {
    /// What another station is to this one, and `None` if it is nothing to it or not there.
    pub fn direction(&self, target: Address) -> Option<Direction> {
        self.way(None, target).ok().map(|way| way.direction)
    }

    /// Sends something to one station; `from` is the alias that speaks, if one does.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn send(
        &mut self,
        now: Duration,
        from: Option<Address>,
        target: Address,
        content: &Content<'_>,
        options: Options,
    ) -> Result<Ticket, SendError> {
        let ticket = self.next_ticket();
        let data = Self::data_of(content).ok_or(SendError::TooLong)?;
        let purpose = Purpose::Program(ticket);
        self.send_data(now, (from, target), content.kind(), data, options, purpose)?;
        Ok(ticket)
    }

    /// Sends something to all of the own workgroup, or of the one that this station employs.
    ///
    /// # Errors
    /// If there is no such subnetwork, it is not permitted, or longer than 64 octets in a packet.
    pub fn send_to_all(
        &mut self,
        now: Duration,
        broadcast: Address,
        content: &Content<'_>,
        options: Options,
    ) -> Result<(), SendError> {
        let to = |group: &&Workgroup| {
            let all = group.mask.address(group.address, group.mask.broadcast());
            all == Some(broadcast)
        };
        if let Some(group) = self.config.workgroups.iter().find(to) {
            self.broadcast(*group, content, options);
            return Ok(());
        }
        let data = Self::data_of(content).ok_or(SendError::TooLong)?;
        let options = Options {
            confirm: false,
            ..options
        };
        let ends = (None, broadcast);
        self.send_data(now, ends, content.kind(), data, options, Purpose::Reply)
    }

    /// Sends something to all of a workgroup of this station.
    pub(super) fn broadcast(&mut self, group: Workgroup, content: &Content<'_>, options: Options) {
        let target = group.mask.address(group.address, group.mask.broadcast());
        let (Some(target), Some(data)) = (target, Self::data_of(content)) else {
            return;
        };
        let index = self.group_of(group.address).unwrap_or_default();
        let members = self.links.iter().filter(|(_, link)| {
            let member = link.role == Role::Employer && link.group == index;
            member && link.is_connected()
        });
        let members: Vec<LinkId> = members.map(|(id, _)| *id).collect();
        for link in members {
            let way = Way {
                link,
                direction: Direction::Employee,
                source: group.address,
            };
            let options = Options {
                confirm: false,
                ..options
            };
            // Who cannot take it is left out.
            let _ = self.enqueue(
                &way,
                target,
                (content.kind(), data.clone()),
                options,
                Purpose::Reply,
                SHORT,
            );
        }
    }

    /// Asks a station something; the answer comes as an event.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn question(
        &mut self,
        now: Duration,
        from: Option<Address>,
        target: Address,
        octets: &[u8],
        options: Options,
    ) -> Result<Ticket, SendError> {
        self.ask(now, from, target, MessageKind::Question, octets, options)
    }

    /// Commands something whose end is told by an answer or a warning.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn command_with_answer(
        &mut self,
        now: Duration,
        target: Address,
        octets: &[u8],
        options: Options,
    ) -> Result<Ticket, SendError> {
        self.ask(now, None, target, MessageKind::Command, octets, options)
    }

    fn ask(
        &mut self,
        now: Duration,
        from: Option<Address>,
        target: Address,
        kind: MessageKind,
        octets: &[u8],
        options: Options,
    ) -> Result<Ticket, SendError> {
        let link = self.way(from, target)?.link;
        let reference = self.free_reference(link, target).ok_or(SendError::Full)?;
        let content = Content::Message {
            kind,
            reference,
            octets,
        };
        let ticket = self.send(now, from, target, &content, options)?;
        self.questions.push(Question {
            ticket,
            target,
            reference,
            link,
            expires: now + self.config.patience,
        });
        Ok(ticket)
    }

    /// A reference that no open question to this station has: 1 to 255.
    fn free_reference(&mut self, link: LinkId, target: Address) -> Option<u8> {
        let taken = |reference: u8| {
            let questions = self.questions.iter();
            let mut to = questions.filter(|open| (open.link, open.target) == (link, target));
            to.any(|open| open.reference == reference)
        };
        let last = self.last_reference;
        let next = (1..=255_u8).map(|step| match last.checked_add(step) {
            Some(reference) => reference,
            None => last.wrapping_add(step).saturating_add(1),
        });
        let free = next.into_iter().find(|reference| !taken(*reference))?;
        self.last_reference = free;
        Some(free)
    }

    /// The asker does not want the answer any more.
    pub fn forget_question(&mut self, ticket: Ticket) {
        self.questions.retain(|question| question.ticket != ticket);
    }

    /// Answers a question, or a command with a reference; `kind` is an answer or a warning. As
    /// every reply it has the priority of what it answers, and is confirmed if that was.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn reply(
        &mut self,
        now: Duration,
        to: &Sender,
        kind: MessageKind,
        reference: u8,
        octets: &[u8],
    ) -> Result<Ticket, SendError> {
        let content = Content::Message {
            kind,
            reference,
            octets,
        };
        let alias = self.config.aliases.contains(&to.to).then_some(to.to);
        self.send(now, alias, to.address, &content, to.options)
    }

    /// Asks for octets of another station's memory.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn read(
        &mut self,
        now: Duration,
        target: Address,
        address: u32,
        length: u16,
        options: Options,
    ) -> Result<Ticket, SendError> {
        let link = self.way(None, target)?.link;
        let mut readings = self.readings.iter();
        if readings.any(|open| (open.link, open.target) == (link, target)) {
            return Err(SendError::Open);
        }
        let content = Content::Read { address, length };
        let ticket = self.send(now, None, target, &content, options)?;
        self.readings.push(Reading {
            ticket,
            target,
            address,
            link,
            expires: now + self.config.patience,
        });
        Ok(ticket)
    }

    /// Takes, gives or tests a semaphore of another station.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn semaphore_of(
        &mut self,
        now: Duration,
        keeper: Address,
        operation: SemaphoreOperation,
        number: u16,
        options: Options,
    ) -> Result<Ticket, SendError> {
        let content = Content::Semaphore { operation, number };
        self.send(now, None, keeper, &content, options)
    }

    /// Arrives at a barrier of another station, or leaves it.
    ///
    /// # Errors
    /// What can be known at once to fail, see [`SendError`].
    pub fn barrier_of(
        &mut self,
        now: Duration,
        keeper: Address,
        operation: BarrierOperation,
        number: u16,
        parties: u8,
        options: Options,
    ) -> Result<Ticket, SendError> {
        let content = Content::Barrier {
            operation,
            number,
            parties,
        };
        self.send(now, None, keeper, &content, options)
    }

    pub(super) fn send_data(
        &mut self,
        now: Duration,
        (from, target): (Option<Address>, Address),
        kind: PacketType,
        data: Vec<u8>,
        options: Options,
        purpose: Purpose,
    ) -> Result<(), SendError> {
        let way = self.way(from, target)?;
        let requested = self.transfers.is_asked(way.link);
        let all = self.is_broadcast(way.link, target);
        // What goes to all goes to the employer as well.
        let directions = match (all, way.direction) {
            (true, Direction::Colleague) => [Direction::Colleague, Direction::Employer],
            (_, direction) => [direction, direction],
        };
        let confirm = options.confirm && !all;
        let mut allowed = directions.into_iter();
        if !allowed.all(|to| rights::permitted(to, kind, &data, confirm, requested)) {
            return Err(SendError::NotPermitted);
        }
        let limit = match way.direction {
            Direction::Employer | Direction::Employee => usize::MAX,
            Direction::Subemployee => SHORT,
            Direction::Colleague if all => SHORT,
            Direction::Colleague => {
                let known = self.colleague_limit(way.link, (way.source, target));
                match (known, confirm) {
                    (Some(limit), _) => limit,
                    (None, true) => {
                        self.hold(now, &way, target, (kind, data), options, purpose)?;
                        return Ok(());
                    }
                    (None, false) => SHORT,
                }
            }
        };
        let options = Options { confirm, ..options };
        self.enqueue(&way, target, (kind, data), options, purpose, limit)
    }

    fn is_broadcast(&self, link: LinkId, target: Address) -> bool {
        let link = self.links.get(&link);
        link.is_some_and(|link| link.is_broadcast(target))
    }

    /// The longest packet for a colleague with which there is a connection.
    fn colleague_limit(&self, link: LinkId, ends: (Address, Address)) -> Option<usize> {
        match self.colleagues.get(&(link, ends)) {
            Some(super::Colleague::Connected(partner)) => Some(partner.largest),
            _ => None,
        }
    }

    /// Waits for the connection with a colleague.
    fn hold(
        &mut self,
        now: Duration,
        way: &Way,
        target: Address,
        what: (PacketType, Vec<u8>),
        options: Options,
        purpose: Purpose,
    ) -> Result<(), SendError> {
        let held = self.outgoing(way, target, what, options, SHORT)?;
        if !held.confirm {
            let what = (held.kind, held.data);
            return self.enqueue(way, target, what, options, purpose, SHORT);
        }
        let held = Outgoing { held: true, ..held };
        self.push_outgoing(way.link, options, held, purpose)?;
        self.meet_colleague(now, way.link, (way.source, target));
        Ok(())
    }

    fn enqueue(
        &mut self,
        way: &Way,
        target: Address,
        what: (PacketType, Vec<u8>),
        options: Options,
        purpose: Purpose,
        limit: usize,
    ) -> Result<(), SendError> {
        let mut message = self.outgoing(way, target, what, options, limit)?;
        let joins = self.links.get(&way.link).is_some_and(|link| {
            let joins = link.partner.joins() || way.direction == Direction::Colleague;
            joins && self.config.abilities & crate::sys::FRAGMENTS != 0
        });
        if !message.divide(joins) {
            return Err(SendError::TooLong);
        }
        self.push_outgoing(way.link, options, message, purpose)
    }

    fn outgoing(
        &self,
        way: &Way,
        target: Address,
        (kind, data): (PacketType, Vec<u8>),
        options: Options,
        limit: usize,
    ) -> Result<Outgoing, SendError> {
        let link = self.links.get(&way.link).ok_or(SendError::NoSuchTarget)?;
        let common = link.partner.checks.common(self.config.checks);
        let sum = options.sum && link.partner.checks.has(Check::Sum);
        let check = match common {
            Some(Check::Crc32) if sum => Check::Sum,
            Some(check) => check,
            None => return Err(SendError::Unsupported),
        };
        if !link.partner.types.has(kind) && kind != PacketType::SYS {
            return Err(SendError::Unsupported);
        }
        let able = link.partner.confirms() && self.config.abilities & crate::sys::NUMBERS != 0;
        let confirm = options.confirm && able;
        let near = link.has_level(target) && link.has_level(way.source);
        Ok(Outgoing {
            kind,
            confirm,
            numbered: confirm,
            full: options.full || !near,
            check,
            source: way.source,
            target,
            mask: link.mask,
            data,
            limit: limit.min(link.partner.largest),
            progress: Progress::default(),
            held: false,
        })
    }

    fn push_outgoing(
        &mut self,
        id: LinkId,
        options: Options,
        message: Outgoing,
        purpose: Purpose,
    ) -> Result<(), SendError> {
        let usual = match message.kind {
            PacketType::SYS => 0,
            PacketType::SIG => 1,
            _ => 4,
        };
        let priority = options.priority.unwrap_or(usual).min(7);
        let limit = self.config.queue;
        let link = self.links.get_mut(&id).ok_or(SendError::NoSuchTarget)?;
        if link.queue.len(priority) >= limit {
            return Err(SendError::Full);
        }
        link.queue.push_message(priority, message, purpose);
        Ok(())
    }

    /// The way to a station, for this one or an alias.
    fn way(&self, from: Option<Address>, target: Address) -> Result<Way, SendError> {
        if let Some(alias) = from {
            return self.way_of_alias(alias, target);
        }
        if let Some((id, link)) = self.up.and_then(|up| Some((up, self.links.get(&up)?))) {
            let up = |direction| Way {
                link: id,
                direction,
                source: link.local,
            };
            if target == link.peer {
                return Ok(up(Direction::Employer));
            }
            if link.has_level(target) && target != link.local {
                return Ok(up(Direction::Colleague));
            }
        }
        if let Some((id, link)) = self
            .way_down(target)
            .and_then(|id| Some((id, self.links.get(&id)?)))
        {
            let direct = link.peer == target;
            return Ok(Way {
                link: id,
                direction: if direct {
                    Direction::Employee
                } else {
                    Direction::Subemployee
                },
                source: link.local,
            });
        }
        match self.own_block_holds(target) && Some(target) != self.address {
            true => Err(SendError::NoSuchTarget),
            false => Err(SendError::NotPermitted),
        }
    }

    fn way_of_alias(&self, alias: Address, target: Address) -> Result<Way, SendError> {
        if !self.config.aliases.contains(&alias) {
            return Err(SendError::NotPermitted);
        }
        let id = self.way_down(target).ok_or(SendError::NoSuchTarget)?;
        let link = self.links.get(&id).ok_or(SendError::NoSuchTarget)?;
        match link.peer == target && link.is_within(alias) {
            true => Ok(Way {
                link: id,
                direction: Direction::Colleague,
                source: alias,
            }),
            false => Err(SendError::NotPermitted),
        }
    }
}
