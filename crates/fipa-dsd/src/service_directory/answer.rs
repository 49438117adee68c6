//! What others ask of a responder, and the packets by which it answers.
use std::net::Ipv4Addr;

use simple_dns::rdata::{A, PTR, RData, SRV, TXT};
use simple_dns::{
    CLASS, CharacterString, Label, Name, Packet, PacketFlag, QTYPE, Question, ResourceRecord, TYPE,
    header_buffer,
};

use super::packet::{
    HEADER, LONGEST, Record, announces_what_it_holds, in_groups, instance, label_of, name,
    read_record, written,
};
use super::txt::TxtString;
use super::{ServiceType, key};

/// Seconds for which records are good. Those of the host, too: nobody needs them, and to ask for
/// them every two minutes would cost more than all the rest.
const LIFE: u32 = 4500;
/// Seconds for which somebody may keep them who does not hear when they change (RFC 6762 section
/// 6.7).
const SHORT_LIFE: u32 = 10;
/// The name under which types are enumerated (RFC 6763 section 9).
const TYPES: [&str; 4] = ["_services", "_dns-sd", "_udp", "local"];
/// Octets of a service beside its label and its strings: compressed names and fixed fields.
const BESIDE: usize = 70;

/// What somebody asks, as far as it is about a service type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Asked {
    pub(crate) wants: Vec<Want>,
    /// The keys of the instances that he knows well enough.
    pub(crate) known: Vec<String>,
    /// Whether he goes on in another packet.
    pub(crate) truncated: bool,
}

/// One thing that is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Want {
    /// Which types there are.
    Types,
    /// Which instances there are.
    Instances,
    /// All about the instance with this key.
    Instance(String),
    /// The addresses of the host.
    Host,
}

/// Somebody who asks once, from a port of his own: he wants his question back.
#[derive(Clone, Debug)]
pub(crate) struct OneShot {
    id: u16,
    questions: Vec<Question<'static>>,
}

/// Who tells.
#[derive(Clone, Debug)]
pub(crate) struct Teller {
    pub(crate) service_type: ServiceType,
    /// The first label of its host name.
    pub(crate) host: String,
    pub(crate) addresses: Vec<Ipv4Addr>,
}

/// An instance that is told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Told {
    pub(crate) label: String,
    pub(crate) strings: Vec<TxtString>,
}

impl Teller {
    /// What a packet asks; `None` if it is no question.
    pub(crate) fn read(&self, packet: &[u8]) -> Option<(Asked, OneShot)> {
        // Most packets are answers, which need not be read again.
        let is_answer = header_buffer::has_flags(packet, PacketFlag::RESPONSE).unwrap_or(true);
        if is_answer || !announces_what_it_holds(packet) {
            return None;
        }
        let packet = Packet::parse(packet).ok()?;
        let known = packet.answers.iter().filter_map(|record| {
            match read_record(record, &self.service_type)? {
                // What is known for less than half of its life is asked for anew.
                Record::Instance { label, ttl } if ttl >= LIFE / 2 => Some(key(&label)),
                _ => None,
            }
        });
        let asked = Asked {
            wants: packet
                .questions
                .iter()
                .filter_map(|q| self.want(q))
                .collect(),
            known: known.collect(),
            truncated: packet.has_flags(PacketFlag::TRUNCATION),
        };
        let one_shot = OneShot {
            id: packet.id(),
            questions: packet
                .questions
                .iter()
                .map(|q| q.clone().into_owned())
                .collect(),
        };
        Some((asked, one_shot))
    }

    fn want(&self, question: &Question<'_>) -> Option<Want> {
        let asks = |types: &[TYPE]| {
            question.qtype == QTYPE::ANY || types.iter().any(|t| question.qtype == (*t).into())
        };
        let named = |labels: &[&str]| is_named(&question.qname, labels);
        if named(&self.service_type.labels()) {
            return asks(&[TYPE::PTR]).then_some(Want::Instances);
        }
        if named(&TYPES) {
            return asks(&[TYPE::PTR]).then_some(Want::Types);
        }
        if named(&[&self.host, "local"]) {
            return asks(&[TYPE::A]).then_some(Want::Host);
        }
        let label = label_of(&question.qname, &self.service_type)?;
        asks(&[TYPE::SRV, TYPE::TXT]).then(|| Want::Instance(key(&label)))
    }

