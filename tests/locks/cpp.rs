//! Agents that talk as those of the C++ library are recorded to: they know no numbers.

use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use fipa::blocking::{Agent, Platform};
use fipa::{Message, Performative};

use crate::robots::Member;
use crate::support::PATIENCE;
use crate::support::daemon::Place;
use crate::support::process::run;

const ALGORITHM: &str = "ricart_agrawala_extended";

/// The owner of `arm`, until its platform has ended; hands on who has or gives back the resource.
fn own(agent: &Agent, told: &Sender<String>) {
    while let Ok(message) = agent.receive() {
        let protocol = message.protocol.as_deref().unwrap_or_default();
        let reply = |act, content: &'static str| message.reply(act).content(content);
        let answer = match (protocol, &message.performative) {
            ("dlm_discover", Performative::QueryIf) => reply(Performative::Inform, "arm"),
            ("dlm_probe", Performative::Request) => message.reply(Performative::Confirm),
            (ALGORITHM, Performative::Request) => reply(Performative::Agree, "7\narm"),
            (ALGORITHM, act) => {
                let content = message.content_str().unwrap();
                let sender = &message.sender.as_ref().unwrap().name;
                // The test may be over.
                let _ = told.send(format!("{act} {content} {sender}"));
                continue;
            }
            _ => continue,
        };
        agent.send(answer);
    }
}

#[test]
fn a_command_at_a_cpp_owner_starts_after_a_heartbeat_without_a_number_and_with_a_warning() {
    let place = Place::new();
    let daemon = place.start("robot1");
    let platform = Platform::attach_to(&daemon.control).unwrap();
    let agent = platform.agent("owner.cpp").unwrap();
    let (sender, told) = channel();
    thread::spawn(move || own(&agent, &sender));

    let member = Member::at(&daemon);
    let options = ["--with", r"owner\.cpp|a@.*", "--heartbeat", "0.4"];
    let script = "echo ${FIPA_LOCK_FENCING-unset}; exit 3";
    let mut command = member.lock("arm", &options, script);
    command.env("FIPA_LOCK_FENCING", "17");
    let began = Instant::now();
    let ended = run(command);
    assert!(began.elapsed() >= Duration::from_millis(400));
    assert_eq!(ended.code, Some(3), "{ended:?}");
    assert_eq!(ended.output, ["unset"]);
    let said = ended.only_error();
    assert!(
        said.starts_with("fipa lock: arm: its owner gives no number"),
        "{said}"
    );
    for expected in ["confirm arm a@robot1", "disconfirm arm a@robot1"] {
        assert_eq!(told.recv_timeout(PATIENCE).unwrap(), expected);
    }
}

#[test]
fn a_cpp_holder_at_our_owner_has_no_number_and_is_waited_for() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &["--owns", "arm"]);
    let platform = Platform::attach_to(&daemon.control).unwrap();
    let cpp = platform.agent("holder.cpp").unwrap();
    let say = |act: Performative, content: &'static str| {
        let message = Message::new(act)
            .to("locks@robot1")
            .protocol(ALGORITHM)
            .conversation_id("holder.cpp_1")
            .content(content);
        assert!(cpp.send(message)[0].outcome.is_success());
    };
    say(Performative::Request, "1\narm");
    let agree = cpp.receive_timeout(PATIENCE).unwrap().unwrap();
    assert_eq!(agree.performative, Performative::Agree);
    say(Performative::Confirm, "arm");
    // The owner probes whoever holds, and sends no number to who did not ask for one.
    let probe = cpp.receive_timeout(PATIENCE).unwrap().unwrap();
    assert_eq!(probe.protocol.as_deref(), Some("dlm_probe"));
    assert!(probe.user_defined.is_empty());
    cpp.send(probe.reply(Performative::Confirm));

    let listed = daemon.run(&["lock", "list", "--json"]).only_json();
    assert_eq!(listed["holder"], "holder.cpp");
    assert!(listed["fencing"].is_null(), "{listed}");
    let member = Member::at(&daemon);
    let late = run(member.lock("arm", &["--timeout", "0.3"], "true"));
    assert_eq!(late.code, Some(1), "{late:?}");
    say(Performative::Disconfirm, "arm");
    let ended = run(member.lock("arm", &[], "test $FIPA_LOCK_FENCING -gt 1000000000000"));
    assert_eq!(ended.code, Some(0), "{ended:?}");
}
