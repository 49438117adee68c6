use std::collections::BTreeSet;

use webpki::BorrowedCertRevocationList;

use crate::{Certificate, FleetError, pem};

/// The certificates of a fleet that are revoked, for ever: a list that the fleet key has signed
/// (X.509 CRL, RFC 5280 section 5), whoever passes it on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revocations {
    der: Vec<u8>,
    serials: BTreeSet<Vec<u8>>,
}

impl Revocations {
    /// Reads a list (DER). Who has signed it is not checked by this.
    pub(crate) fn from_der(der: Vec<u8>) -> Result<Revocations, FleetError> {
        let unreadable = |error| {
            FleetError::Malformed(format!(
                "the list of what is revoked cannot be read: {error}"
            ))
        };
        let list = BorrowedCertRevocationList::from_der(&der).map_err(unreadable)?;
        let serials = list.into_iter().map(|revoked| {
            let revoked = revoked.map_err(unreadable)?;
            Ok(revoked.serial_number.to_owned())
        });
        let serials = serials.collect::<Result<_, FleetError>>()?;
        Ok(Revocations { der, serials })
    }

    /// Reads a list from a text (PEM). Who has signed it is not checked by this.
    pub(crate) fn from_pem(text: &str) -> Result<Revocations, FleetError> {
        let lists = pem::read(text)?.lists;
        Revocations::from_der(pem::only(lists, "list of what is revoked")?)
    }

    /// Its octets (DER), to be passed on.
    pub fn der(&self) -> &[u8] {
        &self.der
    }

    /// The list as text (PEM).
    pub fn to_pem(&self) -> String {
        pem::write(pem::LIST, &self.der)
    }

    /// Whether the certificate is revoked.
    pub fn holds(&self, certificate: &Certificate) -> bool {
        self.serials.contains(certificate.serial())
    }

    /// How many certificates are revoked.
    pub fn len(&self) -> usize {
        self.serials.len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.serials.is_empty()
    }

    pub(crate) fn serials(&self) -> Vec<&[u8]> {
        self.serials.iter().map(Vec::as_slice).collect()
    }

    /// Whether it holds all that the other one does.
    pub(crate) fn includes(&self, other: &Revocations) -> bool {
        self.serials.is_superset(&other.serials)
    }
}
