use fipa_directory::{Entry, MESSAGE_TRANSPORT};
use simple_dns::rdata::{PTR, RData, TXT};
use simple_dns::{CLASS, Label, Name, Packet, QTYPE, ResourceRecord, TYPE};

use super::*;
use crate::service_directory::label;
use crate::service_directory::packet::tests::recorded;

const SECOND: Duration = Duration::from_secs(1);

/// A search on a simulated clock.
struct Search {
    browser: Browser,
    now: Instant,
    begun: Instant,
    packets: Vec<Vec<u8>>,
}

impl Search {
    fn new() -> Search {
        let now = Instant::now();
        let service_type = ServiceType::of_scope("").unwrap();
        Search {
            browser: Browser::new(service_type, id(0), 42, now),
            now,
            begun: now,
            packets: Vec::new(),
        }
    }

    /// What is reported after a packet.
    fn hear(&mut self, packet: &[u8]) -> Vec<String> {
        assert!(self.browser.handle_packet(self.now, packet, false));
        self.events()
    }

    /// What is reported while time passes.
    fn pass(&mut self, time: Duration) -> Vec<String> {
        let until = self.now + time;
        let mut events = self.events();
        while self.browser.poll_timeout() <= until {
            assert!(self.browser.poll_timeout() >= self.begun);
            self.now = self.now.max(self.browser.poll_timeout());
            self.browser.handle_timeout(self.now);
            events.extend(self.events());
        }
        self.now = until;
        events
    }

    fn events(&mut self) -> Vec<String> {
        let mut events = Vec::new();
        while let Some(output) = self.browser.poll_output() {
            match output {
                Output::Packet(packet) => self.packets.push(packet),
                Output::Event(DiscoveryEvent::AgentFound(agent)) => {
                    let locations = agent.entry.locations.len();
                    events.push(format!("+{} {locations}", agent.entry.name));
                }
                Output::Event(DiscoveryEvent::AgentGone { name, .. }) => {
                    events.push(format!("-{name}"));
                }
                Output::Event(other) => events.push(format!("{other:?}")),
            }
        }
        events
    }

    /// The questions asked since the last call: the type, and `*` or a label.
    fn asked(&mut self) -> Vec<String> {
        let mut asked = Vec::new();
        for packet in self.packets.drain(..) {
            for question in Packet::parse(&packet).unwrap().questions {
                let first = question.qname.get_labels()[0].to_string();
                asked.push(match question.qtype {
                    QTYPE::TYPE(TYPE::PTR) => "*".to_owned(),
                    QTYPE::TYPE(TYPE::TXT) => first,
                    other => panic!("{other:?}"),
                });
            }
        }
        asked
    }
}

fn id(n: u8) -> InstanceId {
    InstanceId::from_bytes([n; 16])
}

fn named<'a>(labels: &[&'a str]) -> Name<'a> {
    let labels: Vec<_> = labels
        .iter()
        .map(|label| Label::new_unchecked(label.as_bytes()))
        .collect();
    Name::new_with_labels(&labels)
}

/// An answer with the pointer, and with the text of the entry if there is one.
fn answer(name: &str, ttl: u32, entry: Option<(&Entry, u8)>) -> Vec<u8> {
    let label = label(name).unwrap();
    let service = ["_fipa_service_directory", "_udp", "local"];
    let instance = || named(&[&label, service[0], service[1], service[2]]);
    let mut packet = Packet::new_reply(0);
    let record = |name, data| ResourceRecord::new(name, CLASS::IN, ttl, data);
    let pointer = record(named(&service), RData::PTR(PTR(instance())));
    let strings = entry.map(|(entry, n)| txt::write(entry, id(n)).unwrap().strings);
    let mut text = TXT::new();
    for (key, value) in strings.iter().flatten() {
        text.add_attribute(key, Some(value)).unwrap();
    }
    if entry.is_some() {
        packet.answers.push(record(instance(), RData::TXT(text)));
    }
    packet.answers.push(pointer);
    packet.build_bytes_vec_compressed().unwrap()
}

fn entry(name: &str, addresses: &[&str]) -> Entry {
    let mut entry = Entry::new(name);
    entry.locations = addresses
        .iter()
        .map(|address| fipa_directory::Location {
            address: (*address).into(),
            signature: MESSAGE_TRANSPORT.into(),
        })
        .collect();
    entry
}

/// The announcement of an agent by daemon `n`.
fn announced(name: &str, n: u8) -> Vec<u8> {
    answer(name, 4500, Some((&entry(name, &["tcp://10.0.0.1:1"]), n)))
}

