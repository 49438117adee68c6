//! Letters over HTTP (FIPA SC00084F), to and from JADE: taken over by whoever answers 200, who does
//! not say what becomes of them.

use std::collections::hash_map::DefaultHasher;
use std::collections::{HashMap, VecDeque};
use std::hash::{Hash, Hasher};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_codec::Dialect;
use fipa_directory::{Address, Now};
use fipa_link::Outcome;

use super::Mts;
use super::ahead::MAX_LETTER;
use super::callers::{TIMEOUT, check_names, inbound};
use super::deliveries::Origin;
use super::jade;
use super::notices::Returnable;
use super::routing::{POSTED, Terms};
use crate::machine::{Arrived, Output, PostFailure, PostId, PostedLetter, Refusal, TakenOver};

/// How long a letter is recognised that comes a second time.
const REMEMBERED: Duration = Duration::from_secs(600);

/// Connections whose last letter is remembered.
const MAX_REMEMBERED: usize = 1024;

/// Octets of letters that are remembered as they came; the hash of each is made only for more, and
/// only when something is compared with them.
const MAX_KEPT: usize = 4 << 20;

/// The last letter that came over a connection on which others had come before.
#[derive(Debug)]
struct Last {
    connection: u64,
    letter: Remembered,
    at: Duration,
}

#[derive(Debug)]
enum Remembered {
    Whole { envelope: Bytes, payload: Bytes },
    Hash(u64),
}

impl Remembered {
    fn octets(&self) -> usize {
        match self {
            Remembered::Whole { envelope, payload } => envelope.len() + payload.len(),
            Remembered::Hash(_) => 0,
        }
    }

    fn is(&self, arrived: &Arrived, hash: &mut Option<u64>) -> bool {
        match self {
            Remembered::Whole { envelope, payload } => {
                *envelope == arrived.envelope && *payload == arrived.payload
            }
            Remembered::Hash(remembered) => {
                *remembered == *hash.get_or_insert_with(|| hash_of(arrived))
            }
        }
    }
}

fn hash_of(arrived: &Arrived) -> u64 {
    let mut hasher = DefaultHasher::new();
    (&arrived.envelope, &arrived.payload).hash(&mut hasher);
    hasher.finish()
}

/// What came last over the connections that carried several letters, the longest ago first.
///
/// A sender that sees such a connection end does not know whether its letter was read, and sends
/// it again as the first one of a new connection. Only such a copy is taken for one: whoever sends
/// the same twice over one connection, or each letter over its own, means it.
#[derive(Debug, Default)]
pub(super) struct Recent {
    /// The greatest number of each series, and when it came.
    series: HashMap<u64, (u64, Duration)>,
    last: VecDeque<Last>,
    /// Octets of those that are remembered as they came.
    octets: usize,
}

impl Recent {
    /// Notes a letter. Whether it was taken in before.
    fn is_copy(&mut self, now: Now, arrived: &Arrived) -> bool {
        let (connection, at) = (arrived.connection, now.mono);
        while self.last.len() >= MAX_REMEMBERED
            || self
                .last
                .front()
                .is_some_and(|last| last.at + REMEMBERED < at)
        {
            self.forget(0);
        }
        if arrived.earlier == 0 && arrived.number.is_none() {
            let mut hash = None;
            let is_same = |last: &Last| last.letter.is(arrived, &mut hash);
            let known = self.last.iter().position(is_same);
            return known.is_some_and(|known| self.forget(known));
        }
        let before = self
            .last
            .iter()
            .position(|last| last.connection == connection);
        if let Some(before) = before {
            self.forget(before);
        }
        if let Some(number) = arrived.number {
            return self.is_numbered_copy(now, number);
        }
        let octets = arrived.envelope.len() + arrived.payload.len();
        let letter = match self.octets + octets > MAX_KEPT {
            true => Remembered::Hash(hash_of(arrived)),
            false => Remembered::Whole {
                envelope: arrived.envelope.clone(),
                payload: arrived.payload.clone(),
            },
        };
        self.octets += letter.octets();
        self.last.push_back(Last {
            connection,
            letter,
            at,
        });
        false
    }

    /// Notes a letter of a series. Letters are posted again in their order, and over the old
    /// connection, if that lives, come later than over the new one: so what is not greater than the
    /// greatest was taken in before.
    fn is_numbered_copy(&mut self, now: Now, (series, number): (u64, u64)) -> bool {
        let at = now.mono;
        if self.series.len() >= MAX_REMEMBERED && !self.series.contains_key(&series) {
            self.series.retain(|_, (_, last)| *last + REMEMBERED > at);
            let last = |(_, (_, last)): &(&u64, &(u64, Duration))| *last;
            let oldest = self
                .series
                .iter()
                .min_by_key(last)
                .map(|(series, _)| *series);
            if let Some(oldest) = oldest.filter(|_| self.series.len() >= MAX_REMEMBERED) {
                self.series.remove(&oldest);
            }
        }
        let (greatest, last) = self.series.entry(series).or_default();
        *last = at;
        let is_copy = number <= *greatest;
        *greatest = number.max(*greatest);
        is_copy
    }

