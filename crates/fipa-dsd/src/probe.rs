//! Whether multicast works on each interface of this host, and which daemons are heard there.
//!
//! **Knows** sockets of its own and one question. **Never knows** what follows from the answers.
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr, SocketAddrV6};
use std::time::Duration;

use fipa_directory::InstanceId;
use if_addrs::Interface;
use simple_dns::rdata::RData;
use simple_dns::{CLASS, Name, Packet, PacketFlag, QCLASS, QTYPE, Question, TYPE};
use tokio::net::UdpSocket;
use tokio::task::JoinSet;
use tokio::time::{Instant, timeout_at};

use crate::MdnsError;
use crate::mdns::{GROUP, GROUP_V6, open_at_group, open_at_group_v6};
use crate::service_directory::packet::announces_what_it_holds;

/// The service of the daemons.
const SERVICE: &str = "_fipa._tcp.local";
/// The longest packet (RFC 6762 section 17).
const LONGEST: usize = 9000;
/// A question is asked again after this, in case it was lost. A daemon that was asked by somebody
/// else just before answers nobody for a second.
const AGAIN: Duration = Duration::from_millis(1100);
/// Daemons that are told of on one interface, at most.
const MOST: usize = 1000;

/// An interface of this host, as mDNS finds it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterfaceProbe {
    /// Its name.
    pub name: String,
    /// Its addresses.
    pub addresses: Vec<IpAddr>,
    /// Whether it leads to this host only.
    pub loopback: bool,
    /// Whether mDNS can be spoken on it at all: it is up, and leads to more than one other host.
    pub usable: bool,
    /// What came of a multicast packet that was sent there over IPv4.
    pub multicast: Multicast,
    /// What came of one that was sent there over IPv6.
    pub multicast_v6: Multicast,
    /// The daemons that answered there, by name.
    pub heard: Vec<HeardDaemon>,
}

/// What came of a multicast packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Multicast {
    /// It was sent, and came back to this host as it is to.
    Works,
    /// The system said that it is sent, and it did not come back: this host does not let multicast
    /// in.
    NotHeard,
    /// The system did not send it, and why.
    NotSent(String),
    /// None was sent: the interface is down or leads to one other host, or has no address of this
    /// version of IP. Over IPv6 loopback is not tried: no system routes multicast there.
    Untried,
}

/// A daemon that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeardDaemon {
    /// Where its packet came from.
    pub from: IpAddr,
    /// The run of it.
    pub instance: InstanceId,
    /// Its name, possibly cut.
    pub name: String,
    /// The fleet that it belongs to.
    pub scope: String,
    /// The TCP port that it announces.
    pub port: u16,
    /// How long it took to answer.
    pub after: Duration,
}

/// Asks on every interface at this UDP port who is there, and listens for so long.
///
/// Must be called within a tokio runtime with time and input enabled.
///
/// # Errors
///
/// If the interfaces of this host cannot be listed.
pub async fn probe(port: u16, listen: Duration) -> Result<Vec<InterfaceProbe>, MdnsError> {
    let all = if_addrs::get_if_addrs().map_err(MdnsError::Interfaces)?;
    let mut by_name: BTreeMap<String, Vec<Interface>> = BTreeMap::new();
    for interface in all {
        by_name
            .entry(interface.name.clone())
            .or_default()
            .push(interface);
    }
    let mut probes = JoinSet::new();
    for (name, addresses) in by_name {
        probes.spawn(probe_interface(name, addresses, port, listen));
    }
    let mut found: Vec<InterfaceProbe> = probes.join_all().await;
    found.sort_by(|a, b| (a.loopback, &a.name).cmp(&(b.loopback, &b.name)));
    Ok(found)
}

