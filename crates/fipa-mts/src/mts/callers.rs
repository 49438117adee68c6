//! Connections that others opened, until their first octets tell the kind: our link, or a letter
//! that ends with the stream, as `fipa_services` and the bridge to JADE write it.
//!
//! Nothing is written to a caller before it is known to speak our link: who writes a letter and
//! closes without reading would make its close a reset, which may destroy the letter.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Envelope, FipaTime, Representation, Text};
use fipa_codec::{
    Dialect, EncodeError, EnvelopeRepresentation, Form, Limits, Output as Encoded, bit_efficient,
    decode_envelope, detect, payload_representation,
};
use fipa_directory::Now;
use fipa_link::{Outcome, PREAMBLE, ReceiverOutcome};
use smallvec::smallvec;

use super::connections::FarEnd;
use super::deliveries::Origin;
use super::doors::host_of;
use super::notices::Returnable;
use super::patterns::Names;
use super::routing::{Inbound, Terms};
use super::{Mts, Timer};
use crate::machine::{ConnId, Ended, Notice, Output};

/// Callers whose kind is not known or whose letter is not whole, at most; beyond that the one that
/// has written nothing for longest is given up.
const MAX_CALLERS: usize = 1000;

/// How long a caller may take for its first octet.
const FIRST_OCTET: Duration = Duration::from_secs(5);

/// How long the rest of a letter may make no progress.
const PROGRESS: Duration = Duration::from_secs(30);

/// A timer that is so late was held up with the whole service: what has come meanwhile is read first.
const LATE: Duration = Duration::from_millis(100);

/// How long the outcome of a letter is waited for whose sender waits for none.
pub(super) const TIMEOUT: Duration = Duration::from_secs(10);

/// Octets of the longest name in an envelope: whoever is told of the letter is told the name, too.
const MAX_NAME: usize = 4096;

/// The first octet of a TLS handshake.
const TLS: u8 = 0x16;

/// How letters came that are callers'.
const TCP: &str = "tcp";

/// Blanks within which a letter in XML must begin.
const MAX_BLANKS: usize = 64;

/// Somebody who opened a connection.
#[derive(Debug)]
pub(super) struct Caller {
    far: FarEnd,
    /// Where it is, without its port.
    host: Text,
    /// What has come of its letter.
    octets: BytesMut,
    /// It begins like a letter.
    is_letter: bool,
    /// When it wrote last, or came.
    heard: Duration,
}

impl Caller {
    fn deadline(&self) -> Duration {
        match self.octets.is_empty() {
            true => self.heard + FIRST_OCTET,
            false => self.heard + PROGRESS,
        }
    }
}

impl Mts {
    pub(super) fn called(&mut self, now: Now, conn: ConnId, far: FarEnd) {
        if self.callers.len() >= MAX_CALLERS
            && let Some(quietest) = self.quietest_caller(None)
        {
            self.give_caller_up(quietest, "too many connections wait for their first octets");
        }
        let caller = Caller {
            host: host_of(&far.remote),
            far,
            octets: BytesMut::new(),
            is_letter: false,
            heard: now.mono,
        };
        self.timer(caller.deadline(), Timer::Caller(conn));
        self.callers.insert(conn, caller);
    }

    /// Whether the connection is a link, to which these octets belong.
    pub(super) fn read_caller(&mut self, now: Now, conn: ConnId, octets: &mut BytesMut) -> bool {
        let Some(caller) = self.callers.get_mut(&conn) else {
            return true;
        };
        if caller.octets.is_empty() && octets.first() == Some(&PREAMBLE[0]) {
            let far = caller.far.clone();
            self.callers.remove(&conn);
            if self.is_keyless(&far) {
                self.refuse_link(now, conn, far);
                return true;
            }
            self.open_link(now, conn, None, false, far);
            return true;
        }
        if octets.is_empty() {
            return false;
        }
        caller.heard = now.mono;
        self.caller_octets += octets.len();
        match caller.octets.is_empty() {
            true => caller.octets = octets.split(),
            false => caller.octets.unsplit(octets.split()),
        }
        if let Some(reason) = self.objection(conn) {
            self.give_caller_up(conn, &reason);
        }
        while self.caller_octets > self.config.queue_octets.max(self.config.max_letter)
            && let Some(quietest) = self.quietest_caller(None)
        {
            self.give_caller_up(quietest, "too much waits for the rest of its letter");
        }
        false
    }