    /// Whether there was one at this place.
    fn forget(&mut self, at: usize) -> bool {
        let Some(last) = self.last.remove(at) else {
            return false;
        };
        self.octets -= last.letter.octets();
        true
    }
}

impl Mts {
    /// A letter was posted here. `Ok`: it is taken over; what becomes of it shows later.
    pub fn letter_arrived(&mut self, now: Now, arrived: Arrived) -> Result<(), Refusal> {
        if self.closing {
            return Err(Refusal::Closing);
        }
        let octets = arrived.envelope.len() + arrived.payload.len();
        let max = self.config.max_letter;
        if octets > max {
            return Err(Refusal::TooLarge { octets, max });
        }
        let limits = &self.config.limits;
        let (envelope, _) = fipa_codec::decode_envelope(&arrived.envelope, limits)
            .map_err(|error| Refusal::Unreadable(error.to_string()))?;
        if envelope.intended_receiver().is_empty() {
            return Err(Refusal::Unreadable("it names no receiver".to_owned()));
        }
        check_names(&envelope).map_err(Refusal::Unreadable)?;
        let taken = inbound(now, envelope, arrived.payload.clone(), POSTED)
            .map_err(|error| Refusal::Unreadable(error.to_string()))?;
        if !self.recent.is_copy(now, &arrived) {
            let origin = Origin::Caller {
                from: arrived.remote,
                octets,
                letter: Box::new(Returnable::new(&taken, Dialect::Jade)),
            };
            self.take_in(now, origin, taken, Terms::patient_within(TIMEOUT));
            self.publish_changes(now);
        }
        Ok(())
    }

    /// Sets under which URLs letters are posted to the service.
    pub fn set_http(&mut self, urls: Vec<Address>) {
        self.config.http = urls;
        self.post.urls = urls_of(&self.config.http);
    }

    /// Posts a letter to a place for which a connection is free, or says why it cannot be written.
    pub(super) fn post_over_http(
        &mut self,
        now: Now,
        id: u64,
        address: &Arc<Address>,
    ) -> Result<(), String> {
        let delivery = self.deliveries.get(&id);
        let Some((delivery, foreign)) = delivery.and_then(|d| Some((d, d.foreign.as_deref()?)))
        else {
            return Err("it is not under way any more".to_owned());
        };
        let own = self.post.urls.for_whom(address.is_loopback());
        let written = jade::write(foreign, address, own, &self.config.limits)?;
        let timeout = delivery.deadline.saturating_sub(now.mono);
        let in_series = self.post.ahead.at(address) > 1 && delivery.octets() <= MAX_LETTER;
        let is_behind = !self.is_first(id);
        let post = PostId(self.id());
        self.post
            .set_out_posted(post, id, Arc::clone(address), in_series, is_behind);
        self.outputs.push_back(Output::Post(Box::new(PostedLetter {
            post,
            address: Arc::clone(address),
            envelope: written.envelope,
            payload: written.payload,
            payload_type: written.payload_type,
            timeout,
            in_series,
        })));
        Ok(())
    }

    /// Where answers can be posted by somebody on this host, or by somebody on another one, who is
    /// not told where only this host reaches us.
    pub fn http_urls(&self, same_host: bool) -> Vec<Text> {
        self.post.urls.for_whom(same_host).to_vec()
    }

    /// What became of a letter that was to be posted, or handed over by a plug-in.
    pub(super) fn post_answered(
        &mut self,
        now: Now,
        post: PostId,
        result: Result<TakenOver, PostFailure>,
    ) {
        let Some((id, address)) = self.post.come_back(post) else {
            return;
        };
        match &result {
            Ok(taken) => self.post.ahead.set(&address, taken.ahead),
            Err(PostFailure::Refused(_)) => {}
            // Somebody else may be there meanwhile.
            Err(_) => self.post.ahead.set(&address, 0),
        }
        match result {
            _ if !self.deliveries.contains_key(&id) => {}
            Ok(_) => {
                if let Some(sent) = self.deliveries.get_mut(&id) {
                    sent.via = Some(address.to_text());
                    if let Some(foreign) = &sent.foreign {
                        let name = foreign.to.name.clone();
                        self.trust_neighbour(&name);
                    }
                }
                self.finish(now, id, Outcome::Sent, Text::default());
            }
            Err(PostFailure::Unreached(reason)) => {
                self.place_failed(now, id, format!("{address}: {reason}"));
            }
            Err(failure) => {
                if matches!(failure, PostFailure::Refused(_)) {
                    self.post.is_refused(id);
                }
                let reason = format!("{address}: {failure}");
                self.place_refused(now, id, reason);
            }
        }
        self.run_post(now);
    }
}

