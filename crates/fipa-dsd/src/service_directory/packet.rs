//! The part of mDNS packets that is about service instances.
use simple_dns::rdata::{PTR, RData};
use simple_dns::{
    CLASS, Label, Name, Packet, PacketFlag, QCLASS, Question, ResourceRecord, SimpleDnsError, TYPE,
};

use super::ServiceType;
use super::txt::TxtString;

/// The longest packet that is written: one that no link has to cut (RFC 6762 section 17).
pub(super) const LONGEST: usize = 1400;
/// Octets of the header of a packet.
pub(super) const HEADER: usize = 12;
/// What a question about an instance, or a known answer, has beside its label: a compressed name
/// and the fixed fields.
const BESIDE_LABEL: usize = 18;

/// A record about an instance of a service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Record {
    /// There is such an instance, for so many seconds; 0 is a goodbye.
    Instance { label: String, ttl: u32 },
    /// What its TXT record says, a goodbye aside.
    Text {
        label: String,
        strings: Vec<TxtString>,
    },
    /// Somebody asks for all instances but those that he knows.
    Question { known: Vec<String> },
    /// Somebody asks for the TXT record of an instance.
    TextQuestion { label: String },
}

/// The packet is not one of DNS.
#[derive(Debug, thiserror::Error)]
#[error("not a packet of DNS")]
pub(crate) struct NotDns;

impl From<SimpleDnsError> for NotDns {
    fn from(_: SimpleDnsError) -> NotDns {
        NotDns
    }
}

/// What a packet says about instances of this type, or asks of all.
pub(crate) fn read(packet: &[u8], service_type: &ServiceType) -> Result<Vec<Record>, NotDns> {
    if !announces_what_it_holds(packet) {
        return Err(NotDns);
    }
    let packet = Packet::parse(packet)?;
    if !packet.has_flags(PacketFlag::RESPONSE) {
        let mut questions = read_text_questions(&packet, service_type);
        questions.extend(read_question(&packet, service_type));
        return Ok(questions);
    }
    let records = packet.answers.iter().chain(&packet.additional_records);
    Ok(records
        .filter_map(|record| read_record(record, service_type))
        .collect())
}

/// Questions for all instances of the type, with the answers that are known, each with the seconds
/// that it is good for still.
pub(crate) fn ask_for_instances<'a>(
    service_type: &ServiceType,
    known: impl Iterator<Item = (&'a str, u32)>,
) -> Vec<Vec<u8>> {
    let type_name = || name(&service_type.labels());
    let fixed = HEADER + service_type.domain().len() + 1 + 4;
    let mut groups = in_groups(known, fixed, |(label, _)| label.len());
    if groups.is_empty() {
        groups.push(Vec::new());
    }
    let last = groups.len() - 1;
    let packets = groups.iter().enumerate().map(|(i, known)| {
        let mut packet = Packet::new_query(0);
        if i == 0 {
            packet.questions.push(question(type_name(), TYPE::PTR));
        }
        if i < last {
            // More known answers follow (RFC 6762 section 7.2).
            packet.set_flags(PacketFlag::TRUNCATION);
        }
        for (label, ttl) in known {
            let pointer = RData::PTR(PTR(instance(label, service_type)));
            let answer = ResourceRecord::new(type_name(), CLASS::IN, *ttl, pointer);
            packet.answers.push(answer);
        }
        packet.build_bytes_vec_compressed()
    });
    written(packets)
}

/// Questions for the TXT records of these instances.
pub(crate) fn ask_for_texts(service_type: &ServiceType, labels: &[String]) -> Vec<Vec<u8>> {
    let fixed = HEADER + service_type.domain().len() + 1;
    let groups = in_groups(labels.iter(), fixed, |label| label.len());
    let packets = groups.iter().map(|labels| {
        let mut packet = Packet::new_query(0);
        let questions = labels
            .iter()
            .map(|label| question(instance(label, service_type), TYPE::TXT));
        packet.questions.extend(questions);
        packet.build_bytes_vec_compressed()
    });
    written(packets)
}

