use fipa_acl::{Message, Text};

/// What a [`LockAgent`](crate::LockAgent) wants done, or tells.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
#[expect(clippy::large_enum_variant, reason = "nearly all are messages")]
pub enum Output {
    /// Send this message; one that is not delivered is told by
    /// [`LockAgent::delivery_failed`](crate::LockAgent::delivery_failed).
    Send(Message),
    /// We hold the resource from now on.
    Granted {
        /// The resource.
        resource: Text,
        /// The number of this grant, larger than that of every earlier one. `None`: the owner
        /// issues none, or the algorithm is a plain one, and nothing guards what the lock guards
        /// against a holder that was taken for dead.
        fencing: Option<u64>,
    },
    /// We held the resource and do not any more: whatever uses it stops now.
    Lost {
        /// The resource.
        resource: Text,
        /// Why.
        reason: LossReason,
    },
    /// We waited for the resource, and do not any more.
    Failed {
        /// The resource.
        resource: Text,
        /// Why.
        reason: FailureReason,
    },
    /// Keep this of a resource that we own. With `held` the number is told to nobody before
    /// [`LockAgent::persisted`](crate::LockAgent::persisted) says that it survives a crash.
    Persist {
        /// The resource.
        resource: Text,
        /// What is kept.
        record: Record,
    },
}

/// What an owner keeps of its resource over restarts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Record {
    /// The last number that was issued; 0: none ever was.
    pub fencing: u64,
    /// Whether somebody may hold the resource with that number. An owner that starts with such a
    /// record grants nothing for four heartbeats, unless the holder itself is heard of.
    pub held: bool,
}

/// Why a lock is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum LossReason {
    /// Nothing was heard of the owner for three heartbeats.
    #[error("its owner was not heard for three heartbeats")]
    LeaseExpired,
    /// The owner says that we do not hold it.
    #[error("its owner has taken it back")]
    TakenBack,
    /// The own connection ended, so that the others take us for dead.
    #[error("the connection to the other agents ended")]
    Disconnected,
}

/// Why a lock was not granted.
#[derive(Clone, Debug, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum FailureReason {
    /// No agent says that it owns the resource.
    #[error("no agent owns it")]
    NoOwner,
    /// The owner is silent: the resource is unreachable.
    #[error("its owner does not answer")]
    OwnerSilent,
    /// The owner is gone: the resource is unreachable.
    #[error("its owner is gone")]
    OwnerGone,
    /// The owner refuses.
    #[error("its owner refuses: {0}")]
    Refused(Text),
    /// The own connection ended.
    #[error("the connection to the other agents ended")]
    Disconnected,
}

/// Why a resource cannot be requested.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The name has a line break, or is empty.
    #[error("{0:?} is no name of a resource: it is empty or has a line break")]
    Name(Text),
    /// It is requested or held already.
    #[error("{0} is requested already")]
    Requested(Text),
    /// There are too many resources.
    #[error("there are too many resources")]
    TooManyResources,
    /// There are too many participants.
    #[error("there are too many participants")]
    TooManyParticipants,
}

/// A resource as its owner sees it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct LockView {
    /// The resource.
    pub resource: Text,
    /// Who owns it.
    pub owner: Text,
    /// Who holds it.
    pub holder: Option<Text>,
    /// Who waits for it, by name.
    pub waiting: Vec<Text>,
    /// The last number that was issued; 0: none ever was. `None`: who holds it has none.
    pub fencing: Option<u64>,
}
