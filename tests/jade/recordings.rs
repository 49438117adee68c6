//! Requests as they were sent to JADE, sent to daemons of ours that bear the names of its
//! platforms; and everything that JADE was seen to send, sent to a platform of ours.

use bytes::Bytes;
use fipa::{DeliveryFailure, Message, Performative, Platform};
use fipa_codec::{Limits, decode_envelope, decode_payload};

use crate::agents::{HTTP, http_of};
use crate::fake::Jade;
use crate::replay::{jades, post, recorded, recordings, request};
use crate::support::daemon::{Daemon, Place};

/// What becomes of a recorded request here.
enum Fate {
    /// The same agent answers with the same act, content and tags as JADE's did.
    AsJade,
    /// The same agent answers with the same act and tags; what it says is compared where the AMS and
    /// the DF are tested alone.
    ActAsJade,
    /// It is answered with this act.
    With(Performative),
    /// It is taken over, and nobody answers.
    Silent,
    /// It is not taken over, or asks for something else than to be.
    Status(u16),
}

use Fate::{ActAsJade, AsJade, Silent, Status, With};
const INFORM: Fate = With(Performative::Inform);
const REFUSE: Fate = With(Performative::Refuse);
const NOT_UNDERSTOOD: Fate = With(Performative::NotUnderstood);

/// To the echo.
const ECHO: &[(&str, Fate)] = &[
    ("in_echo-base64", AsJade),
    ("in_echo-basic", AsJade),
    ("in_echo-ble", AsJade),
    // JADE makes characters of the octets.
    ("in_echo-ble-binary", INFORM),
    // JADE cannot read what has no blanks to spare.
    ("in_echo-compact", INFORM),
    ("in_echo-lowercase-act", AsJade),
    ("in_echo-quotes", AsJade),
    ("in_echo-reply-by", AsJade),
    ("in_echo-reply-by-rel", AsJade),
    ("in_echo-sender-noaddr", AsJade),
    ("in_echo-upper-hap", AsJade),
    ("in_echo-uri-path", AsJade),
    ("in_echo-userdef", AsJade),
    ("in_echo-utf8-decl", AsJade),
    // JADE takes what is beyond ASCII for nothing; it is UTF-8.
    ("in_echo-utf8-nodecl", INFORM),
    ("in_echo-word-content", AsJade),
    ("in_payload-newline-end", AsJade),
    // Nobody could read the message of which a notice would have to tell.
    ("in2_bad-rep", Silent),
    ("in2_be-echo-bytes", AsJade),
    ("in2_content-type-acl", AsJade),
    ("in2_date-T", AsJade),
    // A date as the web has it: JADE closes the connection.
    ("in2_date-bad", Status(400)),
    // JADE closes the connection.
    ("in2_env-no-date", INFORM),
    ("in2_loop-stamp2", AsJade),
    // JADE drops it; the message says itself what it is.
    ("in2_no-rep", INFORM),
    ("in2_rep-upper", AsJade),
    // The echo answers no such act.
    ("in2_unknown-performative", Silent),
    ("in2_wrong-payload-length", AsJade),
    // JADE puts blanks around what a reference stands for, here and in the other ones.
    ("in2_xml-echo", ActAsJade),
    // JADE does not take this for octets where the message is in XML.
    ("in2_xml-echo-b64", ActAsJade),
    ("in2_xml-echo-href", ActAsJade),
    // From here on the answers were not recorded. These are all taken by JADE or better than what
    // it takes; it does not know chunks, other line ends, a boundary without quotes.
    ("in2_http-acl-part-extra-after", INFORM),
    ("in2_http-blank-preamble", INFORM),
    ("in2_http-chunked2", INFORM),
    ("in2_http-conn-lower", INFORM),
    ("in2_http-conn-none", INFORM),
    ("in2_http-crlf-preamble", INFORM),
    // Header lines are not folded any more (RFC 9112 section 5.2), and JADE writes none.
    ("in2_http-ct-folded", Status(400)),
    ("in2_http-ct-nospace", INFORM),
    // It names no receiver; JADE takes it and drops it.
    ("in2_http-empty-envelope", Status(400)),
    ("in2_http-epilogue", INFORM),
    ("in2_http-expect100", INFORM),
    // The description of the platform.
    ("in2_http-get", Status(200)),
    ("in2_http-http10", INFORM),
    ("in2_http-lf-only", INFORM),
    // JADE looks for the last delimiter; it always writes a length.
    ("in2_http-no-content-length", Status(411)),
    ("in2_http-no-host", INFORM),
    ("in2_http-no-mime", INFORM),
    ("in2_http-no-tail", INFORM),
    ("in2_http-otherpath", INFORM),
    ("in2_http-part-extra-headers", INFORM),
    ("in2_http-put", Status(405)),
    ("in2_http-unquoted-boundary", INFORM),
    // It declares an entity.
    ("in2_http-xml-doctype", Status(400)),
    ("in2_http-xml-entity", INFORM),
    ("in2_http-xml-multiline", INFORM),
    ("in2_http-xml-ns", INFORM),
    ("in2_http-xml-prefix", INFORM),
];

