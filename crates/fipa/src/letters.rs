//! Transports that are plugged in: each carries letters one by one, to and from services of other
//! makes.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Weak};
use std::time::Duration;

use bytes::Bytes;
use fipa_acl::Text;
use fipa_directory::{Address, ParseAddressError};
use fipa_mts::{Mts, PostFailure, SentLetter};
use fipa_transport::BindError;
use tokio::sync::oneshot;

use crate::Error;
use crate::node::Node;

/// A transport that is not built in: it carries letters, each whole, as the C++ `fipa_services` send
/// them (a bit-efficient envelope, and the payload behind it).
///
/// A platform that has it [plugged in](crate::PlatformBuilder::transport) listens at addresses of
/// its scheme, `SCHEME://HOST:PORT`, tells services of other makes of them, and sends letters to such
/// addresses in the directory and in agent identifiers. Links are never opened by it.
pub trait LetterTransport: fmt::Debug + Send + Sync + 'static {
    /// What stands before `://` in its addresses: lower-case letters, digits, `+`, `-` and `.`.
    fn scheme(&self) -> &'static str;

    /// Binds an endpoint; port 0 takes a free one.
    ///
    /// # Errors
    /// What the system says.
    fn bind(&self, host: &str, port: u16) -> io::Result<Box<dyn LetterListener>>;

    /// Hands a letter over, and blocks until it is known how that went, or for so long. It is called
    /// in threads of their own: for one receiver by one at a time, for one address by a few.
    ///
    /// # Errors
    /// [`PostFailure::Unreached`] if certainly nobody has the letter: then it is tried again, or
    /// elsewhere. [`PostFailure::Unanswered`] if the other side may have it.
    fn send(
        &self,
        host: &str,
        port: u16,
        letter: &[u8],
        timeout: Duration,
    ) -> Result<(), PostFailure>;
}

/// An endpoint of a [`LetterTransport`].
pub trait LetterListener: Send + 'static {
    /// The port that was bound.
    fn port(&self) -> u16;

    /// Puts what comes into the inbox, until that is closed. It is called in a thread of its own.
    fn serve(self: Box<Self>, inbox: LetterInbox);
}

/// Where a [`LetterListener`] puts what comes.
#[derive(Clone)]
pub struct LetterInbox {
    node: Weak<Node<Mts>>,
    scheme: &'static str,
}

impl LetterInbox {
    /// Takes in a letter that came whole. Nobody is told what becomes of it, as its sender is given
    /// no receipt; where it cannot be read, or reaches nobody, the platform gives notice.
    pub fn put(&self, from: SocketAddr, letter: Bytes) {
        if let Some(node) = self.node.upgrade() {
            let from = Text::from(format!("{}://{from}", self.scheme));
            node.with(|now, mts, _| mts.letter_came(now, from, letter, self.scheme));
        }
    }

    /// Whether there is a platform that takes letters in.
    pub fn is_open(&self) -> bool {
        self.node.upgrade().is_some_and(|node| !node.has_ended())
    }
}

impl fmt::Debug for LetterInbox {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("LetterInbox").field(&self.scheme).finish()
    }
}

/// What is plugged in.
#[derive(Clone, Debug, Default)]
pub(crate) struct PlugIns(Vec<Arc<dyn LetterTransport>>);

impl PlugIns {
    pub(crate) fn add(&mut self, transport: Arc<dyn LetterTransport>) {
        self.0.push(transport);
    }

    pub(crate) fn schemes(&self) -> Vec<Text> {
        let schemes = self.0.iter().map(|transport| transport.scheme());
        schemes.map(Text::from_static).collect()
    }

    fn of(&self, scheme: &str) -> Option<&Arc<dyn LetterTransport>> {
        self.0.iter().find(|transport| transport.scheme() == scheme)
    }

    /// Whether an address is of a transport that is built or plugged in.
    pub(crate) fn check(&self, address: &Address) -> Result<(), ParseAddressError> {
        match address {
            Address::Other { scheme, .. } if self.of(scheme).is_none() => {
                Err(ParseAddressError::Scheme(format!("{scheme}://")))
            }
            _ => Ok(()),
        }
    }

    /// Binds an endpoint, and tells where; `None` if its transport is built in.
    pub(crate) fn bind(&self, address: &Address) -> Result<Option<BoundPlugIn>, Error> {
        let Address::Other { scheme, host, port } = address else {
            return Ok(None);
        };
        self.check(address)?;
        let Some(transport) = self.of(scheme) else {
            return Ok(None);
        };
        let failed = |source| BindError {
            address: address.clone(),
            source,
        };
        let listener = transport.bind(host, *port).map_err(failed)?;
        Ok(Some(BoundPlugIn {
            address: Address::Other {
                scheme: scheme.clone(),
                host: host.clone(),
                port: listener.port(),
            },
            scheme: transport.scheme(),
            listener,
        }))
    }

    /// Hands a letter over in a thread of its own: the end of the platform waits for none.
    pub(crate) async fn send(&self, letter: SentLetter) -> Result<(), PostFailure> {
        let unreached = |reason: &str| Err(PostFailure::Unreached(reason.to_owned()));
        let Address::Other { scheme, host, port } = letter.address else {
            return unreached("it is of no transport that is plugged in");
        };
        let Some(transport) = self.of(&scheme).map(Arc::clone) else {
            return unreached("it is of no transport that is plugged in");
        };
        let (told, outcome) = oneshot::channel();
        let send = move || {
            // Nobody wants to know any more once the platform has ended.
            let _ = told.send(transport.send(&host, port, &letter.letter, letter.timeout));
        };
        let thread = std::thread::Builder::new().name(scheme);
        if let Err(error) = thread.spawn(send) {
            return unreached(&format!("no thread: {error}"));
        }
        let failed = "the transport failed, and nobody knows whether it arrived";
        let failed = |_| Err(PostFailure::Unanswered(failed.to_owned()));
        outcome.await.unwrap_or_else(failed)
    }
}

/// An endpoint that is bound and not served yet.
pub(crate) struct BoundPlugIn {
    pub(crate) address: Address,
    scheme: &'static str,
    listener: Box<dyn LetterListener>,
}

impl BoundPlugIn {
    /// Takes letters in for a service, as long as that is there.
    pub(crate) fn serve(self, node: &Arc<Node<Mts>>) -> Result<(), Error> {
        let inbox = LetterInbox {
            node: Arc::downgrade(node),
            scheme: self.scheme,
        };
        let thread = std::thread::Builder::new().name(self.scheme.to_owned());
        let served = thread.spawn(move || self.listener.serve(inbox));
        served.map(drop).map_err(Error::Runtime)
    }
}
