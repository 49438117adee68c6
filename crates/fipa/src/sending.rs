//! From a message to a letter, and to its outcomes.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Message, Representation, Slots, Text};
use fipa_codec::{Output, bit_efficient};
use fipa_link::{Outcome, ReceiverOutcome};
use fipa_mts::Submission;
use tokio::sync::oneshot;

use crate::platform::Inner;
use crate::room::{Place, Room};
use crate::{DEFAULT_TIMEOUT, TrySendError};

/// The parameter of a message that becomes the envelope's: how urgent the letter is.
const PRIORITY: &str = "Priority";

/// A message that was handed over: what becomes of it, one outcome for each receiver that its names
/// and patterns resolve to. When it is dropped the letter is still under way.
#[derive(Debug)]
#[must_use = "nobody else learns what became of the message"]
pub struct Sending {
    receivers: Vec<AgentId>,
    stage: Stage,
}

#[derive(Debug)]
enum Stage {
    Known(Vec<ReceiverOutcome>),
    UnderWay(oneshot::Receiver<Vec<ReceiverOutcome>>),
}

impl Sending {
    /// What is known without anything being handed over.
    pub(crate) fn known(outcomes: Vec<ReceiverOutcome>) -> Sending {
        Sending {
            receivers: Vec::new(),
            stage: Stage::Known(outcomes),
        }
    }
}

impl Future for Sending {
    type Output = Vec<ReceiverOutcome>;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Vec<ReceiverOutcome>> {
        let outcomes = match &mut self.stage {
            Stage::Known(outcomes) => return Poll::Ready(std::mem::take(outcomes)),
            Stage::UnderWay(outcomes) => ready!(Pin::new(outcomes).poll(cx)),
        };
        let receivers = &self.receivers;
        Poll::Ready(match outcomes {
            Ok(outcomes) => named(outcomes, receivers),
            Err(_) => failed(receivers, Outcome::Timeout, "the platform has ended"),
        })
    }
}

/// A message as a letter.
struct Written {
    letter: Letter,
    receivers: Vec<AgentId>,
    /// When its answer is not wanted any more.
    reply_by: Option<i64>,
}

/// Sends a message and waits for what becomes of it: one outcome for each receiver that its names
/// and patterns resolve to. It never waits longer than `timeout`, nor than `reply-by`.
pub(crate) async fn send(
    platform: &Arc<Inner>,
    room: &Room,
    message: Message,
    timeout: Duration,
) -> Vec<ReceiverOutcome> {
    let begun = platform.clock.now();
    let written = match write(platform, message) {
        Ok(written) => written,
        Err(outcomes) => return outcomes,
    };
    let octets = written.letter.payload.len();
    let wait = tokio::time::timeout(timeout, room.wait(octets));
    let Ok(Some(place)) = wait.await else {
        let reason = "too many letters of its sender were under way";
        return failed(&written.receivers, Outcome::Timeout, reason);
    };
    let waited = platform.clock.now().mono.saturating_sub(begun.mono);
    let left = timeout.saturating_sub(waited);
    hand_over(platform, written, left, true, place).await
}

/// Hands a message over if that needs no waiting.
pub(crate) fn try_send(
    platform: &Arc<Inner>,
    room: &Room,
    message: Message,
    timeout: Duration,
) -> Result<Sending, TrySendError> {
    let octets = message.content.as_ref().map_or(0, bytes::Bytes::len);
    let Some(place) = room.take(octets) else {
        return Err(TrySendError::Full(Box::new(message)));
    };
    let mut sending = match write(platform, message.clone()) {
        Ok(written) => hand_over(platform, written, timeout, false, place),
        Err(outcomes) => Sending::known(outcomes),
    };
    // What is known at once tells whether there was room on this platform.
    if let Stage::UnderWay(outcomes) = &mut sending.stage
        && let Ok(told) = outcomes.try_recv()
    {
        if !told.is_empty() && told.iter().all(fipa_mts::is_full) {
            return Err(TrySendError::Full(Box::new(message)));
        }
        sending.stage = Stage::Known(named(told, &sending.receivers));
    }
    Ok(sending)
}

