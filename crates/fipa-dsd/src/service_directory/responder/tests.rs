use proptest::prelude::*;
use simple_dns::rdata::RData;
use simple_dns::{Packet, PacketFlag, TYPE};

use super::super::packet::{Record, ask_for_instances, ask_for_texts, read};
use super::super::{ServiceType, label};
use super::*;

const PORT: u16 = 5353;

fn service_type() -> ServiceType {
    ServiceType::of_scope("").unwrap()
}

fn robot(n: u8) -> SocketAddr {
    SocketAddr::from(([10, 0, 0, n], PORT))
}

/// A responder on a simulated clock.
struct Board {
    responder: Responder,
    now: Instant,
}

impl Board {
    /// With so many agents, all announced long ago.
    fn with(agents: usize) -> Board {
        let mut board = Board::empty();
        for i in 0..agents {
            board.put(&format!("agent-{i}"));
        }
        board.run(Duration::from_secs(60));
        board
    }

    fn empty() -> Board {
        let teller = Teller {
            service_type: service_type(),
            host: "robot-agents".to_owned(),
            addresses: vec![Ipv4Addr::new(10, 0, 0, 1)],
        };
        let now = Instant::now();
        Board {
            responder: Responder::new(teller, PORT, 7, now),
            now,
        }
    }

    fn put(&mut self, name: &str) {
        let strings = vec![
            ("TYPE".to_owned(), b"mts".to_vec()),
            ("LOCATOR".to_owned(), vec![b'x'; 150]),
        ];
        let label = label(name).unwrap();
        self.responder.put(self.now, Told { label, strings });
    }

    fn remove(&mut self, name: &str) {
        self.responder.remove(self.now, &label(name).unwrap());
    }

    fn ask(&mut self, packets: &[Vec<u8>], from: SocketAddr) {
        for packet in packets {
            self.responder.handle_packet(self.now, packet, from);
        }
    }

    /// What is sent within a time, with the moments.
    fn run(&mut self, span: Duration) -> Vec<(Duration, Send)> {
        let (begun, until) = (self.now, self.now + span);
        let mut sent = Vec::new();
        loop {
            self.responder.handle_timeout(self.now);
            let outputs = std::iter::from_fn(|| self.responder.poll_output());
            sent.extend(outputs.map(|output| (self.now - begun, output)));
            match self.responder.poll_timeout() {
                Some(at) if at <= until => {
                    assert!(at > self.now, "woken again and again");
                    self.now = at;
                }
                _ => break,
            }
        }
        self.now = until;
        sent
    }

    /// What all are told within a time, as `+` or `-` and the label.
    fn told(&mut self, span: Duration) -> Vec<String> {
        labels(&self.run(span))
    }
}

fn labels(sent: &[(Duration, Send)]) -> Vec<String> {
    let packets = sent.iter().filter_map(|(_, sent)| match sent {
        Send::ToAll(packet) => Some(packet),
        Send::To(..) => None,
    });
    let records = packets.flat_map(|packet| read(packet, &service_type()).unwrap());
    let told = records.filter_map(|record| match record {
        Record::Instance { label, ttl: 0 } => Some(format!("-{label}")),
        Record::Instance { label, .. } => Some(format!("+{label}")),
        _ => None,
    });
    told.collect()
}

/// A question for all agents but the first so many, whose pointers are good for so long still.
fn question(known: usize, seconds: u32) -> Vec<Vec<u8>> {
    let labels: Vec<String> = (0..known).map(|i| format!("agent-{i}")).collect();
    let known = labels.iter().map(|label| (label.as_str(), seconds));
    ask_for_instances(&service_type(), known)
}

const MOMENT: Duration = Duration::from_millis(700);

#[test]
fn an_agent_is_announced_twice_and_says_goodbye_twice() {
    let mut board = Board::empty();
    board.put("drive.left");
    board.put("arm");
    let sent = board.run(Duration::from_secs(10));
    assert_eq!(labels(&sent), ["+arm", "+drive?left"].repeat(2));
    // Two agents, one packet each time, a second apart.
    let [(first, packet), (second, _)] = &sent[..] else {
        panic!("{sent:?}");
    };
    assert_eq!(*second - *first, PAUSE);
    let Send::ToAll(packet) = packet else {
        panic!("{packet:?}");
    };
    let packet = Packet::parse(packet).unwrap();
    assert!(packet.has_flags(PacketFlag::RESPONSE | PacketFlag::AUTHORITATIVE_ANSWER));
    for record in &packet.answers {
        // A pointer is one of many, the rest is ours alone.
        let alone = record.rdata.type_code() != TYPE::PTR;
        assert_eq!(record.cache_flush, alone, "{record:?}");
        if let RData::SRV(service) = &record.rdata {
            assert_eq!(service.port, 0);
            assert_eq!(service.target.to_string(), "robot-agents.local");
        }
    }
    let hosts = packet
        .answers
        .iter()
        .filter(|r| matches!(r.rdata, RData::A(_)));
    assert_eq!(hosts.count(), 1);

    board.remove("drive.left");
    assert_eq!(board.told(Duration::from_secs(5)), ["-drive?left"; 2]);
    board.remove("drive.left");
    assert_eq!(board.told(Duration::from_secs(5)), [""; 0]);
}