    /// That there are these instances, with all about them, in as many packets as it takes.
    pub(crate) fn tell(&self, told: &[&Told], to: Option<&OneShot>) -> Vec<Vec<u8>> {
        let mut packets = Vec::new();
        let mut left = 0;
        for told in told {
            let strings = told.strings.iter();
            let strings: usize = strings
                .map(|(key, value)| key.len() + value.len() + 2)
                .sum();
            let needed = told.label.len() + strings + BESIDE;
            if left < needed {
                packets.push(begin(to));
                left = LONGEST.saturating_sub(BESIDE + 16 * self.addresses.len());
            }
            left = left.saturating_sub(needed);
            if let Some(packet) = packets.last_mut() {
                packet.answers.extend(self.records(told, to.is_some()));
            }
        }
        for packet in &mut packets {
            packet.answers.extend(self.host_records(to.is_some()));
        }
        written(packets.iter().map(Packet::build_bytes_vec_compressed))
    }

    /// That there is such a type, or where the host is.
    pub(crate) fn tell_beside(
        &self,
        types: bool,
        host: bool,
        to: Option<&OneShot>,
    ) -> Option<Vec<u8>> {
        let mut packet = begin(to);
        if types {
            let pointer = RData::PTR(PTR(name(&self.service_type.labels())));
            packet.answers.push(ResourceRecord::new(
                name(&TYPES),
                CLASS::IN,
                life(to.is_some()),
                pointer,
            ));
        }
        if host {
            packet.answers.extend(self.host_records(to.is_some()));
        }
        packet.build_bytes_vec_compressed().ok()
    }

    /// That there are instances with these labels no longer. The host goes with it, lest somebody
    /// takes the goodbyes of two daemons to one name for one packet that came twice.
    pub(crate) fn say_goodbye(&self, labels: &[String]) -> Vec<Vec<u8>> {
        let fixed = HEADER + self.service_type.domain().len() + 1;
        let groups = in_groups(labels.iter(), fixed, |label| label.len() + BESIDE);
        let packets = groups.iter().map(|labels| {
            let mut packet = begin(None);
            for label in labels {
                packet.answers.push(self.pointer(label, 0));
                packet.answers.push(self.service(label, 0));
            }
            packet.build_bytes_vec_compressed()
        });
        written(packets)
    }

    fn pointer<'a>(&'a self, label: &'a str, life: u32) -> ResourceRecord<'a> {
        let pointer = RData::PTR(PTR(instance(label, &self.service_type)));
        ResourceRecord::new(name(&self.service_type.labels()), CLASS::IN, life, pointer)
    }

    fn service<'a>(&'a self, label: &'a str, life: u32) -> ResourceRecord<'a> {
        let service = RData::SRV(SRV {
            priority: 0,
            weight: 0,
            port: 0,
            target: name(&[&self.host, "local"]),
        });
        ResourceRecord::new(
            instance(label, &self.service_type),
            CLASS::IN,
            life,
            service,
        )
    }

    fn records<'a>(&'a self, told: &'a Told, one_shot: bool) -> [ResourceRecord<'a>; 3] {
        let mut text = TXT::new();
        for (key, value) in &told.strings {
            let string = [key.as_bytes(), b"=", value].concat();
            if let Ok(string) = CharacterString::new(&string) {
                text.add_char_string(string.into_owned());
            }
        }
        let name = instance(&told.label, &self.service_type);
        let text = ResourceRecord::new(name, CLASS::IN, life(one_shot), RData::TXT(text));
        // Nobody else tells anything of this name.
        let text = text.with_cache_flush(!one_shot);
        [
            self.pointer(&told.label, life(one_shot)),
            self.service(&told.label, life(one_shot))
                .with_cache_flush(!one_shot),
            text,
        ]
    }

    fn host_records(&self, one_shot: bool) -> impl Iterator<Item = ResourceRecord<'_>> {
        self.addresses.iter().map(move |address| {
            let host = name(&[&self.host, "local"]);
            let address = RData::A(A::from(*address));
            ResourceRecord::new(host, CLASS::IN, life(one_shot), address)
                .with_cache_flush(!one_shot)
        })
    }
}

fn life(one_shot: bool) -> u32 {
    match one_shot {
        true => SHORT_LIFE,
        false => LIFE,
    }
}

fn begin(to: Option<&OneShot>) -> Packet<'_> {
    let mut packet = Packet::new_reply(to.map_or(0, |one_shot| one_shot.id));
    packet.set_flags(PacketFlag::AUTHORITATIVE_ANSWER);
    if let Some(one_shot) = to {
        packet.questions.extend(one_shot.questions.iter().cloned());
    }
    packet
}

fn is_named(asked: &Name<'_>, labels: &[&str]) -> bool {
    let asked = asked.get_labels();
    let same =
        |(asked, own): (&Label<'_>, &&str)| asked.as_ref().eq_ignore_ascii_case(own.as_bytes());
    asked.len() == labels.len() && asked.iter().zip(labels).all(same)
}