/// To the management, in this order, as a later one may need what an earlier one did.
const MANAGEMENT: &[(&str, Fate)] = &[
    ("in_df-register", ActAsJade),
    ("in_df-search-type", ActAsJade),
    ("in_df-search-none", AsJade),
    ("in_df-search-depth", ActAsJade),
    ("in_df-lower-ontology", ActAsJade),
    ("in_df-no-protocol", ActAsJade),
    ("in_df-register-noname", ActAsJade),
    ("in_df-deregister", ActAsJade),
    ("in_df-register-lease", ActAsJade),
    ("in_df-unknown-action", ActAsJade),
    ("in_df-bad-content", ActAsJade),
    // JADE does not understand it; the standard has a reason for it: missing-argument.
    ("in_df-search-no-constraints-arg", REFUSE),
    // JADE says nothing.
    ("in_df-query-ref", NOT_UNDERSTOOD),
    ("in_df-subscribe", Silent),
    // It has a reply-with, and so is confirmed; JADE confirms none.
    ("in_df-cancel", INFORM),
    // JADE names no language, and says what its parser says.
    ("in2_df-subscribe-bad", NOT_UNDERSTOOD),
    // What JADE found was registered by a stranger.
    ("in2_df-subscribe-existing", Silent),
    ("in2_df-cancel-jade-style", INFORM),
    // Strangers speak for themselves only.
    ("in2_df-reg0", REFUSE),
    ("in2_df-dereg-pre", REFUSE),
    ("in2_df-dereg-post", REFUSE),
    ("in2_df-fed-register", REFUSE),
    ("in2_df-fed-deregister", REFUSE),
    ("in_df-deregister-notify", REFUSE),
    ("in_df-unfederate", REFUSE),
    // No DF is registered here, as the one before was a stranger.
    ("in_df-search-federated", INFORM),
    ("in2_df-fed-search-same-id", INFORM),
    ("in2_df-fed-search-same-id", AsJade),
    ("in2_df-fed-child-answer", Silent),
    ("in_ams-search-name", ActAsJade),
    // Strangers are no agents of our platform.
    ("in_ams-register", REFUSE),
    ("in_ams-search-after-register", ActAsJade),
    ("in_ams-deregister", REFUSE),
    ("in_ams-deregister-again", REFUSE),
    // JADE does not understand it; the standard has a reason for it: unsupported-function.
    ("in_ams-unknown-action", REFUSE),
];

/// To other platforms.
const ELSEWHERE: &[(&str, &[(&str, Fate)])] = &[
    (
        "fedplat",
        &[
            // Nobody makes agents here, or looks for containers.
            ("fed_create-agent", NOT_UNDERSTOOD),
            ("fed_query-agents", NOT_UNDERSTOOD),
            ("fed_query-platform", NOT_UNDERSTOOD),
            ("fed_deregister-from", ActAsJade),
        ],
    ),
    (
        "miniplat",
        &[
            ("mini_burst0", AsJade),
            ("mini_burst1", AsJade),
            ("mini_fed-register", REFUSE),
            // The stamp is that of the JADE platform of this name, and not ours.
            ("mini_loop-stamp-real", INFORM),
        ],
    ),
    ("pyplat", &[("rma_get-description", INFORM)]),
];

