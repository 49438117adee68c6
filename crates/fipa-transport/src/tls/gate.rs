use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fipa_fleet::{Membership, Refusal};
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, WebPkiSupportedAlgorithms, verify_tls13_signature};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::{
    CertificateError, DigitallySignedStruct, DistinguishedName, Error, PeerIncompatible,
    SignatureScheme,
};

/// What became of the certificate that was shown in one handshake.
#[derive(Debug, Default)]
pub(crate) struct Verdict(Mutex<Option<Result<String, Refusal>>>);

impl Verdict {
    /// Whose it is, if it is one of the fleet.
    pub(crate) fn name(&self) -> Option<String> {
        self.lock().clone()?.ok()
    }

    /// Why it was refused.
    pub(crate) fn refusal(&self) -> Option<Refusal> {
        self.lock().clone()?.err()
    }

    /// There is another handshake.
    #[cfg(feature = "quic")]
    pub(crate) fn forget(&self) {
        *self.lock() = None;
    }

    fn lock(&self) -> MutexGuard<'_, Option<Result<String, Refusal>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Lets in, in one handshake, whoever shows a certificate of the fleet and has its key.
#[derive(Debug)]
pub(super) struct Gate {
    membership: Arc<Membership>,
    algorithms: WebPkiSupportedAlgorithms,
    verdict: Arc<Verdict>,
}

impl Gate {
    pub(super) fn new(
        membership: &Arc<Membership>,
        provider: &CryptoProvider,
        verdict: Arc<Verdict>,
    ) -> Gate {
        Gate {
            membership: Arc::clone(membership),
            algorithms: provider.signature_verification_algorithms,
            verdict,
        }
    }

    fn judge(
        &self,
        own: &CertificateDer<'_>,
        others: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<(), Error> {
        let mut chain = vec![own.as_ref()];
        chain.extend(others.iter().map(AsRef::<[u8]>::as_ref));
        let now = Duration::from_secs(now.as_secs());
        let verdict = self.membership.check(&chain, now);
        let told = verdict.as_ref().err().map(alert);
        *self.verdict.lock() = Some(verdict);
        match told {
            None => Ok(()),
            Some(error) => Err(Error::InvalidCertificate(error)),
        }
    }

    fn signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls13_signature(message, cert, signed, &self.algorithms)
    }
}

/// What decides which alert the other side gets.
fn alert(refusal: &Refusal) -> CertificateError {
    match refusal {
        Refusal::WrongFleet => CertificateError::UnknownIssuer,
        Refusal::Expired { .. } => CertificateError::Expired,
        Refusal::NotYetValid { .. } => CertificateError::NotValidYet,
        Refusal::Revoked(_) => CertificateError::Revoked,
        _ => CertificateError::ApplicationVerificationFailure,
    }
}

fn only_tls13() -> Error {
    Error::PeerIncompatible(PeerIncompatible::ServerTlsVersionIsDisabledByOurConfig)
}

impl ServerCertVerifier for Gate {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        _server_name: &ServerName<'_>,
        _ocsp_response: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        self.judge(end_entity, intermediates, now)?;
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _cert: &CertificateDer<'_>,
        _signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Err(only_tls13())
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.signature(message, cert, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.algorithms.supported_schemes()
    }
}

impl ClientCertVerifier for Gate {
    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        &[]
    }

    fn verify_client_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        self.judge(end_entity, intermediates, now)?;
        Ok(ClientCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _cert: &CertificateDer<'_>,
        _signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Err(only_tls13())
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.signature(message, cert, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.algorithms.supported_schemes()
    }
}
