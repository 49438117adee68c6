//! The content language SL (FIPA SC00008I): read, print, take apart.
//!
//! ```text
//!   octets ──▶ Content ── Terms ── Functional: (symbol term …) or (symbol :parameter term …)
//!     ▲           │          └──── text, number, time, octets, truth, variable
//!     └─ Display ─┘
//! ```
//!
//! All of SL is read and printed: actions and propositions (SL0), connectives (SL1), identifying
//! expressions, quantifiers and modal operators (SL2, SL). What stands in parentheses has one
//! form, whatever its symbol means; [`Content::profile`] tells which profile it needs.
//!
//! **Knows** the grammar and the lexis of SL, and how agent identifiers look in it. **Never
//! knows** an ontology: what a symbol stands for in the world is the caller's.
//!
//! ```
//! use fipa_sl::{Content, Profile};
//!
//! let content: Content = "((done (action (agent-identifier :name a@r1) (open gripper))))"
//!     .parse()
//!     .unwrap();
//! let done = content.first().functional("done").unwrap();
//! let action = done.positional()[0].functional("action").unwrap();
//! let agent = fipa_sl::agent_id(&action.positional()[0]).unwrap();
//! assert_eq!(agent.name, "a@r1");
//! assert_eq!(content.profile(), Profile::Sl0);
//! ```

mod agent;
mod content;
mod error;
mod functional;
mod limits;
mod print;
mod profile;
mod reader;
mod scan;
mod term;

pub use agent::agent_id;
pub use content::Content;
pub use error::{FrameError, ParseError, ParseErrorKind};
pub use functional::{Arguments, Functional};
pub use limits::Limits;
pub use profile::Profile;
pub use term::Term;
