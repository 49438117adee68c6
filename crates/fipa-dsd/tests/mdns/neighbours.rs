//! Agents in the directory of C++ robots: theirs are found, ours are announced.
use std::time::{Duration, Instant};

use fipa_directory::{Entry, MESSAGE_TRANSPORT};
use fipa_dsd::{DiscoveryEvent, LeftOut, Mdns};

use crate::support::cpp::{Avahi, CppRobot, can_play_cpp_robot, can_run, recorded_form};
use crate::support::namespace::can_unshare;
use crate::support::{agent, config, event, id, on_loopback, peer, two_hosts};

const SOON: Duration = Duration::from_secs(10);
/// Longer than any answer takes that could still come.
const QUIET: Duration = Duration::from_secs(3);

fn publish(robot: &mut CppRobot, label: &str, addresses: &[&str]) {
    let strings = recorded_form(addresses);
    let strings: Vec<&str> = strings.iter().map(String::as_str).collect();
    robot.publish(label, &strings);
}

#[test]
fn a_cpp_robot_is_found_and_one_goodbye_is_that_of_one() {
    if !can_unshare() || !can_play_cpp_robot() {
        return;
    }
    let (a, b) = two_hosts();
    let mut one = peer(&a, 1, "0.0.0.0:7001");
    let mut robot = CppRobot::start(&b, "10.77.0.2");
    publish(&mut robot, "agent-a", &["tcp://10.77.0.2:39623"]);
    one.expect("agent agent-a - tcp://10.77.0.2:39623", SOON);

    // A locator that fills a string and goes on in a second one.
    let four = [
        "tcp://10.77.0.2:40000",
        "tcp://10.77.1.2:40001",
        "tcp://10.77.2.2:40002",
        "tcp://10.77.3.2:40003",
    ];
    publish(&mut robot, "agent-long", &four);
    let (_, line) = one.expect("agent agent-long", SOON);
    assert_eq!(line, format!("agent agent-long - {}", four.join(" ")));

    let bridge = [
        "TYPE=mts_client",
        "LOCATOR=tcp://10.77.0.2:6789 JadeProxyAgent",
        "DESCRIPTION=Message proxy",
        "TIMESTAMP=20261122-06:53:05:919000",
    ];
    robot.publish("da0@192?168?0?1:1099/JADE", &bridge);
    let (_, line) = one.expect("agent da0", SOON);
    assert_eq!(
        line,
        "agent da0@192.168.0.1:1099/JADE - tcp://10.77.0.2:6789"
    );

    // A late comer finds all, too.
    let mut late = peer(&a, 2, "0.0.0.0:7002");
    for _ in 0..3 {
        late.expect("agent ", SOON);
    }

    robot.withdraw("agent-a");
    one.expect("gone agent-a", SOON);
    while let Some(line) = one.line(QUIET) {
        assert!(line.starts_with("found 2"), "{line}");
    }
}

#[test]
fn a_cpp_robot_that_died_is_gone_when_asked_for() {
    if !can_unshare() || !can_play_cpp_robot() {
        return;
    }
    let (a, b) = two_hosts();
    let mut one = peer(&a, 1, "0.0.0.0:7001");
    let mut robot = CppRobot::start(&b, "10.77.0.2");
    publish(&mut robot, "agent-a", &["tcp://10.77.0.2:39623"]);
    one.expect("agent agent-a", SOON);
    // Who lives answers.
    one.tell("verify-agent agent-a");
    assert_eq!(one.line(QUIET), None);
    drop(robot);
    one.tell("verify-agent agent-a");
    let (time, _) = one.expect("gone agent-a", SOON);
    println!("gone {time:?} after it was asked for");
    // It comes back under the same name.
    let mut robot = CppRobot::start(&b, "10.77.0.2");
    publish(&mut robot, "agent-a", &["tcp://10.77.0.2:39624"]);
    one.expect("agent agent-a - tcp://10.77.0.2:39624", SOON);
}

