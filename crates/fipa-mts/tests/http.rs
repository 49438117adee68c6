//! Letters that are posted over HTTP, and letters that are posted to the service.

use std::time::Duration;

use bytes::Bytes;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Message, Performative, Slots, Text};
use fipa_codec::{Limits, Output as Encoded, bit_efficient, decode_envelope, decode_payload};
use fipa_directory::{Address, InstanceId, Now};
use fipa_link::{Outcome, ReceiverOutcome};
use fipa_mts::{
    Arrived, Config, DeliveryFailure, Machine, Mts, Output, PostFailure, PostedLetter, Refusal,
    Registration, Submission, TakenOver,
};

const OWN: &str = "http://10.0.0.5:7778/acc";
const OWN_LOOPBACK: &str = "http://127.0.0.1:7778/acc";

struct Service {
    mts: Mts,
    now: Now,
    tickets: u64,
}

impl Service {
    fn new() -> Service {
        let mut config = Config::new(InstanceId::from_bytes([7; 16]), "robot1");
        config.http = [OWN_LOOPBACK, OWN].map(|url| url.parse().unwrap()).into();
        Service {
            mts: Mts::new(config),
            now: Now::default(),
            tickets: 0,
        }
    }

    fn register(&mut self, name: &'static str) {
        self.mts.register(self.now, 0, Registration::new(name));
        let outputs = self.outputs();
        assert!(matches!(
            outputs[0],
            Output::Registered { result: Ok(()), .. }
        ));
    }

    fn outputs(&mut self) -> Vec<Output> {
        std::iter::from_fn(|| self.mts.poll_output()).collect()
    }

    fn send(&mut self, message: Message) -> u64 {
        let mut payload = Encoded::new();
        bit_efficient::encode_message(&message, &mut payload).unwrap();
        let form = fipa_acl::Representation::BitEfficient;
        self.submit(&message, form, payload.take_bytes())
    }

    fn submit(&mut self, message: &Message, form: fipa_acl::Representation, payload: Bytes) -> u64 {
        let envelope = Envelope::new(Slots {
            to: message.receiver.clone(),
            from: message.sender.clone(),
            acl_representation: Some(form),
            date: Some(FipaTime::from_unix_millis(0)),
            ..Slots::default()
        });
        self.tickets += 1;
        let letter = Letter { envelope, payload };
        let submission = Submission::new(self.tickets, letter, Duration::from_secs(10));
        self.mts.submit(self.now, submission);
        self.tickets
    }

    fn post(&mut self) -> PostedLetter {
        let posts = self.posts();
        assert_eq!(posts.len(), 1);
        posts.into_iter().next().unwrap()
    }

    fn posts(&mut self) -> Vec<PostedLetter> {
        let outputs = self.outputs().into_iter();
        let posts = outputs.filter_map(|output| match output {
            Output::Post(letter) => Some(*letter),
            _ => None,
        });
        posts.collect()
    }

    fn answer(&mut self, letter: &PostedLetter, result: Result<(), PostFailure>) {
        let result = result.map(|()| TakenOver::default());
        self.mts.posted(self.now, letter.post, result);
    }

    /// It is taken over, and so many may be on their way to the same place.
    fn take_over(&mut self, letter: &PostedLetter, ahead: usize) {
        let taken = TakenOver { ahead };
        self.mts.posted(self.now, letter.post, Ok(taken));
    }

    fn outcome(&mut self) -> ReceiverOutcome {
        let outputs = self.outputs().into_iter();
        let mut outcomes = outputs.filter_map(|output| match output {
            Output::Outcome { outcomes, .. } => Some(outcomes),
            _ => None,
        });
        outcomes.next().expect("no outcome").remove(0)
    }

    fn arrive(&mut self, receiver: &AgentId, connection: u64, earlier: u64) -> Result<(), Refusal> {
        let envelope = format!(
            "<?xml version=\"1.0\"?><envelope><params index=\"1\"><from><agent-identifier>\
             <name>a@platA</name><addresses><url>http://10.0.0.9:7778/acc</url></addresses>\
             </agent-identifier></from><acl-representation>\
             fipa.acl.rep.string.std</acl-representation><intended-receiver><agent-identifier>\
             <name>{}</name><addresses>{}</addresses></agent-identifier></intended-receiver>\
             </params></envelope>",
            receiver.name,
            receiver
                .addresses
                .iter()
                .map(|url| format!("<url>{url}</url>"))
                .collect::<String>(),
        );
        let arrived = Arrived {
            envelope: envelope.into(),
            payload: Bytes::from_static(b"(inform :content hi)"),
            remote: Text::from_static("http://10.0.0.9:4711"),
            connection,
            earlier,
            number: None,
        };
        self.mts.letter_arrived(self.now, arrived)
    }

