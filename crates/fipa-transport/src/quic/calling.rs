//! Being called.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use quinn::crypto::rustls::QuicServerConfig;
use quinn::{Endpoint, Incoming, ServerConfig};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::{Quic, endpoint, within, words};
use crate::stream::Kind;
use crate::tls::Verdict;
use crate::{KeyError, Stream};

/// Callers whose handshakes are under way at once.
const AT_ONCE: usize = 1000;

/// Where so many are under way, who calls has to show that it is where it says it is (RFC 9000,
/// 8.1.2).
const MANY: usize = 100;

/// A socket at which calls are taken.
#[derive(Debug)]
pub(crate) struct Server {
    endpoint: Endpoint,
    config: ServerConfig,
    quic: Quic,
    greeting: Arc<Semaphore>,
}

/// Somebody calls, and has not shown who it is.
#[derive(Debug)]
pub(crate) struct Calling {
    incoming: Incoming,
    config: ServerConfig,
    quic: Quic,
    _permit: OwnedSemaphorePermit,
}

impl Server {
    pub(crate) fn bind(quic: &Quic, at: SocketAddr) -> io::Result<Server> {
        let config = quic.server(&Arc::default()).map_err(io::Error::other)?;
        Ok(Server {
            endpoint: endpoint(at, Some(config.clone()))?,
            config,
            quic: quic.clone(),
            greeting: Arc::new(Semaphore::new(AT_ONCE)),
        })
    }

    pub(crate) fn address(&self) -> io::Result<SocketAddr> {
        self.endpoint.local_addr()
    }

    pub(crate) async fn accept(&self) -> io::Result<Stream> {
        loop {
            let incoming = self.endpoint.accept().await;
            let incoming = incoming.ok_or_else(|| io::Error::other("the socket is closed"))?;
            let many = self.greeting.available_permits() < AT_ONCE - MANY;
            let permit = Arc::clone(&self.greeting).try_acquire_owned();
            match permit {
                Ok(_) if many && incoming.may_retry() && !incoming.remote_address_validated() => {
                    // It calls again, or it was not there.
                    let _ = incoming.retry();
                }
                Ok(permit) => {
                    return Ok(Stream(Kind::Calling(Box::new(Calling {
                        incoming,
                        config: self.config.clone(),
                        quic: self.quic.clone(),
                        _permit: permit,
                    }))));
                }
                Err(_) => incoming.refuse(),
            }
        }
    }
}

impl Calling {
    pub(crate) fn remote(&self) -> SocketAddr {
        self.incoming.remote_address()
    }

    /// Lets the caller show who it is.
    pub(crate) async fn settle(self) -> io::Result<Stream> {
        let verdict = Arc::<Verdict>::default();
        let mut config = self.config;
        config.crypto = self.quic.crypto(&verdict).map_err(io::Error::other)?;
        let settled = async {
            let connection = match self.incoming.accept_with(Arc::new(config)) {
                Ok(connecting) => connecting.await,
                Err(error) => Err(error),
            };
            let connection = connection.map_err(|e| words::of_handshake(&e, &verdict))?;
            self.quic.settle(connection, false).await
        };
        // The packets of a recording cannot be opened, as if they had not come.
        let late = "its handshake did not end within 5 s: it is a recording, or the radio is bad";
        within(settled, late).await
    }
}

impl Quic {
    pub(crate) fn server(&self, verdict: &Arc<Verdict>) -> Result<ServerConfig, KeyError> {
        let mut config = ServerConfig::with_crypto(self.crypto(verdict)?);
        config.transport_config(Arc::clone(&self.0.transport));
        Ok(config)
    }

    fn crypto(&self, verdict: &Arc<Verdict>) -> Result<Arc<QuicServerConfig>, KeyError> {
        let config = QuicServerConfig::try_from(self.0.keys.server(verdict)?);
        config.map(Arc::new).map_err(|error| KeyError::new(&error))
    }
}
