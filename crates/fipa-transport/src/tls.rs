//! TLS on TCP streams: each end shows the certificate of a robot of the fleet (TLS 1.3, RFC 8446).
//!
//! Sessions over TCP are never resumed, and nothing is sent before the handshake is over: each connection is a
//! handshake of its own, in which both sides use their keys, so that a revoked robot does not come
//! back on an old ticket and a recorded handshake opens nothing.

mod gate;
mod secured;

use std::io;
use std::sync::Arc;
use std::time::Duration;

use fipa_fleet::Membership;
use rustls::client::Resumption;
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, ServerName};
use rustls::server::NoServerSessionStorage;
use rustls::sign::{CertifiedKey, SingleCertAndKey};
use rustls::version::TLS13;
use rustls::{ClientConfig, ClientConnection, Connection, ServerConfig, ServerConnection};
use tokio::net::TcpStream;

use self::gate::Gate;
pub(crate) use self::gate::Verdict;
pub(crate) use self::secured::Secured;
#[cfg(feature = "quic")]
pub(crate) use self::secured::of_alert;
use crate::Stream;
use crate::stream::{Kind, Plain};

/// What is spoken over TLS (ALPN, RFC 7301): our stream link.
pub(crate) const PROTOCOL: &[u8] = b"fipa/1";

/// The first octet of a TLS handshake; no letter and no link of ours begins with it.
const HANDSHAKE: u8 = 0x16;

/// How long a handshake may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// Secures streams by the certificates of a fleet.
#[derive(Clone, Debug)]
pub struct Tls {
    membership: Arc<Membership>,
    provider: Arc<CryptoProvider>,
    own: Arc<SingleCertAndKey>,
}

/// The certificate or key of this robot cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("the key of this robot cannot be used: {0}")]
pub struct KeyError(String);

impl KeyError {
    pub(crate) fn new(error: &dyn std::fmt::Display) -> KeyError {
        KeyError(error.to_string())
    }
}

/// What the first octet of a stream says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FirstOctet {
    /// It begins a TLS handshake.
    Tls,
    /// It begins something else.
    Other,
    /// There is none: the stream has ended.
    End,
}

impl Tls {
    /// Secures streams as a robot of a fleet.
    pub fn new(membership: Arc<Membership>) -> Result<Tls, KeyError> {
        let wrong = |error: rustls::Error| KeyError::new(&error);
        let provider = Arc::new(ring::default_provider());
        let certificate = CertificateDer::from(membership.certificate().der().to_vec());
        let key = PrivatePkcs8KeyDer::from(membership.private_key().to_vec());
        let key = PrivateKeyDer::from(key);
        let own = CertifiedKey::from_der(vec![certificate], key, &provider).map_err(wrong)?;
        let tls = Tls {
            membership,
            provider,
            own: Arc::new(SingleCertAndKey::from(own)),
        };
        // What can fail, fails here and not at the first caller.
        tls.client(Arc::default()).map_err(wrong)?;
        tls.server(Arc::default()).map_err(wrong)?;
        Ok(tls)
    }

    /// The fleet, as this robot knows it.
    pub fn membership(&self) -> &Arc<Membership> {
        &self.membership
    }

    /// Secures a stream that somebody else opened. An error says why they are not let in.
    pub async fn accept(&self, stream: Stream) -> io::Result<Stream> {
        let verdict = Arc::<Verdict>::default();
        let config = self
            .server(Arc::clone(&verdict))
            .map_err(io::Error::other)?;
        let session = ServerConnection::new(Arc::new(config)).map_err(io::Error::other)?;
        self.shake_hands(stream, Connection::Server(session), &verdict)
            .await
    }

    /// Secures a stream that we opened.
    pub(crate) async fn connect(&self, stream: Stream) -> io::Result<Stream> {
        let verdict = Arc::<Verdict>::default();
        let config = self
            .client(Arc::clone(&verdict))
            .map_err(io::Error::other)?;
        // Who is there is what the certificate says, whatever the host is called.
        let nobody = ServerName::try_from("fleet.invalid").map_err(io::Error::other)?;
        let session = ClientConnection::new(Arc::new(config), nobody).map_err(io::Error::other)?;
        self.shake_hands(stream, Connection::Client(session), &verdict)
            .await
    }

    async fn shake_hands(
        &self,
        stream: Stream,
        session: Connection,
        verdict: &Verdict,
    ) -> io::Result<Stream> {
        let stream = tcp(stream)?;
        let shaken = secured::shake_hands(stream, session, verdict);
        match tokio::time::timeout(PATIENCE, shaken).await {
            Ok(secured) => Ok(Stream::plain(Plain::Tls(Box::new(secured?)))),
            Err(_) => Err(io::Error::new(
                io::ErrorKind::TimedOut,
                "the TLS handshake took longer than 5 s",
            )),
        }
    }

    pub(crate) fn client(&self, verdict: Arc<Verdict>) -> Result<ClientConfig, rustls::Error> {
        let gate = Arc::new(Gate::new(&self.membership, &self.provider, verdict));
        let mut config = ClientConfig::builder_with_provider(Arc::clone(&self.provider))
            .with_protocol_versions(&[&TLS13])?
            .dangerous()
            .with_custom_certificate_verifier(gate)
            .with_client_cert_resolver(self.own.clone());
        config.alpn_protocols = vec![PROTOCOL.to_vec()];
        config.resumption = Resumption::disabled();
        config.enable_sni = false;
        Ok(config)
    }

    pub(crate) fn server(&self, verdict: Arc<Verdict>) -> Result<ServerConfig, rustls::Error> {
        let gate = Arc::new(Gate::new(&self.membership, &self.provider, verdict));
        let mut config = ServerConfig::builder_with_provider(Arc::clone(&self.provider))
            .with_protocol_versions(&[&TLS13])?
            .with_client_cert_verifier(gate)
            .with_cert_resolver(self.own.clone());
        config.alpn_protocols = vec![PROTOCOL.to_vec()];
        config.session_storage = Arc::new(NoServerSessionStorage {});
        config.send_tls13_tickets = 0;
        Ok(config)
    }
}

impl Stream {
    /// Waits for the first octet, which stays to be read. Streams that are no TCP have none.
    pub async fn first_octet(&self) -> io::Result<FirstOctet> {
        let Kind::Plain(Plain::Tcp(stream)) = &self.0 else {
            return Ok(FirstOctet::Other);
        };
        let mut first = [0];
        Ok(match stream.peek(&mut first).await? {
            0 => FirstOctet::End,
            _ if first == [HANDSHAKE] => FirstOctet::Tls,
            _ => FirstOctet::Other,
        })
    }
}

fn tcp(stream: Stream) -> io::Result<TcpStream> {
    match stream.0 {
        Kind::Plain(Plain::Tcp(stream)) => Ok(stream),
        _ => Err(io::Error::other("a fleet speaks TLS over TCP only")),
    }
}
