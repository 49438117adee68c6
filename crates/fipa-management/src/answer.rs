//! What the AMS and the DF have in common: taking a request apart, and answering it.

use bytes::Bytes;
use fipa_acl::{AgentId, Message, Performative, Text};
use fipa_sl::{Arguments, Content, FrameError, Functional, Limits, Profile, Term};

use crate::objects::unexpected_parameter;
use crate::{ONTOLOGY, Reason};

/// What is read of a request: far more than any honest one has.
pub(crate) const LIMITS: Limits = Limits {
    max_octets: 64 << 10,
    max_depth: 32,
    max_terms: 4096,
};

/// The action that is asked for.
#[derive(Debug)]
pub(crate) struct Action {
    actor: Term,
    pub(crate) function: Functional,
}

/// What an answer says.
pub(crate) enum Outcome {
    Done,
    Result(Vec<Term>),
    Refused(Reason),
    Failed(Reason),
    NotUnderstood(Reason),
}

impl From<FrameError> for Outcome {
    fn from(error: FrameError) -> Outcome {
        Outcome::Refused(Reason::from(error))
    }
}

impl Action {
    /// The action in the content of a request; it shares no buffer with the message.
    pub(crate) fn of(message: &Message) -> Result<Action, Outcome> {
        let content = read_content(message)?;
        let not_understood =
            || Outcome::NotUnderstood(Reason::UnrecognisedValue(Text::from_static("content")));
        let Term::Functional(action) = content.into_first() else {
            return Err(not_understood());
        };
        match Action::from_functional(action) {
            Some(action) => Ok(action),
            None => Err(not_understood()),
        }
    }

    pub(crate) fn from_functional(action: Functional) -> Option<Action> {
        if !action.is("action") {
            return None;
        }
        let Arguments::Positional(arguments) = action.arguments else {
            return None;
        };
        let [actor, Term::Functional(function)] = <[Term; 2]>::try_from(arguments).ok()? else {
            return None;
        };
        Some(Action { actor, function })
    }

    /// The object that stands as the argument at this place. What it says that the ontology does
    /// not know is refused: it could neither be stored nor matched.
    pub(crate) fn object<'a, T>(&'a self, at: usize, object: &'static str) -> Result<T, Outcome>
    where
        T: TryFrom<&'a Term, Error = FrameError>,
    {
        let argument = self.function.positional().get(at);
        let argument = argument.ok_or(FrameError::NotA { object })?;
        let value = T::try_from(argument)?;
        match unexpected_parameter(argument) {
            Some(reason) => Err(Outcome::Refused(reason)),
            None => Ok(value),
        }
    }

    /// Checks that there are no more arguments than the function has.
    pub(crate) fn at_most(&self, count: usize) -> Result<(), Outcome> {
        if self.function.positional().len() > count || !self.function.parameters().is_empty() {
            return Err(Outcome::Refused(Reason::UnexpectedArgumentCount));
        }
        Ok(())
    }

    pub(crate) fn to_term(&self) -> Term {
        Functional::action(self.actor.clone(), self.function.clone().into()).into()
    }
}

/// The content of a message, in a buffer of its own: what is kept of it must not keep the letter.
pub(crate) fn read_content(message: &Message) -> Result<Content, Outcome> {
    let octets = message.content.as_deref().unwrap_or_default();
    let read = match octets.len() > LIMITS.max_octets {
        true => None,
        false => Content::parse(&Bytes::copy_from_slice(octets), &LIMITS).ok(),
    };
    let unreadable = Reason::UnrecognisedValue(Text::from_static("content"));
    read.ok_or(Outcome::NotUnderstood(unreadable))
}

/// Checks that the language and the ontology are ours; what is not said is taken to be.
pub(crate) fn check_terms_of(message: &Message) -> Result<(), Outcome> {
    let unsupported = |name| {
        Err(Outcome::NotUnderstood(Reason::UnsupportedValue(
            Text::from_static(name),
        )))
    };
    let language = message.language.as_ref().map(ToString::to_string);
    if language.is_some_and(|name| Profile::from_language(&name).is_none()) {
        return unsupported("language");
    }
    let ontology = message.ontology.as_ref().map(ToString::to_string);
    if ontology.is_some_and(|name| !name.eq_ignore_ascii_case(ONTOLOGY)) {
        return unsupported("ontology");
    }
    Ok(())
}

/// The answer to an act that the agent does not take. What answers an earlier act is never
/// answered, or two agents could go on for ever.
pub(crate) fn not_taken(from: &Text, message: &Message) -> Option<Message> {
    let opens = matches!(
        message.performative,
        Performative::Cfp
            | Performative::Propagate
            | Performative::Propose
            | Performative::Proxy
            | Performative::QueryIf
            | Performative::QueryRef
            | Performative::RequestWhen
            | Performative::RequestWhenever
            | Performative::Subscribe
            | Performative::Other(_)
    );
    if !opens {
        return None;
    }
    let act = Text::from(message.performative.as_str());
    let outcome = Outcome::NotUnderstood(Reason::UnsupportedAct(act));
    answer(from, message, None, outcome)
}

/// The answer of an agent to a message; none where nobody is named to whom it could go.
pub(crate) fn answer(
    from: &Text,
    message: &Message,
    action: Option<&Action>,
    outcome: Outcome,
) -> Option<Message> {
    let (act, content) = match outcome {
        Outcome::Done => {
            let done = Functional::new("done", action.map(Action::to_term));
            (Performative::Inform, Content::new(done))
        }
        Outcome::Result(items) => {
            let items = Term::sequence(items);
            let arguments = action.map(Action::to_term).into_iter().chain([items]);
            let result = Functional::new("result", arguments);
            (Performative::Inform, Content::new(result))
        }
        Outcome::Refused(reason) => (Performative::Refuse, explained(action, &reason)),
        Outcome::Failed(reason) => (Performative::Failure, explained(action, &reason)),
        Outcome::NotUnderstood(reason) => (Performative::NotUnderstood, explained(action, &reason)),
    };
    reply(from, message, act, &content)
}

/// The action and the reason behind it; the reason alone where no action could be read.
fn explained(action: Option<&Action>, reason: &Reason) -> Content {
    match action {
        Some(action) => Content::new(action.to_term()).and(reason),
        None => Content::new(reason),
    }
}

/// A reply with a content in SL.
pub(crate) fn reply(
    from: &Text,
    message: &Message,
    act: Performative,
    content: &Content,
) -> Option<Message> {
    let mut reply = message.reply(act).from_agent(AgentId::new(from));
    if reply.receiver.is_empty() {
        return None;
    }
    let language = reply.language.as_ref().map(ToString::to_string);
    if language.is_none_or(|name| Profile::from_language(&name).is_none()) {
        reply = reply.language(content.profile().language());
    }
    if reply.ontology.is_none() {
        reply = reply.ontology(ONTOLOGY);
    }
    Some(reply.content(content.to_bytes()))
}