#[test]
fn avahi_shows_our_agents() {
    let has_avahi = || can_run("avahi and dbus-daemon", "sh", &["-c", AVAHI]);
    if !can_unshare() || !has_avahi() {
        return;
    }
    let (a, b) = two_hosts();
    let mut one = peer(&a, 1, "0.0.0.0:7001");
    one.tell("announce drive.left@robot1 tcp://[::1]:1 quic://10.77.0.1:7002 tcp://0.0.0.0:7001");
    one.tell("announce Arm@robot1 tcp://0.0.0.0:7001");
    let avahi = Avahi::start(&b, "cable");
    let lines = wait_for(|| {
        let lines = avahi.browse(&b, "_fipa_service_directory._udp");
        let resolved = lines.iter().filter(|line| line.starts_with("=;"));
        let mut resolved: Vec<_> = resolved.cloned().collect();
        resolved.sort();
        (resolved.len() == 2).then_some(resolved)
    });
    println!("{lines:#?}");
    let arm: Vec<&str> = lines[0].split(';').collect();
    assert_eq!(arm[1..4], ["cable", "IPv4", "Arm\\064robot1"]);
    let fields: Vec<&str> = lines[1].splitn(10, ';').collect();
    assert_eq!(fields[3], "drive\\063left\\064robot1");
    // Host, address and port.
    assert!(
        fields[6].starts_with("fipa-0101010101010101-"),
        "{fields:?}"
    );
    assert_eq!(fields[7..9], ["10.77.0.1", "0"]);
    let transport = MESSAGE_TRANSPORT;
    // avahi shows the last string first.
    let expected = [
        format!("\"ID={}\"", id(1)),
        "\"TIMESTAMP=19700101-00:00:00:000000\"".to_owned(),
        "\"DESCRIPTION=an agent\"".to_owned(),
        format!("\"LOCATOR=tcp://10.77.0.1:7001 {transport};quic://10.77.0.1:7002 fipa.quic;\""),
        format!("\"TYPE={transport}\""),
    ];
    assert_eq!(fields[9], expected.join(" "));

    one.tell("withdraw drive.left@robot1");
    wait_for(|| {
        let lines = avahi.browse(&b, "_fipa_service_directory._udp");
        let resolved: Vec<_> = lines.iter().filter(|l| l.starts_with("=;")).collect();
        println!("{resolved:?}");
        // The other one is there all the time.
        assert!(
            resolved.iter().any(|line| line.contains(";Arm")),
            "{lines:?}"
        );
        (resolved.len() == 1).then_some(())
    });
}

const AVAHI: &str = "command -v avahi-daemon avahi-browse dbus-daemon mount";

/// Waits for something to come true.
fn wait_for<T>(mut what: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(20) {
        if let Some(found) = what() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(250));
    }
    panic!("it does not come true");
}

fn numbered(i: usize) -> Entry {
    agent(&format!("agent-{i}@robot1"))
}

/// The names of agents that are found and gone until it is quiet.
async fn agents_seen(mdns: &mut Mdns) -> (Vec<String>, Vec<String>) {
    let (mut found, mut gone) = (Vec::new(), Vec::new());
    while let Some(event) = event(mdns, QUIET).await {
        match event {
            DiscoveryEvent::AgentFound(agent) => {
                assert_eq!(agent.instance, Some(id(1)));
                found.push(agent.entry.name.to_string());
            }
            DiscoveryEvent::AgentGone { name, instance } => {
                assert_eq!(instance, Some(id(1)));
                gone.push(name.to_string());
            }
            DiscoveryEvent::Found(_) => {}
            other => panic!("{other:?}"),
        }
    }
    (found, gone)
}

#[test]
fn two_hundred_of_a_thousand_agents_are_announced() {
    let test = "neighbours::two_hundred_of_a_thousand_agents_are_announced";
    on_loopback(test, two_hundred_of_a_thousand);
}

async fn two_hundred_of_a_thousand() {
    let mut one = Mdns::start(config(1, &["127.0.0.1:7001"])).unwrap();
    let mut two = Mdns::start(config(2, &["127.0.0.1:7002"])).unwrap();
    let report = one.set_agents((0..1000).map(numbered));
    assert_eq!((report.announced, report.waiting), (200, 800));
    assert_eq!(one.announce_agent(numbered(1000)), Err(LeftOut::Limit(200)));
    let (commands, mut run) = tokio::sync::mpsc::unbounded_channel::<&str>();
    let announcing = tokio::spawn(async move {
        loop {
            tokio::select! {
                event = one.next() => assert!(!is_of_agent(&event.unwrap())),
                command = run.recv() => match command {
                    Some(name) => one.withdraw_agent(name),
                    None => return one.shutdown().await,
                },
            }
        }
    });
    let (mut found, gone) = agents_seen(&mut two).await;
    found.sort();
    found.dedup();
    assert_eq!((found.len(), gone.len()), (200, 0));

    // One leaves, one takes its place, and nobody sees another one flicker.
    commands.send("agent-7@robot1").unwrap();
    let (found, gone) = agents_seen(&mut two).await;
    assert_eq!(gone, ["agent-7@robot1"]);
    assert_eq!(found, ["agent-200@robot1"]);

    // A late comer finds them all at once.
    let mut late = Mdns::start(config(3, &["127.0.0.1:7003"])).unwrap();
    let (mut found, gone) = agents_seen(&mut late).await;
    found.sort();
    found.dedup();
    assert_eq!((found.len(), gone.len()), (200, 0));
    late.shutdown().await;

    // A daemon that shuts down takes all of them along.
    drop(commands);
    announcing.await.unwrap();
    let mut gone = 0;
    while let Some(event) = event(&mut two, QUIET).await {
        gone += usize::from(is_of_agent(&event));
        assert!(!matches!(event, DiscoveryEvent::AgentFound(_)));
    }
    assert_eq!(gone, 200);
    two.shutdown().await;
}

fn is_of_agent(event: &DiscoveryEvent) -> bool {
    matches!(
        event,
        DiscoveryEvent::AgentFound(_) | DiscoveryEvent::AgentGone { .. }
    )
}
