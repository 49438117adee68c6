//! FIPA interaction protocols as data: files in a dialect of SCXML, loaded, checked and drawn.
//!
//! **Knows** the schema below, what is wrong with a file and where, and how a protocol looks.
//! **Never knows** a conversation: who is in which state is the monitor's affair.
//!
//! ```
//! use fipa_protocol::{Limits, load};
//!
//! let file = br#"<scxml initial="asked">
//!   <state id="asked"><transition performative="query-.*" from="initiator" to="B" target="told"/></state>
//!   <state id="told"><transition performative="inform" from="B" to="initiator" target="dnoe"/></state>
//!   <state id="done" final="yes"/>
//! </scxml>"#;
//! let loaded = load("ask.scxml", file, &Limits::default()).unwrap();
//! assert!(loaded.protocol.is_none());
//! assert_eq!(
//!     loaded.diagnostics[0].to_string(),
//!     "3:78: error [undeclared-target]: the target \"dnoe\" is no state of this file; did you mean done?"
//! );
//! ```
//!
//! # The schema
//!
//! Three forms mean the same and may be mixed: the dialect of fipa_acl, the standard SCXML of W3C, and
//! what this crate adds in the namespace [`NAMESPACE`] (shown with the prefix `fipa:`).
//!
//! | element | attributes |
//! |---|---|
//! | outermost (its name is not looked at) | `initial`: the first state, else the first one in the file · `name`: the protocol's, else that of the file without its ending · `fipa:aliases`: further names · `fipa:rules`: `fipa` or `fipa-acl`, see below · `fipa:states`: `participant` (each agent to which the initiator opens the conversation has a state of its own) or `conversation` (all share one) · `fipa:match`: which of `in-reply-to`, `language`, `ontology` are compared |
//! | `<state>`, `<final>` | `id` · `final`: `yes`, `true`, `1`, `no`, `false`, `0` · `initial` of a state that holds states · `fipa:outcome` of a final state: `done`, `refused`, `failed`, `cancelled`, `timed-out`, `peer-lost`, else it follows from the last act · `fipa:timeout`: how long it is stayed in, such as `30s` · `fipa:on-timeout`: the state that is entered when that time, or the `reply-by` of the message that led here, has passed |
//! | `<initial>` within a state or the outermost | holds `<transition target="…"/>` |
//! | `<transition>` within a state | `performative`: a regular expression for the whole name of the act, in any case · `from`, `to`: roles · `target`: a state · or `event`: names of acts, separated by blanks, `*` for any; then `from` and `to` may be left out: the first message goes from `initiator` to `participant`, any other between any two agents of the conversation; without `target` the state stays · `fipa:protocol="any"`: the message may bear the name of another protocol |
//! | `<subprotocol>` within a state | `name`: a regular expression for the name of the protocol · `from`: the role that initiates it · `proxied_to`: the role to which its answer is passed on, once, in this protocol · `fipa:awaited="no"`: this conversation may end before it |
//! | `<fipa:role>` | `name` · `open="yes"`: any agent that has no other role may play it, at any time |
//!
//! A role is any word; whoever first sends or receives in it is bound to it. A role that is a regular
//! expression, such as `.*`, is played by the agents whose names match. `__self__` is the agent
//! whose monitor it is. Within states that hold states, transitions of the outer one hold in each
//! inner one, after its own; reaching an inner `<final>` takes the transition with the event
//! `done.state.ID`. A final state with transitions is one where a conversation may end or go on.
//!
//! Of several transitions that take a message, the first one is taken. `cond` is not evaluated. What
//! else SCXML has (`datamodel`, `onentry`, `invoke`, …) and what stands in other namespaces is
//! ignored; `parallel` and `history` are errors. An unknown element without a prefix is a warning, and so
//! is an attribute that is like a known one, or one of ours without its prefix.
//!
//! # Default transitions
//!
//! A file holds the nominal flow only. With the rules `fipa`, in every state that is not closed:
//! `not-understood` between two agents of the conversation ends the interaction of the two, and so does
//! `failure` from anybody; `cancel` from the initiator begins the cancel meta-protocol: `inform` ends
//! it as cancelled; after `failure` the interaction goes on in the state it was in, and until
//! either comes, the nominal flow goes on too.
//!
//! With the rules `fipa-acl` they are those of its monitor: states and transitions generated for
//! each declared transition (`not-understood` and `cancel` both ways, `failure` from anybody to
//! `__self__`), of which a declared act that matches `not-understood` leaves out all three, and one that
//! matches `cancel` the last two. The conversation has one state, each role name is an expression for
//! names of agents as well, and a failed cancel ends the conversation.

mod check;
mod diagnostic;
pub mod draw;
mod library;
mod limits;
mod loader;
mod names;
mod pattern;
mod performatives;
mod protocol;
mod suggestion;
mod xml;

pub use diagnostic::{Code, Diagnostic, LoadError, Position, Severity};
pub use library::{Library, builtin};
pub use limits::Limits;
pub use loader::{Loaded, load};
pub use names::canonical_name;
pub use pattern::{Pattern, PatternError};
pub use performatives::Performatives;
pub use protocol::{
    Keeping, Matching, Outcome, Party, Protocol, Role, RoleId, Rules, State, StateId, Subprotocol,
    Transition,
};

/// The XML namespace of what this crate adds to SCXML.
pub const NAMESPACE: &str = "urn:x-fipa:protocol:1";
