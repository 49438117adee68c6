//! One key for a fleet: it makes a certificate for each robot, and by these robots know each other.
//!
//! ```text
//!   operator's machine                       robot1                          robot2
//!   FleetKey ── issue("robot1") ──▶ robot1.fleet ─▶ Membership ◀── TLS ──▶ Membership
//!      └────── revoke("robot2") ──▶ Revocations ──────────┴── check: whose is this certificate?
//! ```
//!
//! A certificate (X.509, RFC 5280) binds the name of a robot's message transport service, as the
//! URI `fipa:NAME` among its subject's names, to a key that only that robot has. A [`Membership`]
//! is what a robot holds: its certificate and key, the certificate of the fleet, the robots that
//! were in the fleet when it joined, and what was revoked. Revoked is revoked for ever, so a list is
//! newer than another when it holds all of that and more, and it matters not who passes it on.
//!
//! **Knows** certificates, their validity, and where an operator and a robot keep them
//! ([`Folder`]). **Never knows** a socket, a clock or a handshake: whoever runs one asks
//! [`Membership::check`].

mod certificate;
mod error;
mod folder;
mod key;
mod membership;
mod name;
mod pem;
mod refusal;
mod revocations;
mod time;

pub use certificate::{Certificate, Fingerprint, ParseFingerprintError};
pub use error::FleetError;
pub use folder::{Folder, Installed, default_folder, write_secret};
pub use key::{FleetKey, ROBOT_DAYS};
pub use membership::Membership;
pub use name::{NameError, check_name};
pub use refusal::Refusal;
pub use revocations::Revocations;
