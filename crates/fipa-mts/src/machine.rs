use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Letter, Text};
use fipa_directory::{Address, Change, Directory, InstanceId, MESSAGE_TRANSPORT, Now};
use fipa_link::{CallBack, CalledBack, Facts, Outcome, ReceiverOutcome, Sniffed};

use crate::{StoredLetter, Urgency};

/// A connection, numbered by whoever opens the sockets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ConnId(pub u64);

/// A dial that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DialId(pub u64);

/// A letter that is to be posted over HTTP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PostId(pub u64);

/// A stream that was opened.
#[derive(Clone, Debug)]
pub struct Connected {
    /// Its number from now on.
    pub conn: ConnId,
    /// The dial that it answers, with the address that was reached; `None` for an accepted one.
    pub dialled: Option<(DialId, Address)>,
    /// Whether it is the control socket, on which programs attach.
    pub control: bool,
    /// Whether the partner is on this host, and may be told loopback addresses.
    pub same_host: bool,
    /// Where the partner's end is, for people.
    pub remote: Text,
    /// The robot whose certificate the partner has shown.
    pub identity: Option<Text>,
    /// Whether there are streams beside the main one, for letters of each [`Urgency`].
    pub lanes: bool,
}

/// How a stream ended, and how far the writing had got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ended<'a> {
    /// In words, for people.
    pub reason: &'a str,
    /// Whether one of the two ends closed it; otherwise it broke, and what was under way in either
    /// direction may be lost.
    pub orderly: bool,
    /// Whether the system took every octet that waited to be written. It is not known that any of
    /// them arrived.
    pub all_written: bool,
}

/// Something that the network announces.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Announced {
    /// A platform of ours.
    Platform(InstanceId),
    /// An agent of another make, by its name.
    Agent(Text),
}

/// An agent to register.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Registration {
    /// The agent's name: a word of ASCII, unique in the network.
    pub name: Text,
    /// The service type.
    pub kind: Text,
    /// Free text for people; empty: the service writes one.
    pub description: Text,
}

impl Registration {
    /// An agent of the usual service type.
    pub fn new(name: impl Into<Text>) -> Registration {
        Registration {
            name: name.into(),
            kind: Text::from_static(MESSAGE_TRANSPORT),
            description: Text::default(),
        }
    }
}

/// A letter that an agent hands to its message transport service.
#[derive(Clone, Debug)]
pub struct Submission {
    /// Ties the [`Output::Outcome`] to it.
    pub ticket: u64,
    /// The letter.
    pub letter: Letter,
    /// How long the outcome is waited for; the service may wait shorter.
    pub timeout: Duration,
    /// When an answer is not wanted any more (the message's `reply-by`), in milliseconds since
    /// 1970-01-01T00:00:00Z. After that the letter is not sent: its outcome is
    /// [`Expired`](fipa_link::Outcome::Expired).
    pub reply_by: Option<i64>,
    /// The transports that the sender prefers, as schemes of addresses: `tcp`. Among the locations
    /// of a receiver that has several these are tried first and in this order, the others after
    /// them in the receiver's.
    pub transports: Vec<Text>,
    /// Whether a queue that is full is waited for, until the timeout. Otherwise the letter is
    /// refused at once. What a program submits to its daemon always waits there.
    pub patient: bool,
}

impl Submission {
    /// A letter without `reply-by` and preference, which is not waited for.
    pub fn new(ticket: u64, letter: Letter, timeout: Duration) -> Submission {
        Submission {
            ticket,
            letter,
            timeout,
            reply_by: None,
            transports: Vec::new(),
            patient: false,
        }
    }

    /// What is left until `reply-by`; `None` when there is none.
    pub(crate) fn until_reply_by(&self, now: Now) -> Option<Duration> {
        let left = self.reply_by?.saturating_sub(now.unix_millis).max(0);
        Some(Duration::from_millis(left.unsigned_abs()))
    }
}

/// Why a letter is not sent whose `reply-by` has passed.
pub(crate) const REPLY_BY: &str = "reply-by has passed";

/// Whether an outcome says that a queue or mailbox was full: later there may be room.
pub fn is_full(told: &ReceiverOutcome) -> bool {
    was_full(told.outcome, &told.reason)
}

/// Whether a letter was refused because a queue or mailbox was full: later there may be room.
pub(crate) fn was_full(outcome: Outcome, reason: &str) -> bool {
    outcome == Outcome::Refused && reason.ends_with(FULL)
}

/// What the reason ends with where a queue is full.
const FULL: &str = " is full";

