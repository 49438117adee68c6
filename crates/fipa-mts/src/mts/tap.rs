//! Who watches what passes.
//!
//! A letter is noted when it is taken in and told once all its outcomes are known, as the octets
//! that came: nothing is copied or read. While nobody watches there is no [`Tap`]. A watcher that
//! does not keep up loses what does not fit, and is told how much that was.

use std::collections::BTreeMap;

use fipa_acl::{Letter, Text};
use fipa_codec::{Output as Encoded, bit_efficient};
use fipa_directory::Now;
use fipa_link::{Frame, Inside, Passed, ReceiverOutcome, Sniffed};
use smallvec::smallvec;

use super::Mts;
use super::connections::Partner;
use super::routing::Inbound;
use crate::machine::{ConnId, Output};
use crate::pieces::Pieces;

/// Octets that wait for a watcher before it loses what comes.
const MAX_WAITING: usize = 8 << 20;

/// What is noted for those who watch.
#[derive(Debug, Default)]
pub(super) struct Tap {
    /// Programs, and how much each has lost since it was told last.
    programs: BTreeMap<ConnId, u64>,
    /// Whether the process around us watches.
    own: bool,
    number: u64,
    /// The letter that is being taken in.
    coming: Option<Taken>,
    /// Letters whose outcomes are not all known.
    open: BTreeMap<u64, Taken>,
}

/// A letter that was taken in.
#[derive(Clone, Debug)]
struct Taken {
    number: u64,
    unix_millis: i64,
    from: Text,
    via: &'static str,
    parts: Pieces,
}

impl Taken {
    fn told(self, outcomes: Vec<ReceiverOutcome>) -> Sniffed {
        Sniffed {
            number: self.number,
            unix_millis: self.unix_millis,
            lost: 0,
            passed: Passed::Letter {
                from: self.from,
                via: Text::from_static(self.via),
                outcomes,
                parts: self.parts.into_iter().collect(),
            },
        }
    }
}

impl Tap {
    fn next(&mut self) -> u64 {
        self.number += 1;
        self.number
    }

    /// The letter that is being taken in has got this number.
    pub(super) fn opened(&mut self, pending: u64) {
        if let Some(taken) = self.coming.take() {
            self.open.insert(pending, taken);
        }
    }
}

impl Mts {
    /// Whether somebody watches what passes.
    pub fn is_watched(&self) -> bool {
        self.tap.is_some()
    }

    /// Tells those who watch of a message between us and a device.
    pub fn passed_inside(&mut self, now: Now, inside: Inside) {
        let Some(tap) = &mut self.tap else {
            return;
        };
        let sniffed = Sniffed {
            number: tap.next(),
            unix_millis: now.unix_millis,
            lost: 0,
            passed: Passed::Inside(inside),
        };
        self.tell_all(now, &sniffed);
    }

    /// A letter is being taken in. To be called while somebody watches.
    pub(super) fn tap_letter(&mut self, now: Now, inbound: &Inbound) {
        if let Some(tap) = &mut self.tap {
            tap.coming = Some(Taken {
                number: tap.next(),
                unix_millis: now.unix_millis,
                from: inbound.from.clone().unwrap_or_default(),
                via: inbound.via.unwrap_or_default(),
                parts: inbound.parts.clone(),
            });
        }
    }

    /// A letter of an agent here is not even taken in.
    pub(super) fn tap_refused(&mut self, now: Now, letter: &Letter) {
        let mut head = Encoded::new();
        let encoded = bit_efficient::encode_envelope(&letter.envelope, &mut head);
        if let (Some(tap), Ok(())) = (&mut self.tap, encoded) {
            tap.coming = Some(Taken {
                number: tap.next(),
                unix_millis: now.unix_millis,
                from: Text::default(),
                via: "",
                parts: smallvec![head.take_bytes(), letter.payload.clone()],
            });
        }
    }