    fn mail(&mut self, name: &str) -> usize {
        std::iter::from_fn(|| self.mts.take_mail(name)).count()
    }
}

fn to(urls: &[&'static str]) -> Message {
    let receiver = AgentId {
        addresses: urls.iter().map(|url| Text::from_static(url)).collect(),
        ..AgentId::new("ping@platA")
    };
    Message::new(Performative::Request)
        .from_agent("a@robot1")
        .to(receiver)
        .reply_to("c@robot1")
        .content("grüße")
}

#[test]
fn a_letter_is_posted_as_jade_reads_it_and_is_sent_once_it_was_taken_over() {
    let mut service = Service::new();
    service.send(to(&["http://10.0.0.9:7778/acc"]));
    let letter = service.post();
    assert_eq!(letter.address.to_string(), "http://10.0.0.9:7778/acc");
    assert_eq!(
        letter.payload_type,
        "fipa.acl.rep.string.std; charset=UTF-8"
    );
    let limits = Limits::default();
    let (envelope, _) = decode_envelope(&letter.envelope, &limits).unwrap();
    assert_eq!(envelope.intended_receiver().len(), 1);
    assert_eq!(envelope.payload_length(), Some(letter.payload.len() as u64));
    // Never an address that only this host can use.
    assert_eq!(envelope.from().unwrap().addresses, [OWN]);
    let message = decode_payload(&envelope, &letter.payload, &limits).unwrap();
    assert_eq!(message.content_str(), Some("grüße"));
    assert_eq!(message.sender.unwrap().addresses, [OWN]);
    assert_eq!(message.reply_to[0].addresses, [OWN]);
    service.answer(&letter, Ok(()));
    let outcome = service.outcome();
    assert_eq!(outcome.outcome, Outcome::Sent);
    assert_eq!(outcome.via.unwrap(), "http://10.0.0.9:7778/acc");
    assert_eq!(service.mts.letters_under_way(), 0);
}

#[test]
fn what_is_in_string_form_already_stays_so_and_names_its_charset() {
    let mut service = Service::new();
    let message = to(&["http://10.0.0.9:7778/acc"]);
    for (text, payload_type) in [
        (
            "(inform :content \"gr\u{fc}\u{df}e\")",
            "fipa.acl.rep.string.std; charset=UTF-8",
        ),
        ("(inform :content hello)", "application/text"),
    ] {
        let payload = Bytes::from_static(text.as_bytes());
        service.submit(&message, fipa_acl::Representation::String, payload.clone());
        let letter = service.post();
        assert_eq!(
            (letter.payload_type.as_str(), &letter.payload),
            (payload_type, &payload)
        );
        service.answer(&letter, Ok(()));
    }
}

#[test]
fn somebody_on_this_host_may_be_told_loopback() {
    let mut service = Service::new();
    service.send(to(&["http://127.0.0.1:7779/acc"]));
    let letter = service.post();
    let (envelope, _) = decode_envelope(&letter.envelope, &Limits::default()).unwrap();
    assert_eq!(envelope.from().unwrap().addresses, [OWN_LOOPBACK, OWN]);
}

#[test]
fn each_receiver_has_a_letter_of_its_own() {
    let mut service = Service::new();
    let url = "http://10.0.0.9:7778/acc";
    let message = to(&[url]).to(AgentId::new("pong@platA").address(url));
    service.send(message);
    let posts = service.posts();
    let receivers = posts.iter().map(|post| {
        let (envelope, _) = decode_envelope(&post.envelope, &Limits::default()).unwrap();
        assert_eq!(envelope.to().len(), 2);
        let [receiver] = envelope.intended_receiver() else {
            panic!("not one receiver");
        };
        receiver.name.clone()
    });
    assert_eq!(receivers.collect::<Vec<_>>(), ["ping@platA", "pong@platA"]);
}

#[test]
fn the_next_address_is_tried_and_at_last_the_reasons_are_told() {
    let mut service = Service::new();
    service.send(to(&["http://one:1/acc", "http://two:2/acc"]));
    // Nobody there: once more, and then the next one.
    for address in ["http://one:1/acc", "http://one:1/acc"] {
        let letter = service.post();
        assert_eq!(letter.address.to_string(), address);
        service.answer(&letter, Err(PostFailure::Unreached("nobody".to_owned())));
    }
    let letter = service.post();
    assert_eq!(letter.address.to_string(), "http://two:2/acc");
    // Whoever says no is not asked again.
    service.answer(
        &letter,
        Err(PostFailure::Refused("406 Not Acceptable".to_owned())),
    );
    let outcome = service.outcome();
    assert_eq!(outcome.outcome, Outcome::Refused);
    assert_eq!(
        outcome.reason,
        "http://one:1/acc: nobody; http://two:2/acc: 406 Not Acceptable"
    );
}

#[test]
fn letters_for_one_receiver_keep_their_order() {
    let mut service = Service::new();
    let url = "http://10.0.0.9:7778/acc";
    for _ in 0..3 {
        service.send(to(&[url]));
    }
    for _ in 0..3 {
        let letter = service.post();
        service.answer(&letter, Ok(()));
    }
    assert_eq!(service.mts.letters_under_way(), 0);
}

#[test]
fn a_letter_that_is_not_answered_in_time_is_told_and_frees_its_place() {
    let mut service = Service::new();
    let url = "http://10.0.0.9:7778/acc";
    service.send(to(&[url]));
    let letter = service.post();
    assert_eq!(letter.timeout, Duration::from_secs(10));
    service.now.mono += Duration::from_secs(10);
    service.mts.handle_timeout(service.now);
    let outcome = service.outcome();
    assert_eq!(outcome.outcome, Outcome::Timeout);
    assert!(
        outcome.reason.contains("did not answer in time"),
        "{}",
        outcome.reason
    );
    service.answer(&letter, Err(PostFailure::Unanswered("late".to_owned())));
    service.send(to(&[url]));
    service.post();
}

#[test]
fn our_own_url_leads_to_our_own_agents_only() {
    let mut service = Service::new();
    service.send(to(&[OWN]));
    assert_eq!(service.outcome().outcome, Outcome::Unknown);
    service.register("Arm@robot1");
    let receiver = AgentId::new("arm@ROBOT1").address(OWN);
    service.send(Message::new(Performative::Inform).to(receiver));
    assert_eq!(service.outcome().outcome, Outcome::Delivered);
}

#[test]
fn a_letter_that_is_posted_reaches_its_receiver_with_our_stamp() {
    let mut service = Service::new();
    service.register("arm@robot1");
    service.arrive(&AgentId::new("arm@robot1"), 1, 0).unwrap();
    let letter = service.mts.take_mail("arm@robot1").unwrap();
    let stamp = letter.envelope.stamps().next().unwrap();
    assert_eq!(
        (stamp.by.as_str(), stamp.via.as_deref()),
        ("robot1", Some("http"))
    );
    // JADE does not tell names apart that differ in case only.
    service
        .arrive(&AgentId::new("ARM@robot1").address(OWN), 1, 1)
        .unwrap();
    assert_eq!(service.mail("arm@robot1"), 1);
}

#[test]
fn whoever_posts_a_letter_for_nobody_is_told_where_it_says() {
    let mut service = Service::new();
    service
        .arrive(&AgentId::new("nobody@robot1"), 1, 0)
        .unwrap();
    let told = service.post();
    assert_eq!(told.address.to_string(), "http://10.0.0.9:7778/acc");
    let limits = Limits::default();
    let (envelope, _) = decode_envelope(&told.envelope, &limits).unwrap();
    assert_eq!(envelope.intended_receiver()[0].name, "a@platA");
    let message = decode_payload(&envelope, &told.payload, &limits).unwrap();
    let failure = DeliveryFailure::of(&message).unwrap();
    assert_eq!(failure.receivers[0].name, "nobody@robot1");
    assert_eq!(failure.service.unwrap().name, "ams@robot1");
}

#[test]
fn a_letter_that_comes_again_over_a_new_connection_is_delivered_once() {
    let mut service = Service::new();
    service.register("arm@robot1");
    let arm = AgentId::new("arm@robot1");
    // The same twice over one connection is meant so.
    service.arrive(&arm, 1, 0).unwrap();
    service.arrive(&arm, 1, 1).unwrap();
    assert_eq!(service.mail("arm@robot1"), 2);
    // Its answer was lost with the connection.
    service.arrive(&arm, 2, 0).unwrap();
    assert_eq!(service.mail("arm@robot1"), 0);
    service.arrive(&arm, 3, 0).unwrap();
    assert_eq!(service.mail("arm@robot1"), 1);
}

#[test]
fn what_is_posted_here_is_not_posted_on() {
    let mut service = Service::new();
    service.register("Arm@robot1");
    // Whatever URL of ours the sender knows, it means us, and does not tell names apart by their case.
    for url in ["http://robot1.lan:7778/acc", "http://10.0.0.77:7778/acc"] {
        let arm = AgentId::new("arm@ROBOT1").address(url);
        service.arrive(&arm, 1, 0).unwrap();
        assert_eq!(service.mail("Arm@robot1"), 1);
        let nobody = AgentId::new("nobody@robot1").address(url);
        service.arrive(&nobody, 1, 1).unwrap();
        // Its sender is told, where it says.
        let told = service.post();
        assert_eq!(told.address.to_string(), "http://10.0.0.9:7778/acc");
        service.answer(&told, Ok(()));
        assert_eq!(service.mts.letters_under_way(), 0);
    }
}

#[test]
fn names_that_jade_makes_of_its_host_work_as_they_are() {
    let mut service = Service::new();
    let url = Text::from_static("http://10.0.0.9:7778/acc");
    for name in ["ping@10.0.0.9:1099/JADE", "a.b-c_d@host.lan:1099/JADE"] {
        let receiver = AgentId::new(name).address(url.clone());
        service.send(
            Message::new(Performative::Inform)
                .from_agent("a@robot1")
                .to(receiver),
        );
        let letter = service.post();
        let (envelope, _) = decode_envelope(&letter.envelope, &Limits::default()).unwrap();
        assert_eq!(envelope.intended_receiver()[0].name, name);
        service.answer(&letter, Ok(()));
        assert_eq!(service.outcome().outcome, Outcome::Sent);
    }
}

#[test]
fn what_cannot_be_read_is_refused() {
    let mut service = Service::new();
    let arrived = |envelope: &'static str| Arrived {
        envelope: Bytes::from_static(envelope.as_bytes()),
        payload: Bytes::new(),
        remote: Text::default(),
        connection: 1,
        earlier: 0,
        number: None,
    };
    for envelope in ["", "<envelope>", "hello", "<other/>"] {
        let refused = service.mts.letter_arrived(service.now, arrived(envelope));
        assert!(
            matches!(refused, Err(Refusal::Unreadable(_))),
            "{envelope}: {refused:?}"
        );
    }
    service.mts.shutdown(service.now);
    let refused = service
        .mts
        .letter_arrived(service.now, arrived("<envelope/>"));
    assert_eq!(refused, Err(Refusal::Closing));
}