/// Whether a packet is as long as the number of its records demands, so that memory is not taken
/// for records that never arrived.
pub(crate) fn announces_what_it_holds(packet: &[u8]) -> bool {
    let Some((header, body)) = packet.split_at_checked(HEADER) else {
        return false;
    };
    let counts = header[4..].chunks_exact(2);
    // A question has a name, a type and a class; a record also a lifetime and a length.
    let least = counts.zip([5, 11, 11, 11]).map(|(count, least)| {
        let count = usize::from(count[0]) << 8 | usize::from(count[1]);
        count * least
    });
    least.sum::<usize>() <= body.len()
}

fn read_question(packet: &Packet<'_>, service_type: &ServiceType) -> Option<Record> {
    let type_name = name(&service_type.labels());
    let ours = |question: &Question<'_>| {
        question.qtype == TYPE::PTR.into()
            && question.qname == type_name
            && !question.unicast_response
    };
    let known = packet.answers.iter();
    let known = known.filter_map(|record| match read_record(record, service_type)? {
        Record::Instance { label, .. } => Some(label),
        _ => None,
    });
    let asked = packet.questions.iter().any(ours);
    asked.then(|| Record::Question {
        known: known.collect(),
    })
}

fn read_text_questions(packet: &Packet<'_>, service_type: &ServiceType) -> Vec<Record> {
    let questions = packet.questions.iter();
    let texts = questions.filter(|question| question.qtype == TYPE::TXT.into());
    texts
        .filter_map(|question| label_of(&question.qname, service_type))
        .map(|label| Record::TextQuestion { label })
        .collect()
}

pub(super) fn read_record(
    record: &ResourceRecord<'_>,
    service_type: &ServiceType,
) -> Option<Record> {
    match &record.rdata {
        RData::PTR(PTR(alias)) if record.name == name(&service_type.labels()) => {
            Some(Record::Instance {
                label: label_of(alias, service_type)?,
                ttl: record.ttl,
            })
        }
        RData::TXT(txt) if record.ttl > 0 => {
            let strings = txt.iter_raw().map(|(key, value)| {
                let key = String::from_utf8_lossy(key).into_owned();
                (key, value.unwrap_or_default().to_vec())
            });
            Some(Record::Text {
                label: label_of(&record.name, service_type)?,
                strings: strings.collect(),
            })
        }
        _ => None,
    }
}

/// The label of an instance of this type.
pub(super) fn label_of(full: &Name<'_>, service_type: &ServiceType) -> Option<String> {
    let (label, rest) = full.get_labels().split_first()?;
    let same = rest.len() == service_type.labels().len()
        && rest
            .iter()
            .zip(service_type.labels())
            .all(|(label, own)| label.as_ref().eq_ignore_ascii_case(own.as_bytes()));
    let label = std::str::from_utf8(label.as_ref()).ok()?;
    same.then(|| label.to_owned())
}

pub(super) fn name<'a>(labels: &[&'a str]) -> Name<'a> {
    let labels: Vec<_> = labels
        .iter()
        .map(|label| Label::new_unchecked(label.as_bytes()))
        .collect();
    Name::new_with_labels(&labels)
}

pub(super) fn instance<'a>(label: &'a str, service_type: &'a ServiceType) -> Name<'a> {
    let [service, protocol, domain] = service_type.labels();
    name(&[label, service, protocol, domain])
}

fn question(name: Name<'_>, record: TYPE) -> Question<'_> {
    Question::new(name, record.into(), QCLASS::CLASS(CLASS::IN), false)
}

/// The items in groups, each of which fits into one packet beside what is fixed.
pub(super) fn in_groups<T>(
    items: impl Iterator<Item = T>,
    fixed: usize,
    label: impl Fn(&T) -> usize,
) -> Vec<Vec<T>> {
    let mut groups = Vec::new();
    let mut left = 0;
    for item in items {
        let needed = label(&item) + BESIDE_LABEL;
        if left < needed {
            groups.push(Vec::new());
            left = LONGEST - fixed;
        }
        left = left.saturating_sub(needed);
        if let Some(group) = groups.last_mut() {
            group.push(item);
        }
    }
    groups
}

/// The packets; one that cannot be written, for a label that no packet can have held, is left out.
pub(super) fn written(packets: impl Iterator<Item = simple_dns::Result<Vec<u8>>>) -> Vec<Vec<u8>> {
    packets.filter_map(Result::ok).collect()
}

#[cfg(test)]
pub(in crate::service_directory) mod tests;
