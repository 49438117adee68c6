//! Whether others reach the daemon of this host: a way out need not be a way in.

use fipa::{CallBack, CallBackResult};

use super::super::evidence::Back;
use super::{Check, failed, ok, warning};

/// What came of having another daemon call.
pub(super) fn called_back(back: &Back) -> Vec<Check> {
    let whom = &back.whom;
    let unknown = |reason: &str| {
        let said = format!("whether {whom} reaches this daemon is not known: {reason}");
        let advice =
            "ask again in a minute, or run fipa doctor there; best have both of one version";
        vec![warning("port", said, advice)]
    };
    let Some(answer) = &back.answer else {
        return unknown("it does not answer, and may be of an older version");
    };
    if !answer.refusal.is_empty() {
        return unknown(&answer.refusal);
    }
    if answer.calls.is_empty() {
        return vec![warning(
            "port",
            format!("{whom} cannot call this daemon, which listens on this host only"),
            "start fipad with --listen ADDRESS:PORT, lest all depends on who calls first",
        )];
    }
    let reached = |call: &&CallBack| call.result == CallBackResult::Answered;
    let somewhere = answer.calls.iter().any(|call| reached(&call));
    let calls = answer.calls.iter();
    calls.map(|call| one(whom, call, somewhere)).collect()
}

/// One address; `somewhere`: the daemon is reached at this one or at another.
fn one(whom: &str, call: &CallBack, somewhere: bool) -> Check {
    let address = &call.address;
    let bad = match somewhere {
        true => warning,
        false => failed,
    };
    let said = format!(
        "{whom} cannot reach this daemon at {address}: {}",
        call.reason
    );
    match call.result {
        CallBackResult::Answered => ok("port", format!("{whom} reaches this daemon at {address}")),
        CallBackResult::Untried if somewhere => ok(
            "port",
            format!("{whom} did not try {address}: {}", call.reason),
        ),
        CallBackResult::Untried => warning(
            "port",
            format!("{whom} did not try {address}: {}", call.reason),
            "see that --advertise is an address of this host in the network of the robots",
        ),
        CallBackResult::NotReached => bad(
            "port",
            said,
            "a firewall on this robot, or on the way, drops incoming TCP: let this port in",
        ),
        CallBackResult::Refused => bad(
            "port",
            said,
            "a firewall on this robot rejects incoming TCP, or --advertise names the wrong port",
        ),
        CallBackResult::Stranger => bad(
            "port",
            said,
            "the address or the port belongs to somebody else: see --listen and --advertise",
        ),
    }
}
