use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Expression, Message, Text};
use fipa_directory::Now;
use fipa_protocol::{Library, Outcome, Protocol};

use crate::explain;
use crate::machine::{Context, Machine, Said};
use crate::plan::{NoPlan, Plan, is_name_of, opening};
use crate::verdict::{Rule, Verdict, Violation};

/// One conversation, judged message by message.
///
/// The sender of the first message is the initiator. Each agent that it addresses is a participant
/// with a state of its own, unless the protocol keeps one state for all.
#[derive(Clone, Debug)]
pub struct Conversation {
    protocol: Arc<Protocol>,
    own: Option<Text>,
    begun: Option<Begun>,
}

/// What holds from the first message on.
#[derive(Clone, Debug)]
struct Begun {
    id: Option<Text>,
    /// The protocol as messages bear it.
    bears: Option<Text>,
    machine: Machine,
}

/// One agent's part in a conversation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Participant {
    /// Its name; of several that share a state, all of them.
    pub agents: Vec<Text>,
    /// The state of the interaction with it.
    pub state: Text,
    /// How that ended, if it may.
    pub outcome: Option<Outcome>,
}

/// A message that may be taken, with what it does.
struct Judged<'a> {
    context: Context<'a>,
    said: Said<'a>,
    plan: Plan<'a>,
}

impl Conversation {
    /// A conversation that has not begun. `own` is the agent on whose behalf it is watched; without
    /// one, everybody's messages are seen.
    pub fn new(protocol: Arc<Protocol>, own: Option<Text>) -> Conversation {
        Conversation {
            protocol,
            own,
            begun: None,
        }
    }

    /// The protocol.
    pub fn protocol(&self) -> &Arc<Protocol> {
        &self.protocol
    }

    /// What the message would be, without taking it. `library` has the protocols of
    /// sub-conversations.
    pub fn judge(&self, library: &Library, now: Now, message: &Message) -> Verdict {
        let Some(begun) = &self.begun else {
            return match self.first(library, now, message) {
                Ok(begun) => Verdict::Accepted {
                    state: begun.state(),
                },
                Err(violation) => Verdict::Violation(violation),
            };
        };
        match begun.judge(self.own.as_ref(), library, now, message) {
            Ok(judged) => Verdict::Accepted {
                state: begun.machine.label_after(judged.context, &judged.plan),
            },
            Err(verdict) => verdict,
        }
    }

    /// Judges the message, and takes it if it is accepted.
    pub fn observe(&mut self, library: &Library, now: Now, message: &Message) -> Verdict {
        let Some(begun) = &mut self.begun else {
            return match self.first(library, now, message) {
                Ok(begun) => {
                    let state = begun.state();
                    self.begun = Some(begun);
                    Verdict::Accepted { state }
                }
                Err(violation) => Verdict::Violation(violation),
            };
        };
        match begun.judge(self.own.as_ref(), library, now, message) {
            Ok(Judged {
                context,
                said,
                plan,
            }) => {
                let state = begun.machine.label_after(context, &plan);
                begun.machine.apply(context, said, plan);
                Verdict::Accepted { state }
            }
            Err(verdict) => verdict,
        }
    }

    fn first(
        &self,
        library: &Library,
        now: Now,
        message: &Message,
    ) -> Result<Begun, Box<Violation>> {
        let state = || self.protocol.state(self.protocol.initial()).id().clone();
        let said = said(message, false, state)?;
        let context = Context {
            library,
            own: self.own.as_ref().map(Text::as_str),
            now,
        };
        let Some(transition) = opening(&self.protocol, &message.performative) else {
            return Err(Box::new(explain::no_opening(&self.protocol, said)));
        };
        Ok(Begun {
            id: message.conversation_id.as_ref().map(id_text),
            bears: message
                .protocol
                .as_ref()
                .map(|name| match name == self.protocol.name() {
                    true => self.protocol.name().clone(),
                    false => name.detached(),
                }),
            machine: Machine::open(&self.protocol, context, said, transition),
        })
    }

    /// How many sub-conversations there will be: no more are accepted then, and the conversation
    /// does not end before all of them. To be called after the first message.
    pub fn announce_sub_conversations(&mut self, number: usize) {
        if let Some(begun) = &mut self.begun {
            begun.machine.announced = Some(number);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) changes something, on [`Now::mono`].
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.begun.as_ref()?.machine.deadline()
    }

    /// Its id, once it has begun.
    pub(crate) fn id(&self) -> Option<&Text> {
        self.begun.as_ref()?.id.as_ref()
    }

    /// No time-out is sooner; found out faster than the next one.
    pub(crate) fn soonest(&self) -> Option<Duration> {
        self.begun.as_ref()?.machine.soonest
    }

    /// The time has come; tells whether anything changed.
    pub fn handle_timeout(&mut self, now: Now) -> bool {
        self.begun
            .as_mut()
            .is_some_and(|begun| begun.machine.expire(now))
    }

    /// An agent is gone; tells whether it had a part here.
    pub fn agent_gone(&mut self, name: &str) -> bool {
        self.begun
            .as_mut()
            .is_some_and(|begun| begun.machine.agent_gone(name))
    }