#[test]
fn an_address_of_a_link_is_tried_as_a_link_where_it_comes_first() {
    let mut service = Service::new();
    service.send(to(&["tcp://10.0.0.9:4100", "http://10.0.0.9:7778/acc"]));
    let outputs = service.outputs();
    let dialled = outputs.iter().find_map(|output| match output {
        Output::Dial { addresses, .. } => Some(addresses.clone()),
        _ => None,
    });
    assert_eq!(dialled, Some(vec![Address::tcp("10.0.0.9", 4100)]));
}

const PLACE: &str = "http://10.0.0.9:7778/acc";

/// A message to one of several receivers at one place.
fn numbered(receiver: &'static str, number: usize) -> Message {
    let receiver = AgentId::new(receiver).address(PLACE);
    Message::new(Performative::Inform)
        .from_agent("a@robot1")
        .to(receiver)
        .content(format!("<{number}>"))
}

/// Which receivers' letters these are, and what number each has.
fn read(posts: &[PostedLetter]) -> Vec<(String, usize)> {
    let read = posts.iter().map(|letter| {
        let (envelope, _) = decode_envelope(&letter.envelope, &Limits::default()).unwrap();
        let payload = String::from_utf8_lossy(&letter.payload).into_owned();
        let number = payload.split(['<', '>']).nth(1).unwrap().parse().unwrap();
        (envelope.intended_receiver()[0].name.to_string(), number)
    });
    read.collect()
}

