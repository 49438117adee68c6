use std::time::Duration;

use crate::Fingerprint;
use crate::time::shown;

/// Why somebody is not let in.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// No certificate was shown.
    #[error("it has no key: it showed no certificate")]
    NoCertificate,
    /// Another key signed the certificate, or none.
    #[error("it is not of this fleet: another key made its certificate")]
    WrongFleet,
    /// The certificate has expired.
    #[error(
        "the certificate of {name} expired at {}, and it is {} now: make a new one by \
         `fipa key join {name}`, or set the clock here", shown(*.end), shown(*.now)
    )]
    Expired {
        /// Who it says it is.
        name: String,
        /// The end of its validity, since 1970-01-01T00:00:00Z.
        end: Duration,
        /// Our clock.
        now: Duration,
    },
    /// The certificate is not valid yet.
    #[error(
        "the certificate of {name} is valid from {} on, and it is {} here: is the clock set?",
        shown(*.begin), shown(*.now)
    )]
    NotYetValid {
        /// Who it says it is.
        name: String,
        /// The begin of its validity, since 1970-01-01T00:00:00Z.
        begin: Duration,
        /// Our clock.
        now: Duration,
    },
    /// The certificate was revoked.
    #[error("the certificate of {0} is revoked")]
    Revoked(String),
    /// The certificate is of the fleet, and not among those that are pinned.
    #[error("the certificate of {name} is not pinned here; its fingerprint is {fingerprint}")]
    NotPinned {
        /// Who it is.
        name: String,
        /// What would have to be listed.
        fingerprint: Fingerprint,
    },
    /// The certificate names nobody, or several.
    #[error("its certificate does not say which robot it is")]
    Nameless,
    /// The certificate cannot be read, or is for something else.
    #[error("its certificate cannot be used: {0}")]
    Unusable(String),
}
