use std::fmt;
use std::time::Duration;

use fipa_acl::Text;

use crate::diagnostic::Position;
use crate::pattern::Pattern;
use crate::performatives::Performatives;

/// An interaction protocol: roles, states, and the messages that lead from state to state.
///
/// Made by [`load`](crate::load) only, so that it holds what the checks found to hold: every target
/// is a state, and every state that is not final has a way on.
#[derive(Clone, Debug)]
pub struct Protocol {
    pub(crate) name: Text,
    pub(crate) aliases: Vec<Text>,
    pub(crate) roles: Vec<Role>,
    pub(crate) states: Vec<State>,
    pub(crate) initial: StateId,
    pub(crate) rules: Rules,
    pub(crate) keeping: Keeping,
    pub(crate) matching: Matching,
}

/// A state of one protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StateId(pub(crate) u16);

/// A role of one protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RoleId(pub(crate) u16);

/// Which default transitions there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rules {
    /// Those of FIPA: `not-understood` either way and `failure` to anybody end the interaction with
    /// a participant; `cancel` of the initiator begins the cancel meta-protocol, and if that fails,
    /// the interaction goes on.
    #[default]
    Fipa,
    /// Those of fipa_acl, which are states and transitions of the protocol, and its binding of
    /// roles.
    FipaAcl,
}

/// What has a state of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keeping {
    /// Each agent to which the initiator opened the conversation.
    #[default]
    ByParticipant,
    /// The conversation; the agents of one role share it.
    ByConversation,
}

/// What is compared beside the act, the sender and the receivers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Matching {
    /// An answer's `in-reply-to` is the `reply-with` of what it answers.
    pub in_reply_to: bool,
    /// The language is that of the first message.
    pub language: bool,
    /// The ontology is that of the first message.
    pub ontology: bool,
}

impl RoleId {
    /// Its place among the roles of the protocol.
    pub fn index(self) -> usize {
        usize::from(self.0)
    }
}

/// A part that agents play in a protocol.
#[derive(Clone, Debug)]
pub struct Role {
    pub(crate) name: Text,
    pub(crate) open: bool,
    pub(crate) pattern: Option<Pattern>,
}

/// Who sends or receives what a transition takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Party {
    /// The agents of a role.
    Role(RoleId),
    /// Any agent of the conversation: the file does not say.
    Any,
    /// The agent whose monitor it is (`__self__`).
    Own,
}

/// A state of a protocol.
#[derive(Clone, Debug)]
pub struct State {
    pub(crate) id: Text,
    pub(crate) is_final: bool,
    pub(crate) outcome: Option<Outcome>,
    pub(crate) timeout: Option<Duration>,
    pub(crate) on_timeout: Option<StateId>,
    pub(crate) transitions: Vec<Transition>,
    pub(crate) subprotocols: Vec<Subprotocol>,
    /// Where the file has it; default states have none.
    pub(crate) position: Option<Position>,
}

/// What leads from one state to another.
#[derive(Clone, Debug)]
pub struct Transition {
    pub(crate) performatives: Performatives,
    pub(crate) from: Party,
    pub(crate) to: Party,
    pub(crate) target: StateId,
    pub(crate) any_protocol: bool,
    pub(crate) guarded: bool,
    pub(crate) inherited: bool,
    /// Where the file has it; default transitions have none.
    pub(crate) position: Option<Position>,
}

/// Conversations of another protocol that take place within a state.
#[derive(Clone, Debug)]
pub struct Subprotocol {
    pub(crate) name: Pattern,
    pub(crate) expression: Text,
    pub(crate) from: Party,
    pub(crate) proxied_to: Option<Party>,
    pub(crate) awaited: bool,
}

/// How an interaction ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Outcome {
    /// As it was meant to.
    Done,
    /// An offer, a request or a proposal was turned down.
    Refused,
    /// Something failed, or was not understood.
    Failed,
    /// The initiator cancelled it.
    Cancelled,
    /// An answer did not come in time.
    TimedOut,
    /// An agent that was waited for is gone.
    PeerLost,
}

impl Protocol {
    /// The name, as messages bear it.
    pub fn name(&self) -> &Text {
        &self.name
    }

    /// Further names.
    pub fn aliases(&self) -> &[Text] {
        &self.aliases
    }

    /// The roles, those of the first transition first.
    pub fn roles(&self) -> &[Role] {
        &self.roles
    }

    /// The states in the order of the file; default states of [`Rules::FipaAcl`] follow.
    pub fn states(&self) -> impl Iterator<Item = (StateId, &State)> + Clone {
        (0..).map(StateId).zip(&self.states)
    }

    /// The state before the first message.
    pub fn initial(&self) -> StateId {
        self.initial
    }

