use fipa_acl::{Message, Performative, Text, UserDefined};
use fipa_sl::{Content, FrameError, Limits, ParseError, Term};

use crate::{AmsAgentDescription, ApDescription, DfAgentDescription, Reason};

/// The parameter by which our DF tells that there is more.
pub(crate) const MORE: &str = "More-Results";

/// Why a message is not the answer that was hoped for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AnswerError {
    /// It agrees; the answer itself is still to come.
    #[error("it agrees, and has not answered yet")]
    NotYet,
    /// It does not do it.
    #[error("refused: {0}")]
    Refused(Reason),
    /// It tried and could not.
    #[error("failed: {0}")]
    Failed(Reason),
    /// It cannot do with the request.
    #[error("not understood: {0}")]
    NotUnderstood(Reason),
    /// The answer's content is no SL.
    #[error("the answer cannot be read: {0}")]
    Content(#[from] ParseError),
    /// The answer holds an object that is none of the ontology.
    #[error("the answer cannot be read: {0}")]
    Object(#[from] FrameError),
    /// The answer is none to this request.
    #[error("the answer is not one to this request: {0} is missing")]
    Unexpected(&'static str),
}

/// The descriptions that a DF found.
pub fn search_result(answer: &Message) -> Result<Vec<DfAgentDescription>, AnswerError> {
    objects(answer, "result", |term| DfAgentDescription::try_from(term))
}

/// Whether a DF knows more than it tells in its answer to a search, or in the first notification of a
/// subscription, though more was wanted. Ours says so in a parameter of its own, `X-More-Results`;
/// JADE's says nothing.
pub fn has_more(message: &Message) -> bool {
    let is_mark = |given: &UserDefined| given.name.eq_ignore_ascii_case(MORE);
    message.user_defined.iter().any(is_mark)
}

/// The descriptions that a DF tells a subscriber. One that has nothing but its name matches no
/// longer.
pub fn notification(message: &Message) -> Result<Vec<DfAgentDescription>, AnswerError> {
    objects(message, "=", |term| DfAgentDescription::try_from(term))
}

/// The agents that an AMS lists. JADE's lists most without addresses: see
/// [`AmsAgentDescription::at`].
pub fn agents_result(answer: &Message) -> Result<Vec<AmsAgentDescription>, AnswerError> {
    objects(answer, "result", |term| AmsAgentDescription::try_from(term))
}

/// What an AMS tells about its platform.
pub fn description_result(answer: &Message) -> Result<ApDescription, AnswerError> {
    let found = objects(answer, "result", |term| ApDescription::try_from(term))?;
    let first = found.into_iter().next();
    first.ok_or(AnswerError::Unexpected("the ap-description"))
}

/// Whether an action was done.
pub fn done(answer: &Message) -> Result<(), AnswerError> {
    done_action(answer).map(|_| ())
}

/// The description that a DF registered, with the lease that it granted.
pub fn registered(answer: &Message) -> Result<DfAgentDescription, AnswerError> {
    let missing = AnswerError::Unexpected("the registered description");
    let action = done_action(answer)?;
    let function = action
        .functional("action")
        .map(|action| action.positional());
    let Some([_, Term::Functional(function)]) = function else {
        return Err(missing);
    };
    let description = function.positional().first().ok_or(missing)?;
    Ok(DfAgentDescription::try_from(description)?)
}

fn done_action(answer: &Message) -> Result<Term, AnswerError> {
    let expression = informed(answer)?;
    let done = expression.functional("done");
    let action = done.and_then(|done| done.positional().first());
    action.cloned().ok_or(AnswerError::Unexpected("(done …)"))
}

/// The objects in what stands behind the action or the query.
pub(super) fn objects<T>(
    answer: &Message,
    operator: &'static str,
    read: impl Fn(&Term) -> Result<T, FrameError>,
) -> Result<Vec<T>, AnswerError> {
    let expression = informed(answer)?;
    let Some([_, value]) = expression.functional(operator).map(|f| f.positional()) else {
        return Err(AnswerError::Unexpected("the result"));
    };
    let items = value.items().unwrap_or(std::slice::from_ref(value));
    Ok(items.iter().map(read).collect::<Result<_, _>>()?)
}

/// The expression that an INFORM tells.
fn informed(answer: &Message) -> Result<Term, AnswerError> {
    match answer.performative {
        Performative::Inform => Ok(content(answer)?.into_first()),
        Performative::Agree => Err(AnswerError::NotYet),
        Performative::Refuse => Err(AnswerError::Refused(reason(answer))),
        Performative::Failure => Err(AnswerError::Failed(reason(answer))),
        Performative::NotUnderstood => Err(AnswerError::NotUnderstood(reason(answer))),
        _ => Err(AnswerError::Unexpected("an inform")),
    }
}

/// All that our DF may know at the most.
const LIMITS: Limits = Limits {
    max_octets: 64 << 20,
    max_depth: 64,
    max_terms: 4 << 20,
};

fn content(message: &Message) -> Result<Content, ParseError> {
    let octets = message.content.clone().unwrap_or_default();
    Content::parse(&octets, &LIMITS)
}

/// Why a request came to nothing: the last of what is said. Some peers write the reason without
/// the parentheses around it, or plain words.
fn reason(answer: &Message) -> Reason {
    let octets = answer.content.clone().unwrap_or_default();
    match content(answer) {
        Ok(content) if content.first().as_text().is_none() => {
            Reason::from(content.others().last().unwrap_or(content.first()))
        }
        Ok(_) if let Ok(term) = Term::parse(&octets, &Limits::default()) => Reason::from(&term),
        _ => Reason::InternalError(Text::from_utf8_lossy(octets)),
    }
}