    /// Why what has come cannot become a letter that is taken in.
    fn objection(&mut self, conn: ConnId) -> Option<String> {
        let remote = self.callers.get(&conn)?.far.remote.clone();
        if let Some(refusal) = self.keyless_refusal(&remote) {
            return Some(refusal.to_owned());
        }
        let caller = self.callers.get_mut(&conn)?;
        let (octets, max) = (&caller.octets, self.config.max_letter);
        if octets.len() > max {
            return Some(format!("it is larger than the {max} octets that are taken"));
        }
        if !caller.is_letter {
            caller.is_letter = matches!(detect(octets), Form::BitEfficientEnvelope | Form::Xml);
        }
        if caller.is_letter || may_begin_xml(octets) {
            return None;
        }
        let first = octets.first().copied().unwrap_or_default();
        if first == TLS {
            return Some(
                "it speaks TLS as a robot of a fleet, and there is no fleet here".to_owned(),
            );
        }
        Some(format!(
            "neither a link nor a letter begins with the octet {first:#04x}"
        ))
    }

    /// The caller that has written nothing for longest, of this address if one is given.
    pub(super) fn quietest_caller(&self, address: Option<&Text>) -> Option<ConnId> {
        let from = |caller: &Caller| address.is_none_or(|a| caller.host == *a);
        let callers = self.callers.iter().filter(|(_, caller)| from(caller));
        let quietest = callers.min_by_key(|(conn, caller)| (caller.heard, **conn));
        quietest.map(|(conn, _)| *conn)
    }

    pub(super) fn caller_timeout(&mut self, now: Now, conn: ConnId) {
        let Some(caller) = self.callers.get_mut(&conn) else {
            return;
        };
        if now.mono > caller.deadline() + LATE {
            caller.heard = now.mono;
        }
        let deadline = caller.deadline();
        if deadline > now.mono {
            self.timer(deadline, Timer::Caller(conn));
        } else if caller.octets.is_empty() {
            self.give_caller_up(
                conn,
                "the other side opened the connection and said nothing",
            );
        } else {
            let seconds = PROGRESS.as_secs();
            self.give_caller_up(conn, &format!("its rest did not come within {seconds} s"));
        }
    }

    pub(super) fn give_caller_up(&mut self, conn: ConnId, reason: &str) {
        self.outputs.push_back(Output::Close(conn));
        if let Some(caller) = self.forget_caller(conn) {
            self.caller_notice(caller.far.remote, caller.octets.len(), reason);
        }
    }

    pub(super) fn forget_caller(&mut self, conn: ConnId) -> Option<Caller> {
        let caller = self.callers.remove(&conn)?;
        self.caller_octets -= caller.octets.len();
        Some(caller)
    }

    pub(super) fn caller_notice(&mut self, from: Text, octets: usize, reason: &str) {
        let reason = Text::from(reason);
        self.notice(match octets {
            0 => Notice::LinkFailed { with: from, reason },
            octets => Notice::LetterLost {
                from,
                octets,
                reason,
            },
        });
    }

    /// The end of the stream ends the letter. Who said nothing at all has lost nothing.
    pub(super) fn caller_ended(&mut self, now: Now, conn: ConnId, ended: Ended<'_>) {
        let Some(caller) = self.forget_caller(conn) else {
            return;
        };
        let (from, octets) = (caller.far.remote, caller.octets.freeze());
        if octets.is_empty() {
            return;
        }
        if !ended.orderly {
            let reason = format!("the connection broke before its end: {}", ended.reason);
            self.caller_notice(from, octets.len(), &reason);
            return;
        }
        self.whole_letter(now, from, octets, TCP);
    }

    /// A letter came whole, by a transport that is plugged in. Its sender is given no receipt; what
    /// is wrong with it is told by a notice. `from` is where it came from, a URL; `scheme` that of
    /// the transport.
    pub fn letter_came(&mut self, now: Now, from: Text, letter: Bytes, scheme: &'static str) {
        let (octets, max) = (letter.len(), self.config.max_letter);
        let objection = match self.keyless_refusal(&from) {
            _ if self.closing => Some("the service ends".to_owned()),
            Some(refusal) => Some(refusal.to_owned()),
            None if octets > max => {
                Some(format!("it is larger than the {max} octets that are taken"))
            }
            None => None,
        };
        match objection {
            Some(reason) => self.caller_notice(from, octets, &reason),
            None => self.whole_letter(now, from, letter, scheme),
        }
        self.publish_changes(now);
    }

