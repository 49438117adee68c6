//! A daemon's mDNS in a process of its own: this test process, started again.
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use fipa_directory::{Entry, Location, MESSAGE_TRANSPORT};
use fipa_dsd::{DiscoveredAgent, DiscoveryEvent, Mdns};
use tokio::sync::mpsc;

use super::namespace::Namespace;
use super::{config, id};

/// Holds the number, the name and the endpoints of the daemon, separated by blanks.
const PEER: &str = "FIPA_DSD_PEER";
/// Begins every line that is meant for the parent.
const MARK: &str = "@@ ";

/// The other side of a started daemon.
pub(crate) struct Peer {
    process: Child,
    lines: Receiver<String>,
}

impl Peer {
    /// Starts daemon `n` with these endpoints in `namespace`; `test` is the test that calls
    /// [`run_if_asked`]. Returns once it has announced itself.
    pub(crate) fn start(namespace: &Namespace, test: &str, n: u8, endpoints: &str) -> Peer {
        let mut process = namespace
            .command(std::env::current_exe().unwrap())
            .args(["--exact", test, "--nocapture"])
            .env(PEER, format!("{n} {endpoints}"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let output = BufReader::new(process.stdout.take().unwrap());
        std::thread::spawn(move || {
            // The test harness writes its own words before ours.
            for line in output.lines().map_while(Result::ok) {
                if let Some((_, ours)) = line.split_once(MARK) {
                    let _ = sender.send(ours.to_owned());
                }
            }
        });
        let mut peer = Peer { process, lines };
        assert_eq!(
            peer.line(Duration::from_secs(10)).as_deref(),
            Some("started")
        );
        peer
    }

    /// The next line of the daemon, if one comes in time: `found <n> <addresses>`, `lost <n>`,
    /// `agent <name> <n or -> <addresses>` or `gone <name>`.
    pub(crate) fn line(&mut self, within: Duration) -> Option<String> {
        let line = self.lines.recv_timeout(within).ok();
        println!("{:?}", line.as_deref().unwrap_or("nothing"));
        line
    }

    /// Waits for a line that begins like this; tells how long that took, and the line.
    pub(crate) fn expect(&mut self, beginning: &str, within: Duration) -> (Duration, String) {
        let begun = Instant::now();
        while let Some(left) = within.checked_sub(begun.elapsed()) {
            match self.line(left) {
                Some(line) if line.starts_with(beginning) => return (begun.elapsed(), line),
                Some(_) => {}
                None => break,
            }
        }
        panic!("no `{beginning}` within {within:?}");
    }

    /// Tells the daemon `verify <n>`, `verify-agent <name>`, `withdraw <name>`, or `announce <name>`
    /// and addresses, or `quit`.
    pub(crate) fn tell(&mut self, command: &str) {
        let input = self.process.stdin.as_mut().unwrap();
        writeln!(input, "{command}").unwrap();
    }
}

impl Drop for Peer {
    /// Ends the daemon as a crash does: no goodbye.
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Plays a daemon if this process was started for that, until told to quit.
pub(crate) fn run_if_asked() {
    let Ok(spec) = std::env::var(PEER) else {
        return;
    };
    let mut words = spec.split_whitespace();
    let n = words.next().unwrap().parse().unwrap();
    let endpoints: Vec<_> = words.collect();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(run(Mdns::start(config(n, &endpoints)).unwrap()));
}

async fn run(mut mdns: Mdns) {
    mdns.set_repeat(Duration::from_secs(2));
    say("started");
    let mut commands = commands();
    loop {
        tokio::select! {
            event = mdns.next() => say(&describe(event.expect("mDNS runs"))),
            command = commands.recv() => match command.as_deref().and_then(|c| c.split_once(' ')) {
                Some(("verify", n)) => mdns.verify(id(n.parse().unwrap())).unwrap(),
                Some(("verify-agent", name)) => mdns.verify_agent(name).unwrap(),
                Some(("announce", agent)) => mdns.announce_agent(entry(agent)).unwrap(),
                Some(("withdraw", name)) => mdns.withdraw_agent(name),
                _ => return mdns.shutdown().await,
            }
        }
    }
}

/// The entry of `<name> <addresses>`.
fn entry(agent: &str) -> Entry {
    let mut words = agent.split(' ');
    let mut entry = Entry::new(words.next().unwrap());
    entry.locations = words
        .map(|address| Location {
            address: address.into(),
            signature: MESSAGE_TRANSPORT.into(),
        })
        .collect();
    entry.description = "an agent".into();
    entry
}

fn describe(event: DiscoveryEvent) -> String {
    match event {
        DiscoveryEvent::Found(peer) => {
            let addresses: Vec<_> = peer.addresses.iter().map(ToString::to_string).collect();
            format!(
                "found {} {}",
                peer.instance.as_bytes()[0],
                addresses.join(" ")
            )
        }
        DiscoveryEvent::Lost(instance) => format!("lost {}", instance.as_bytes()[0]),
        DiscoveryEvent::AgentFound(agent) => describe_agent(&agent),
        DiscoveryEvent::AgentGone { name, .. } => format!("gone {name}"),
        DiscoveryEvent::Warning(text) => format!("warning {text}"),
    }
}

/// `agent <name> <number of the daemon or -> <addresses>`.
fn describe_agent(agent: &DiscoveredAgent) -> String {
    let number = |instance: &fipa_directory::InstanceId| instance.as_bytes()[0].to_string();
    let daemon = agent.instance.as_ref().map_or("-".to_owned(), number);
    let locations = agent.entry.locations.iter();
    let addresses: Vec<_> = locations
        .map(|location| location.address.as_str())
        .collect();
    format!(
        "agent {} {daemon} {}",
        agent.entry.name,
        addresses.join(" ")
    )
}

fn say(line: &str) {
    println!("{MARK}{line}");
}

/// The lines of the standard input; the channel ends with them.
fn commands() -> mpsc::UnboundedReceiver<String> {
    let (sender, receiver) = mpsc::unbounded_channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                break;
            }
        }
    });
    receiver
}
