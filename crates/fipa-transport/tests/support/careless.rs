//! A caller who minds nothing.

use std::io::Write;
use std::net::TcpStream;
use std::sync::Arc;

use fipa_fleet::Membership;
use rustls::client::ResolvesClientCert;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::ring::default_provider;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, ServerName, UnixTime};
use rustls::sign::CertifiedKey;
use rustls::{ClientConfig, ClientConnection, DigitallySignedStruct, Error, SignatureScheme};

#[derive(Debug)]
struct Minding;

impl ServerCertVerifier for Minding {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        let algorithms = default_provider().signature_verification_algorithms;
        algorithms.supported_schemes()
    }
}

/// Shows this certificate, whoever asks and whatever for.
#[derive(Debug)]
struct Shown(Option<Arc<CertifiedKey>>);

impl ResolvesClientCert for Shown {
    fn resolve(&self, _: &[&[u8]], _: &[SignatureScheme]) -> Option<Arc<CertifiedKey>> {
        self.0.clone()
    }

    fn has_certs(&self) -> bool {
        self.0.is_some()
    }
}

fn made(shown: Option<CertifiedKey>) -> ClientConfig {
    let mut config = ClientConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(Minding))
        .with_client_cert_resolver(Arc::new(Shown(shown.map(Arc::new))));
    config.alpn_protocols = vec![b"fipa/1".to_vec()];
    config
}

pub(crate) fn config(shown: Option<&Membership>) -> Arc<ClientConfig> {
    match shown {
        Some(m) => config_with(m.certificate().der(), m.private_key()),
        None => Arc::new(made(None)),
    }
}

pub(crate) fn config_with(certificate: &[u8], key: &[u8]) -> Arc<ClientConfig> {
    Arc::new(made(Some(pair(certificate, key))))
}

fn pair(certificate: &[u8], key: &[u8]) -> CertifiedKey {
    let key = PrivateKeyDer::from(PrivatePkcs8KeyDer::from(key.to_vec()));
    let key = default_provider()
        .key_provider
        .load_private_key(key)
        .unwrap();
    let chain = vec![CertificateDer::from(certificate.to_vec())];
    CertifiedKey::new(chain, key)
}

/// What calls over QUIC with a certificate and a key, and would send early if it may.
#[cfg(feature = "quic")]
pub(crate) fn quic(shown: Option<(&[u8], &[u8])>, early: bool) -> quinn::Endpoint {
    let mut config = made(shown.map(|(certificate, key)| pair(certificate, key)));
    config.enable_early_data = early;
    let config = quinn::crypto::rustls::QuicClientConfig::try_from(config).unwrap();
    let mut endpoint = quinn::Endpoint::client("127.0.0.1:0".parse().unwrap()).unwrap();
    endpoint.set_default_client_config(quinn::ClientConfig::new(Arc::new(config)));
    endpoint
}

/// Calls, writes something, and waits for the end.
pub(crate) fn call(port: u16, config: Arc<ClientConfig>) {
    let name = ServerName::try_from("fleet.invalid").unwrap();
    let mut session = ClientConnection::new(config, name).unwrap();
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let mut stream = rustls::Stream::new(&mut session, &mut stream);
    let _ = stream.write_all(b"\x8fFIPA\r\n\x01");
    let _ = std::io::copy(&mut stream, &mut std::io::sink());
}
