//! Dialling: whom, where, and after which pause.

use std::time::Duration;

use fipa_directory::{Address, InstanceId, Now, State};

use super::connections::SCOPE;
use super::fleet::{FLEET, NAME};
use super::gossip::TOLD_AT_ONCE;
use super::peer::Peer;
use super::{Mts, Timer};
use crate::machine::{DialId, Output};

/// The pause before the second dial; each further one is twice as long, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

/// The longest pause where nobody waits: for a platform that is only looked out for.
const LOOKOUT_PAUSE: Duration = Duration::from_secs(30);

/// The longest pause before a platform that does not want us, as it is of another fleet.
const UNWANTED_PAUSE: Duration = Duration::from_secs(60);

/// What a dial is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Peer(InstanceId),
    Seed(u64),
}

/// How dialling goes.
#[derive(Debug, Default)]
pub(super) struct Dialling {
    pub(super) under_way: bool,
    /// When to dial again.
    pub(super) again: Option<Duration>,
    pub(super) attempts: u32,
}

impl Dialling {
    pub(super) fn is_idle(&self) -> bool {
        !self.under_way && self.again.is_none()
    }
}

impl Mts {
    pub(super) fn dial_peer(&mut self, now: Now, instance: InstanceId) {
        let Some(peer) = self.peers.get_mut(instance) else {
            return;
        };
        let addresses = peer.addresses();
        if peer.dialling.under_way || self.closing {
            return;
        }
        if addresses.is_empty() {
            return;
        }
        peer.dialling.under_way = true;
        peer.dialling.again = None;
        self.dial(now, Purpose::Peer(instance), addresses);
    }

    pub(super) fn dial_peer_later(&mut self, now: Now, instance: InstanceId, pause: Duration) {
        let at = now.mono + pause;
        if let Some(peer) = self.peers.get_mut(instance)
            && peer.dialling.is_idle()
        {
            peer.dialling.again = Some(at);
            self.timer(at, Timer::Peer(instance));
        }
    }

    pub(super) fn dial(&mut self, _now: Now, purpose: Purpose, addresses: Vec<Address>) {
        let dial = DialId(self.id());
        self.dials.insert(dial, purpose);
        self.outputs.push_back(Output::Dial {
            dial,
            addresses,
            link: true,
        });
    }

    /// Why the last dial for this led to nobody.
    pub(super) fn dial_error(&self, purpose: Purpose) -> Option<&str> {
        match purpose {
            Purpose::Peer(instance) => Some(&self.peers.get(instance)?.last_error),
            Purpose::Seed(seed) => Some(&self.seeds.get(seed)?.last_error),
        }
    }

    /// A dial led to nobody.
    pub(super) fn dial_ended(&mut self, now: Now, purpose: Purpose, reason: &str) {
        if let Purpose::Seed(id) = purpose
            && self.is_for_keyless(id)
        {
            return self.seed_is_mute(now, id);
        }
        let random = self.random.f64();
        let mut longest = LONGEST_PAUSE;
        let dialling = match purpose {
            Purpose::Peer(instance) => {
                let is_only_told = self.peers.get(instance).is_some_and(Peer::is_only_told);
                let crowd = match is_only_told {
                    true => self.peers.only_told() / TOLD_AT_ONCE,
                    false => 0,
                };
                let Some(peer) = self.peers.get_mut(instance) else {
                    return;
                };
                peer.last_error = reason.to_owned();
                peer.dialling.under_way = false;
                if !peer.links.is_empty() {
                    return;
                }
                if peer.discovered.is_none() && peer.state != State::Suspect {
                    longest = LOOKOUT_PAUSE * (1 + crowd as u32);
                }
                &mut peer.dialling
            }
            Purpose::Seed(id) => {
                let Some(seed) = self.seeds.get_mut(id) else {
                    return;
                };
                seed.last_error = reason.to_owned();
                seed.dialling.under_way = false;
                if seed.myself || seed.instance.is_some() {
                    return;
                }
                &mut seed.dialling
            }
        };
        if [SCOPE, FLEET, NAME]
            .iter()
            .any(|unwanted| reason.ends_with(unwanted))
        {
            longest = UNWANTED_PAUSE;
        }
        let at = now.mono + pause(dialling.attempts, longest, random);
        dialling.attempts += 1;
        dialling.again = Some(at);
        match purpose {
            Purpose::Peer(instance) => self.timer(at, Timer::Peer(instance)),
            Purpose::Seed(seed) => self.timer(at, Timer::Seed(seed)),
        }
    }
}

/// 100 ms, 200 ms, … up to the longest; each half to all of that, at random, so that a fleet does
/// not dial in step.
fn pause(attempts: u32, longest: Duration, random: f64) -> Duration {
    let whole = FIRST_PAUSE * 2_u32.pow(attempts.min(10));
    whole.min(longest).mul_f64(0.5 + random / 2.0)
}
