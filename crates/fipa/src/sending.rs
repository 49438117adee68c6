//! From a message to a letter, and to its outcomes.

use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Message, Representation, Slots, Text};
use fipa_codec::{Output, bit_efficient};
use fipa_link::{Outcome, ReceiverOutcome};
use fipa_mts::Submission;

use crate::platform::Inner;

/// Sends a message and waits for what becomes of it: one outcome for each receiver that its names
/// and patterns resolve to. It never waits longer than `timeout`, nor than `reply-by`.
pub(crate) async fn send(
    platform: &Arc<Inner>,
    mut message: Message,
    timeout: Duration,
) -> Vec<ReceiverOutcome> {
    let now = platform.clock.now().unix_millis;
    let reply_by = message.reply_by.map(|reply_by| reply_by.resolve(now));
    // A relative time means another point in time wherever it is read.
    message.reply_by = reply_by.map(FipaTime::from_unix_millis);
    let letter = match letter(message.clone(), now) {
        Ok(letter) => letter,
        Err(reason) => return failed(&message.receiver, Outcome::Refused, &reason),
    };
    let outcomes = platform.backend.with(|now, machine, hub| {
        let (ticket, outcomes) = hub.expect_outcome();
        let submission = Submission {
            reply_by,
            ..Submission::new(ticket, letter, timeout)
        };
        machine.submit(now, submission);
        outcomes
    });
    match outcomes.await {
        Ok(outcomes) => named(outcomes, &message.receiver),
        Err(_) => failed(
            &message.receiver,
            Outcome::Timeout,
            "the platform has ended",
        ),
    }
}

/// An outcome that holds for the whole letter names no receiver: it holds for each.
fn named(outcomes: Vec<ReceiverOutcome>, receivers: &[AgentId]) -> Vec<ReceiverOutcome> {
    match &outcomes[..] {
        [only] if only.to.is_empty() => failed(receivers, only.outcome, &only.reason),
        _ => outcomes,
    }
}

fn failed(receivers: &[AgentId], outcome: Outcome, reason: &str) -> Vec<ReceiverOutcome> {
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
fn letter(mut message: Message, now: i64) -> Result<Letter, String> {
    let receivers = message.receiver.clone();
    // A pattern such as (a|b)@x is no word, which a name within a message must be; the envelope,
    // which alone decides where the letter goes, takes any text.
    message.receiver.retain(|receiver| receiver.name.is_word());
    let mut payload = Output::new();
    bit_efficient::encode_message(&message, &mut payload).map_err(|error| error.to_string())?;
    let payload = payload.take_bytes();
    let base = Slots {
        to: receivers.clone(),
        from: message.sender.clone(),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(payload.len() as u64),
        date: Some(FipaTime::from_unix_millis(now)),
        intended_receiver: receivers,
        ..Slots::default()
    };
    Ok(Letter {
        envelope: Envelope::new(base),
        payload,
    })
}
