use std::collections::BTreeSet;
use std::fmt;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use rustls_pki_types::{CertificateDer, UnixTime};
use webpki::{
    CertRevocationList, EndEntityCert, Error, KeyUsage, OwnedCertRevocationList,
    RevocationOptionsBuilder, anchor_from_trusted_cert,
};

use crate::{Certificate, Fingerprint, FleetError, Refusal, Revocations, pem};

/// What a robot holds of its fleet: who it is, and by what it knows the others.
///
/// What is revoked may grow while it is in use ([`learn`](Self::learn)).
pub struct Membership {
    own: Certificate,
    key: Vec<u8>,
    fleet: Vec<u8>,
    robots: BTreeSet<String>,
    revoked: RwLock<Option<Arc<Revocations>>>,
    pinned: Option<BTreeSet<Fingerprint>>,
}

/// Begins the line that names a robot of the fleet, in the text of a membership.
const ROBOT: &str = "robot: ";

impl Membership {
    pub(crate) fn new(
        own: Certificate,
        key: Vec<u8>,
        fleet: Vec<u8>,
        mut robots: BTreeSet<String>,
        revoked: Option<Revocations>,
    ) -> Result<Membership, FleetError> {
        robots.insert(own.name().to_owned());
        let membership = Membership {
            own,
            key,
            fleet,
            robots,
            revoked: RwLock::default(),
            pinned: None,
        };
        // Not a matter of the clock: a robot whose clock is not set is in the fleet all the same.
        let when = membership.own_time();
        if let Err(refusal) = membership.check(&[membership.own.der()], when) {
            return Err(FleetError::Own(refusal));
        }
        if let Some(revoked) = revoked {
            membership.learn(revoked.der())?;
        }
        Ok(membership)
    }

    /// Reads what [`to_pem`](Self::to_pem) wrote: the file that a robot is given.
    pub fn from_pem(text: &str) -> Result<Membership, FleetError> {
        let sections = pem::read(text)?;
        let mut certificates = sections.certificates.into_iter();
        let (Some(own), Some(fleet), None) = (
            certificates.next(),
            certificates.next(),
            certificates.next(),
        ) else {
            return Err(FleetError::Malformed(
                "it is not the file of a robot: two certificates belong into it".to_owned(),
            ));
        };
        let key = pem::only(sections.keys, "private key")?;
        let names = text.lines().filter_map(|line| line.strip_prefix(ROBOT));
        let names = names.filter(|name| crate::check_name(name).is_ok());
        let list = sections.lists.into_iter().next();
        Membership::new(
            Certificate::from_der(own)?,
            key,
            fleet,
            names.map(str::to_owned).collect(),
            list.map(Revocations::from_der).transpose()?,
        )
    }

    /// All of it as text: the file that a robot is given. It is a secret.
    pub fn to_pem(&self) -> String {
        let mut text =
            "A robot of a fleet of fipa. Whoever has this file is that robot.\n".to_owned();
        for robot in &self.robots {
            text += &format!("{ROBOT}{robot}\n");
        }
        text += &pem::write(pem::KEY, &self.key);
        text += &self.own.to_pem();
        text += &pem::write(pem::CERTIFICATE, &self.fleet);
        if let Some(revoked) = self.revoked() {
            text += &revoked.to_pem();
        }
        text
    }

    /// Lets in only those whose certificates have these fingerprints; they must be of the fleet as
    /// well.
    #[must_use]
    pub fn pinned(mut self, fingerprints: impl IntoIterator<Item = Fingerprint>) -> Membership {
        self.pinned = Some(fingerprints.into_iter().collect());
        self
    }

    /// The certificate of this robot.
    pub fn certificate(&self) -> &Certificate {
        &self.own
    }

    /// The name of this robot: that of its message transport service.
    pub fn name(&self) -> &str {
        self.own.name()
    }

    /// The private key of the certificate (PKCS #8, DER). It is a secret.
    pub fn private_key(&self) -> &[u8] {
        &self.key
    }

    /// What tells fleets apart.
    pub fn fleet(&self) -> Fingerprint {
        Fingerprint::of(&self.fleet)
    }

    /// The robots that were in the fleet when this one joined, itself among them.
    pub fn robots(&self) -> impl Iterator<Item = &str> {
        self.robots.iter().map(String::as_str)
    }

    /// What is known to be revoked.
    pub fn revoked(&self) -> Option<Arc<Revocations>> {
        let revoked = self.revoked.read().unwrap_or_else(PoisonError::into_inner);
        revoked.clone()
    }

    /// Takes a list of what is revoked (DER), wherever it comes from, if the fleet key has signed
    /// it. Whether something was new in it.
    pub fn learn(&self, list: &[u8]) -> Result<bool, FleetError> {
        let list = Revocations::from_der(list.to_owned())?;
        self.check_signed(&list)?;
        let mut known = self.revoked.write().unwrap_or_else(PoisonError::into_inner);
        match known.as_deref() {
            Some(known) if known.includes(&list) => return Ok(false),
            Some(known) if !list.includes(known) => return Err(FleetError::OlderList),
            _ => {}
        }
        *known = Some(Arc::new(list));
        Ok(true)
    }

