use fipa_acl::FipaTime;
use fipa_directory::{Now, Record};
use fipa_link::ReceiverOutcome;
use serde_json::{Value, json};

/// An entry of the directory, with its age at `now` in seconds.
pub fn record_to_json(record: &Record, now: Now) -> Value {
    let entry = &record.entry;
    let locations: Vec<Value> = entry
        .locations
        .iter()
        .map(|l| json!({"address": l.address.as_str(), "signature": l.signature.as_str()}))
        .collect();
    let age = now.mono.saturating_sub(record.since);
    json!({
        "name": entry.name.as_str(),
        "type": entry.kind.as_str(),
        "locations": locations,
        "description": entry.description.as_str(),
        "timestamp": FipaTime::from_unix_millis(entry.timestamp).to_string(),
        "age_s": (age.as_secs_f64() * 1000.0).round() / 1000.0,
        "source": record.source.as_str(),
        "state": record.state.as_str(),
    })
}

/// What became of a letter for one receiver. `via` is null where it went nowhere, `reason` is
/// null where it arrived.
pub fn outcome_to_json(outcome: &ReceiverOutcome) -> Value {
    json!({
        "to": outcome.to.as_str(),
        "outcome": outcome.outcome.as_str(),
        "via": outcome.via.as_deref(),
        "reason": Some(outcome.reason.as_str()).filter(|reason| !reason.is_empty()),
    })
}