#[test]
fn who_comes_back_at_once_is_announced_and_its_goodbye_not_repeated() {
    let mut board = Board::with(1);
    board.remove("agent-0");
    assert_eq!(board.told(Duration::ZERO), ["-agent-0"]);
    board.put("agent-0");
    assert_eq!(board.told(Duration::from_secs(5)), ["+agent-0"; 2]);
}

#[test]
fn the_goodbye_to_an_agent_that_has_moved_is_not_repeated() {
    let mut there = Board::empty();
    there.put("agent-0");
    let announced = there.run(Duration::from_millis(200));
    let [(_, Send::ToAll(announcement))] = &announced[..] else {
        panic!("{announced:?}");
    };
    let mut here = Board::with(2);
    here.remove("agent-0");
    here.remove("agent-1");
    assert_eq!(here.told(Duration::ZERO), ["-agent-0", "-agent-1"]);
    here.ask(std::slice::from_ref(announcement), robot(2));
    assert_eq!(here.told(Duration::from_secs(5)), ["-agent-1"]);
}

#[test]
fn a_question_is_answered_with_what_is_not_known() {
    let mut board = Board::with(20);
    board.ask(&question(0, 0), robot(2));
    assert_eq!(board.told(MOMENT).len(), 20);
    board.run(PAUSE);
    board.ask(&question(19, 4000), robot(2));
    assert_eq!(board.told(MOMENT), ["+agent-19"]);
    board.run(PAUSE);
    board.ask(&question(20, 4000), robot(2));
    assert_eq!(board.run(MOMENT), []);
    // What is half forgotten is told again.
    board.ask(&question(20, 2000), robot(2));
    assert_eq!(board.told(MOMENT).len(), 20);
}

#[test]
fn what_is_known_is_heard_in_all_packets_that_tell_it() {
    let mut board = Board::with(200);
    let packets = question(200, 4000);
    assert!(packets.len() > 3);
    // They come one after the other, and somebody else asks in between.
    for packet in &packets {
        board.ask(std::slice::from_ref(packet), robot(2));
        assert_eq!(board.run(Duration::from_millis(150)), []);
    }
    assert_eq!(board.run(MOMENT), []);
    // If the last of them is lost, what it held is told.
    board.ask(&packets[..packets.len() - 1], robot(2));
    let told = board.told(MOMENT).len();
    assert!((1..100).contains(&told), "{told}");
}

#[test]
fn what_all_were_told_since_somebody_asked_is_not_told_again() {
    let mut board = Board::with(10);
    for n in 2..50 {
        board.ask(&question(0, 0), robot(n));
    }
    assert_eq!(board.told(3 * PAUSE).len(), 10);
    // Who asks after they were told is told, but not within the same second.
    board.ask(&question(0, 0), robot(8));
    assert_eq!(board.told(MOMENT).len(), 10);
    board.ask(&question(0, 0), robot(9));
    let sent = board.run(PAUSE);
    assert_eq!(labels(&sent).len(), 10);
    assert!(sent[0].0 >= Duration::from_millis(200), "{:?}", sent[0].0);
}

#[test]
fn of_two_who_ask_from_one_address_each_is_told_what_he_lacks() {
    let mut board = Board::with(10);
    // Two programs of one host have the same address and port.
    board.ask(&question(10, 4000), robot(2));
    board.ask(&question(9, 4000), robot(2));
    assert_eq!(board.told(MOMENT), ["+agent-9"]);
}

#[test]
fn who_goes_on_and_on_is_answered_all_the_same() {
    let mut board = Board::with(200);
    let packets = question(100, 4000);
    let mut told = Vec::new();
    board.ask(&packets[..1], robot(2));
    for _ in 0..30 {
        let mut more = Packet::new_query(0);
        more.set_flags(PacketFlag::TRUNCATION);
        let more = [more.build_bytes_vec().unwrap()];
        board.ask(&more, robot(2));
        told.extend(board.told(Duration::from_millis(100)));
    }
    assert!(told.len() >= 100, "{}", told.len());
}

#[test]
fn all_are_announced_anew_where_somebody_may_not_have_heard_it() {
    let mut board = Board::with(2);
    board.remove("agent-0");
    board.run(Duration::ZERO);
    board.responder.announce_anew(board.now);
    let mut told = board.told(Duration::from_secs(5));
    told.sort();
    assert_eq!(told, ["+agent-1", "+agent-1", "-agent-0"]);
}