    /// Which default transitions there are.
    pub fn rules(&self) -> Rules {
        self.rules
    }

    /// What has a state of its own.
    pub fn keeping(&self) -> Keeping {
        self.keeping
    }

    /// What is compared beside the act, the sender and the receivers.
    pub fn matching(&self) -> Matching {
        self.matching
    }

    /// A state of this protocol.
    ///
    /// # Panics
    /// The id is one of another protocol that has more states.
    #[inline]
    pub fn state(&self, id: StateId) -> &State {
        &self.states[usize::from(id.0)]
    }

    /// A role of this protocol; `None` for an id of another one.
    #[inline]
    pub fn role(&self, id: RoleId) -> Option<&Role> {
        self.roles.get(usize::from(id.0))
    }

    /// The role of whoever opens the conversation.
    pub fn initiator(&self) -> Party {
        let first = self.state(self.initial).transitions.first();
        first.map_or(Party::Any, |transition| transition.from)
    }

    /// The name of a party as people read it.
    pub fn party_name(&self, party: Party) -> &str {
        match party {
            Party::Role(id) => self.role(id).map_or("anybody", |role| &role.name),
            Party::Any => "anybody",
            Party::Own => SELF,
        }
    }
}

/// The role of the agent whose monitor it is.
pub(crate) const SELF: &str = "__self__";

impl Role {
    /// The name.
    pub fn name(&self) -> &Text {
        &self.name
    }

    /// Whether any agent may play it at any time; nobody is bound to it.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// Whether the name of the role is an expression that the agent's name matches.
    #[inline]
    pub fn takes(&self, agent: &str) -> bool {
        self.pattern
            .as_ref()
            .is_some_and(|pattern| pattern.matches(agent))
    }
}

impl State {
    /// The id.
    pub fn id(&self) -> &Text {
        &self.id
    }

    /// Whether the interaction may end here. If it has transitions, it may go on as well.
    #[inline]
    pub fn is_final(&self) -> bool {
        self.is_final
    }

    /// What ending here means, if the file says.
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// How long it is stayed in.
    pub fn timeout(&self) -> Option<Duration> {
        self.timeout
    }

    /// The state that is entered when that time, or the `reply-by` of the last message, has
    /// passed; without one the interaction has then timed out.
    pub fn on_timeout(&self) -> Option<StateId> {
        self.on_timeout
    }

    /// What leads on, in the order in which it is tried.
    #[inline]
    pub fn transitions(&self) -> &[Transition] {
        &self.transitions
    }

    /// What takes place within it.
    pub fn subprotocols(&self) -> &[Subprotocol] {
        &self.subprotocols
    }

    /// Whether the file has it; else it is a default state.
    pub fn is_declared(&self) -> bool {
        self.position.is_some()
    }
}

impl Transition {
    /// The acts that it takes.
    #[inline]
    pub fn performatives(&self) -> &Performatives {
        &self.performatives
    }

    /// Who sends them.
    #[inline]
    pub fn from(&self) -> Party {
        self.from
    }

    /// Who receives them.
    #[inline]
    pub fn to(&self) -> Party {
        self.to
    }

    /// The state to which it leads.
    #[inline]
    pub fn target(&self) -> StateId {
        self.target
    }

    /// Whether the message may bear the name of another protocol.
    pub fn takes_any_protocol(&self) -> bool {
        self.any_protocol
    }

    /// Whether the file has it; else it is a default transition.
    pub fn is_declared(&self) -> bool {
        self.position.is_some()
    }
}

impl Subprotocol {
    /// Which protocols, by their names.
    pub fn name(&self) -> &Pattern {
        &self.name
    }

    /// Who initiates them.
    pub fn from(&self) -> Party {
        self.from
    }

    /// To whom the initiator passes the answer on.
    pub fn proxied_to(&self) -> Option<Party> {
        self.proxied_to
    }

    /// Whether this conversation ends only after them.
    pub fn is_awaited(&self) -> bool {
        self.awaited
    }
}

impl Outcome {
    /// The outcome as files and programs write it, such as `timed-out`.
    pub fn as_str(self) -> &'static str {
        match self {
            Outcome::Done => "done",
            Outcome::Refused => "refused",
            Outcome::Failed => "failed",
            Outcome::Cancelled => "cancelled",
            Outcome::TimedOut => "timed-out",
            Outcome::PeerLost => "peer-lost",
        }
    }

    pub(crate) fn named(name: &str) -> Option<Outcome> {
        let all = [
            Outcome::Done,
            Outcome::Refused,
            Outcome::Failed,
            Outcome::Cancelled,
            Outcome::TimedOut,
            Outcome::PeerLost,
        ];
        all.into_iter().find(|outcome| outcome.as_str() == name)
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}