    /// Ends what has not ended, with this outcome; what may end where it is, ended as it was
    /// meant to.
    pub fn abandon(&mut self, outcome: Outcome) {
        if let Some(begun) = &mut self.begun {
            begun.machine.abandon(outcome);
        }
    }

    /// Whether it may end here: every participant is in a final state, and so is every
    /// sub-conversation that was announced or has begun.
    pub fn is_complete(&self) -> bool {
        self.begun
            .as_ref()
            .is_some_and(|begun| begun.machine.is_complete(begun.machine.announced))
    }

    /// Whether nothing can follow any more.
    pub fn is_closed(&self) -> bool {
        self.begun
            .as_ref()
            .is_some_and(|begun| begun.machine.is_closed())
    }

    /// How it ended, if it may end here: done if it is done with any participant.
    pub fn outcome(&self) -> Option<Outcome> {
        self.begun.as_ref()?.machine.outcome()
    }

    /// The state of the first participant.
    pub fn state(&self) -> Text {
        match &self.begun {
            Some(begun) => begun.state(),
            None => self.protocol.state(self.protocol.initial()).id().clone(),
        }
    }

    /// Who takes part, the initiator aside, and how far it came with each.
    pub fn participants(&self) -> Vec<Participant> {
        let Some(Begun { machine, .. }) = &self.begun else {
            return Vec::new();
        };
        let protocol = &machine.protocol;
        machine
            .played()
            .map(|branch| Participant {
                agents: branch
                    .bindings
                    .iter()
                    .map(|(_, agent)| agent.name.clone())
                    .collect(),
                state: branch.label(protocol),
                outcome: branch.ended(protocol, machine.announced),
            })
            .collect()
    }

    /// Who opened it.
    pub fn initiator(&self) -> Option<&Text> {
        self.begun.as_ref().map(|begun| &begun.machine.initiator)
    }
}

impl Begun {
    fn state(&self) -> Text {
        let first = self.machine.played().next();
        first.map_or_else(Text::default, |branch| branch.label(&self.machine.protocol))
    }

    fn judge<'a>(
        &self,
        own: Option<&'a Text>,
        library: &'a Library,
        now: Now,
        message: &'a Message,
    ) -> Result<Judged<'a>, Verdict> {
        let violation = |violation| Verdict::Violation(Box::new(violation));
        if !is_same_id(self.id.as_ref(), message.conversation_id.as_ref()) {
            let found = message.conversation_id.as_ref().map(id_text);
            let (found, known) = (
                found.as_ref().map(Text::as_str),
                self.id.as_ref().map(Text::as_str),
            );
            return Err(violation(explain::other(
                Rule::ConversationId,
                self.state(),
                found,
                known,
            )));
        }
        let foreign = match (&message.protocol, &self.bears) {
            (Some(found), Some(known)) => {
                found != known
                    && !is_name_of(&self.machine.protocol, found)
                    && !is_name_like(known, found)
            }
            (None, None) => false,
            (found, known) => {
                let (found, known) = (
                    found.as_ref().map(Text::as_str),
                    known.as_ref().map(Text::as_str),
                );
                return Err(violation(explain::other(
                    Rule::Protocol,
                    self.state(),
                    found,
                    known,
                )));
            }
        };
        let said = said(message, foreign, || self.state()).map_err(Verdict::Violation)?;
        let context = Context {
            library,
            own: own.map(Text::as_str),
            now,
        };
        match self.machine.plan(context, said) {
            Ok(plan) => Ok(Judged {
                context,
                said,
                plan,
            }),
            Err(NoPlan::Unknown) => Err(Verdict::NotMonitored),
            Err(NoPlan::Wrong(wrong)) => {
                Err(violation(self.machine.explain(context, said, &wrong)))
            }
        }
    }
}

/// The message with what it must say.
fn said(
    message: &Message,
    foreign: bool,
    state: impl FnOnce() -> Text,
) -> Result<Said<'_>, Box<Violation>> {
    let rule = match &message.sender {
        Some(sender) if !message.receiver.is_empty() => {
            return Ok(Said {
                message,
                sender: &sender.name,
                foreign,
            });
        }
        Some(_) => Rule::Receiver,
        None => Rule::Sender,
    };
    Err(Box::new(explain::incomplete(rule, state())))
}

/// Whether two names are forms of one, whatever protocol that is.
fn is_name_like(known: &str, found: &str) -> bool {
    fipa_protocol::canonical_name(known) == fipa_protocol::canonical_name(found)
}

fn is_same_id(known: Option<&Text>, found: Option<&Expression>) -> bool {
    match (known, found) {
        (None, None) => true,
        (Some(known), Some(found)) => match found.as_str() {
            Some(found) => *known == *found,
            None => *known == id_text(found),
        },
        _ => false,
    }
}

/// A conversation-id as a text that does not keep the message alive.
pub(crate) fn id_text(id: &Expression) -> Text {
    match id.as_str() {
        Some(id) => Text::from(id),
        None => Text::from(id.to_string()),
    }
}
