//! TLS, with the certificates of files. Who cannot be verified is not talked to.

use std::format;
use std::io;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::sync::Arc;
use std::time::Duration;
use std::vec::Vec;

use tokio::net::TcpStream;
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use tokio_rustls::rustls::server::WebPkiClientVerifier;
use tokio_rustls::rustls::{ClientConfig, RootCertStore, ServerConfig};
use tokio_rustls::{TlsAcceptor, TlsConnector, TlsStream};

use super::endpoint::TlsFiles;

/// How long the other end has to say who it is.
const GREETING: Duration = Duration::from_secs(10);

/// What a TLS stream is dialled with.
#[derive(Clone)]
pub(super) struct Dialler {
    connector: TlsConnector,
    host: ServerName<'static>,
}

/// What TLS streams are taken with.
#[derive(Clone)]
pub(super) struct Listener(TlsAcceptor);

impl Dialler {
    pub(super) fn new(place: &str, files: &TlsFiles) -> io::Result<Dialler> {
        let host = place.rsplit_once(':').map_or(place, |(host, _)| host);
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let host = ServerName::try_from(host.to_string()).map_err(unusable)?;
        let builder = ClientConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .map_err(unusable)?
            .with_root_certificates(authorities(files.authorities.as_deref())?);
        let config = match own(files)? {
            Some((chain, key)) => builder
                .with_client_auth_cert(chain, key)
                .map_err(unusable)?,
            None => builder.with_no_client_auth(),
        };
        Ok(Dialler {
            connector: Arc::new(config).into(),
            host,
        })
    }

    pub(super) async fn connect(&self, stream: TcpStream) -> io::Result<TlsStream<TcpStream>> {
        let connected = self.connector.connect(self.host.clone(), stream);
        let stream = tokio::time::timeout(GREETING, connected).await??;
        Ok(stream.into())
    }
}

impl Listener {
    pub(super) fn new(files: &TlsFiles) -> io::Result<Listener> {
        let builder = ServerConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .map_err(unusable)?;
        let builder = match &files.authorities {
            Some(file) => {
                let roots = Arc::new(authorities(Some(file))?);
                let verifier = WebPkiClientVerifier::builder_with_provider(roots, provider());
                builder.with_client_cert_verifier(verifier.build().map_err(unusable)?)
            }
            None => builder.with_no_client_auth(),
        };
        let Some((chain, key)) = own(files)? else {
            return Err(unusable(
                "a place that listens needs cert=FILE and key=FILE",
            ));
        };
        let config = builder.with_single_cert(chain, key).map_err(unusable)?;
        Ok(Listener(Arc::new(config).into()))
    }

    pub(super) async fn accept(&self, stream: TcpStream) -> io::Result<TlsStream<TcpStream>> {
        let stream = tokio::time::timeout(GREETING, self.0.accept(stream)).await??;
        Ok(stream.into())
    }
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}

fn authorities(file: Option<&Path>) -> io::Result<RootCertStore> {
    let file = file.ok_or_else(|| unusable("who is there cannot be verified without ca=FILE"))?;
    let mut roots = RootCertStore::empty();
    for certificate in certificates(file)? {
        roots
            .add(certificate)
            .map_err(|error| in_file(file, error))?;
    }
    Ok(roots)
}

type Own = (Vec<CertificateDer<'static>>, PrivateKeyDer<'static>);

fn own(files: &TlsFiles) -> io::Result<Option<Own>> {
    let (Some(certificate), Some(key)) = (&files.certificate, &files.key) else {
        return Ok(None);
    };
    let chain = certificates(certificate)?;
    let key = PrivateKeyDer::from_pem_file(key).map_err(|error| in_file(key, error))?;
    Ok(Some((chain, key)))
}

fn certificates(file: &Path) -> io::Result<Vec<CertificateDer<'static>>> {
    let read = CertificateDer::pem_file_iter(file).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let read = read.map_err(|error| in_file(file, error))?;
    match read.is_empty() {
        true => Err(in_file(file, "there is no certificate in it")),
        false => Ok(read),
    }
}

fn in_file(file: &Path, error: impl ToString) -> io::Error {
    unusable(format!(
        "{}: {}",
        PathBuf::from(file).display(),
        error.to_string()
    ))
}

fn unusable(error: impl ToString) -> io::Error {
    let said: String = error.to_string();
    io::Error::new(io::ErrorKind::InvalidInput, said)
}