#[test]
fn the_recorded_conversation_is_followed() {
    let mut search = Search::new();
    let mut events = Vec::new();
    for packet in recorded() {
        events.extend(search.hear(&packet));
        events.extend(search.pass(Duration::from_millis(200)));
    }
    events.extend(search.pass(2 * SECOND));
    // The last three go with one packet.
    events[5..].sort();
    let expected = [
        "+agent-a 1",
        "+da0@192.168.0.1:1099/JADE 1",
        "+agent-long 5",
        "+agent-emptydesc 1",
        "-agent-a",
        "-agent-emptydesc",
        "-agent-long",
        "-da0@192.168.0.1:1099/JADE",
    ];
    assert_eq!(events, expected);
}

#[test]
fn questions_become_rare() {
    let mut search = Search::new();
    search.pass(Duration::from_secs(60));
    assert_eq!(search.asked(), ["*"; 3]);
    search.pass(Duration::from_secs(24 * 3600));
    let asked = search.asked().len();
    assert!((115..=144).contains(&asked), "{asked}");
}

#[test]
fn while_there_is_news_the_question_is_repeated() {
    let mut search = Search::new();
    for i in 0..60 {
        search.hear(&announced(&format!("agent-{i}"), 1));
        search.pass(SECOND);
    }
    assert_eq!(search.asked().len(), 4);
}

/// A question as another robot asks it.
fn question(known: &[&str]) -> Vec<u8> {
    let service_type = ServiceType::of_scope("").unwrap();
    let known = known.iter().map(|label| (*label, 4000));
    packet::ask_for_instances(&service_type, known).remove(0)
}

#[test]
fn what_another_robot_asks_need_not_be_asked_again() {
    let mut search = Search::new();
    search.pass(Duration::from_secs(60));
    search.asked();
    search.hear(&announced("a", 1));
    // Just now it would not help: it is long until our next question.
    search.hear(&question(&["a"]));
    search.pass(Duration::from_secs(450));
    search.hear(&question(&["a"]));
    search.pass(Duration::from_secs(450));
    assert_eq!(search.asked(), [""; 0]);
    search.pass(Duration::from_secs(300));
    assert_eq!(search.asked(), ["*"]);
    // Those who know more than we do get answers of no use to us.
    search.pass(Duration::from_secs(450));
    search.hear(&question(&["a", "b"]));
    search.pass(Duration::from_secs(300));
    assert_eq!(search.asked(), ["*"]);
}

#[test]
fn what_is_repeated_is_reported_once() {
    let mut search = Search::new();
    assert_eq!(search.hear(&announced("a", 1)), ["+a 1"]);
    assert_eq!(search.hear(&announced("a", 1)), [""; 0]);
    let moved = entry("a", &["tcp://10.0.0.1:1", "tcp://10.0.0.2:1"]);
    let moved = answer("a", 4500, Some((&moved, 1)));
    assert_eq!(search.hear(&moved), ["+a 2"]);
}

#[test]
fn a_missing_text_is_asked_for_a_few_times() {
    let mut search = Search::new();
    search.pass(SECOND);
    search.asked();
    assert_eq!(search.hear(&answer("a.b", 4500, None)), [""; 0]);
    search.pass(Duration::from_secs(60));
    let mut asked = search.asked();
    asked.retain(|asked| asked != "*");
    assert_eq!(asked, ["a?b"; 5]);
    assert_eq!(search.hear(&announced("a.b", 1)), ["+a.b 1"]);
}

#[test]
fn a_text_that_another_robot_asks_for_need_not_be_asked_for() {
    let service_type = ServiceType::of_scope("").unwrap();
    let mut search = Search::new();
    search.pass(Duration::from_secs(60));
    search.asked();
    let theirs = packet::ask_for_texts(&service_type, &["a".to_owned()]).remove(0);
    search.hear(&answer("a", 4500, None));
    // Each time just before we would.
    for _ in 0..20 {
        search.hear(&theirs);
        search.pass(Duration::from_millis(90));
    }
    assert_eq!(search.asked(), [""; 0]);
    search.pass(SECOND);
    assert_eq!(search.asked(), ["a"; 2]);
}

#[test]
fn a_goodbye_counts_after_a_second_unless_it_is_taken_back() {
    let mut search = Search::new();
    search.hear(&announced("a", 1));
    search.hear(&announced("b", 1));
    assert_eq!(search.hear(&answer("a", 0, None)), [""; 0]);
    assert_eq!(search.hear(&answer("b", 0, None)), [""; 0]);
    assert_eq!(search.pass(SECOND / 2), [""; 0]);
    assert_eq!(search.hear(&announced("b", 1)), [""; 0]);
    assert_eq!(search.pass(2 * SECOND), ["-a"]);
    assert_eq!(search.hear(&announced("a", 1)), ["+a 1"]);
}

