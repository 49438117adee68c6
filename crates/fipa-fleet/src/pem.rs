//! Texts that hold certificates, keys and lists (PEM, RFC 7468).

use ::pem::{EncodeConfig, LineEnding, Pem};

use crate::FleetError;

pub(crate) const CERTIFICATE: &str = "CERTIFICATE";
pub(crate) const KEY: &str = "PRIVATE KEY";
pub(crate) const LIST: &str = "X509 CRL";

/// The octets of the sections of a text, by kind, in their order.
#[derive(Default)]
pub(crate) struct Sections {
    pub(crate) certificates: Vec<Vec<u8>>,
    pub(crate) keys: Vec<Vec<u8>>,
    pub(crate) lists: Vec<Vec<u8>>,
}

/// Octets of a text, at most.
const LONGEST: usize = 16 << 20;

pub(crate) fn read(text: &str) -> Result<Sections, FleetError> {
    if text.len() > LONGEST {
        return Err(FleetError::Malformed(format!(
            "there are {} octets, {LONGEST} are allowed",
            text.len()
        )));
    }
    let read = ::pem::parse_many(text)
        .map_err(|error| FleetError::Malformed(format!("it is no PEM: {error}")))?;
    let mut sections = Sections::default();
    for section in read {
        match section.tag() {
            CERTIFICATE => sections.certificates.push(section.into_contents()),
            KEY => sections.keys.push(section.into_contents()),
            LIST => sections.lists.push(section.into_contents()),
            _ => {}
        }
    }
    Ok(sections)
}

/// The section of a kind, of which there must be one.
pub(crate) fn only(mut sections: Vec<Vec<u8>>, what: &str) -> Result<Vec<u8>, FleetError> {
    match (sections.pop(), sections.len()) {
        (Some(only), 0) => Ok(only),
        (found, _) => Err(FleetError::Malformed(match found {
            None => format!("there is no {what} in it"),
            Some(_) => format!("there is more than one {what} in it"),
        })),
    }
}

pub(crate) fn write(kind: &str, octets: &[u8]) -> String {
    let section = Pem::new(kind, octets);
    let config = EncodeConfig::new().set_line_ending(LineEnding::LF);
    ::pem::encode_config(&section, config)
}