/// Why an agent was not registered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// The name cannot be written in any representation.
    #[error(
        "{0:?} is no agent name: ASCII without blanks and parentheses, not beginning with a digit, # - @ or a quote"
    )]
    Name(Text),
    /// Somebody else here holds the name.
    #[error("the name {0} is held by another connection")]
    Held(Text),
    /// The service said no, and why.
    #[error("{0}")]
    Refused(Text),
    /// The daemon cannot be reached.
    #[error("there is no daemon at the control socket")]
    NoDaemon,
}

/// A letter to be posted over HTTP (FIPA SC00084F), as its receiver's platform reads it.
#[derive(Clone, Debug)]
pub struct PostedLetter {
    /// The number to answer with.
    pub post: PostId,
    /// Where to.
    pub address: Arc<Address>,
    /// The octets of the envelope, in XML.
    pub envelope: Bytes,
    /// The octets of the payload.
    pub payload: Bytes,
    /// The media type of the payload.
    pub payload_type: Text,
    /// How long the answer is waited for.
    pub timeout: Duration,
    /// It is posted behind those that were posted so to the same place, and before they are
    /// answered: the place takes letters in their order, and knows which it has.
    pub in_series: bool,
}

/// What is known once a letter was taken over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TakenOver {
    /// How many letters the place takes before it has answered the first one: less than two if
    /// each must wait for the answer to the one in front.
    pub ahead: usize,
}

/// A letter to be handed over whole by a transport that is plugged in.
#[derive(Clone, Debug)]
pub struct SentLetter {
    /// The number to answer with.
    pub post: PostId,
    /// Where to: an [`Address::Other`].
    pub address: Address,
    /// Its octets: a bit-efficient envelope, and the payload.
    pub letter: Bytes,
    /// How long the outcome is waited for.
    pub timeout: Duration,
}

/// Why a letter that was to be posted, or handed over by a transport that is plugged in, was not
/// taken over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PostFailure {
    /// Not all of it was written: nobody has it. It is tried again.
    #[error("{0}")]
    Unreached(String),
    /// It was written, and nobody said that it was taken over.
    #[error("{0}")]
    Unanswered(String),
    /// The other side said "no".
    #[error("{0}")]
    Refused(String),
}

/// A letter that was posted to us.
#[derive(Clone, Debug)]
pub struct Arrived {
    /// The octets of its envelope.
    pub envelope: Bytes,
    /// The octets of its payload.
    pub payload: Bytes,
    /// Where it came from, for people.
    pub remote: Text,
    /// The number of the connection, which no other has.
    pub connection: u64,
    /// How many requests came over the connection before.
    pub earlier: u64,
    /// The series of letters to which it belongs, and its number there, if the sender told them.
    /// Letters of a series come in the order of their numbers; one that comes again is a copy.
    pub number: Option<(u64, u64)>,
}

/// Why a letter that was posted is not taken over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Its envelope cannot be read, or not be passed on.
    #[error("the envelope cannot be read: {0}")]
    Unreadable(String),
    /// It is larger than what is taken.
    #[error("the letter has {octets} octets, and {max} are taken")]
    TooLarge {
        /// Octets of the letter.
        octets: usize,
        /// Octets of the largest letter that is taken.
        max: usize,
    },
    /// The service ends.
    #[error("the service ends")]
    Closing,
}

