//! Packets for others: which way they go, and how they are adapted to the next link.

use alloc::vec::Vec;
use core::time::Duration;

use super::queue::addressing;
use super::receive::Arrival;
use super::rights::Direction;
use super::types::{LinkId, Role};
use super::{Purpose, Station};
use crate::sys::Outcome;
use crate::{Address, Check, Packet};

impl Station {
    /// A packet from an employee: it reaches its own subnetwork alone.
    pub(super) fn take_from_employee(&mut self, now: Duration, arrival: &Arrival<'_>) {
        let Some(link) = self.links.get(&arrival.link) else {
            return;
        };
        if arrival.source != link.peer {
            self.drops.misplaced += 1;
            return;
        }
        if link.is_broadcast(arrival.target) {
            let siblings = self.members(link.group, arrival.link);
            for sibling in siblings {
                // What does not fit there is dropped there.
                let _ = self.forward(arrival, sibling);
            }
            self.deliver(now, arrival, Direction::Employer);
        } else if arrival.target == link.local {
            self.deliver(now, arrival, Direction::Employer);
        } else if !link.is_within(arrival.target) || arrival.target == arrival.source {
            self.turn_down(arrival, Outcome::NOT_PERMITTED, None);
        } else if self.config.aliases.contains(&arrival.target) {
            self.deliver(now, arrival, Direction::Colleague);
        } else {
            self.pass_on(arrival);
        }
    }

    /// A packet from the employer, through it from a colleague, or from above it.
    pub(super) fn take_from_employer(&mut self, now: Duration, arrival: &Arrival<'_>) {
        let Some(link) = self.links.get(&arrival.link) else {
            return;
        };
        let direction = if arrival.source == link.peer {
            Direction::Employee
        } else if link.is_within(arrival.source) {
            Direction::Colleague
        } else {
            Direction::Subemployee
        };
        let own = arrival.source == link.local || link.is_broadcast(arrival.source);
        let in_block = link
            .mask
            .is_some_and(|mask| mask.same_block(link.local, arrival.target));
        if own {
            self.drops.misplaced += 1;
        } else if arrival.target == link.local || link.is_broadcast(arrival.target) {
            self.deliver(now, arrival, direction);
        } else if !in_block || arrival.confirm || direction == Direction::Colleague {
            self.turn_down(arrival, Outcome::NOT_PERMITTED, None);
        } else {
            self.pass_on(arrival);
        }
    }

    /// Forwards a packet to the employee that it is for, or on whose branch its target is.
    fn pass_on(&mut self, arrival: &Arrival<'_>) {
        let next = self.way_down(arrival.target);
        let Some(next) = next.filter(|next| *next != arrival.link) else {
            self.turn_down(arrival, Outcome::NO_SUCH_TARGET, None);
            return;
        };
        if let Err((outcome, limit)) = self.forward(arrival, next) {
            self.turn_down(arrival, outcome, limit);
        }
    }

    /// The link to the employee with this address, or above it.
    pub(super) fn way_down(&self, target: Address) -> Option<LinkId> {
        let down = |role| role == Role::Employer;
        let mut links = self.links.iter();
        let found = links.find(|(_, link)| down(link.role) && link.leads_to(target));
        found.map(|(id, _)| *id)
    }

    /// The connected links of a workgroup, but one.
    pub(super) fn members(&self, group: usize, but: LinkId) -> Vec<LinkId> {
        let members = self.links.iter().filter(|(id, link)| {
            let member = link.role == Role::Employer && link.group == group;
            member && link.is_connected() && **id != but
        });
        members.map(|(id, _)| *id).collect()
    }

    /// Writes a packet to the next link, as its partner can take it.
    fn forward(
        &mut self,
        arrival: &Arrival<'_>,
        next: LinkId,
    ) -> Result<(), (Outcome, Option<u32>)> {
        let Some(link) = self.links.get(&next) else {
            return Err((Outcome::NO_SUCH_TARGET, None));
        };
        let partner = &link.partner;
        if !partner.types.has(arrival.kind) {
            return Err((Outcome::UNSUPPORTED, None));
        }
        let bare = !partner.confirms() && arrival.numbered.is_some();
        if bare && arrival.is_fragment() {
            return Err((Outcome::UNSUPPORTED, None));
        }
        if link.queue.len(arrival.priority) >= self.config.queue {
            return Err((Outcome::REFUSED, None));
        }
        let check = match (arrival.check, partner.checks.has(arrival.check)) {
            (check, true) => check,
            (Check::Sum, false) => Check::Crc32,
            (Check::Crc32, false) => Check::Sum,
        };
        let near = link.has_level(arrival.target) && link.has_level(arrival.source);
        let full = arrival.full || !near;
        let packet = Packet {
            kind: arrival.kind,
            priority: arrival.priority,
            confirm: arrival.confirm && !bare,
            check,
            numbered: arrival.numbered.filter(|_| !bare),
            addressing: addressing(arrival.target, arrival.source, link.mask, full),
            data: arrival.data,
        };
        let encoded = packet
            .encode(link.mask)
            .map_err(|_| (Outcome::TOO_LONG, None))?;
        if encoded.count() > partner.largest {
            let limit = u32::try_from(partner.largest).ok();
            return Err((Outcome::TOO_LONG, limit));
        }
        let octets = encoded.octets().collect();
        let purpose = match arrival.numbered.filter(|_| bare) {
            None => Purpose::Reply,
            Some(numbered) => match self.stand_in(arrival, numbered.psn) {
                Some(purpose) => purpose,
                None => return Ok(()),
            },
        };
        self.push_purpose(next, arrival.priority, octets, purpose);
        Ok(())
    }

    /// For a partner that cannot number: notes the packet, and that it is confirmed once it is
    /// written. `None` if it has come before.
    fn stand_in(&mut self, arrival: &Arrival<'_>, psn: u8) -> Option<Purpose> {
        let key = arrival.key();
        let confirmed = self.confirmation(arrival, Outcome::ACCEPTED, None);
        let confirm = confirmed
            .filter(|_| arrival.confirm)
            .map(|packet| (arrival.link, arrival.priority, packet));
        match self.heard.known(key, psn) {
            None => {
                self.heard.note(key, psn, None);
                Some(Purpose::Forwarded { key, psn, confirm })
            }
            Some(outcome) => {
                self.drops.repeated += 1;
                if let (Some(_), Some((link, priority, packet))) = (outcome, confirm) {
                    self.push_packet(link, priority, packet);
                }
                None
            }
        }
    }
}