    /// All outcomes of a letter are known. To be called while somebody watches.
    pub(super) fn tap_outcomes(&mut self, now: Now, pending: u64, outcomes: &[ReceiverOutcome]) {
        let taken = self.tap.as_mut().and_then(|tap| tap.open.remove(&pending));
        if let Some(taken) = taken {
            self.tell_all(now, &taken.told(outcomes.to_vec()));
        }
    }

    /// A program begins or ends to watch.
    pub(super) fn program_watches(&mut self, now: Now, conn: ConnId, on: bool) {
        if on {
            let tap = self.tap.get_or_insert_default();
            let lost = tap.programs.entry(conn).or_default();
            let begin = mark(now, Passed::Begin, std::mem::take(lost));
            self.send(now, conn, Frame::Sniffed(Box::new(begin)));
            return;
        }
        let Some(tap) = &self.tap else {
            return;
        };
        if !tap.programs.contains_key(&conn) {
            return;
        }
        let open: Vec<Taken> = tap.open.values().cloned().collect();
        for taken in open {
            self.tell_program(now, conn, &taken.told(Vec::new()));
        }
        let lost = self.program_is_gone(conn);
        let end = mark(now, Passed::End, lost);
        self.send(now, conn, Frame::Sniffed(Box::new(end)));
    }

    /// A program watches no more; what it has lost is returned.
    pub(super) fn program_is_gone(&mut self, conn: ConnId) -> u64 {
        let lost = self.tap.as_mut().and_then(|tap| tap.programs.remove(&conn));
        self.drop_idle_tap();
        lost.unwrap_or_default()
    }

    /// The process around us begins or ends to watch.
    pub(super) fn own_watches(&mut self, now: Now, on: bool) {
        let told = |passed| Output::Sniffed(Box::new(mark(now, passed, 0)));
        if on {
            self.tap.get_or_insert_default().own = true;
            self.outputs.push_back(told(Passed::Begin));
        } else if let Some(tap) = &mut self.tap
            && std::mem::take(&mut tap.own)
        {
            let open = tap.open.values().cloned();
            let open = open.map(|taken| Output::Sniffed(Box::new(taken.told(Vec::new()))));
            self.outputs.extend(open);
            self.outputs.push_back(told(Passed::End));
            self.drop_idle_tap();
        }
    }

    /// We end: those who watch are told what is under way still.
    pub(super) fn end_tap(&mut self, now: Now) {
        let programs = self.tap.iter().flat_map(|tap| tap.programs.keys().copied());
        for conn in programs.collect::<Vec<_>>() {
            self.program_watches(now, conn, false);
        }
        self.own_watches(now, false);
    }

    fn drop_idle_tap(&mut self) {
        let idle = |tap: &Tap| tap.programs.is_empty() && !tap.own;
        if self.tap.as_deref().is_some_and(idle) {
            self.tap = None;
        }
    }

    fn tell_all(&mut self, now: Now, sniffed: &Sniffed) {
        let Some(tap) = &self.tap else {
            return;
        };
        if tap.own {
            let told = Output::Sniffed(Box::new(sniffed.clone()));
            self.outputs.push_back(told);
        }
        let programs: Vec<ConnId> = tap.programs.keys().copied().collect();
        for conn in programs {
            self.tell_program(now, conn, sniffed);
        }
    }

    fn tell_program(&mut self, now: Now, conn: ConnId, sniffed: &Sniffed) {
        let (Some(tap), Some(open)) = (&mut self.tap, self.conns.get(&conn)) else {
            return;
        };
        let Some(lost) = tap.programs.get_mut(&conn) else {
            return;
        };
        let Partner::Program { max_letter, .. } = open.partner else {
            return;
        };
        if open.link.queued() > MAX_WAITING || sniffed.octets() as u64 > max_letter {
            *lost += 1;
            return;
        }
        let mut sniffed = sniffed.clone();
        sniffed.lost = std::mem::take(lost);
        self.send(now, conn, Frame::Sniffed(Box::new(sniffed)));
    }
}

/// The begin or end of a watch.
fn mark(now: Now, passed: Passed, lost: u64) -> Sniffed {
    Sniffed {
        number: 0,
        unix_millis: now.unix_millis,
        lost,
        passed,
    }
}