/// What a machine wants done, or tells.
#[derive(Clone, Debug)]
pub enum Output {
    /// Open a stream to one of these addresses, tried in this order, and say how it went by
    /// [`Machine::connected`] or [`Machine::dial_failed`].
    Dial {
        /// The number to answer with.
        dial: DialId,
        /// Where to.
        addresses: Vec<Address>,
        /// Whether it is to be a link, which a robot of a fleet secures.
        link: bool,
    },
    /// Octets wait to be written to this connection.
    Transmit(ConnId),
    /// Close this connection once what waits is written, or the partner takes no more of it;
    /// [`Machine::closed`] follows.
    Close(ConnId),
    /// Close this connection once what waits is written, however long the partner takes for it:
    /// the end of the stream ends the letter. [`Machine::closed`] follows.
    Finish(ConnId),
    /// Break this connection off, so that the partner does not take the end of the stream for the
    /// end of a letter; [`Machine::closed`] follows.
    Abort(ConnId),
    /// Post this letter, and say how it went by [`Machine::posted`].
    Post(Box<PostedLetter>),
    /// Hand this letter over, and say how it went by [`Machine::posted`].
    Send(Box<SentLetter>),
    /// What became of a registration.
    Registered {
        /// The ticket it was asked with.
        ticket: u64,
        /// How it went.
        result: Result<(), RegisterError>,
    },
    /// What became of a submission: one outcome a receiver.
    Outcome {
        /// The ticket of the submission.
        ticket: u64,
        /// The outcomes, in the order in which the receivers were resolved.
        outcomes: Vec<ReceiverOutcome>,
    },
    /// An agent has left; nothing more comes for it here.
    Left {
        /// The ticket it was asked with.
        ticket: u64,
        /// The agent.
        name: Text,
        /// The letters that were delivered to it and not taken yet, the oldest first.
        letters: Vec<Letter>,
    },
    /// A letter waits in the mailbox of this agent.
    Mail(Text),
    /// The directory changed.
    Directory(Change),
    /// Store this letter so that it survives a crash, and say how that went by
    /// [`Mts::stored`](crate::Mts::stored).
    Store(StoredLetter),
    /// Remove this letter from the store; it comes after its [`Output::Store`].
    Unstore(u64),
    /// Ask the network whether this is still there: it is announced but does not answer.
    Verify(Announced),
    /// What passes the service, while that is watched.
    Sniffed(Box<Sniffed>),
    /// Something for the log.
    Notice(Notice),
    /// What the daemon told that was asked for facts.
    Facts(Box<Facts>),
    /// Find out whether the service `whom` answers at each of these addresses, all at once and
    /// within some seconds, and say so by [`Machine::called_back`].
    CallBack {
        /// The number to answer with.
        call: u64,
        /// Who is to answer.
        whom: InstanceId,
        /// Where.
        addresses: Vec<Address>,
    },
    /// What came of being called back.
    CalledBack {
        /// The ticket it was asked with.
        ticket: u64,
        /// The answer.
        called: CalledBack,
    },
    /// A robot of the fleet tells what is revoked; whether that is so, the fleet key's signature
    /// says, which is for others to check. What is news is handed back by [`Machine::revoked`].
    Revoked(Bytes),
}

/// Something that a person who looks for a fault wants to know.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Notice {
    /// A link to a peer is open.
    PeerUp {
        /// The peer's name.
        name: Text,
        /// How it is reached.
        via: Text,
    },
    /// The last link to a peer broke, or it fell silent.
    PeerSuspect {
        /// The peer's name.
        name: Text,
        /// What happened.
        reason: Text,
    },
    /// A peer did not come back, or said goodbye: its agents are removed.
    PeerGone {
        /// The peer's name.
        name: Text,
        /// What happened.
        reason: Text,
    },
    /// Another daemon bears our name.
    Conflict {
        /// The name.
        name: Text,
        /// Where the other one is.
        other: Text,
    },
    /// A connection was given up.
    LinkFailed {
        /// With whom.
        with: Text,
        /// Why.
        reason: Text,
    },
    /// Somebody, or something that somebody said, is not let in.
    Refused {
        /// Who.
        who: Text,
        /// Why.
        reason: Text,
    },
    /// A letter that came over a connection of its own, whose sender is given no receipt, did not
    /// reach everybody whom it was for.
    LetterLost {
        /// Where it came from.
        from: Text,
        /// How many octets of it have come.
        octets: usize,
        /// What is wrong, or for whom it was lost.
        reason: Text,
    },
    /// An agent of ours is not announced to C++ robots. Over links it is known all the same.
    NotAnnounced {
        /// The agent.
        name: Text,
        /// Why not.
        reason: Text,
    },
    /// A letter for a robot that is away could not be stored.
    NotStored {
        /// The receiver.
        to: Text,
        /// Why.
        reason: Text,
    },
    /// A letter is given up that was stored for a robot that is away.
    StoredLetterDropped {
        /// Its sender.
        from: Text,
        /// The receiver.
        to: Text,
        /// How many octets it has.
        octets: usize,
        /// Why.
        reason: Text,
    },
    /// There were more notices about somebody within a minute than are told. The platform that runs
    /// the machine counts them.
    LeftOut {
        /// About whom; `others` where these were too many to be counted apart.
        who: Text,
        /// How many.
        count: u64,
    },
    /// The daemon is there (again); told to programs.
    DaemonUp,
    /// The daemon is not there; it is looked for.
    DaemonLost {
        /// What happened.
        reason: Text,
    },
    /// The daemon was looked for long enough.
    DaemonGivenUp {
        /// What happened last.
        reason: Text,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Notice::PeerUp { name, via } => write!(f, "{name} is reached at {via}"),
            Notice::PeerSuspect { name, reason } => write!(f, "{name} is not heard: {reason}"),
            Notice::PeerGone { name, reason } => write!(f, "{name} is gone: {reason}"),
            Notice::Conflict { name, other } => {
                write!(f, "another daemon bears the name {name} too, at {other}")
            }
            Notice::LinkFailed { with, reason } => write!(f, "no link with {with}: {reason}"),
            Notice::Refused { who, reason } => write!(f, "refused {who}: {reason}"),
            Notice::LetterLost {
                from,
                octets,
                reason,
            } => write!(
                f,
                "a letter of {octets} octets from {from} is lost: {reason}"
            ),
            Notice::NotAnnounced { name, reason } => {
                write!(f, "{name} is not announced to C++ robots: {reason}")
            }
            Notice::NotStored { to, reason } => {
                write!(f, "a letter for {to} cannot be stored: {reason}")
            }
            Notice::StoredLetterDropped {
                from,
                to,
                octets,
                reason,
            } => write!(
                f,
                "a stored letter of {octets} octets from {from} for {to} is dropped: {reason}"
            ),
            Notice::LeftOut { who, count } => {
                write!(
                    f,
                    "{count} more notices about {who} within a minute are left out"
                )
            }
            Notice::DaemonUp => f.write_str("the daemon is there"),
            Notice::DaemonLost { reason } => write!(f, "the daemon is lost: {reason}"),
            Notice::DaemonGivenUp { reason } => write!(f, "no daemon: {reason}"),
        }
    }
}