/// Under which URLs letters are posted to the service, as they are told to others.
#[derive(Debug)]
pub(super) struct Urls {
    all: Vec<Text>,
    for_others: Vec<Text>,
}

impl Urls {
    fn for_whom(&self, same_host: bool) -> &[Text] {
        match same_host {
            true => &self.all,
            false => &self.for_others,
        }
    }
}

pub(super) fn urls_of(urls: &[Address]) -> Urls {
    let for_others = urls.iter().filter(|url| url.is_for_others());
    Urls {
        all: urls.iter().map(Address::to_text).collect(),
        for_others: for_others.map(Address::to_text).collect(),
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;

    fn arrived(connection: u64, earlier: u64, payload: &'static str) -> Arrived {
        Arrived {
            envelope: Bytes::from_static(b"<envelope/>"),
            payload: Bytes::from_static(payload.as_bytes()),
            remote: Text::from_static("http://10.0.0.9:1"),
            connection,
            earlier,
            number: None,
        }
    }

    #[test]
    fn a_letter_of_a_series_is_a_copy_if_its_number_came_already_whatever_the_connection() {
        let (mut recent, now) = (Recent::default(), Now::default());
        let mut is_copy = |connection, series, number| {
            let arrived = Arrived {
                number: Some((series, number)),
                ..arrived(connection, 7, "a")
            };
            recent.is_copy(now, &arrived)
        };
        let come: [bool; 3] = [1, 2, 3].map(|number| is_copy(1, 9, number));
        assert_eq!(come, [false; 3]);
        assert_eq!(
            [1, 3, 4].map(|number| is_copy(2, 9, number)),
            [true, true, false]
        );
        // What the first connection still held.
        assert!(is_copy(1, 9, 4));
        // A letter that was refused may be missing.
        assert!(!is_copy(2, 9, 6));
        assert!(!is_copy(2, 8, 1));
        for series in 100..5000 {
            assert!(!is_copy(3, series, 1));
        }
        assert!(recent.series.len() <= MAX_REMEMBERED);
    }

    #[test]
    fn what_a_letter_of_a_series_came_behind_was_answered_and_does_not_come_again() {
        let (mut recent, now) = (Recent::default(), Now::default());
        assert!(!recent.is_copy(now, &arrived(1, 1, "a")));
        let numbered = Arrived {
            number: Some((9, 1)),
            ..arrived(1, 2, "b")
        };
        assert!(!recent.is_copy(now, &numbered));
        assert!(!recent.is_copy(now, &arrived(2, 0, "a")));
    }

    #[test]
    fn a_letter_is_a_copy_if_it_was_the_last_of_a_connection_and_is_the_first_of_a_new_one() {
        let (mut recent, now) = (Recent::default(), Now::default());
        assert!(!recent.is_copy(now, &arrived(1, 0, "a")));
        assert!(!recent.is_copy(now, &arrived(1, 1, "b")));
        // The first letter of a connection is never sent again.
        assert!(!recent.is_copy(now, &arrived(2, 0, "a")));
        assert!(recent.is_copy(now, &arrived(3, 0, "b")));
        // Once.
        assert!(!recent.is_copy(now, &arrived(4, 0, "b")));
    }

    #[test]
    fn the_same_letter_twice_over_one_connection_is_two_letters() {
        let (mut recent, now) = (Recent::default(), Now::default());
        assert!(!recent.is_copy(now, &arrived(1, 0, "a")));
        assert!(!recent.is_copy(now, &arrived(1, 1, "a")));
        assert!(!recent.is_copy(now, &arrived(1, 2, "a")));
    }

    #[test]
    fn what_is_remembered_is_bounded_in_number_and_time() {
        let mut recent = Recent::default();
        let mut now = Now::default();
        for connection in 0..5000 {
            assert!(!recent.is_copy(now, &arrived(connection, 1, "a")));
        }
        assert!(recent.last.len() <= MAX_REMEMBERED);
        now.mono += REMEMBERED + Duration::from_secs(1);
        assert!(!recent.is_copy(now, &arrived(9999, 0, "a")));
        assert!(recent.last.is_empty());
        assert_eq!(recent.octets, 0);
    }

    #[test]
    fn large_letters_are_recognised_and_not_kept() {
        let (mut recent, now) = (Recent::default(), Now::default());
        let large = |connection, earlier| Arrived {
            payload: Bytes::from(vec![connection as u8 % 10; MAX_KEPT / 2]),
            ..arrived(connection, earlier, "")
        };
        for connection in 1..5 {
            assert!(!recent.is_copy(now, &large(connection, 1)));
        }
        assert!(recent.octets <= MAX_KEPT);
        for connection in 11..15 {
            assert!(recent.is_copy(now, &large(connection, 0)));
        }
        assert_eq!((recent.last.len(), recent.octets), (0, 0));
    }
}
