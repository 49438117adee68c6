//! Which descriptions match a template (FIPA SC00023K, search): those that have every part of it.
//! Of sets, each element of the template must match one of the description.

use fipa_acl::Text;
use fipa_sl::Term;

use crate::{DfAgentDescription, KnownAgent, Property, ServiceDescription};

pub(super) fn matches(template: &DfAgentDescription, there: &DfAgentDescription) -> bool {
    let same_agent = match (&template.name, &there.name) {
        (None, _) => true,
        (Some(wanted), Some(there)) => wanted.is_same_agent(there),
        (Some(_), None) => false,
    };
    let same_lease = template.lease_time.is_none() || template.lease_time == there.lease_time;
    same_agent
        && same_lease
        && has_texts(&template.protocols, &there.protocols)
        && has_texts(&template.ontologies, &there.ontologies)
        && has_texts(&template.languages, &there.languages)
        && has_texts(&template.scope, &there.scope)
        && has_all(&template.services, &there.services, service_matches)
}

fn service_matches(template: &ServiceDescription, there: &ServiceDescription) -> bool {
    same_text(&template.kind, &there.kind)
        && same_text(&template.name, &there.name)
        && same_text(&template.ownership, &there.ownership)
        && has_texts(&template.protocols, &there.protocols)
        && has_texts(&template.ontologies, &there.ontologies)
        && has_texts(&template.languages, &there.languages)
        && has_all(&template.properties, &there.properties, property_matches)
}

fn property_matches(template: &Property, there: &Property) -> bool {
    template.name.eq_ignore_ascii_case(&there.name)
        && match (&template.value, &there.value) {
            (None, _) => true,
            (Some(wanted), Some(there)) => wanted == there || same_number(wanted, there),
            (Some(_), None) => false,
        }
}

/// Whether a number and a string are the same text: peers write either.
fn same_number(a: &Term, b: &Term) -> bool {
    match (a, b) {
        (Term::Number(number), Term::Text(text)) | (Term::Text(text), Term::Number(number)) => {
            number == text
        }
        _ => false,
    }
}

fn same_text(wanted: &Option<Text>, there: &Option<Text>) -> bool {
    match (wanted, there) {
        (None, _) => true,
        (Some(wanted), Some(there)) => wanted.eq_ignore_ascii_case(there),
        (Some(_), None) => false,
    }
}

fn has_texts(wanted: &[Text], there: &[Text]) -> bool {
    has_all(wanted, there, |a, b| a.eq_ignore_ascii_case(b))
}

fn has_all<T>(wanted: &[T], there: &[T], matches: impl Fn(&T, &T) -> bool) -> bool {
    let is_there = |wanted: &T| there.iter().any(|there| matches(wanted, there));
    wanted.iter().all(is_there)
}

/// The description of an agent that the directory knows and nobody registered with the DF: its
/// service is what the directory says it is.
pub(super) fn described(agent: KnownAgent<'_>) -> DfAgentDescription {
    let service = ServiceDescription::new(local_name(agent.name), agent.kind);
    DfAgentDescription::of(agent.name).service(service)
}

/// Whether such a description would match; nothing is allocated to find that out.
pub(super) fn matches_known(template: &DfAgentDescription, agent: KnownAgent<'_>) -> bool {
    let is_agent = |name: &Text| *name == agent.name;
    let is_service = |service: &ServiceDescription| {
        let is = |wanted: &Option<Text>, there: &str| {
            let wanted = wanted.as_ref();
            wanted.is_none_or(|wanted| wanted.eq_ignore_ascii_case(there))
        };
        is(&service.kind, agent.kind)
            && is(&service.name, local_name(agent.name))
            && service.ownership.is_none()
            && service.protocols.is_empty()
            && service.ontologies.is_empty()
            && service.languages.is_empty()
            && service.properties.is_empty()
    };
    template
        .name
        .as_ref()
        .is_none_or(|wanted| is_agent(&wanted.name))
        && template.lease_time.is_none()
        && template.protocols.is_empty()
        && template.ontologies.is_empty()
        && template.languages.is_empty()
        && template.scope.is_empty()
        && template.services.iter().all(is_service)
}

/// What stands in front of the platform's name.
fn local_name(name: &str) -> &str {
    name.rsplit_once('@').map_or(name, |(local, _)| local)
}