fn numbers(posts: &[PostedLetter]) -> Vec<usize> {
    read(posts).into_iter().map(|(_, number)| number).collect()
}

/// A service that knows that eight letters may be on their way to the place.
fn eight_ahead() -> Service {
    let mut service = Service::new();
    service.send(numbered("b@platB", 0));
    let first = service.post();
    assert!(!first.in_series);
    service.take_over(&first, 8);
    service.outputs();
    service
}

#[test]
fn a_place_that_takes_letters_ahead_gets_them_in_order_before_it_answers() {
    let mut service = eight_ahead();
    for number in 0..12 {
        service.send(numbered("b@platB", number));
    }
    let mut posts = service.posts();
    assert_eq!(numbers(&posts), (0..8).collect::<Vec<_>>());
    for number in 8..12 {
        service.take_over(&posts.remove(0), 8);
        let next = service.posts();
        assert_eq!(numbers(&next), [number]);
        posts.extend(next);
    }
    assert!(posts.iter().all(|letter| letter.in_series));
    // It does not any more: what follows waits for all of them.
    service.take_over(&posts.remove(0), 0);
    service.send(numbered("b@platB", 12));
    for letter in posts {
        assert!(service.posts().is_empty());
        service.take_over(&letter, 0);
    }
    let last = service.post();
    assert!(!last.in_series);
    assert_eq!(numbers(&[last]), [12]);
}