async fn probe_interface(
    name: String,
    interfaces: Vec<Interface>,
    port: u16,
    listen: Duration,
) -> InterfaceProbe {
    let usable = interfaces.iter().all(|i| i.is_oper_up() && !i.is_p2p());
    let loopback = interfaces.iter().any(Interface::is_loopback);
    let addresses: Vec<IpAddr> = interfaces.iter().map(Interface::ip).collect();
    let ipv4 = addresses.iter().find_map(|address| match address {
        IpAddr::V4(address) => Some(*address),
        IpAddr::V6(_) => None,
    });
    let with_ipv6 = interfaces.iter().find(|interface| interface.ip().is_ipv6());
    let ipv6 = with_ipv6.and_then(|interface| interface.index);
    let over_ipv4 = async {
        let address = ipv4.filter(|_| usable)?;
        let socket = open_at_group(address, port);
        let group = SocketAddr::from((GROUP, port));
        Some(ask(socket, group, &addresses, listen).await)
    };
    let over_ipv6 = async {
        let index = ipv6.filter(|_| usable && !loopback)?;
        let socket = open_at_group_v6(index, port);
        let group = SocketAddr::from(SocketAddrV6::new(GROUP_V6, port, 0, index));
        Some(ask(socket, group, &addresses, listen).await)
    };
    let (over_ipv4, over_ipv6) = tokio::join!(over_ipv4, over_ipv6);
    let multicast_v6 = match &over_ipv6 {
        // All its addresses are so new that the system does not use them yet.
        Some(Err(error)) if error.kind() == io::ErrorKind::AddrNotAvailable => Multicast::Untried,
        asked => verdict(asked.as_ref()),
    };
    let multicast = verdict(over_ipv4.as_ref());
    // What comes by IPv6 comes from link-local addresses, by which nobody can be called.
    let heard = over_ipv4.and_then(Result::ok).map(|asked| asked.heard);
    let mut heard = heard.unwrap_or_default();
    heard.sort_by(|a, b| a.name.cmp(&b.name));
    InterfaceProbe {
        name,
        addresses,
        loopback,
        usable,
        multicast,
        multicast_v6,
        heard,
    }
}

/// What came of asking.
#[derive(Debug, Default)]
struct Asked {
    /// Whether the question came back to this host.
    echoed: bool,
    heard: Vec<HeardDaemon>,
}

fn verdict(asked: Option<&io::Result<Asked>>) -> Multicast {
    match asked {
        None => Multicast::Untried,
        Some(Err(error)) => Multicast::NotSent(error.to_string()),
        Some(Ok(Asked { echoed: true, .. })) => Multicast::Works,
        Some(Ok(_)) => Multicast::NotHeard,
    }
}

async fn ask(
    socket: io::Result<UdpSocket>,
    group: SocketAddr,
    own: &[IpAddr],
    listen: Duration,
) -> io::Result<Asked> {
    let socket = socket?;
    let question = question().map_err(io::Error::other)?;
    let begun = Instant::now();
    let mut asked = Asked::default();
    for until in [begun + AGAIN.min(listen), begun + listen] {
        socket.send_to(&question, group).await?;
        while let Ok(received) = timeout_at(until, receive(&socket)).await {
            let (packet, from) = received?;
            // Whoever else of this host asks the same proves the same.
            asked.echoed |= packet == question && own.contains(&from);
            for daemon in answers(&packet, from, begun.elapsed()) {
                let known = |heard: &HeardDaemon| heard.instance == daemon.instance;
                if !asked.heard.iter().any(known) && asked.heard.len() < MOST {
                    asked.heard.push(daemon);
                }
            }
        }
    }
    Ok(asked)
}

async fn receive(socket: &UdpSocket) -> io::Result<(Vec<u8>, IpAddr)> {
    let mut octets = vec![0; LONGEST];
    let (length, from) = socket.recv_from(&mut octets).await?;
    octets.truncate(length);
    Ok((octets, from.ip()))
}

fn question() -> simple_dns::Result<Vec<u8>> {
    let mut packet = Packet::new_query(0);
    packet.questions.push(Question::new(
        Name::new(SERVICE)?,
        QTYPE::TYPE(TYPE::PTR),
        QCLASS::CLASS(CLASS::IN),
        false,
    ));
    packet.build_bytes_vec()
}