#[test]
fn thousands_who_ask_at_once_cost_no_more_than_one() {
    let mut board = Board::with(200);
    for n in 0..5000_u16 {
        let from = SocketAddr::from(([10, 1, (n >> 8) as u8, n as u8], PORT));
        board.ask(&question(0, 0), from);
    }
    assert!(board.responder.askers.len() <= MOST_ASKERS);
    let sent = board.run(MOMENT);
    assert_eq!(labels(&sent).len(), 200);
    // Not all in one go, which the sockets of others could not hold.
    let moments: std::collections::BTreeSet<Duration> = sent.iter().map(|(at, _)| *at).collect();
    assert_eq!(moments.len(), 4);
}

#[test]
fn one_agent_the_host_and_the_type_can_be_asked_for() {
    let mut board = Board::with(3);
    let text = ask_for_texts(&service_type(), &["Agent-1".to_owned()]);
    board.ask(&text, robot(2));
    assert_eq!(board.told(MOMENT), ["+agent-1"]);
    let nobody = ask_for_texts(&service_type(), &["agent-9".to_owned()]);
    board.ask(&nobody, robot(2));
    assert_eq!(board.run(MOMENT), []);

    let mut ask_for = |name: &str, kind: TYPE| {
        let mut packet = Packet::new_query(0);
        let name = simple_dns::Name::new_unchecked(name);
        let class = simple_dns::QCLASS::CLASS(simple_dns::CLASS::IN);
        let question = simple_dns::Question::new(name, kind.into(), class, false);
        packet.questions.push(question);
        board.ask(&[packet.build_bytes_vec().unwrap()], robot(2));
        let sent = board.run(PAUSE);
        let answers = sent.iter().flat_map(|(_, sent)| {
            let (Send::ToAll(packet) | Send::To(_, packet)) = sent;
            let packet = Packet::parse(packet).unwrap();
            let types = packet.answers.iter().map(|record| record.rdata.type_code());
            types.collect::<Vec<TYPE>>()
        });
        answers.collect::<Vec<TYPE>>()
    };
    assert_eq!(ask_for("robot-agents.local", TYPE::A), [TYPE::A]);
    assert_eq!(ask_for("robot-agents.local", TYPE::TXT), []);
    assert_eq!(ask_for("others.local", TYPE::A), []);
    let types = "_services._dns-sd._udp.local";
    assert_eq!(ask_for(types, TYPE::PTR), [TYPE::PTR]);
}

#[test]
fn who_asks_from_a_port_of_his_own_is_answered_there_with_his_question() {
    let mut board = Board::with(2);
    let mut packets = question(0, 0);
    packets[0][..2].copy_from_slice(&[0xab, 0xcd]);
    let from = SocketAddr::from(([10, 0, 0, 2], 40_000));
    board.ask(&packets, from);
    let sent = board.run(MOMENT);
    let [(_, Send::To(to, packet))] = &sent[..] else {
        panic!("{sent:?}");
    };
    assert_eq!(*to, from);
    let packet = Packet::parse(packet).unwrap();
    assert_eq!((packet.id(), packet.questions.len()), (0xabcd, 1));
    let of_all = |record: &simple_dns::ResourceRecord<'_>| record.cache_flush || record.ttl > 10;
    assert!(!packet.answers.iter().any(of_all));
}

#[test]
fn goodbye_is_said_to_all_at_once_in_few_packets() {
    let mut board = Board::with(200);
    board.responder.remove_all(board.now);
    let sent = board.run(Duration::from_secs(5));
    assert_eq!(labels(&sent).len(), 400);
    assert!(sent.len() <= 40, "{}", sent.len());
}

#[test]
fn without_agents_nothing_is_answered() {
    let mut board = Board::with(1);
    board.remove("agent-0");
    board.run(PAUSE);
    board.ask(&question(0, 0), robot(2));
    assert_eq!(board.run(PAUSE), []);
}

proptest! {
    #[test]
    fn any_octets_are_read_without_a_panic(
        octets in prop::collection::vec(any::<u8>(), 0..200),
        at: prop::sample::Index,
        octet: u8,
    ) {
        let mut board = Board::with(2);
        let mut packet = question(1, 4000).remove(0);
        let at = at.index(packet.len());
        packet[at] = octet;
        board.ask(&[octets, packet], robot(2));
        board.run(PAUSE);
    }

    #[test]
    fn every_agent_is_told_however_long_its_entry(
        lengths in prop::collection::vec(0..1200_usize, 1..40),
    ) {
        let mut board = Board::empty();
        for (i, length) in lengths.iter().enumerate() {
            let value = vec![b'x'; *length];
            let strings = value.chunks(190).map(|chunk| ("LOCATOR".to_owned(), chunk.to_vec()));
            let told = Told {
                label: format!("agent-{i}"),
                strings: strings.collect(),
            };
            board.responder.put(board.now, told);
        }
        let sent = board.run(Duration::from_millis(500));
        prop_assert_eq!(labels(&sent).len(), lengths.len());
        for (_, sent) in &sent {
            let (Send::ToAll(packet) | Send::To(_, packet)) = sent;
            // One that no link has to cut.
            prop_assert!(packet.len() <= 1472, "{}", packet.len());
        }
    }
}
