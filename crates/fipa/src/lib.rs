//! FIPA for robots: agents that find each other without a server, exchange messages whose meaning
//! is standardised, and are told what became of each.
//!
//! ```text
//!   your program                              another robot
//!   Agent ─ send ─▶ Platform ══ TCP link ══▶ Platform ─ mailbox ─▶ Agent
//!     ▲               │  ▲                      │
//!     └── outcome ────┘  └────── receipt ◀──────┘
//! ```
//!
//! With the feature `tls` a platform can be a robot of a fleet, which lets in nobody else.
//!
//! A [`Platform`] is where agents live: one in this process, or the daemon of this machine. An
//! [`Agent`] sends, receives and asks. Control loops that do not know async use [`blocking`].
//!
//! ```
//! # async fn example() -> Result<(), Box<dyn std::error::Error>> {
//! use fipa::prelude::*;
//! use std::time::Duration;
//!
//! let robot1 = Platform::builder().name("robot1").mdns(false).start().await?;
//! let arm = robot1.agent("arm@robot1").await?;
//! let drive = robot1.agent("drive@robot1").await?;
//!
//! let driver = tokio::spawn(async move {
//!     let order = drive.receive().await.unwrap();
//!     drive.send(order.reply(Performative::Inform).content("at the dock")).await;
//! });
//!
//! let order = Message::new(Performative::Request).to("drive@robot1").content("go to the dock");
//! let answer = arm.request(order, Duration::from_secs(5)).await?;
//! assert_eq!(answer.content_str(), Some("at the dock"));
//! # driver.await?;
//! # Ok(()) }
//! # tokio::runtime::Runtime::new().unwrap().block_on(example()).unwrap();
//! ```

mod addresses;
mod agent;
mod announcing;
mod backend;
pub mod blocking;
mod builder;
mod clock;
mod control_path;
mod conversations;
mod discovery;
mod error;
mod greet;
mod http;
mod letters;
pub mod locks;
mod management;
mod names;
mod node;
mod platform;
mod restraint;
mod room;
mod security;
mod sending;
mod sniffer;

pub use agent::{Agent, DEFAULT_TIMEOUT, Incoming};
pub use builder::PlatformBuilder;
pub use control_path::default_control_path;
pub use conversations::{
    Answer, Contracts, ConversationError, ConversationEvent, ConversationEvents, Monitoring, Order,
    Responder, Subscription, Violated, Violations,
};
pub use error::{Error, ReceiveError, RequestError, TrySendError};
pub use fipa_acl::{
    AgentId, Envelope, Expression, FipaTime, Letter, Message, Performative, Representation, Text,
    UserDefined,
};
pub use fipa_conversation::{Event, EventKind, Expected, Rule as ConversationRule, Violation};
pub use fipa_directory::{
    Address, Change, ChangeKind, Entry, Field, InstanceId, Location, Now, Pattern, PatternError,
    Record, Source, State,
};
pub use fipa_dsd::{
    HeardDaemon, InterfaceProbe, InterfaceSelector, MDNS_PORT, Multicast, probe as probe_mdns,
};
#[cfg(feature = "tls")]
pub use fipa_fleet::{
    Fingerprint, FleetError, Folder, Membership, ParseFingerprintError, default_folder,
};
pub use fipa_link::{
    CallBack, CallBackResult, CalledBack, Facts, Inside, Outcome, Parts, Passed, PeerFacts,
    ReceiverOutcome, Sniffed,
};
pub use fipa_mts::{
    Action, DeliveryFailure, NamePattern, Network, NetworkError, Notice, OutboxConfig, PostFailure,
    RegisterError, Registration, Rule, Rules,
};
pub use fipa_outbox::OpenError as OutboxError;
pub use fipa_protocol::{Library, Outcome as ConversationOutcome};
#[cfg(feature = "tls")]
pub use greet::greet_in_fleet;
pub use greet::{GreetError, Greeting, greet};
pub use letters::{LetterInbox, LetterListener, LetterTransport};
pub use platform::{Changes, Notices, Platform};
pub use sending::Sending;
pub use sniffer::{Sniffer, open_letter};

/// What most programs need.
pub mod prelude {
    pub use crate::{Agent, AgentId, Message, Outcome, Performative, Platform, ReceiverOutcome};
}