/// The daemons that a packet tells of, goodbyes aside.
fn answers(packet: &[u8], from: IpAddr, after: Duration) -> Vec<HeardDaemon> {
    if !announces_what_it_holds(packet) {
        return Vec::new();
    }
    let Ok(packet) = Packet::parse(packet) else {
        return Vec::new();
    };
    if !packet.has_flags(PacketFlag::RESPONSE) {
        return Vec::new();
    }
    let records: Vec<_> = packet
        .answers
        .iter()
        .chain(&packet.additional_records)
        .filter(|record| record.ttl > 0)
        .collect();
    let port_of = |name: &Name<'_>| {
        records.iter().find_map(|record| match &record.rdata {
            RData::SRV(service) if record.name == *name => Some(service.port),
            _ => None,
        })
    };
    let suffix = format!(".{SERVICE}");
    let daemon = |record: &&simple_dns::ResourceRecord<'_>| {
        let RData::TXT(text) = &record.rdata else {
            return None;
        };
        if !record.name.to_string().to_lowercase().ends_with(&suffix) {
            return None;
        }
        let text = text.attributes();
        let value = |key: &str| text.get(key).cloned().flatten();
        Some(HeardDaemon {
            from,
            instance: value("id")?.parse().ok()?,
            name: value("name").unwrap_or_default(),
            scope: value("scope").unwrap_or_default(),
            port: port_of(&record.name)?,
            after,
        })
    };
    records.iter().filter_map(daemon).collect()
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use proptest::prelude::*;
    use simple_dns::ResourceRecord;
    use simple_dns::rdata::{SRV, TXT};

    use super::*;

    const FROM: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 2));
    const AFTER: Duration = Duration::from_millis(5);

    /// An answer with the SRV and TXT records of a daemon.
    fn packet(label: &str, ttl: u32, strings: &[&str]) -> Vec<u8> {
        let full = format!("{label}.{SERVICE}");
        let name = || Name::new(&full).unwrap();
        let text = strings
            .iter()
            .fold(TXT::new(), |text, string| text.with_string(string).unwrap());
        let service = SRV {
            priority: 0,
            weight: 0,
            port: 4100,
            target: Name::new("robot.local").unwrap(),
        };
        let mut packet = Packet::new_reply(0);
        for data in [RData::SRV(service), RData::TXT(text)] {
            let record = ResourceRecord::new(name(), CLASS::IN, ttl, data);
            packet.additional_records.push(record);
        }
        packet.build_bytes_vec_compressed().unwrap()
    }

    #[test]
    fn a_daemon_that_answers_is_read_and_its_goodbye_is_not() {
        let id = "ab".repeat(16);
        let strings = [&format!("id={id}"), "name=Arm 1", "scope=plant", "v=1"];
        let expected = HeardDaemon {
            from: FROM,
            instance: InstanceId::from_bytes([0xab; 16]),
            name: "Arm 1".to_owned(),
            scope: "plant".to_owned(),
            port: 4100,
            after: AFTER,
        };
        let heard = answers(&packet("arm-1-abababab", 120, &strings), FROM, AFTER);
        assert_eq!(heard, [expected]);
        assert_eq!(answers(&packet("arm-1", 0, &strings), FROM, AFTER), []);
        assert_eq!(answers(&packet("arm-1", 120, &["name=x"]), FROM, AFTER), []);
        // A question is no answer, least of all our own.
        assert_eq!(answers(&question().unwrap(), FROM, AFTER), []);
    }

    proptest! {
        #[test]
        fn any_octets_are_read_without_a_panic(
            mut octets in prop::collection::vec(any::<u8>(), 0..200),
            at in 0..100_usize,
            octet: u8,
        ) {
            answers(&octets, FROM, AFTER);
            octets = packet("arm", 120, &["id=0", "name=Arm"]);
            let at = at % octets.len();
            octets[at] = octet;
            answers(&octets, FROM, AFTER);
        }
    }
}