fn write(platform: &Arc<Inner>, mut message: Message) -> Result<Written, Vec<ReceiverOutcome>> {
    let now = platform.clock.now().unix_millis;
    let reply_by = message.reply_by.map(|reply_by| reply_by.resolve(now));
    // A relative time means another point in time wherever it is read.
    message.reply_by = reply_by.map(FipaTime::from_unix_millis);
    let receivers = message.receiver.clone();
    match letter(message, now) {
        Ok(letter) => Ok(Written {
            letter,
            receivers,
            reply_by,
        }),
        Err(reason) => Err(failed(&receivers, Outcome::Refused, &reason)),
    }
}

fn hand_over(
    platform: &Arc<Inner>,
    written: Written,
    timeout: Duration,
    patient: bool,
    place: Place,
) -> Sending {
    let outcomes = platform.backend.with(|now, machine, hub| {
        let (ticket, outcomes) = hub.expect_outcome(Some(place));
        let submission = Submission {
            reply_by: written.reply_by,
            patient,
            ..Submission::new(ticket, written.letter, timeout)
        };
        machine.submit(now, submission);
        outcomes
    });
    Sending {
        receivers: written.receivers,
        stage: Stage::UnderWay(outcomes),
    }
}

/// An outcome that holds for the whole letter names no receiver: it holds for each.
fn named(outcomes: Vec<ReceiverOutcome>, receivers: &[AgentId]) -> Vec<ReceiverOutcome> {
    match &outcomes[..] {
        [only] if only.to.is_empty() => failed(receivers, only.outcome, &only.reason),
        _ => outcomes,
    }
}

/// Sends a message of which nobody waits to learn what became.
pub(crate) fn post(platform: &Inner, message: Message) {
    let now = platform.clock.now().unix_millis;
    match letter(message, now) {
        Ok(letter) => platform.backend.with(|now, machine, hub| {
            let (ticket, _) = hub.expect_outcome(None);
            machine.submit(now, Submission::new(ticket, letter, DEFAULT_TIMEOUT));
        }),
        Err(reason) => tracing::warn!("a message cannot be written: {reason}"),
    }
}

pub(crate) fn failed(
    receivers: &[AgentId],
    outcome: Outcome,
    reason: &str,
) -> Vec<ReceiverOutcome> {
    let one = |to: Text| ReceiverOutcome {
        to,
        outcome,
        via: None,
        reason: Text::from(reason),
    };
    match receivers {
        [] => vec![one(Text::default())],
        receivers => receivers.iter().map(|r| one(r.name.clone())).collect(),
    }
}

/// The letter around a message: addressed as the message is, dated now.
pub(crate) fn letter(mut message: Message, now: i64) -> Result<Letter, String> {
    let receivers = message.receiver.clone();
    // A pattern such as (a|b)@x is no word, which a name within a message must be; the envelope,
    // which alone decides where the letter goes, takes any text.
    message.receiver.retain(|receiver| receiver.name.is_word());
    let mut payload = Output::new();
    bit_efficient::encode_message(&message, &mut payload).map_err(|error| error.to_string())?;
    let payload = payload.take_bytes();
    let urgency = message.user_defined.iter();
    let urgency = urgency.filter(|p| p.name.eq_ignore_ascii_case(PRIORITY));
    let user_defined = urgency.map(|p| (p.name.clone(), Text::from(p.value.to_string())));
    let base = Slots {
        to: receivers.clone(),
        from: message.sender.clone(),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(payload.len() as u64),
        date: Some(FipaTime::from_unix_millis(now)),
        intended_receiver: receivers,
        user_defined: user_defined.collect(),
        ..Slots::default()
    };
    Ok(Letter {
        envelope: Envelope::new(base),
        payload,
    })
}
