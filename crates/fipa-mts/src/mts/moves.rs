//! Agents that move to another service: letters under way follow them, or fail with the truth.
//!
//! A name that went less than a second ago may be on its way to another place: letters for it wait
//! here until that second is over. One that has turned up elsewhere gets them there. A letter that
//! was written to a peer is not followed up: only the peer knows what became of it. (SC00023: letters
//! for an agent in transit are buffered, or forwarded to its new place.)

use std::collections::{BTreeSet, HashMap};
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{Letter, Text};
use fipa_codec::bit_efficient;
use fipa_directory::{Address, InstanceId, Now};
use fipa_link::Outcome;

use super::deliveries::Target;
use super::programs::Local;
use super::routing::Route;
use super::{Mts, Timer};
use crate::machine::Output;

/// How long an agent may be nowhere while it moves.
const MOVING: Duration = Duration::from_secs(1);

/// Letters that wait for agents on the move, at most.
const MAX_HELD: usize = 10_000;

/// Letters that wait for agents on the move.
#[derive(Debug, Default)]
pub(super) struct Held {
    /// By receiver: until when, which, and the octets of each.
    letters: HashMap<Text, (Duration, Vec<(u64, usize)>)>,
    order: BTreeSet<(Duration, Text)>,
    count: usize,
    octets: usize,
}

impl Held {
    fn put(&mut self, name: Text, until: Duration, id: u64, octets: usize) {
        let held = self.letters.entry(name.clone());
        let (_, letters) = held.or_insert_with(|| {
            self.order.insert((until, name));
            (until, Vec::new())
        });
        letters.push((id, octets));
        self.count += 1;
        self.octets += octets;
    }

    /// All for an agent.
    fn take(&mut self, name: &Text) -> Vec<u64> {
        let Some((until, letters)) = self.letters.remove(name) else {
            return Vec::new();
        };
        self.order.remove(&(until, name.clone()));
        self.count -= letters.len();
        self.octets -= letters.iter().map(|(_, octets)| octets).sum::<usize>();
        letters.into_iter().map(|(id, _)| id).collect()
    }

    /// An agent that has been waited for for long enough.
    fn overdue(&self, now: Now) -> Option<Text> {
        let (until, name) = self.order.first()?;
        (*until <= now.mono).then(|| name.clone())
    }
}

impl Mts {
    /// Takes an agent away and hands over the letters that wait for it: what came for it until now
    /// is in them, and what comes from now on follows it or is answered as unknown. Told by
    /// [`Output::Left`].
    pub(super) fn leave_local(&mut self, now: Now, ticket: u64, name: &str) {
        let letters = match self.remove_local(now, name) {
            Some(Local::Mailbox(mailbox)) => mailbox.into_letters(),
            _ => Vec::new(),
        };
        let name = Text::from(name);
        self.outputs.push_back(Output::Left {
            ticket,
            name,
            letters,
        });
    }

    /// Sets where others reach the service. All agents here move in one step: others learn of it
    /// from one frame.
    pub fn set_endpoints(&mut self, now: Now, endpoints: Vec<Address>) {
        self.config.endpoints = endpoints;
        let locations = self.own_locations();
        let own = self.config.instance;
        let moved = self.directory.owned_by(own).map(|record| {
            let mut entry = record.entry.clone();
            entry.locations.clone_from(&locations);
            (record.source, entry)
        });
        for (source, entry) in moved.collect::<Vec<_>>() {
            self.directory.put(now, own, source, entry);
        }
        self.publish_changes(now);
        self.tell_own_place(now);
    }

    /// Whether nobody has the name, and somebody had it a moment ago.
    pub(super) fn is_moving(&self, now: Now, name: &str) -> bool {
        let gone = self.directory.tombstone(now, name);
        gone.is_some_and(|record| now.mono < record.since + MOVING)
    }

