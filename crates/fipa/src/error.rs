use std::path::PathBuf;

use fipa_directory::ParseAddressError;
use fipa_dsd::MdnsError;
use fipa_mts::RegisterError;
use fipa_outbox::OpenError;
use fipa_transport::BindError;

/// Why a platform or an agent could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An address cannot be used.
    #[error(transparent)]
    Address(#[from] ParseAddressError),
    /// The name of the service is not an ASCII word.
    #[error("{0:?} is no name: ASCII without blanks and parentheses, beginning with a letter")]
    Name(String),
    /// An endpoint cannot be bound.
    #[error(transparent)]
    Bind(#[from] BindError),
    /// The HTTP server cannot be bound.
    #[error("cannot take letters over HTTP at {address}: {source}")]
    Http {
        /// Where it was to be.
        address: fipa_directory::Address,
        /// What the system said.
        source: std::io::Error,
    },
    /// Another daemon answers at the control socket.
    #[error("another daemon answers at {}", .0.display())]
    ControlInUse(PathBuf),
    /// The letters that an earlier run has stored cannot be read, or none can be stored.
    #[error(transparent)]
    Outbox(#[from] OpenError),
    /// mDNS cannot be spoken.
    #[error("mDNS: {0}")]
    Mdns(#[from] MdnsError),
    /// Nobody answers at the control socket.
    #[error("no daemon at {}: {reason}", .path.display())]
    NoDaemon {
        /// The control socket.
        path: PathBuf,
        /// What happened.
        reason: String,
    },
    /// The agent was not registered.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// The platform has ended.
    #[error("the platform has ended")]
    Ended,
    /// No thread could be started.
    #[error("no runtime: {0}")]
    Runtime(std::io::Error),
    /// The platform is to bear a name that is not that of its certificate.
    #[error("the certificate of the fleet is for {certified}, and the platform is to be {name}")]
    NotCertified {
        /// The name that was given.
        name: String,
        /// The name of the certificate.
        certified: String,
    },
    /// The key of the robot cannot be used.
    #[error("{0}")]
    Key(String),
    /// The machine gives no random numbers.
    #[error("no random numbers: {0}")]
    Random(String),
}

/// Why there is no message.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReceiveError {
    /// A letter came whose payload cannot be read.
    #[error("a letter from {from} cannot be read: {reason}")]
    Unreadable {
        /// The agent that sent it, as its envelope says.
        from: String,
        /// What is wrong with it.
        reason: String,
        /// The letter as it came.
        letter: Box<fipa_acl::Letter>,
    },
    /// The platform has ended, or the daemon was away for too long.
    #[error("the platform has ended")]
    Ended,
}

/// Why a message was not handed over at once.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrySendError {
    /// Too much of the sender is under way, or a queue or mailbox of this platform is full. Nobody
    /// has the message.
    #[error("there is no room for the message now")]
    Full(Box<fipa_acl::Message>),
}

/// Why a request has no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The request did not reach its receiver.
    #[error("{to}: {outcome}: {reason}")]
    Undelivered {
        /// The receiver.
        to: String,
        /// What became of the request.
        outcome: fipa_link::Outcome,
        /// Why.
        reason: String,
    },
    /// A message transport service on the way has told that it could not deliver the request.
    #[error("{0}")]
    Returned(Box<fipa_mts::DeliveryFailure>),
    /// It was delivered, and no answer came in time.
    #[error("delivered, but no answer came within {0:?}")]
    NoAnswer(std::time::Duration),
    /// The platform has ended.
    #[error("the platform has ended")]
    Ended,
}
