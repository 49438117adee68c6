//! How long the monitor takes to judge one message among 100,000 conversations.
//!
//! Every message is of another conversation, and not in the order in which they began, so that what
//! the monitor knows of it is rarely in the processor's caches; the message itself is, as it was just
//! decoded. The last rows stay with one conversation.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use fipa_acl::{Message, Performative};
use fipa_conversation::{Config, Monitor, Verdict};
use fipa_directory::Now;
use fipa_protocol::Library;

const CONVERSATIONS: usize = 100_000;
const BIDDERS: usize = 20;

/// Messages that are timed together: so few that other programs rarely come in between. The median of
/// them is told, and what nine of ten stay below.
const CHUNK: usize = 200;

fn main() {
    println!("{CONVERSATIONS} conversations               ns median      p90");
    let library = Arc::new(Library::builtin());
    one_to_one(&library);
    contract_nets(&library);
    subscription(&library);
}

fn one_to_one(library: &Arc<Library>) {
    let mut monitor = monitor(library, "arm@robot1");
    time(
        "begin fipa-request",
        request,
        |message| take(&mut monitor, message),
        true,
    );
    let say = |act: Performative| {
        move |n| {
            request(scattered(n))
                .reply(act.clone())
                .from_agent("drive@robot2")
        }
    };
    let agree = say(Performative::Agree);
    time(
        "ask about agree",
        &agree,
        |message| monitor.judge_outgoing(Now::default(), message),
        true,
    );
    time(
        "take agree",
        &agree,
        |message| take(&mut monitor, message),
        true,
    );
    let wrong = say(Performative::Propose);
    time(
        "explain a violation",
        wrong,
        |message| take(&mut monitor, message),
        false,
    );
    let inform = say(Performative::Inform);
    time(
        "take inform, the end",
        inform,
        |message| take(&mut monitor, message),
        true,
    );
}

/// As many participants, in conversations of 20.
fn contract_nets(library: &Arc<Library>) {
    let mut monitor = monitor(library, "buyer@robot1");
    for number in 0..CONVERSATIONS / BIDDERS {
        take(&mut monitor, &call(number));
    }
    let propose = |n| {
        let n = scattered(n);
        let call = call(n / BIDDERS);
        call.reply(Performative::Propose)
            .from_agent(bidder(n % BIDDERS))
    };
    time(
        "take a proposal of one of 20",
        propose,
        |message| take(&mut monitor, message),
        true,
    );
}

/// What is told again and again in one subscription, beside all the others.
fn subscription(library: &Arc<Library>) {
    let mut monitor = monitor(library, "arm@robot1");
    for number in 0..CONVERSATIONS {
        take(&mut monitor, &request(number));
    }
    let subscribe = Message {
        performative: Performative::Subscribe,
        ..request(CONVERSATIONS)
    };
    let subscribe = subscribe.protocol("fipa-subscribe");
    take(&mut monitor, &subscribe);
    let say = |act: Performative| {
        let message = subscribe.reply(act).from_agent("drive@robot2");
        move |_| message.clone()
    };
    let inform = say(Performative::Inform);
    time(
        "take inform of a subscription",
        inform,
        |message| take(&mut monitor, message),
        true,
    );
    let wrong = say(Performative::Agree);
    time(
        "explain a violation there",
        wrong,
        |message| take(&mut monitor, message),
        false,
    );
}

fn monitor(library: &Arc<Library>, own: &str) -> Monitor {
    Monitor::new(Arc::clone(library), Some(own.into()), Config::default())
}

/// Observers take the events at once.
fn take(monitor: &mut Monitor, message: &Message) -> Verdict {
    let verdict = monitor.observe(Now::default(), message);
    while monitor.poll_event().is_some() {}
    verdict
}

fn time(
    what: &str,
    make: impl Fn(usize) -> Message,
    mut judge: impl FnMut(&Message) -> Verdict,
    accepted: bool,
) {
    let mut as_expected = 0;
    let mut each: Vec<u128> = Vec::new();
    for chunk in 0..CONVERSATIONS / CHUNK {
        let numbers = chunk * CHUNK..(chunk + 1) * CHUNK;
        let messages: Vec<Message> = numbers.map(&make).collect();
        let start = Instant::now();
        for message in &messages {
            let verdict = black_box(judge(black_box(message)));
            as_expected += usize::from(matches!(verdict, Verdict::Accepted { .. }) == accepted);
        }
        each.push(start.elapsed().as_nanos() / CHUNK as u128);
    }
    each.sort_unstable();
    let (median, p90) = (each[each.len() / 2], each[each.len() * 9 / 10]);
    assert_eq!(as_expected, CONVERSATIONS, "{what}");
    println!("    {what:32} {median:>8} {p90:>8}");
}

/// Every number below that of the conversations, once, scattered.
fn scattered(number: usize) -> usize {
    number * 7_919 % CONVERSATIONS
}

fn request(number: usize) -> Message {
    Message::new(Performative::Request)
        .from_agent("arm@robot1")
        .to("drive@robot2")
        .protocol("fipa-request")
        .conversation_id(format!("5f0c1f04-6f3e-4c7e--dock--{number}"))
        .reply_with("r-1")
}

fn call(number: usize) -> Message {
    let call = (0..BIDDERS).fold(Message::new(Performative::Cfp), |call, n| {
        call.to(bidder(n))
    });
    call.from_agent("buyer@robot1")
        .protocol("fipa-contract-net")
        .conversation_id(format!("cfp-{number}"))
}

fn bidder(number: usize) -> String {
    format!("bidder{number}@robot{number}")
}
