//! Who we are, and who is let in.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use fipa_fleet::Refusal;
use quinn::Connection;
use rustls::client::Resumption;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, ring, verify_tls12_signature, verify_tls13_signature};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, ServerName, UnixTime};
use rustls::server::{ServerSessionMemoryCache, StoresServerSessions};
use rustls::version::TLS13;
use rustls::{ClientConfig, DigitallySignedStruct, ServerConfig, SignatureScheme};

use super::NOBODY;
use crate::tls::{PROTOCOL, Verdict};
use crate::{KeyError, Tls};

/// Tickets that callers have and that are still good, at most.
const TICKETS: usize = 256;

/// Tickets that are kept of one address.
const KEPT: usize = 4;

#[derive(Debug)]
pub(super) struct Keys {
    who: Who,
    /// Each ticket is in it until it is used.
    tickets: Arc<dyn StoresServerSessions>,
}

#[derive(Debug)]
enum Who {
    Robot(Tls),
    Anybody {
        provider: Arc<CryptoProvider>,
        certificate: CertificateDer<'static>,
        key: Vec<u8>,
    },
}

impl Keys {
    pub(super) fn new(tls: Option<Tls>) -> Result<Keys, KeyError> {
        let who = match tls {
            Some(tls) => Who::Robot(tls),
            None => {
                let made = rcgen::generate_simple_self_signed([NOBODY.to_owned()]);
                let made = made.map_err(|error| KeyError::new(&error))?;
                Who::Anybody {
                    provider: Arc::new(ring::default_provider()),
                    certificate: made.cert.der().clone(),
                    key: made.signing_key.serialize_der(),
                }
            }
        };
        Ok(Keys {
            who,
            tickets: ServerSessionMemoryCache::new(TICKETS),
        })
    }

    pub(super) fn tls(&self) -> Option<&Tls> {
        match &self.who {
            Who::Robot(tls) => Some(tls),
            Who::Anybody { .. } => None,
        }
    }

    /// For handshakes at one address; a ticket of one is good for the next.
    pub(super) fn client(&self, verdict: &Arc<Verdict>) -> Result<ClientConfig, KeyError> {
        let wrong = |error: rustls::Error| KeyError::new(&error);
        let mut config = match &self.who {
            Who::Robot(tls) => tls.client(Arc::clone(verdict)).map_err(wrong)?,
            Who::Anybody { provider, .. } => {
                let anybody = Anybody(Arc::clone(provider));
                ClientConfig::builder_with_provider(Arc::clone(provider))
                    .with_protocol_versions(&[&TLS13])
                    .map_err(wrong)?
                    .dangerous()
                    .with_custom_certificate_verifier(Arc::new(anybody))
                    .with_no_client_auth()
            }
        };
        config.alpn_protocols = vec![PROTOCOL.to_vec()];
        config.enable_sni = false;
        config.resumption = Resumption::in_memory_sessions(KEPT);
        Ok(config)
    }

    /// For one handshake.
    pub(super) fn server(&self, verdict: &Arc<Verdict>) -> Result<ServerConfig, KeyError> {
        let wrong = |error: rustls::Error| KeyError::new(&error);
        let mut config = match &self.who {
            Who::Robot(tls) => tls.server(Arc::clone(verdict)).map_err(wrong)?,
            Who::Anybody {
                provider,
                certificate,
                key,
            } => {
                let key = PrivatePkcs8KeyDer::from(key.clone());
                ServerConfig::builder_with_provider(Arc::clone(provider))
                    .with_protocol_versions(&[&TLS13])
                    .map_err(wrong)?
                    .with_no_client_auth()
                    .with_single_cert(vec![certificate.clone()], PrivateKeyDer::from(key))
                    .map_err(wrong)?
            }
        };
        config.alpn_protocols = vec![PROTOCOL.to_vec()];
        config.session_storage = Arc::clone(&self.tickets);
        config.send_tls13_tickets = 1;
        // Nothing is taken before the handshake is over.
        config.max_early_data_size = 0;
        Ok(config)
    }

    /// Whose certificate was shown, now or in the handshake that is resumed; without a fleet nobody
    /// is asked.
    pub(super) fn judge(&self, shown: Option<&[u8]>) -> Result<Option<String>, Refusal> {
        let Who::Robot(tls) = &self.who else {
            return Ok(None);
        };
        let certificate = shown.ok_or(Refusal::NoCertificate)?;
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let now = now.unwrap_or(Duration::ZERO);
        tls.membership().check(&[certificate], now).map(Some)
    }
}

/// The certificate of the other side.
pub(super) fn shown(connection: &Connection) -> Option<Vec<u8>> {
    let chain = connection.peer_identity()?;
    let chain = chain.downcast::<Vec<CertificateDer<'static>>>().ok()?;
    chain.first().map(|certificate| certificate.to_vec())
}

/// Lets anybody be the server who has the key that it shows.
#[derive(Debug)]
struct Anybody(Arc<CryptoProvider>);

impl ServerCertVerifier for Anybody {
    fn verify_server_cert(
        &self,
        _end_entity: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _server_name: &ServerName<'_>,
        _ocsp_response: &[u8],
        _now: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = &self.0.signature_verification_algorithms;
        verify_tls12_signature(message, cert, signed, algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = &self.0.signature_verification_algorithms;
        verify_tls13_signature(message, cert, signed, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.signature_verification_algorithms.supported_schemes()
    }
}
