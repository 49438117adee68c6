//! Our own addition to an AMS: it lists the agents of another platform among its own ones. No
//! other make has it.

use fipa_acl::{AgentId, Message, Text};
use fipa_sl::{Functional, Term};

use super::AnswerError;
use super::answers::objects;
use super::requests::request;
use crate::Reason;
use crate::answer::{Action, Outcome, answer};

/// The function.
const ADD_PLATFORM: &str = "add-platform";

/// Asks the AMS of a platform of ours to list the agents of the platform at this URL.
pub fn platform_request(ams: &AgentId, url: &str) -> Message {
    request(ams, Functional::new(ADD_PLATFORM, [Term::text(url)]))
}

/// The name of the platform whose agents are listed from now on.
pub fn platform_result(answer: &Message) -> Result<Text, AnswerError> {
    let read = |term: &Term| Ok(term.as_text().unwrap_or_default());
    let names = objects(answer, "result", read)?;
    let name = names.into_iter().next();
    name.ok_or(AnswerError::Unexpected("the name of the platform"))
}

/// The URL of the platform that somebody asks to be listed.
pub fn requested_platform(message: &Message) -> Option<Text> {
    let action = Action::of(message).ok()?;
    match action.function.positional() {
        [url] if action.function.is(ADD_PLATFORM) => url.as_text(),
        _ => None,
    }
}

/// The answer to such a request: the platform's name, or why it cannot be asked.
pub fn platform_answer(
    ams: &Text,
    message: &Message,
    result: Result<Text, String>,
) -> Option<Message> {
    let action = Action::of(message).ok()?;
    let outcome = match result {
        Ok(name) => Outcome::Result(vec![Term::text(name)]),
        Err(reason) => Outcome::Failed(Reason::InternalError(Text::from(reason))),
    };
    answer(ams, message, Some(&action), outcome)
}