    /// Lets a copy wait until its receiver turns up somewhere.
    pub(super) fn hold(&mut self, now: Now, id: u64) {
        let Some((name, octets)) = self.receiver_of(id) else {
            return;
        };
        let full =
            self.held.count >= MAX_HELD || self.held.octets + octets > self.config.queue_octets;
        let gone = self.directory.tombstone(now, &name).map(|gone| gone.since);
        match gone {
            Some(since) if now.mono < since + MOVING && !full => {
                if let Some(delivery) = self.deliveries.get_mut(&id) {
                    delivery.target = Target::Held;
                }
                self.held.put(name, since + MOVING, id, octets);
                self.timer(since + MOVING, Timer::Held);
            }
            _ if self.may_wait(now, id) => self.wait_for_robot(now, id),
            _ => self.nobody_here(now, id),
        }
    }

    /// Agents have not turned up anywhere.
    pub(super) fn held_timeout(&mut self, now: Now) {
        while let Some(name) = self.held.overdue(now) {
            for id in self.held.take(&name) {
                if self.is_moving(now, &name) {
                    // It was here again, and has left again.
                    self.hold(now, id);
                } else {
                    let here = &self.config.name;
                    let reason = format!("the agent has gone, and {here} knows it nowhere else");
                    self.wait_or_finish(now, id, Outcome::Unknown, Text::from(reason));
                }
            }
        }
    }

    /// An agent has turned up: letters that wait for it go there.
    pub(super) fn follow(&mut self, now: Now, name: &Text) {
        for id in self.held.take(name) {
            self.reroute(now, id);
        }
        self.run_outbox(now, name);
    }

    /// Starts a copy anew that nobody has taken, to where its receiver is now.
    pub(super) fn reroute(&mut self, now: Now, id: u64) {
        let Some((name, _)) = self.receiver_of(id) else {
            return;
        };
        let route = self.route_to(&name);
        let Some(delivery) = self.deliveries.get_mut(&id) else {
            return;
        };
        delivery.take_back();
        match route {
            Some(Route::Program(conn)) => {
                delivery.target = Target::Program(conn);
                self.transmit_delivery(now, conn, id);
            }
            Some(Route::Peer(instance)) => self.retarget(now, id, instance),
            Some(Route::Mailbox) => {
                let octets = Bytes::from(delivery.parts.concat());
                self.put_copy_into_mailbox(now, id, &name, &octets);
            }
            _ => self.hold(now, id),
        }
    }

    /// Puts a copy that was meant for elsewhere into a mailbox here.
    fn put_copy_into_mailbox(&mut self, now: Now, id: u64, name: &Text, octets: &Bytes) {
        let letter = match bit_efficient::decode_envelope(octets, &self.config.limits) {
            Ok((envelope, payload)) => Letter {
                envelope,
                payload: octets.slice(payload..),
            },
            Err(error) => {
                let reason = Text::from(format!("the envelope cannot be read: {error}"));
                return self.finish(now, id, Outcome::Refused, reason);
            }
        };
        let Some(Local::Mailbox(mailbox)) = self.locals.get_mut(name) else {
            return;
        };
        match mailbox.push(letter) {
            Ok(()) => {
                self.mail_has_come(now, name);
                self.finish(now, id, Outcome::Delivered, Text::default());
            }
            Err(full) => {
                let reason = Text::from(full.to_string());
                self.not_taken(now, id, Outcome::Refused, reason);
            }
        }
    }

    /// A peer is gone, and its entries with it: what it may have got has an unknown fate, what it
    /// has not got goes to where the receiver is now.
    pub(super) fn release_deliveries(&mut self, now: Now, instance: InstanceId, reason: &str) {
        self.unfold_all(|target, _| target == Target::Peer(instance));
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        let mut released = peer.waiting.take_all();
        let links = peer.links.iter().filter_map(|conn| self.conns.get(conn));
        let mut sent: Vec<u64> = links.flat_map(|open| &open.outstanding).copied().collect();
        sent.sort_unstable();
        released.extend(sent);
        for id in released {
            let Some(delivery) = self.deliveries.get(&id) else {
                continue;
            };
            let Some((name, _)) = self.receiver_of(id) else {
                continue;
            };
            if delivery.was_written() || self.route_to(&name).is_none() {
                self.wait_or_finish(now, id, Outcome::Timeout, Text::from(reason));
            } else {
                self.reroute(now, id);
            }
        }
    }
}