#[test]
fn nothing_follows_a_letter_that_is_posted_alone_or_is_large() {
    let mut service = Service::new();
    service.send(numbered("b@platB", 0));
    service.send(numbered("b@platB", 1));
    service.send(numbered("c@platB", 2));
    let [b, c] = service.posts().try_into().unwrap();
    // Now it is known that letters may follow, but the first one is on its own connection.
    service.take_over(&c, 8);
    assert!(service.posts().is_empty());
    service.take_over(&b, 8);
    let b = service.post();
    assert_eq!(
        (numbers(std::slice::from_ref(&b)), b.in_series),
        (vec![1], true)
    );
    let large = numbered("b@platB", 3).ontology("x".repeat(140_000));
    service.send(large);
    service.send(numbered("b@platB", 4));
    assert!(service.posts().is_empty());
    service.take_over(&b, 8);
    let large = service.post();
    assert_eq!(
        (numbers(std::slice::from_ref(&large)), large.in_series),
        (vec![3], false)
    );
    service.take_over(&large, 8);
    assert_eq!(numbers(&service.posts()), [4]);
}

#[test]
fn the_first_letters_for_others_do_not_wait_behind_many_for_one() {
    let mut service = eight_ahead();
    for number in 0..100 {
        service.send(numbered("b@platB", number));
    }
    assert_eq!(service.posts().len(), 8);
    service.send(numbered("c@platB", 0));
    service.send(numbered("d@platB", 0));
    let names = read(&service.posts()).into_iter().map(|(name, _)| name);
    assert_eq!(names.collect::<Vec<_>>(), ["c@platB", "d@platB"]);
}

#[test]
fn letters_that_come_back_go_again_in_order_one_by_one() {
    let mut service = eight_ahead();
    for number in 0..5 {
        service.send(numbered("b@platB", number));
    }
    let posts = service.posts();
    assert_eq!(posts.len(), 5);
    service.take_over(&posts[0], 8);
    let lost = || PostFailure::Unreached("the network is gone".to_owned());
    service.answer(&posts[1], Err(lost()));
    let mut again = service.post();
    for letter in &posts[2..] {
        service.answer(letter, Err(lost()));
    }
    assert!(service.posts().is_empty());
    for number in 1..5 {
        assert_eq!(numbers(std::slice::from_ref(&again)), [number]);
        assert_eq!(again.in_series, number > 1);
        // Known again, but what came back waits for its turn.
        service.take_over(&again, 8);
        if number < 4 {
            again = service.post();
        }
    }
    assert!(service.posts().is_empty());
}