/// A state machine that drives links: what [`Mts`](crate::Mts) and [`Program`](crate::Program)
/// have in common.
///
/// Whoever runs it hands in events with the time, then does what
/// [`poll_output`](Self::poll_output) says until that is `None`.
pub trait Machine {
    /// A stream was opened.
    fn connected(&mut self, now: Now, connected: Connected);
    /// No stream could be opened.
    fn dial_failed(&mut self, now: Now, dial: DialId, reason: &str);
    /// What came of an [`Output::CallBack`]: one call an address.
    fn called_back(&mut self, _now: Now, _call: u64, _calls: Vec<CallBack>) {}
    /// Octets arrived; what does not make a whole frame yet is left in the buffer.
    fn received(&mut self, now: Now, conn: ConnId, octets: &mut BytesMut);
    /// Octets arrived on a lane of a connection that has [lanes](Connected::lanes). Whether more is
    /// wanted: otherwise what is left, and what is still to come on it, waits until more has come
    /// on the main stream.
    fn received_on(
        &mut self,
        _now: Now,
        _conn: ConnId,
        _lane: Urgency,
        octets: &mut BytesMut,
    ) -> bool {
        octets.clear();
        true
    }
    /// The stream ended; what had arrived was handed over before.
    fn closed(&mut self, now: Now, conn: ConnId, ended: Ended<'_>);
    /// What became of an [`Output::Post`] or an [`Output::Send`].
    ///
    /// Only a service posts.
    fn posted(&mut self, now: Now, post: PostId, result: Result<TakenOver, PostFailure>) {
        let _ = (now, post, result);
    }
    /// The next octets to write to a connection.
    fn poll_transmit(&mut self, now: Now, conn: ConnId) -> Option<Bytes>;
    /// The next octets to write on a lane of a connection that has [lanes](Connected::lanes).
    fn poll_transmit_on(&mut self, _now: Now, _conn: ConnId, _lane: Urgency) -> Option<Bytes> {
        None
    }
    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, on [`Now::mono`].
    fn poll_timeout(&self) -> Option<Duration>;
    /// The time has come.
    fn handle_timeout(&mut self, now: Now);
    /// What is to be done next.
    fn poll_output(&mut self) -> Option<Output>;

    /// Registers an agent with a mailbox here; answered by [`Output::Registered`].
    fn register(&mut self, now: Now, ticket: u64, registration: Registration);
    /// Takes an agent away, with what waits for it.
    fn deregister(&mut self, now: Now, name: &str);
    /// Takes an agent away and hands over what waits for it; answered by [`Output::Left`]. What is
    /// under way to it follows it to where it is registered next, within a second, or is answered
    /// as unknown.
    fn leave(&mut self, now: Now, ticket: u64, name: &str);
    /// Takes in a letter; answered by one [`Output::Outcome`].
    fn submit(&mut self, now: Now, submission: Submission);
    /// The oldest letter that waits for an agent registered here.
    fn take_mail(&mut self, name: &str) -> Option<Letter>;
    /// The directory as it is known here.
    fn directory(&self) -> &Directory;
    /// Begins or ends to watch what passes the service: told by [`Output::Sniffed`], with a mark at
    /// the begin and at the end. A program does not come to the end while its daemon is away.
    fn sniff(&mut self, now: Now, on: bool);
    /// The name of the message transport service; empty while a program has not met its daemon.
    fn service_name(&self) -> Text;
    /// What is revoked in the fleet: passed on to the other robots.
    fn revoked(&mut self, _now: Now, _list: Bytes) {}
    /// Says goodbye on every link; the connections close once that is written.
    fn shutdown(&mut self, now: Now);
}
