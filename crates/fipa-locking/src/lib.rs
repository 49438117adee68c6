//! Mutual exclusion among agents, without a server, while agents come, go and die.
//!
//! ```text
//!   waiter ── query-if ─────▶ all      who owns it?     owner ── inform ──▶ all
//!   waiter ── request ──────▶ all      Ricart-Agrawala: all others agree, now or when they release
//!      │                               Suzuki-Kasami: the owner lends the token
//!      │ all grants
//!      ├──── confirm, X-Fencing 0 ──▶ owner ── Persist ──▶ host ── persisted ──▶ owner
//!      ▼                                └───── inform, X-Fencing 17 ──▶ holder
//!   holder ── probe, X-Fencing 17 ──▶ owner ── confirm, X-Holder, X-Fencing ──▶ holder
//!      └───── disconfirm, or the token ──▶ owner: the next one
//! ```
//!
//! **Knows** the algorithms of Ricart and Agrawala (1981) and of Suzuki and Kasami (1985), the
//! extensions of the C++ library `distributed_locking` (owner discovery, heartbeats), and its
//! messages; leases and fencing numbers are ours. **Never knows** a clock, a socket, a file or a
//! directory: time and messages come in as arguments, what is to be done comes out as [`Output`].
//!
//! # What holds
//!
//! 1. *Never two holders while leases are kept.* The owner lends a resource to one agent at a time,
//!    whatever the others have granted. It takes it back four heartbeats after the holder was last
//!    heard. The holder counts three, from when it *sent* the latest message that the owner
//!    answered as to a holder. What the owner answered it had heard after that, so the holder stops
//!    first by one heartbeat, however long messages took. That heartbeat is for clocks that
//!    differ, and for what used the resource to stop.
//! 2. *Under false suspicion never two equal fencing numbers.* The owner counts them, and tells
//!    none before the host has made it durable. An owner that starts again while somebody may hold
//!    the resource lends nothing for four heartbeats, unless the holder itself is heard.
//! 3. *Every request is granted, or its agent is told why not.* Whatever is unanswered is said
//!    again; who is silent for four heartbeats is not waited for, unless the owner names it as the
//!    holder; an owner that is silent for so long makes the resource unreachable. This holds of
//!    the extended algorithms; the plain ones need agents that stay and messages that arrive.
//!
//! An owner of the C++ library issues no numbers and lends nothing. With it the grants decide, and
//! the four heartbeats after which a silent agent is done without.
//!
//! # What is sent beside the messages of the C++ library
//!
//! User-defined parameters, which it ignores:
//!
//! | Parameter | In | Says |
//! |---|---|---|
//! | `X-Fencing` | `confirm` of Ricart-Agrawala | 0: a number is wanted |
//! | | `inform` of Ricart-Agrawala, `propagate`, `disconfirm` | the number of the grant |
//! | | a probe, and its answer | the number whose lease is meant; 0: I hold nothing |
//! | `X-Holder` | the owner's answer to a probe | who holds the resource; `-`: nobody |
//! | `X-Resource` | a probe between owner and others | the resource that is meant; without it all are |
//! | `X-Conversation` | the owner's probe of a holder | the conversation of the grant |
//! | `X-Heartbeat` | `confirm`, `request` of Suzuki-Kasami | the holder's heartbeat in ms; the owner's is the longest |
//! | | `inform`, `propagate` | the heartbeat by which the lease counts |
//!
//! and two messages: the `inform` with which the owner answers a `confirm` that has `X-Fencing: 0`,
//! and the `inform` with which everybody answers a `query-ref` of the protocol `dlm_list`
//! ([`list_query`]): what is owned there, a line for each resource.
//!
//! ```text
//!   FENCING HOLDER COUNT WAITING... RESOURCE
//!   17 arm@robot1 2 drive@robot2 lift@robot3 the gripper
//! ```
//!
//! The number is that of [`LockView::fencing`], `-` where there is none; the holder is `-` where
//! there is none; the count says how many names follow; the rest of the line is the resource.
//!
//! # Messages of an entry
//!
//! Of *n* agents, one that is not the owner enters and leaves, and nobody else wants to; a message
//! to several receivers counts once for each. Finding the owner takes 2(n-1) more, once.
//!
//! | | algorithm | to and from the owner | probes | n = 3 | 10 | 50 |
//! |---|---|---|---|---|---|---|
//! | Ricart-Agrawala | 2(n-1) | 2 | 2 | 4+2+2 | 18+2+2 | 98+2+2 |
//! | extended | 2(n-1) | 3 | 2n | 4+3+6 | 18+3+20 | 98+3+100 |
//! | Suzuki-Kasami | n, or 0 with the token | 0 | 0 | 3 | 10 | 50 |
//! | extended | n+1 | 0 | 4 | 4+0+4 | 11+0+4 | 51+0+4 |
//!
//! The probes are the first of each watch; a holder and its owner exchange four more in each
//! heartbeat, a waiter two with each agent that it waits for.
//!
#![doc = "<div>"]
#![doc = include_str!("messages.svg")]
#![doc = "</div>"]
//!
//! # Example
//!
//! ```
//! use std::time::Duration;
//! use fipa_acl::Text;
//! use fipa_locking::{Algorithm, Config, LockAgent, Output, Record};
//!
//! let now = Duration::from_secs(1);
//! let mut owner = LockAgent::new(Config::new("locks@robot1", 0));
//! owner.own(now, "gripper", Record::default())?;
//! let mut robot = LockAgent::new(Config::new("arm@robot2", 0));
//! let participants = [Text::from("locks@robot1")];
//! robot.request(now, "gripper", Algorithm::RicartAgrawalaExtended, participants)?;
//!
//! let mut granted = None;
//! while granted.is_none() {
//!     while let Some(output) = robot.poll_output() {
//!         match output {
//!             Output::Send(message) => drop(owner.handle(now, &message)),
//!             Output::Granted { fencing, .. } => granted = fencing,
//!             _ => {}
//!         }
//!     }
//!     while let Some(output) = owner.poll_output() {
//!         match output {
//!             Output::Send(message) => drop(robot.handle(now, &message)),
//!             Output::Persist { resource, record } => owner.persisted(now, &resource, record.fencing),
//!             _ => {}
//!         }
//!     }
//! }
//! assert_eq!(granted, Some(1));
//! assert!(robot.holds(now, "gripper"));
//! # Ok::<(), fipa_locking::RequestError>(())
//! ```

mod agent;
mod algorithm;
mod config;
mod listing;
#[cfg(test)]
mod model;
mod output;
mod owned;
mod post;
mod request;
mod token;
mod watch;
mod wire;

pub use agent::LockAgent;
pub use algorithm::Algorithm;
pub use config::Config;
pub use listing::{ListError, list_query, read_list};
pub use output::{FailureReason, LockView, LossReason, Output, Record, RequestError};
