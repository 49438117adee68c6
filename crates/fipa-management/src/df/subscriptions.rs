use std::collections::BTreeMap;

use fipa_acl::{AgentId, Message, Performative, Text};
use fipa_sl::{Content, Functional, Term};

use super::detach::detached;
use super::matching::matches;
use crate::answer::{Action, Outcome, read_content};
use crate::objects::{CONSTRAINTS, DF_DESCRIPTION};
use crate::{DfAgentDescription, ONTOLOGY, Reason, SearchConstraints};

/// Who wants to be told, by subscriber and conversation.
#[derive(Debug, Default)]
pub(super) struct Subscriptions {
    of: BTreeMap<(Text, String), Subscription>,
}

/// A search whose results are told as they change.
#[derive(Debug)]
pub(super) struct Subscription {
    /// A notification without its content.
    notification: Message,
    /// The identifying expression, as it was sent.
    query: Term,
    pub(super) template: DfAgentDescription,
    pub(super) constraints: SearchConstraints,
}

impl Subscription {
    /// What a SUBSCRIBE asks for: `((iota ?x (result (action DF (search …)) ?x)))`.
    pub(super) fn of(from: &Text, message: &Message) -> Result<Subscription, Outcome> {
        let query = read_content(message)?.into_first();
        let action = action_of(&query).ok_or(Outcome::NotUnderstood(Reason::UnrecognisedValue(
            Text::from_static("content"),
        )))?;
        if !action.function.is("search") {
            let name = action.function.symbol.clone();
            return Err(Outcome::Refused(Reason::UnsupportedFunction(name)));
        }
        let template = action.object(0, DF_DESCRIPTION)?;
        let constraints = action.object(1, CONSTRAINTS)?;
        action.at_most(2)?;
        let mut notification = detached(&message.reply(Performative::Inform))
            .from_agent(AgentId::new(from))
            // Nobody answers for a subscriber that is gone, and nobody needs to.
            .user_defined("JADE-ignore-failure", "true");
        if notification.ontology.is_none() {
            notification = notification.ontology(ONTOLOGY);
        }
        if notification.language.is_none() {
            notification = notification.language("fipa-sl");
        }
        Ok(Subscription {
            notification,
            query,
            template,
            constraints,
        })
    }

    pub(super) fn notification(&self, items: &[DfAgentDescription]) -> Message {
        let items = Term::sequence(items.iter().map(Term::from));
        let equal = Functional::new("=", [self.query.clone(), items]);
        let content = Content::new(equal).to_bytes();
        self.notification.clone().content(content)
    }
}

/// The action within `(iota ?x (result ACTION ?x))`, or with `any` or `all` for `iota`.
fn action_of(query: &Term) -> Option<Action> {
    let expression = query.as_functional()?;
    let is_identifying = ["iota", "any", "all"].iter().any(|op| expression.is(op));
    let [_, formula] = expression.positional() else {
        return None;
    };
    let result = formula.functional("result").filter(|_| is_identifying)?;
    let action = result.positional().first()?.as_functional()?;
    Action::from_functional(action.clone())
}

impl Subscriptions {
    pub(super) fn len(&self) -> usize {
        self.of.len()
    }

    /// Takes up a subscription in the place of an earlier one of its conversation.
    pub(super) fn insert(&mut self, message: &Message, subscription: Subscription) {
        if let Some(key) = key_of(message) {
            self.of.insert(key, subscription);
        }
    }

    /// Ends the subscription that a CANCEL means: the one of its conversation, or else that of the
    /// SUBSCRIBE which its content repeats. Tells whether there was one.
    pub(super) fn cancel(&mut self, cancel: &Message) -> bool {
        let Some(key) = key_of(cancel) else {
            return false;
        };
        if self.of.remove(&key).is_some() {
            return true;
        }
        let (subscriber, _) = key;
        let conversation = cancelled_conversation(cancel);
        let key = conversation.map(|conversation| (subscriber, conversation));
        key.is_some_and(|key| self.of.remove(&key).is_some())
    }

    /// Ends all subscriptions of an agent.
    pub(super) fn drop_subscriber(&mut self, name: &str) {
        self.of.retain(|(subscriber, _), _| subscriber != name);
    }

    /// What subscribers are told when a description takes the place of another. One that matches
    /// no longer is told as a name without services.
    pub(super) fn changed(
        &self,
        before: Option<&DfAgentDescription>,
        after: Option<&DfAgentDescription>,
    ) -> Vec<Message> {
        let is_match = |subscription: &Subscription, there: Option<&DfAgentDescription>| {
            there.is_some_and(|there| matches(&subscription.template, there))
        };
        let told = self.of.values().filter_map(|subscription| {
            let item = match after {
                Some(after) if is_match(subscription, Some(after)) => after.clone(),
                _ if is_match(subscription, before) => DfAgentDescription {
                    name: before.and_then(|before| before.name.clone()),
                    ..DfAgentDescription::default()
                },
                _ => return None,
            };
            Some(subscription.notification(&[item]))
        });
        told.collect()
    }
}

fn key_of(message: &Message) -> Option<(Text, String)> {
    let subscriber = message.sender.as_ref()?.name.detached();
    let conversation = message.conversation_id.as_ref();
    let conversation = conversation.map(ToString::to_string);
    Some((subscriber, conversation.unwrap_or_default()))
}

/// The conversation of the SUBSCRIBE that a CANCEL repeats as its action.
fn cancelled_conversation(cancel: &Message) -> Option<String> {
    let content = read_content(cancel).ok()?;
    let action = content.first().functional("action")?;
    let [_, act] = action.positional() else {
        return None;
    };
    let conversation = act.functional("subscribe")?.parameter("conversation-id")?;
    match conversation {
        Term::Number(number) => Some(number.to_string()),
        other => Some(other.as_text()?.to_string()),
    }
}
