//! What went wrong, for people.

use std::io;

use fipa_fleet::Refusal;
use quinn::ConnectionError;
use rustls::AlertDescription;

use super::{BROKEN_OFF, DONE, NOT_LET_IN};
use crate::tls::{Verdict, of_alert};

/// QUIC numbers the alerts of TLS from here (RFC 9001, 4.8).
const ALERTS: u64 = 0x100;

/// Why a handshake failed.
pub(super) fn of_handshake(error: &ConnectionError, verdict: &Verdict) -> io::Error {
    if let Some(refusal) = verdict.refusal() {
        return io::Error::other(refusal);
    }
    let ConnectionError::TransportError(wrong) = error else {
        return of_connection(error);
    };
    match alert(wrong.code.into()) {
        Some(AlertDescription::CertificateRequired) => io::Error::other(Refusal::NoCertificate),
        Some(AlertDescription::DecryptError) => {
            io::Error::other("it does not have the key of the certificate that it showed")
        }
        _ => of_connection(error),
    }
}

/// Why a connection ended.
pub(super) fn of_connection(error: &ConnectionError) -> io::Error {
    let (kind, why) = match error {
        ConnectionError::TimedOut => (
            io::ErrorKind::TimedOut,
            "nothing was heard of the other side".to_owned(),
        ),
        ConnectionError::Reset => (
            io::ErrorKind::ConnectionReset,
            "the other side knows nothing of the connection any more".to_owned(),
        ),
        ConnectionError::ApplicationClosed(close) if close.error_code == NOT_LET_IN => (
            io::ErrorKind::PermissionDenied,
            "the other side does not accept our certificate".to_owned(),
        ),
        ConnectionError::ApplicationClosed(close) if close.error_code == BROKEN_OFF => (
            io::ErrorKind::ConnectionReset,
            "the other side broke off the connection".to_owned(),
        ),
        ConnectionError::ApplicationClosed(close) if close.error_code == DONE => (
            io::ErrorKind::ConnectionAborted,
            "the other side closed the connection".to_owned(),
        ),
        ConnectionError::ConnectionClosed(close) => match alert(close.error_code.into()) {
            Some(AlertDescription::CertificateRequired) => (
                io::ErrorKind::PermissionDenied,
                "it wants a certificate of its fleet, and we have none".to_owned(),
            ),
            Some(alert) => (io::ErrorKind::PermissionDenied, of_alert(alert)),
            None if close.error_code == quinn::TransportErrorCode::CONNECTION_REFUSED => (
                io::ErrorKind::ConnectionRefused,
                "the other side takes no calls now".to_owned(),
            ),
            None => (io::ErrorKind::ConnectionAborted, format!("QUIC: {error}")),
        },
        other => (io::ErrorKind::Other, format!("QUIC: {other}")),
    };
    io::Error::new(kind, why)
}

fn alert(code: u64) -> Option<AlertDescription> {
    let number = u8::try_from(code.checked_sub(ALERTS)?).ok()?;
    Some(AlertDescription::from(number))
}