    /// Whose certificate this is, if it is one of the fleet, valid and not revoked. `chain` is what
    /// was shown (DER), the robot's own first; `now` is since 1970-01-01T00:00:00Z.
    pub fn check(&self, chain: &[&[u8]], now: Duration) -> Result<String, Refusal> {
        let der = CertificateDer::from(*chain.first().ok_or(Refusal::NoCertificate)?);
        let unusable = |error: Error| Refusal::Unusable(error.to_string());
        let shown = EndEntityCert::try_from(&der).map_err(unusable)?;
        let name = crate::certificate::name_of(&shown).ok_or(Refusal::Nameless)?;
        // Its validity is judged last: before, it may be anybody's.
        let at = UnixTime::since_unix_epoch(now);
        match self.verify(&shown, at) {
            Ok(()) => {}
            Err(Error::CertExpired { not_after, .. }) => {
                self.signed_by_fleet(&shown, not_after)?;
                return Err(Refusal::Expired {
                    name: name.to_owned(),
                    end: Duration::from_secs(not_after.as_secs()),
                    now,
                });
            }
            Err(Error::CertNotValidYet { not_before, .. }) => {
                self.signed_by_fleet(&shown, not_before)?;
                return Err(Refusal::NotYetValid {
                    name: name.to_owned(),
                    begin: Duration::from_secs(not_before.as_secs()),
                    now,
                });
            }
            Err(error) => return Err(refusal(error)),
        }
        let certificate = Certificate::from_der(der.to_vec())
            .map_err(|error| Refusal::Unusable(error.to_string()))?;
        if self.revoked().is_some_and(|list| list.holds(&certificate)) {
            return Err(Refusal::Revoked(name.to_owned()));
        }
        let fingerprint = certificate.fingerprint();
        match &self.pinned {
            // What is pinned is others: the own one is not news.
            Some(pinned) if !pinned.contains(&fingerprint) && certificate != self.own => {
                Err(Refusal::NotPinned {
                    name: name.to_owned(),
                    fingerprint,
                })
            }
            _ => Ok(name.to_owned()),
        }
    }

    fn signed_by_fleet(&self, shown: &EndEntityCert<'_>, when: UnixTime) -> Result<(), Refusal> {
        self.verify(shown, when).map_err(refusal)
    }

    fn verify(&self, shown: &EndEntityCert<'_>, at: UnixTime) -> Result<(), Error> {
        let fleet = CertificateDer::from(self.fleet.as_slice());
        let anchor = anchor_from_trusted_cert(&fleet)?;
        let algorithms = webpki::ALL_VERIFICATION_ALGS;
        let usage = KeyUsage::client_auth();
        shown.verify_for_usage(algorithms, &[anchor], &[], at, usage, None, None)?;
        Ok(())
    }

    /// Whether the fleet key has signed a list: the own certificate, of the same fleet, is looked up
    /// in it.
    fn check_signed(&self, list: &Revocations) -> Result<(), FleetError> {
        let foreign = |error: Error| {
            FleetError::Malformed(format!(
                "the list of what is revoked is not of this fleet: {error}"
            ))
        };
        let list = OwnedCertRevocationList::from_der(list.der()).map_err(foreign)?;
        let list = CertRevocationList::from(list);
        let lists = [&list];
        let lookup = RevocationOptionsBuilder::new(&lists)
            .map_err(|_| FleetError::Malformed("there is no list of what is revoked".to_owned()))?;
        let own = CertificateDer::from(self.own.der());
        let own = EndEntityCert::try_from(&own).map_err(foreign)?;
        let fleet = CertificateDer::from(self.fleet.as_slice());
        let anchor = anchor_from_trusted_cert(&fleet).map_err(foreign)?;
        let at = UnixTime::since_unix_epoch(self.own_time());
        let (algorithms, usage) = (webpki::ALL_VERIFICATION_ALGS, KeyUsage::client_auth());
        let lookup = Some(lookup.build());
        match own.verify_for_usage(algorithms, &[anchor], &[], at, usage, lookup, None) {
            Ok(_) | Err(Error::CertRevoked) => Ok(()),
            Err(error) => Err(foreign(error)),
        }
    }

    /// A time at which the own certificate is valid.
    fn own_time(&self) -> Duration {
        self.own.valid_until().unwrap_or_default()
    }
}

impl fmt::Debug for Membership {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Membership");
        shown
            .field("name", &self.name())
            .field("fleet", &self.fleet());
        shown.finish_non_exhaustive()
    }
}

fn refusal(error: Error) -> Refusal {
    match error {
        Error::UnknownIssuer
        | Error::InvalidSignatureForPublicKey
        | Error::SignatureAlgorithmMismatch => Refusal::WrongFleet,
        other => Refusal::Unusable(other.to_string()),
    }
}