/// To nobody, and to the echo for others; each has a test of its own.
const APART: &[&str] = &[
    "in_echo-reply-to",
    "in_unknown-agent",
    "in_unknown-agent-ignore",
    "in_unknown-agent-inform",
    "in_unknown-agent-nocontent",
    "in2_http-pipeline2",
];

fn platform(place: &Place, name: &str) -> Daemon {
    place.start_with(name, &HTTP)
}

fn file(name: &str) -> String {
    format!("{name}.req.http")
}

/// Sends a recording and checks what becomes of it.
fn check(daemon: &Daemon, fake: &Jade, name: &str, fate: &Fate) {
    let status = match fate {
        Status(status) => *status,
        _ => 200,
    };
    let statuses = post(&http_of(daemon), &request(&file(name), fake.port), 1);
    assert_eq!(statuses, [status], "{name}");
    let act = match fate {
        Silent | Status(_) => return,
        With(act) => act.clone(),
        AsJade | ActAsJade => jades(name).performative,
    };
    let ours = fake.letter().message;
    assert_eq!(ours.performative, act, "{name}: {ours:?}");
    let sender = ours.sender.as_ref().unwrap();
    assert_eq!(sender.addresses, [http_of(daemon).as_str()], "{name}");
    if !matches!(fate, AsJade | ActAsJade) {
        return;
    }
    let jades = jades(name);
    assert_eq!(sender.name, jades.sender.as_ref().unwrap().name, "{name}");
    assert_eq!(ours.in_reply_to, jades.in_reply_to, "{name}");
    assert_eq!(ours.conversation_id, jades.conversation_id, "{name}");
    assert_eq!(ours.protocol, jades.protocol, "{name}");
    assert_eq!(ours.language, jades.language, "{name}");
    assert_eq!(ours.ontology, jades.ontology, "{name}");
    if matches!(fate, AsJade) {
        assert_eq!(ours.content, jades.content, "{name}");
    }
}

#[test]
fn every_recorded_request_to_an_echo_agent_gets_its_answer() {
    let (place, fake) = (Place::new(), Jade::silent("pyplat"));
    let daemon = platform(&place, "platA");
    let _echo = daemon.attach("echo", "echo@platA");
    for (name, fate) in ECHO {
        check(&daemon, &fake, name, fate);
    }
    fake.nothing_comes();
}

#[test]
fn every_recorded_request_to_the_management_gets_its_answer() {
    let (place, fake) = (Place::new(), Jade::silent("pyplat"));
    let daemon = platform(&place, "platA");
    for (name, fate) in MANAGEMENT {
        check(&daemon, &fake, name, fate);
    }
    fake.nothing_comes();
}

#[test]
fn every_recorded_request_to_other_platforms_gets_its_answer() {
    for (platform_name, cases) in ELSEWHERE {
        let (place, fake) = (Place::new(), Jade::silent("pyplat"));
        let daemon = platform(&place, platform_name);
        let _echo = daemon.attach("echo", &format!("echo@{platform_name}"));
        for (name, fate) in *cases {
            check(&daemon, &fake, name, fate);
        }
        fake.nothing_comes();
    }
}

#[test]
fn no_recorded_request_is_left_out() {
    let tables = [ECHO, MANAGEMENT].into_iter();
    let tables = tables.chain(ELSEWHERE.iter().map(|(_, cases)| *cases));
    let mut names: Vec<&str> = tables.flatten().map(|(name, _)| *name).collect();
    names.extend(APART);
    names.sort_unstable();
    names.dedup();
    assert_eq!(names, recordings(".req.http"));
}

#[test]
fn an_echo_goes_to_all_who_are_to_have_the_answer() {
    let (place, fake) = (Place::new(), Jade::silent("pyplat"));
    let daemon = platform(&place, "platA");
    let _echo = daemon.attach("echo", "echo@platA");
    let octets = request(&file("in_echo-reply-to"), fake.port);
    assert_eq!(post(&http_of(&daemon), &octets, 1), [200]);
    let answers = [fake.letter(), fake.letter()];
    let mut names: Vec<_> = answers
        .iter()
        .map(|answer| {
            assert_eq!(answer.message.content_str(), Some("r"));
            assert_eq!(answer.message.receiver.len(), 2);
            answer.letter.envelope.intended_receiver()[0].name.clone()
        })
        .collect();
    names.sort();
    assert_eq!(names, ["boss@pyplat", "deputy@pyplat"]);
    // Two requests that are sent at once are answered one after the other.
    let octets = request(&file("in2_http-pipeline2"), fake.port);
    assert_eq!(post(&http_of(&daemon), &octets, 2), [200, 200]);
    for _ in 0..2 {
        assert_eq!(fake.letter().message.performative, Performative::Inform);
    }
}

