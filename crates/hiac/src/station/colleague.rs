//! Connections between colleagues, through their employer.

use alloc::string::String;
use alloc::vec::Vec;
use core::time::Duration;

use super::connect::sys_packet;
use super::link::Partner;
use super::receive::Arrival;
use super::types::{Failure, LinkId};
use super::{Colleague, Pair, Station};
use crate::sys::{self, Outcome, Parameters, Subtype};
use crate::{Address, Check};

/// How often a colleague is called.
const COLLEAGUE_CALLS: u32 = 5;

impl Station {
    /// The employer says that a colleague is lost.
    pub(super) fn colleague_lost(&mut self, now: Duration, id: LinkId, lost: Address) {
        self.heard.forget_source(id, lost);
        let is_it = |link: LinkId, (_, other): Pair| link == id && other == lost;
        self.colleagues
            .retain(|(link, pair), _| !is_it(*link, *pair));
        self.forget_party(now, |party| (party.link, party.address) == (id, lost));
        self.fail_to(now, id, lost, false, &Failure::Lost);
    }

    fn fail_to(
        &mut self,
        now: Duration,
        id: LinkId,
        target: Address,
        unconfirmed_only: bool,
        failure: &Failure,
    ) {
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        for done in link.queue.fail_to(target, unconfirmed_only, failure) {
            self.done(now, id, done);
        }
    }

    /// Begins a connection with a colleague, unless there is one. The longest packet that it takes,
    /// if there is.
    pub(super) fn meet_colleague(
        &mut self,
        now: Duration,
        id: LinkId,
        ends: Pair,
    ) -> Option<usize> {
        match self.colleagues.get(&(id, ends)) {
            Some(Colleague::Connected(partner)) => return Some(partner.largest),
            Some(Colleague::Calling { .. }) => return None,
            None => {}
        }
        let calling = Colleague::Calling {
            next: now,
            left: COLLEAGUE_CALLS,
        };
        self.colleagues.insert((id, ends), calling);
        self.call_colleagues(now);
        None
    }

    pub(super) fn call_colleagues(&mut self, now: Duration) {
        let period = self.config.period;
        let mut due = Vec::new();
        for (key, colleague) in &mut self.colleagues {
            if let Colleague::Calling { next, left } = colleague
                && *next <= now
            {
                due.push((*key, *left > 0));
                *next = now + period;
                *left = left.saturating_sub(1);
            }
        }
        for ((id, (own, colleague)), again) in due {
            if !again {
                self.colleagues.remove(&(id, (own, colleague)));
                self.fail_to(now, id, colleague, false, &Failure::Unconfirmed);
                continue;
            }
            let check = self.usual_check();
            let parameters = self.colleague_parameters(check);
            let packet = sys_packet(check, 0, Subtype::Initialize, (colleague, own), &parameters);
            self.push_packet(id, 0, packet);
        }
    }

    fn colleague_parameters(&self, check: Check) -> Parameters<'_> {
        Parameters {
            period: None,
            role: Some(sys::COLLEAGUE),
            ..self.own_parameters(check)
        }
    }

    /// A connection packet came from a colleague.
    pub(super) fn colleague_connection(
        &mut self,
        now: Duration,
        arrival: &Arrival<'_>,
        subtype: Subtype,
        read: &Parameters<'_>,
    ) {
        let (id, colleague) = (arrival.link, arrival.source);
        let ends = (arrival.target, colleague);
        let partner = Partner::of(read);
        let common = partner.checks.common(self.config.checks).is_some();
        let called = self.colleagues.contains_key(&(id, ends));
        match subtype {
            Subtype::Initialize if !common => {
                self.refuse(arrival, Outcome::UNSUPPORTED, "there is no check in common");
            }
            Subtype::Initialize => {
                let parameters = self.colleague_parameters(arrival.check);
                let back = (colleague, arrival.target);
                let packet = sys_packet(arrival.check, 0, Subtype::Accept, back, &parameters);
                self.push_packet(id, 0, packet);
                self.heard.forget_pair(id, colleague, arrival.target);
                self.fail_to(now, id, colleague, true, &Failure::Unconfirmed);
                self.colleague_there(now, id, ends, partner);
            }
            Subtype::Accept if called && common => {
                self.heard.forget_pair(id, colleague, arrival.target);
                self.colleague_there(now, id, ends, partner);
            }
            Subtype::Refuse if called => {
                self.colleagues.remove(&(id, ends));
                let reason = read.reason.map(String::from);
                let outcome = read.result.unwrap_or(Outcome::REFUSED);
                let failure = Failure::Refused(outcome, reason);
                self.fail_to(now, id, colleague, false, &failure);
            }
            _ => self.drops.unconnected += 1,
        }
    }

    fn colleague_there(&mut self, now: Duration, id: LinkId, ends: Pair, partner: Partner) {
        let largest = partner.largest.max(64);
        let partner = Partner { largest, ..partner };
        self.colleagues
            .insert((id, ends), Colleague::Connected(partner));
        let Some(link) = self.links.get_mut(&id) else {
            return;
        };
        let limit = largest.min(link.partner.largest);
        for done in link.queue.release(ends.1, limit) {
            self.done(now, id, done);
        }
    }
}
