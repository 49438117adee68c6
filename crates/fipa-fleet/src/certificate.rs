use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use ring::digest::{SHA256, digest};
use rustls_pki_types::{CertificateDer, UnixTime};
use webpki::{EndEntityCert, Error, KeyUsage, anchor_from_trusted_cert};

use crate::name::SCHEME;
use crate::{FleetError, pem};

/// The certificate of a robot: public, nothing of it needs to be kept from anybody.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Certificate {
    der: Vec<u8>,
    name: String,
    serial: Vec<u8>,
}

/// What tells certificates apart: the SHA-256 of one. As text, 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Fingerprint([u8; 32]);

/// The text is no fingerprint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no fingerprint: 64 hexadecimal digits, as `fipa key show` prints them")]
pub struct ParseFingerprintError(String);

impl Certificate {
    /// Reads the certificate of a robot (DER). That it is of a fleet is not checked by this.
    pub fn from_der(der: Vec<u8>) -> Result<Certificate, FleetError> {
        let cert = CertificateDer::from(der.as_slice());
        let read = EndEntityCert::try_from(&cert).map_err(|error| {
            FleetError::Malformed(format!("the certificate cannot be read: {error}"))
        })?;
        let name = name_of(&read).ok_or_else(|| {
            FleetError::Malformed("the certificate does not say which robot it is for".to_owned())
        })?;
        let (name, serial) = (name.to_owned(), read.serial().to_owned());
        Ok(Certificate { der, name, serial })
    }

    /// Reads the first certificate of a text (PEM).
    pub fn from_pem(text: &str) -> Result<Certificate, FleetError> {
        let certificates = pem::read(text)?.certificates;
        let first = certificates.into_iter().take(1).collect();
        Certificate::from_der(pem::only(first, "certificate")?)
    }

    /// The certificate as text (PEM).
    pub fn to_pem(&self) -> String {
        pem::write(pem::CERTIFICATE, &self.der)
    }

    /// Its octets (DER).
    pub fn der(&self) -> &[u8] {
        &self.der
    }

    /// The robot: the name of its message transport service.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The number that the fleet gave it.
    pub(crate) fn serial(&self) -> &[u8] {
        &self.serial
    }

    /// Its fingerprint.
    pub fn fingerprint(&self) -> Fingerprint {
        Fingerprint::of(&self.der)
    }

    /// The end of its validity, since 1970-01-01T00:00:00Z; `None` if it has none that could be
    /// read.
    pub fn valid_until(&self) -> Option<Duration> {
        // Nothing is valid at the end of time: the answer says since when it is not.
        let end = UnixTime::since_unix_epoch(Duration::from_secs(u64::MAX));
        match self.error_at(end)? {
            Error::CertExpired { not_after, .. } => Some(Duration::from_secs(not_after.as_secs())),
            _ => None,
        }
    }

    fn error_at(&self, at: UnixTime) -> Option<Error> {
        let der = CertificateDer::from(self.der.as_slice());
        let cert = EndEntityCert::try_from(&der).ok()?;
        let anchor = anchor_from_trusted_cert(&der).ok()?;
        let algorithms = webpki::ALL_VERIFICATION_ALGS;
        let usage = KeyUsage::client_auth();
        let anchors = [anchor];
        let verified = cert.verify_for_usage(algorithms, &anchors, &[], at, usage, None, None);
        verified.map(|_| ()).err()
    }
}

/// The one name that a certificate is for.
pub(crate) fn name_of<'a>(cert: &EndEntityCert<'a>) -> Option<&'a str> {
    let mut names = cert
        .valid_uri_names()
        .filter_map(|uri| uri.strip_prefix(SCHEME));
    match (names.next(), names.next()) {
        (Some(name), None) if crate::check_name(name).is_ok() => Some(name),
        _ => None,
    }
}

impl Fingerprint {
    /// That of some octets.
    pub fn of(octets: &[u8]) -> Fingerprint {
        let mut fingerprint = [0; 32];
        fingerprint.copy_from_slice(digest(&SHA256, octets).as_ref());
        Fingerprint(fingerprint)
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|octet| write!(f, "{octet:02x}"))
    }
}

impl fmt::Debug for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for Fingerprint {
    type Err = ParseFingerprintError;

    fn from_str(text: &str) -> Result<Fingerprint, ParseFingerprintError> {
        let wrong = || ParseFingerprintError(text.to_owned());
        let digits: Option<Vec<u8>> = text.chars().map(|c| Some(c.to_digit(16)? as u8)).collect();
        let digits = digits.ok_or_else(wrong)?;
        let octets = digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]);
        let octets: Vec<u8> = octets.collect();
        match (digits.len(), octets.try_into()) {
            (64, Ok(octets)) => Ok(Fingerprint(octets)),
            _ => Err(wrong()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fingerprint_reads_as_it_is_written() {
        let fingerprint = Fingerprint::of(b"abc");
        let text = fingerprint.to_string();
        assert!(text.starts_with("ba7816bf8f01cfea"));
        assert_eq!(text.parse(), Ok(fingerprint));
        assert_eq!(text.to_uppercase().parse(), Ok(fingerprint));
        for wrong in ["", "ba78", &text[1..], &text.replace('b', "é")] {
            assert!(wrong.parse::<Fingerprint>().is_err(), "{wrong}");
        }
    }
}