#[test]
fn a_lifetime_is_renewed_by_one_question_for_all() {
    let mut search = Search::new();
    let short = |name| answer(name, 120, Some((&entry(name, &["tcp://10.0.0.1:1"]), 1)));
    for name in ["a", "b", "c"] {
        search.hear(&short(name));
    }
    search.pass(Duration::from_secs(91));
    search.asked();
    assert_eq!(search.pass(Duration::from_secs(18)), [""; 0]);
    let asked = search.asked();
    assert!((1..=9).contains(&asked.len()), "{asked:?}");
    assert!(asked.iter().all(|asked| asked == "*"), "{asked:?}");
    search.hear(&short("a"));
    let mut events = search.pass(Duration::from_secs(30));
    events.sort();
    assert_eq!(events, ["-b", "-c"]);
}

#[test]
fn only_the_old_are_asked_to_answer() {
    let mut search = Search::new();
    search.hear(&announced("fresh", 1));
    search.hear(&answer("short", 10, Some((&entry("short", &[]), 1))));
    search.pass(Duration::from_secs(6));
    search.packets.clear();
    search.pass(Duration::from_secs(6));
    let asked = Packet::parse(&search.packets[0]).unwrap();
    assert_eq!(asked.answers.len(), 1);
    assert!((4480..4500).contains(&asked.answers[0].ttl));
}

#[test]
fn who_does_not_answer_is_gone_after_two_seconds_and_asked_for_anew() {
    let mut search = Search::new();
    search.hear(&announced("a", 1));
    search.hear(&announced("b", 1));
    search.pass(Duration::from_secs(500));
    search.asked();
    assert!(search.browser.verify(search.now, "a"));
    assert!(search.browser.verify(search.now, "b"));
    assert!(!search.browser.verify(search.now, "c"));
    assert_eq!(search.pass(SECOND / 2), [""; 0]);
    let mut asked = search.asked();
    asked.sort();
    assert_eq!(asked, ["a", "b"]);
    search.hear(&announced("b", 1));
    assert_eq!(search.pass(SECOND), [""; 0]);
    assert_eq!(search.asked(), ["a"]);
    assert_eq!(search.pass(SECOND), ["-a"]);
    search.pass(2 * SECOND);
    assert!(search.asked().contains(&"*".to_owned()));
}

#[test]
fn what_this_daemon_announces_is_not_reported() {
    let mut search = Search::new();
    assert_eq!(search.hear(&announced("a", 0)), [""; 0]);
    assert_eq!(search.hear(&answer("a", 0, None)), [""; 0]);
    assert_eq!(search.pass(2 * SECOND), [""; 0]);
    // The label passes from another daemon to ours and back.
    assert_eq!(search.hear(&announced("b", 1)), ["+b 1"]);
    assert_eq!(search.hear(&announced("b", 0)), ["-b"]);
    assert_eq!(search.hear(&announced("b", 2)), ["+b 1"]);
}

#[test]
fn another_true_name_is_another_agent() {
    let mut search = Search::new();
    assert_eq!(search.hear(&announced("a.b", 1)), ["+a.b 1"]);
    assert_eq!(search.hear(&announced("a?b", 1)), ["-a.b", "+a?b 1"]);
}

#[test]
fn with_a_daemon_go_its_agents() {
    let mut search = Search::new();
    for (name, n) in [("a", 1), ("b", 2), ("c", 1)] {
        search.hear(&announced(name, n));
    }
    search.browser.forget(id(1));
    let mut events = search.events();
    events.sort();
    assert_eq!(events, ["-a", "-c"]);
    assert_eq!(search.hear(&announced("a", 1)), ["+a 1"]);
}

#[test]
fn a_loopback_address_counts_only_where_it_was_heard_on_loopback() {
    let mut search = Search::new();
    let packet = entry("a", &["tcp://127.0.0.1:1", "tcp://10.0.0.1:1"]);
    let packet = answer("a", 4500, Some((&packet, 1)));
    assert_eq!(search.hear(&packet), ["+a 1"]);
    search.browser.handle_packet(search.now, &packet, true);
    assert_eq!(search.events(), ["+a 2"]);
    assert_eq!(search.hear(&packet), [""; 0]);
}

#[test]
fn a_flood_of_names_is_bounded() {
    let mut search = Search::new();
    let mut warnings = 0;
    for i in 0..=MOST_KNOWN + 1 {
        let events = search.hear(&answer(&format!("agent-{i}"), 4500, None));
        warnings += events.len();
    }
    assert_eq!(warnings, 1);
    assert_eq!(search.browser.known.len(), MOST_KNOWN);
    assert!(!search.browser.handle_packet(search.now, b"nonsense", false));
}
