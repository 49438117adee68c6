//! Whether others reach a service: who is called back, where, and how often.
mod support;

use fipa_acl::Text;
use fipa_directory::{Address, InstanceId};
use fipa_link::{AskCallBack, CallBack, CallBackResult, CalledBack, Frame, Role};
use fipa_mts::{Config, ConnId, Ended, Machine, Output};

use support::{PARTNER, Raw, secs};

/// A service whose partner is linked from 10.0.0.9.
fn linked() -> Raw {
    let mut config = Config::new(InstanceId::from_bytes([1; 16]), "here");
    config.endpoints = vec!["tcp://10.0.0.1:4100".parse().unwrap()];
    Raw::with(config, Role::Daemon, false, "tcp://10.0.0.9:40000")
}

fn ask(raw: &mut Raw, request: u64, addresses: &[&str]) {
    let addresses = addresses.iter().map(|address| Text::from(*address));
    raw.say(Frame::AskCallBack(AskCallBack {
        request,
        whom: PARTNER,
        addresses: addresses.collect(),
    }));
}

/// The calls that the service wants made.
fn wanted(raw: &Raw) -> Vec<(u64, InstanceId, Vec<String>)> {
    let calls = raw.outputs.iter().filter_map(|output| match output {
        Output::CallBack {
            call,
            whom,
            addresses,
        } => {
            let addresses = addresses.iter().map(Address::to_string).collect();
            Some((*call, *whom, addresses))
        }
        _ => None,
    });
    calls.collect()
}

/// What the service tells whoever asked it by a ticket.
fn told(raw: &Raw) -> Vec<(u64, &str)> {
    let told = raw.outputs.iter().filter_map(|output| match output {
        Output::CalledBack { ticket, called } => Some((*ticket, called.refusal.as_str())),
        _ => None,
    });
    told.collect()
}

fn answers(raw: &Raw) -> Vec<&CalledBack> {
    let answers = raw.heard.iter().filter_map(|frame| match frame {
        Frame::CalledBack(called) => Some(called),
        _ => None,
    });
    answers.collect()
}

#[test]
fn who_asks_is_called_at_the_host_that_its_link_comes_from_and_nowhere_else() {
    let mut raw = linked();
    let elsewhere = ["tcp://10.0.0.8:22", "tcp://robot:22", "unix:///x", "?"];
    let asked = [&["tcp://10.0.0.9:4100"][..], &elsewhere].concat();
    ask(&mut raw, 7, &asked);
    let [(call, whom, addresses)] = &wanted(&raw)[..] else {
        panic!("{:?}", raw.outputs);
    };
    assert_eq!(*whom, PARTNER);
    assert_eq!(addresses, &["tcp://10.0.0.9:4100"]);
    assert!(answers(&raw).is_empty());

    let answered = CallBack {
        address: "tcp://10.0.0.9:4100".into(),
        result: CallBackResult::Answered,
        reason: Text::default(),
    };
    raw.mts.called_back(raw.now, *call, vec![answered.clone()]);
    raw.exchange();
    let [called] = answers(&raw)[..] else {
        panic!("{:?}", raw.heard);
    };
    assert_eq!((called.request, called.refusal.as_str()), (7, ""));
    assert_eq!(called.calls[0], answered);
    let untried = &called.calls[1..];
    let addresses: Vec<&str> = untried.iter().map(|c| c.address.as_str()).collect();
    assert_eq!(addresses, elsewhere);
    let not_called = |call: &CallBack| call.result == CallBackResult::Untried;
    assert!(untried.iter().all(not_called));
}

#[test]
fn eight_addresses_are_called_at_most() {
    let mut raw = linked();
    let many: Vec<String> = (1..100).map(|p| format!("tcp://10.0.0.9:{p}")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    ask(&mut raw, 1, &many);
    assert_eq!(wanted(&raw)[0].2, many[..8]);
}

#[test]
fn others_are_called_back_ten_times_a_minute_at_most() {
    let mut raw = linked();
    for request in 1..=11 {
        ask(&mut raw, request, &["tcp://10.0.0.9:4100"]);
    }
    assert_eq!(wanted(&raw).len(), 10);
    let [refused] = answers(&raw)[..] else {
        panic!("{:?}", raw.heard);
    };
    assert_eq!(refused.request, 11);
    assert!(!refused.refusal.is_empty() && refused.calls.is_empty());
    raw.now = raw.now.plus(secs(60));
    ask(&mut raw, 12, &["tcp://10.0.0.9:4100"]);
    assert_eq!(wanted(&raw).len(), 11);
}

#[test]
fn a_program_learns_from_another_service_whether_that_reaches_its_own() {
    let mut raw = Raw::new(Role::Program);
    raw.say(Frame::AskCallBack(AskCallBack {
        request: 3,
        whom: PARTNER,
        addresses: Vec::new(),
    }));
    let [called] = answers(&raw)[..] else {
        panic!("{:?}", raw.heard);
    };
    assert_eq!(called.request, 3);
    assert_eq!(called.refusal, "there is no link with it");
    assert!(wanted(&raw).is_empty());
}

#[test]
fn the_question_is_passed_on_with_the_own_endpoints_and_only_who_was_asked_answers_it() {
    let mut raw = linked();
    raw.mts.ask_call_back(raw.now, 5, PARTNER);
    raw.exchange();
    let asked = raw.heard.iter().find_map(|frame| match frame {
        Frame::AskCallBack(ask) => Some(ask.clone()),
        _ => None,
    });
    let asked = asked.expect("a question");
    assert_eq!(asked.whom, raw.mts.config().instance);
    assert_eq!(asked.addresses, ["tcp://10.0.0.1:4100"]);
    let answer = |request| {
        Frame::CalledBack(CalledBack {
            request,
            refusal: "not now".into(),
            calls: Vec::new(),
        })
    };
    raw.say(answer(asked.request + 1));
    assert_eq!(told(&raw), []);
    raw.say(answer(asked.request));
    raw.say(answer(asked.request));
    assert_eq!(told(&raw), [(5, "not now")]);
}

#[test]
fn a_link_that_ends_answers_what_waits_for_it() {
    let mut raw = linked();
    raw.mts.ask_call_back(raw.now, 9, PARTNER);
    let ended = Ended {
        reason: "broken",
        orderly: false,
        all_written: true,
    };
    raw.mts.closed(raw.now, ConnId(1), ended);
    raw.outputs
        .extend(std::iter::from_fn(|| raw.mts.poll_output()));
    assert_eq!(told(&raw), [(9, "the link with it has ended")]);
}