#[test]
fn who_writes_to_nobody_is_told_by_the_ams_as_jade_does() {
    let (place, fake) = (Place::new(), Jade::silent("pyplat"));
    let daemon = platform(&place, "platA");
    let url = http_of(&daemon);
    let octets = request(&file("in_unknown-agent-ignore"), fake.port);
    assert_eq!(post(&url, &octets, 1), [200]);
    for name in [
        "in_unknown-agent",
        "in_unknown-agent-inform",
        "in_unknown-agent-nocontent",
    ] {
        assert_eq!(post(&url, &request(&file(name), fake.port), 1), [200]);
        let (ours, jades) = (fake.letter().message, jades(name));
        assert_eq!(ours.performative, jades.performative, "{name}");
        assert_eq!(ours.in_reply_to, jades.in_reply_to, "{name}");
        assert_eq!(ours.conversation_id, jades.conversation_id, "{name}");
        assert_eq!(ours.protocol, jades.protocol, "{name}");
        let [ours, jades] = [ours, jades].map(|told| DeliveryFailure::of(&told).unwrap());
        assert_eq!(ours.receivers[0].name, jades.receivers[0].name, "{name}");
        let [ours, jades] = [ours, jades].map(|told| told.service.unwrap().name);
        assert_eq!(ours, jades, "{name}");
    }
    fake.nothing_comes();
}

/// The message that a recording holds, as it is read without any transport.
fn message_of(name: &str) -> Message {
    let [envelope, payload] = ["env.xml", "acl"].map(|part| recorded(&format!("{name}.{part}")));
    let (envelope, _) = decode_envelope(&Bytes::from(envelope), &Limits::default()).unwrap();
    decode_payload(&envelope, &Bytes::from(payload), &Limits::default()).unwrap()
}

/// Where the platform that JADE wrote to takes letters.
async fn pyplat() -> Platform {
    let builder = Platform::builder().name("pyplat").mdns(false);
    builder.http("127.0.0.1:0", "/acc").start().await.unwrap()
}

#[test]
fn everything_that_jade_was_seen_to_send_reaches_its_receiver_as_it_is() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let platform = runtime.block_on(pyplat());
    let url = platform.http_urls()[0].to_string();
    let names = ["pyagent@pyplat", "second@pyplat", "third@otherplat"];
    let agents = names.map(|name| runtime.block_on(platform.agent(name)).unwrap());
    let fake = Jade::silent("capplat");
    let (mut received, mut answered) = (0, 0);
    for name in recordings(".env.xml") {
        let octets = request(&format!("{name}.http"), fake.port);
        assert_eq!(post(&url, &octets, 1), [200], "{name}");
        let (envelope, _) = decode_envelope(
            &Bytes::from(recorded(&format!("{name}.env.xml"))),
            &Limits::default(),
        )
        .unwrap();
        let to = &envelope.intended_receiver()[0].name;
        let Some(agent) = agents.iter().find(|agent| agent.name() == to) else {
            // To its AMS or its DF.
            if !name.ends_with("df-cancel") && !name.ends_with("df-subscribe") {
                assert_eq!(fake.letter().message.sender.unwrap().name, *to, "{name}");
            }
            answered += 1;
            continue;
        };
        let message = runtime.block_on(agent.receive()).unwrap();
        let mut wanted = message_of(&name);
        // The addresses of the fake are those of this run.
        wanted.sender = message.sender.clone();
        assert_eq!(message.receiver.len(), wanted.receiver.len(), "{name}");
        wanted.receiver = message.receiver.clone();
        wanted.reply_to = message.reply_to.clone();
        assert_eq!(message, wanted, "{name}");
        received += 1;
    }
    assert_eq!((received, answered), (105, 8));
}
