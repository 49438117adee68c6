use std::time::Duration;

use rcgen::{
    BasicConstraints, CertificateParams, CertificateRevocationListParams, DistinguishedName,
    DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyIdMethod, KeyPair, KeyUsagePurpose,
    RevokedCertParams, SanType, SerialNumber,
};

use crate::name::SCHEME;
use crate::time::date;
use crate::{Certificate, Fingerprint, FleetError, Membership, Revocations, check_name, pem};

/// Days for which the certificate of a robot is valid, unless told otherwise.
pub const ROBOT_DAYS: u32 = 5 * 365;

/// Days for which a fleet key is.
const FLEET_DAYS: u32 = 30 * 365;

const DAY: Duration = Duration::from_secs(24 * 3600);

/// The key of a fleet: whoever has it decides who belongs to the fleet.
#[derive(Debug)]
pub struct FleetKey {
    key: KeyPair,
    certificate: Vec<u8>,
}

impl FleetKey {
    /// Makes a new fleet. `now` is since 1970-01-01T00:00:00Z.
    pub fn generate(now: Duration) -> Result<FleetKey, FleetError> {
        let key = KeyPair::generate().map_err(making)?;
        let mut params = authority(&key);
        (params.not_before, params.not_after) = validity(now, FLEET_DAYS);
        let certificate = params.self_signed(&key).map_err(making)?;
        let certificate = certificate.der().to_vec();
        Ok(FleetKey { key, certificate })
    }

    /// Reads a fleet key and its certificate, as [`to_pem`](Self::to_pem) wrote them.
    pub fn from_pem(text: &str) -> Result<FleetKey, FleetError> {
        let sections = pem::read(text)?;
        let certificate = pem::only(sections.certificates, "certificate of a fleet")?;
        let key = pem::only(sections.keys, "private key")?;
        let key = KeyPair::try_from(key)
            .map_err(|error| FleetError::Malformed(format!("the key cannot be read: {error}")))?;
        Ok(FleetKey { key, certificate })
    }

    /// Key and certificate as text. It is a secret.
    pub fn to_pem(&self) -> String {
        let key = pem::write(pem::KEY, self.key.serialized_der());
        key + &pem::write(pem::CERTIFICATE, &self.certificate)
    }

    /// What tells fleets apart.
    pub fn fingerprint(&self) -> Fingerprint {
        Fingerprint::of(&self.certificate)
    }

    /// Makes key and certificate for a robot, valid for so many days. `robots` are the certificates
    /// that were made before: the robot knows their names as taken.
    pub fn issue(
        &self,
        name: &str,
        days: u32,
        now: Duration,
        robots: &[Certificate],
        revoked: Option<&Revocations>,
    ) -> Result<Membership, FleetError> {
        check_name(name)?;
        let key = KeyPair::generate().map_err(making)?;
        let mut params = CertificateParams::default();
        let uri = format!("{SCHEME}{name}");
        let uri = uri.try_into().map_err(making)?;
        params.subject_alt_names = vec![SanType::URI(uri)];
        params.distinguished_name = common_name(name);
        params.use_authority_key_identifier_extension = true;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![
            ExtendedKeyUsagePurpose::ServerAuth,
            ExtendedKeyUsagePurpose::ClientAuth,
        ];
        (params.not_before, params.not_after) = validity(now, days);
        let certificate = params.signed_by(&key, &self.issuer()).map_err(making)?;
        Membership::new(
            Certificate::from_der(certificate.der().to_vec())?,
            key.serialized_der().to_vec(),
            self.certificate.clone(),
            robots.iter().map(|robot| robot.name().to_owned()).collect(),
            revoked.cloned(),
        )
    }

    /// The list of all certificates that are revoked, these and those before.
    pub fn revoke(
        &self,
        certificates: &[Certificate],
        before: Option<&Revocations>,
        now: Duration,
    ) -> Result<Revocations, FleetError> {
        let mut serials: Vec<&[u8]> = before.map(Revocations::serials).unwrap_or_default();
        serials.extend(certificates.iter().map(Certificate::serial));
        serials.sort_unstable();
        serials.dedup();
        let revoked = serials.iter().map(|serial| RevokedCertParams {
            serial_number: SerialNumber::from_slice(serial),
            revocation_time: date(now),
            reason_code: None,
            invalidity_date: None,
        });
        let number = u64::try_from(serials.len()).unwrap_or(u64::MAX);
        let params = CertificateRevocationListParams {
            this_update: date(now),
            next_update: date(now + DAY * FLEET_DAYS),
            crl_number: SerialNumber::from(number),
            issuing_distribution_point: None,
            revoked_certs: revoked.collect(),
            key_identifier_method: KeyIdMethod::Sha256,
        };
        let list = params.signed_by(&self.issuer()).map_err(making)?;
        Revocations::from_der(list.der().to_vec())
    }

    fn issuer(&self) -> Issuer<'static, &KeyPair> {
        Issuer::new(authority(&self.key), &self.key)
    }
}

/// What the certificate of a fleet says, the same for the same key.
fn authority(key: &KeyPair) -> CertificateParams {
    let mut params = CertificateParams::default();
    let fingerprint = Fingerprint::of(key.public_key_raw()).to_string();
    let short: String = fingerprint.chars().take(16).collect();
    params.distinguished_name = common_name(&format!("fipa fleet {short}"));
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params
}

fn common_name(name: &str) -> DistinguishedName {
    let mut names = DistinguishedName::new();
    names.push(DnType::CommonName, name);
    names
}

/// From yesterday on, as clocks of robots are late.
fn validity(now: Duration, days: u32) -> (::time::OffsetDateTime, ::time::OffsetDateTime) {
    (date(now.saturating_sub(DAY)), date(now + DAY * days))
}

fn making(error: rcgen::Error) -> FleetError {
    FleetError::Making(error.to_string())
}
