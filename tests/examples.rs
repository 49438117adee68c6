//! The examples, as two robots would run them.

mod support;

use std::path::PathBuf;
use std::process::Command;

use support::namespace::Namespace;
use support::process::Process;

#[test]
fn request_is_answered_by_serve() {
    // They speak mDNS at its usual port, where others of this machine would hear them.
    let Some(host) = Namespace::new() else {
        return;
    };
    let mut serve = Process::start(host.enter(&example("serve")));
    assert_eq!(serve.line(), "drive@robot2 is there");
    let request = Process::start(host.enter(&example("request"))).wait();
    assert_eq!(request.code, Some(0), "{request:?}");
    assert_eq!(request.output, ["inform: at the dock"]);
    assert_eq!(serve.line(), "go to the dock");
    assert_eq!(serve.line(), "the answer is delivered");
}

/// An example, which cargo builds beside the tests.
fn example(name: &str) -> Command {
    let test = std::env::current_exe().unwrap();
    let target = test.ancestors().nth(2).unwrap();
    let example: PathBuf = target.join("examples").join(name);
    Command::new(example)
}
