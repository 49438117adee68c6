use fipa_acl::Text;
use fipa_sl::{FrameError, Functional, Term};

use super::frame::{Frame, WithLists};

const OBJECT: &str = "ap-description";
const SERVICE: &str = "ap-service";

/// An agent platform and how it is reached (FIPA SC00023K, ap-description).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ApDescription {
    /// The name of the platform, which stands behind the @ of its agents.
    pub name: Text,
    /// Its transport services.
    pub services: Vec<ApService>,
}

/// A service of a platform, as a rule a message transport protocol (FIPA SC00023K, ap-service).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ApService {
    /// The name of the service.
    pub name: Text,
    /// What it is, such as `fipa.mts.mtp.http.std`.
    pub kind: Text,
    /// Where it is reached.
    pub addresses: Vec<Text>,
}

impl TryFrom<&Term> for ApDescription {
    type Error = FrameError;

    /// JADE writes quotes into the name of its platform; they are taken off.
    fn try_from(term: &Term) -> Result<ApDescription, FrameError> {
        let frame = Frame::of(term, OBJECT)?;
        let name = frame.required_text("name")?;
        Ok(ApDescription {
            name: Text::from(name.trim_matches('"')),
            services: frame.objects("ap-services", |term| ApService::try_from(term))?,
        })
    }
}

impl From<&ApDescription> for Term {
    fn from(description: &ApDescription) -> Term {
        Functional::object(Text::from_static(OBJECT))
            .with("name", &description.name)
            .with_sequence("ap-services", description.services.iter().map(Term::from))
            .into()
    }
}

impl TryFrom<&Term> for ApService {
    type Error = FrameError;

    fn try_from(term: &Term) -> Result<ApService, FrameError> {
        let frame = Frame::of(term, SERVICE)?;
        Ok(ApService {
            name: frame.required_text("name")?,
            kind: frame.required_text("type")?,
            addresses: frame.texts("addresses")?,
        })
    }
}

impl From<&ApService> for Term {
    fn from(service: &ApService) -> Term {
        Functional::object(Text::from_static(SERVICE))
            .with("name", &service.name)
            .with("type", &service.kind)
            .with_sequence("addresses", service.addresses.iter().map(Term::from))
            .into()
    }
}
