//! What the conversation monitor says, for people and for programs.

use fipa_conversation::{Expected, Verdict, Violation};
use serde_json::{Value, json};

/// A verdict on the `n`th message.
pub(crate) fn to_json(n: u64, verdict: &Verdict) -> Value {
    match verdict {
        Verdict::Accepted { state } => accepted(n, state),
        Verdict::Violation(violation) => violated(n, violation),
        Verdict::NotMonitored => {
            json!({"n": n, "verdict": "not-monitored", "state": null, "rule": null, "expected": []})
        }
    }
}

pub(crate) fn accepted(n: u64, state: &str) -> Value {
    json!({"n": n, "verdict": "accepted", "state": state, "rule": null, "expected": []})
}

pub(crate) fn violated(n: u64, violation: &Violation) -> Value {
    let expected: Vec<Value> = violation.expected.iter().map(expected_to_json).collect();
    json!({
        "n": n,
        "verdict": "violation",
        "state": violation.state.as_str(),
        "rule": violation.rule.as_str(),
        "expected": expected,
    })
}

fn expected_to_json(expected: &Expected) -> Value {
    json!({
        "performative": expected.performative.as_str(),
        "from": expected.from.as_str(),
        "to": expected.to.as_str(),
    })
}
