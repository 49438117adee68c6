//! How soon a daemon that joins late knows all agents of another one.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use fipa::prelude::*;
use fipa_benches::daemons::{self, Daemon};

fn main() -> ExitCode {
    if daemons::is_daemon() {
        return fipa_daemon::main();
    }
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .expect("a runtime");
    println!("agents    registered ms   known to a late joiner ms   gone when it is killed ms");
    for agents in [1_000, 10_000] {
        runtime.block_on(measure(agents));
    }
    ExitCode::SUCCESS
}

async fn measure(count: usize) {
    let folder = tempfile::tempdir().expect("a folder");
    let one = Daemon::start(folder.path(), "robot1", &[]);
    let platform = Platform::attach_to(one.control()).await.expect("robot1");
    let begun = Instant::now();
    let mut agents = Vec::with_capacity(count);
    for n in 0..count {
        let name = format!("agent{n}@robot1");
        agents.push(platform.agent(name).await.expect("an agent"));
    }
    let registered = begun.elapsed();

    // From the start of the process to the directory in the hands of a program there.
    let begun = Instant::now();
    let two = Daemon::start(folder.path(), "robot2", &[one.endpoint()]);
    let late = Platform::attach_to(two.control()).await.expect("robot2");
    until(|| late.find(agents[count - 1].name()).is_some()).await;
    let known = begun.elapsed();
    let found = late.search(".*").expect("a pattern");
    assert_eq!(found.len(), count, "all or none");

    let begun = Instant::now();
    drop(one);
    until(|| late.search(".*").expect("a pattern").is_empty()).await;
    let gone = begun.elapsed();
    let ms = |span: Duration| span.as_secs_f64() * 1e3;
    println!(
        "{count:6}    {:13.1}   {:25.1}   {:25.1}",
        ms(registered),
        ms(known),
        ms(gone)
    );
}

async fn until(reached: impl Fn() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while !reached() {
        assert!(Instant::now() < deadline, "not reached in a minute");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}
