//! Who answers at an address: a link that ends with the greeting.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{Address, InstanceId};
use fipa_link::{Event, Frame, Hello, Link, LinkConfig, Role};
use fipa_transport::{Buffers, Driver, End, Handle};
use tokio::sync::oneshot;

use crate::clock::Clock;
use crate::security::Security;

/// How long whoever accepted the connection may take for the greeting.
const PATIENCE: Duration = Duration::from_secs(3);

/// A platform that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Greeting {
    /// Where it answered.
    pub address: Address,
    /// The run of it.
    pub instance: InstanceId,
    /// The name of its message transport service.
    pub name: Text,
    /// The fleet that it belongs to.
    pub scope: Text,
    /// The version of the link that it speaks; ours is [`VERSION`](Greeting::VERSION).
    pub version: u16,
    /// How far its clock is ahead of ours, in milliseconds; the way of the greeting makes it look
    /// later by some.
    pub clock_ahead_millis: i64,
}

impl Greeting {
    /// The version of the link that we speak.
    pub const VERSION: u16 = Hello::VERSION;
}

/// Why there was no greeting.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GreetError {
    /// The host is there, and nobody listens.
    #[error("{0}")]
    Refused(String),
    /// Nobody was reached.
    #[error("{0}")]
    Unreachable(String),
    /// Robots of a fleet let in nobody else.
    #[error("it lets in robots of its fleet only")]
    Keyless,
    /// Somebody answered who is no platform of this kind or version.
    #[error("{0}")]
    Strange(String),
    /// Somebody accepted the connection and said nothing.
    #[error("the other side accepted the connection and said nothing")]
    Mute,
}

/// Opens a connection to the first of these addresses that answers, and ends it when the platform
/// there has said who it is. It takes 6 s at most an address.
pub async fn greet(addresses: &[Address]) -> Result<Greeting, GreetError> {
    greet_by(addresses, secured(Security::open())?).await
}

fn secured(security: Result<Security, crate::Error>) -> Result<Security, GreetError> {
    security.map_err(|error| GreetError::Strange(error.to_string()))
}

/// The same as a robot of a fleet, whose platforms talk to nobody else.
#[cfg(feature = "tls")]
pub async fn greet_in_fleet(
    addresses: &[Address],
    membership: &Arc<fipa_fleet::Membership>,
) -> Result<Greeting, GreetError> {
    let tls = fipa_transport::Tls::new(Arc::clone(membership));
    let tls = tls.map_err(|error| GreetError::Strange(error.to_string()))?;
    greet_by(addresses, secured(Security::of(tls))?).await
}

pub(crate) async fn greet_by(
    addresses: &[Address],
    security: Security,
) -> Result<Greeting, GreetError> {
    let dialled = security.dial(addresses, true).await;
    let (stream, address) = dialled.map_err(|error| match error.is_refused() {
        true => GreetError::Refused(error.to_string()),
        false => GreetError::Unreachable(error.to_string()),
    })?;
    let clock = Clock::start();
    let hello = Hello {
        version: Hello::VERSION,
        role: Role::Program,
        instance: InstanceId::from_bytes([0; 16]),
        name: Text::from_static("doctor"),
        scope: Text::default(),
        endpoints: Vec::new(),
        max_letter: 0,
        unix_millis: clock.now().unix_millis,
        checks: false,
    };
    let (answer, answered) = oneshot::channel();
    let handle = Arc::new(Handle::default());
    let greeter = Greeter {
        clock,
        handle: Arc::clone(&handle),
        state: Mutex::new((Link::new(LinkConfig::new(hello), clock.now()), Some(answer))),
    };
    let pump = fipa_transport::pump(stream, handle, Arc::new(Buffers::default()), greeter);
    let pumping = tokio::spawn(pump);
    let answered = tokio::time::timeout(PATIENCE, answered).await;
    pumping.abort();
    let Ok(Ok(answered)) = answered else {
        return Err(GreetError::Mute);
    };
    let hello = answered?;
    Ok(Greeting {
        address,
        instance: hello.instance,
        name: hello.name,
        scope: hello.scope,
        version: hello.version,
        clock_ahead_millis: hello.unix_millis.saturating_sub(clock.now().unix_millis),
    })
}

type Answer = oneshot::Sender<Result<Hello, GreetError>>;

struct Greeter {
    clock: Clock,
    handle: Arc<Handle>,
    state: Mutex<(Link, Option<Answer>)>,
}

impl Driver for Greeter {
    fn received(&self, octets: &mut BytesMut) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let answer = match state.0.receive(self.clock.now(), octets) {
            Ok(Some(Event::Opened(hello))) => Ok(hello),
            Ok(Some(Event::Frame(Frame::Goodbye(reason)))) => Err(match &*reason {
                fipa_mts::ONLY_FLEET => GreetError::Keyless,
                reason => GreetError::Strange(format!("it refused: {reason}")),
            }),
            Ok(_) => return,
            Err(error) => Err(GreetError::Strange(error.to_string())),
        };
        if let Some(waiting) = state.1.take() {
            // Whoever has given up does not want to know any more.
            let _ = waiting.send(answer);
        }
        self.handle.close();
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        parts.extend(std::iter::from_fn(|| state.0.poll_transmit()));
        false
    }

    fn closed(&self, _end: &End, _all_written: bool) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.1 = None;
    }
}