    fn whole_letter(&mut self, now: Now, from: Text, letter: Bytes, via: &'static str) {
        let octets = letter.len();
        let dialect = match EnvelopeRepresentation::detect(&letter) {
            Some(EnvelopeRepresentation::BitEfficient) => Dialect::Cpp,
            _ => Dialect::JadeBridge,
        };
        match read_letter(now, letter, &self.config.limits, via) {
            Ok(inbound) => {
                let letter = Box::new(Returnable::new(&inbound, dialect));
                let origin = Origin::Caller {
                    from,
                    octets,
                    letter,
                };
                self.take_in(now, origin, inbound, Terms::patient_within(TIMEOUT));
            }
            Err(reason) => self.caller_notice(from, octets, &reason),
        }
    }

    /// What became of a caller's letter; nobody waits for that, but somebody may look for it.
    pub(super) fn tell_of_caller(
        &mut self,
        from: Text,
        octets: usize,
        outcomes: &[ReceiverOutcome],
    ) {
        let failed = |told: &&ReceiverOutcome| !told.outcome.is_success() && !Mts::is_stored(told);
        for told in outcomes.iter().filter(failed) {
            let ReceiverOutcome {
                to,
                outcome,
                reason,
                ..
            } = told;
            let why = match (to.is_empty(), outcome) {
                (true, _) => reason.to_string(),
                (false, Outcome::Unknown) => format!("for {to}: {reason}"),
                (false, outcome) => format!("for {to}, {outcome}: {reason}"),
            };
            self.caller_notice(from.clone(), octets, &why);
        }
    }
}

/// Whether a letter in XML may still follow what has come.
fn may_begin_xml(octets: &[u8]) -> bool {
    const MARKS: [&[u8]; 2] = [b"\xef\xbb\xbf", b"\xff\xfe<\0"];
    let marked = MARKS.iter().any(|mark| mark.starts_with(octets));
    let text = octets.strip_prefix(MARKS[0]).unwrap_or(octets);
    marked || octets.len() <= MAX_BLANKS && text.trim_ascii().is_empty()
}

/// Reads a letter that fills its connection, or its message.
fn read_letter(
    now: Now,
    octets: Bytes,
    limits: &Limits,
    via: &'static str,
) -> Result<Inbound, String> {
    let unreadable = |error: &dyn std::fmt::Display| format!("it cannot be read: {error}");
    let (envelope, at) = decode_envelope(&octets, limits).map_err(|e| unreadable(&e))?;
    check_names(&envelope)?;
    let payload = octets.slice(at..);
    let come = payload.len() as u64;
    if let Some(announced) = envelope.payload_length()
        && announced > come
    {
        return Err(format!(
            "it ends after {come} of the {announced} octets of its payload"
        ));
    }
    let in_bits = EnvelopeRepresentation::detect(&octets);
    if in_bits != Some(EnvelopeRepresentation::BitEfficient) {
        return inbound(now, envelope, payload, via).map_err(|e| unreadable(&e));
    }
    Ok(Inbound {
        parts: smallvec![octets],
        envelope,
        payload: at,
        from: None,
        via: Some(via),
        names: Names::FewPatterns,
    })
}

/// Whether the names of the agents in an envelope are of a length that may be one's.
pub(super) fn check_names(envelope: &Envelope) -> Result<(), String> {
    let receivers = [envelope.to(), envelope.intended_receiver()];
    let names = receivers.into_iter().flatten().chain(envelope.from());
    match names.map(|agent| agent.name.len()).max() {
        Some(longest) if longest > MAX_NAME => Err(format!(
            "a name has {longest} octets; up to {MAX_NAME} are taken"
        )),
        _ => Ok(()),
    }
}

/// A letter whose envelope was in XML. Our links carry bit-efficient envelopes, which need what XML
/// may leave out.
pub(super) fn inbound(
    now: Now,
    mut envelope: Envelope,
    payload: Bytes,
    via: &'static str,
) -> Result<Inbound, EncodeError> {
    if envelope.base.acl_representation.is_none() {
        let seen = payload_representation(&envelope, &payload);
        envelope.base.acl_representation = seen.or(Some(Representation::String));
    }
    let date = FipaTime::from_unix_millis(now.unix_millis);
    envelope.base.date.get_or_insert(date);
    let mut head = Encoded::new();
    bit_efficient::encode_envelope(&envelope, &mut head)?;
    let head = head.take_bytes();
    Ok(Inbound {
        payload: head.len(),
        parts: smallvec![head, payload],
        envelope,
        from: None,
        via: Some(via),
        names: Names::FewPatterns,
    })
}
