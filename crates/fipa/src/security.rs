//! How connections with other machines are secured: as a robot of a fleet, or not at all.

#[cfg(feature = "tls")]
use std::collections::HashMap;
#[cfg(feature = "tls")]
use std::sync::{Arc, Mutex, PoisonError};
#[cfg(feature = "tls")]
use std::time::{Duration, Instant};

use bytes::Bytes;
use fipa_acl::Text;
use fipa_directory::{Address, Now};
#[cfg(feature = "quic")]
use fipa_transport::Quic;
use fipa_transport::{BindError, DialError, Listener, Stream};
#[cfg(feature = "tls")]
use fipa_transport::{FirstOctet, Tls};

use crate::Error;

/// How long a caller may take for its first octet.
#[cfg(feature = "tls")]
const FIRST_OCTET: Duration = Duration::from_secs(5);

/// Callers that may greet at once.
#[cfg(feature = "tls")]
const GREETING: usize = 1000;

/// How long it is not told again that the same caller is refused for the same reason, and of how
/// many that is remembered.
#[cfg(feature = "tls")]
const QUIET: Duration = Duration::from_secs(60);
#[cfg(feature = "tls")]
const REMEMBERED: usize = 256;

/// Secures connections, where there is a fleet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Security {
    #[cfg(feature = "tls")]
    fleet: Option<Arc<Fleet>>,
    /// Only who is attached to a platform has none.
    #[cfg(feature = "quic")]
    quic: Option<Quic>,
}

#[cfg(feature = "tls")]
#[derive(Debug)]
struct Fleet {
    tls: Tls,
    greeting: tokio::sync::Semaphore,
    /// Hosts that were refused, why, and when that was told.
    told: Mutex<HashMap<(String, String), Instant>>,
}

impl Security {
    /// Without a fleet.
    pub(crate) fn open() -> Result<Security, Error> {
        Ok(Security {
            #[cfg(feature = "quic")]
            quic: Some(Quic::new(None).map_err(|error| Error::Key(error.to_string()))?),
            ..Security::default()
        })
    }

    /// Binds an endpoint of links.
    pub(crate) async fn bind(&self, address: &Address) -> Result<Listener, BindError> {
        #[cfg(feature = "quic")]
        if let Some(quic) = &self.quic {
            return Listener::bind_link(address, quic).await;
        }
        Listener::bind(address).await
    }

    /// Opens a stream, secured if it is to be a link.
    pub(crate) async fn dial(
        &self,
        addresses: &[Address],
        link: bool,
    ) -> Result<(Stream, Address), DialError> {
        #[cfg(feature = "quic")]
        if let (Some(quic), true) = (&self.quic, link) {
            return fipa_transport::dial_link(addresses, quic).await;
        }
        #[cfg(all(feature = "tls", not(feature = "quic")))]
        if let (Some(fleet), true) = (&self.fleet, link) {
            return fipa_transport::dial_secured(addresses, &fleet.tls).await;
        }
        let _ = link;
        fipa_transport::dial(addresses).await
    }

    /// Whether callers show who they are.
    pub(crate) fn is_on(&self) -> bool {
        #[cfg(feature = "tls")]
        return self.fleet.is_some();
        #[cfg(not(feature = "tls"))]
        return false;
    }

    /// Lets a caller show who it is, if it wants to. `None`: it has gone. An error says why it is
    /// refused; it is empty if that was told not long ago.
    pub(crate) async fn accept(&self, stream: Stream) -> Result<Option<Stream>, String> {
        #[cfg(feature = "tls")]
        if let Some(fleet) = &self.fleet {
            return fleet.accept(stream).await;
        }
        let settled = stream.settle().await;
        settled.map(Some).map_err(|error| error.to_string())
    }

    /// Takes a list of what is revoked, if it is good; whether there is something new in it.
    pub(crate) fn learn_revoked(&self, list: &[u8]) -> Result<bool, String> {
        #[cfg(feature = "tls")]
        if let Some(fleet) = &self.fleet {
            let learned = fleet.tls.membership().learn(list);
            return learned.map_err(|error| error.to_string());
        }
        let _ = list;
        Ok(false)
    }

    /// What is revoked, to be passed on; `None` without a fleet.
    pub(crate) fn revoked(&self) -> Option<Bytes> {
        #[cfg(feature = "tls")]
        if let Some(fleet) = &self.fleet {
            let revoked = fleet.tls.membership().revoked();
            return Some(revoked.map_or(Bytes::new(), |list| Bytes::copy_from_slice(list.der())));
        }
        None
    }

    /// Who is not let in any more with this certificate, and why.
    pub(crate) fn check(&self, certificate: &[u8], now: Now) -> Result<(), (Text, Text)> {
        #[cfg(feature = "tls")]
        if let Some(fleet) = &self.fleet {
            let since_epoch = u64::try_from(now.unix_millis).unwrap_or_default();
            let membership = fleet.tls.membership();
            let checked = membership.check(&[certificate], Duration::from_millis(since_epoch));
            return checked.map(drop).map_err(|refusal| {
                let reason = Text::from(refusal.to_string());
                (Text::from_static("a robot that was linked"), reason)
            });
        }
        let _ = (certificate, now);
        Ok(())
    }
}

#[cfg(feature = "tls")]
impl Security {
    /// As a robot of a fleet.
    pub(crate) fn of(tls: Tls) -> Result<Security, Error> {
        Ok(Security {
            #[cfg(feature = "quic")]
            quic: {
                let quic = Quic::new(Some(tls.clone()));
                Some(quic.map_err(|error| Error::Key(error.to_string()))?)
            },
            fleet: Some(Arc::new(Fleet {
                tls,
                greeting: tokio::sync::Semaphore::new(GREETING),
                told: Mutex::default(),
            })),
        })
    }
}

#[cfg(feature = "tls")]
impl Fleet {
    async fn accept(&self, stream: Stream) -> Result<Option<Stream>, String> {
        let host = host_of(&stream);
        let accepted = match self.greeting.try_acquire() {
            Ok(_permit) => self.greet(stream).await,
            Err(_) => Err("too many greet at once".to_owned()),
        };
        accepted.map_err(|reason| match self.is_news(host, &reason) {
            true => reason,
            false => String::new(),
        })
    }

    async fn greet(&self, stream: Stream) -> Result<Option<Stream>, String> {
        if stream.is_calling() {
            let settled = stream.settle().await;
            return settled.map(Some).map_err(|error| error.to_string());
        }
        match tokio::time::timeout(FIRST_OCTET, stream.first_octet()).await {
            Ok(Ok(FirstOctet::Tls)) => {
                let secured = self.tls.accept(stream).await;
                secured.map(Some).map_err(|error| error.to_string())
            }
            Ok(Ok(FirstOctet::Other)) => Ok(Some(stream)),
            Ok(Ok(FirstOctet::End) | Err(_)) => Ok(None),
            Err(_) => Err("it opened the connection and said nothing".to_owned()),
        }
    }

    fn is_news(&self, host: String, reason: &str) -> bool {
        // What differs each time, as a time of day does, is no news.
        let kind: String = reason.chars().filter(|c| !c.is_ascii_digit()).collect();
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        told.retain(|_, at| now.duration_since(*at) < QUIET);
        if told.len() >= REMEMBERED {
            return true;
        }
        told.insert((host, kind), now).is_none()
    }
}

/// Where a caller is, without the port, which changes.
#[cfg(feature = "tls")]
fn host_of(stream: &Stream) -> String {
    let remote = stream.remote();
    match remote.rsplit_once(':') {
        Some((host, _)) => host.to_owned(),
        None => remote,
    }
}
