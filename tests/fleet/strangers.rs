//! Strangers are refused, that is told with the reason, and nothing comes of what they say.

use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use fipa_fleet::Folder;
use rustix::process::Signal;

use crate::place::{Fleet, agents, now, refused, socket_address};
use crate::stranger::{Intrusion, letter};
use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place, tool};
use crate::support::process::{Process, run};

const DAY: Duration = Duration::from_secs(24 * 3600);

/// A robot with an agent that would print what it is sent.
struct Home {
    fleet: Fleet,
    daemon: Daemon,
    sink: Process,
}

impl Home {
    fn new() -> Home {
        let fleet = Fleet::new();
        fleet.join("robot1");
        let mut command = fleet.fipad("robot1", &[]);
        for scheme in ["tcp", "quic"] {
            command.args(["--listen", &format!("{scheme}://127.0.0.1:0")]);
        }
        let daemon = Daemon::start(command);
        let sink = daemon.attach_with(&["listen", "--as", "sink@robot1", "--json"]);
        Home {
            fleet,
            daemon,
            sink,
        }
    }

    fn address(&self) -> &str {
        socket_address(&self.daemon)
    }

    /// Where it listens: over TCP, and over QUIC.
    fn endpoints(&self) -> [String; 2] {
        [0, 1].map(|n| {
            self.daemon.ready["endpoints"][n]
                .as_str()
                .unwrap()
                .to_owned()
        })
    }

    /// Nothing was delivered, and nobody is known who was not known before.
    fn stays_untouched(self) {
        assert_eq!(agents(&self.daemon), ["sink@robot1"]);
        self.sink.signal(Signal::TERM);
        let ended = self.sink.wait();
        assert_eq!(ended.output, [""; 0], "nothing may be delivered");
    }
}

#[test]
fn a_robot_of_the_fleet_is_let_in() {
    for over in 0..2 {
        let mut home = Home::new();
        let robot2 = home.fleet.join("robot2");
        let honest = Intrusion::honest("robot2", "arm@robot2");
        let answer = honest.secretly(&home.endpoints()[over], Some(&robot2));
        assert_eq!(answer.receipt.unwrap().0, "delivered");
        assert_eq!(home.sink.json()["message"]["content"], "let me in");
    }
}

#[test]
fn whoever_has_no_good_certificate_is_refused() {
    let mut home = Home::new();
    let others = Fleet::new();
    let operator = home.fleet.operator();
    let wrong = others.join("robot2");
    let late = operator.issue("robot2", 1, now() - DAY * 9).unwrap();
    let early = operator.issue("robot2", 9, now() + DAY * 9).unwrap();
    let honest = Intrusion::honest("robot2", "arm@robot2");
    for endpoint in home.endpoints() {
        let (place, _) = endpoint.rsplit_once(':').unwrap();
        for (shown, said) in [
            (None, "it has no key: it showed no certificate"),
            (Some(&wrong), "another key made its certificate"),
            (Some(&late), "the certificate of robot2 expired at"),
            (Some(&early), "is the clock set?"),
        ] {
            let answer = honest.secretly(&endpoint, shown);
            assert_eq!(answer.receipt, None, "{said}");
            let who = refused(&mut home.daemon, said);
            assert!(who.starts_with(place), "{who}");
        }
    }
    home.stays_untouched();
}

#[test]
fn whoever_has_no_key_is_refused() {
    let mut home = Home::new();
    let answer = Intrusion::honest("robot2", "arm@robot2").plainly(home.daemon.endpoint());
    assert_eq!(answer.receipt, None);
    assert_eq!(
        answer.goodbye.unwrap(),
        "only links of the fleet are taken here"
    );
    refused(&mut home.daemon, "it has no key of the fleet");

    // A letter in the way of C++ robots is refused as well.
    let mut caller = TcpStream::connect(home.address()).unwrap();
    caller
        .write_all(&letter("arm@rover", "sink@robot1"))
        .unwrap();
    caller.shutdown(Shutdown::Write).unwrap();
    let _ = io::copy(&mut caller, &mut io::sink());
    home.stays_untouched();
}

#[test]
fn a_daemon_without_a_fleet_is_refused_and_told() {
    let mut home = Home::new();
    let place = Place::new();
    let mut command = place.fipad("open");
    command.args(["--no-mdns", "--peer", home.daemon.endpoint()]);
    command.env("FIPA_LOG", "fipa=info");
    let mut open = Process::start(command);
    open.json();
    let said = open.error_line();
    assert!(
        said.contains("only links of the fleet are taken here"),
        "{said}"
    );
    refused(&mut home.daemon, "it has no key of the fleet");
    home.stays_untouched();
}

#[test]
fn a_robot_of_another_fleet_is_refused_and_refuses() {
    let mut home = Home::new();
    let others = Fleet::new();
    for (name, endpoint) in ["robot2", "robot3"].iter().zip(home.endpoints()) {
        others.join(name);
        let mut command = others.fipad(name, &[]);
        command.args(["--peer", &endpoint]);
        let _stranger = Daemon::start(command);
        refused(
            &mut home.daemon,
            "does not accept our certificate: it is of another fleet",
        );
    }
    home.stays_untouched();
}

#[test]
fn a_revoked_robot_is_refused_from_then_on() {
    revoke_a_linked_robot(false);
}

#[test]
fn a_revoked_robot_is_refused_from_then_on_over_quic() {
    revoke_a_linked_robot(true);
}

fn revoke_a_linked_robot(over_quic: bool) {
    let mut home = Home::new();
    home.fleet.join("robot2");
    let mut command = home.fleet.fipad("robot2", &[]);
    let [tcp, quic] = home.endpoints();
    command.args(["--peer", if over_quic { &quic } else { &tcp }]);
    let robot2 = Daemon::start(command);
    let echo = robot2.attach("echo", "echo@robot2");
    home.daemon.wait_for("echo@robot2");

    let list = home.fleet.operator().revoke("robot2", now()).unwrap();
    let file = home.fleet.place.path("revoked.pem");
    std::fs::write(&file, list.to_pem()).unwrap();
    let mut command = tool(&["key", "revoke"]);
    command
        .arg(&file)
        .arg("--dir")
        .arg(home.fleet.folder("robot1"));
    assert_eq!(run(command).code, Some(0));

    refused(&mut home.daemon, "the certificate of robot2 is revoked");
    drop(echo);
    robot2.kill();
    eventually(|| agents(&home.daemon) == ["sink@robot1"]);
    let membership = Folder::new(home.fleet.folder("robot2"))
        .membership()
        .unwrap();
    for endpoint in home.endpoints() {
        let honest = Intrusion::honest("robot2", "arm@robot2");
        let answer = honest.secretly(&endpoint, Some(&membership));
        assert_eq!(answer.receipt, None);
    }
    home.stays_untouched();
}

#[test]
fn robots_tell_each_other_what_is_revoked() {
    let home = Home::new();
    let mut three = home.fleet.start("robot3", &[&home.daemon]);
    let two = home.fleet.join("robot2");
    let _echo = three.attach("echo", "echo@robot3");
    home.daemon.wait_for("echo@robot3");

    let list = home.fleet.operator().revoke("robot2", now()).unwrap();
    Folder::new(home.fleet.folder("robot1"))
        .install(&list.to_pem())
        .unwrap();
    let folder = Folder::new(home.fleet.folder("robot3"));
    eventually(|| folder.revoked().unwrap().is_some_and(|kept| kept == list));
    let answer = Intrusion::honest("robot2", "arm@robot2").secretly(three.endpoint(), Some(&two));
    assert_eq!(answer.receipt, None);
    refused(&mut three, "the certificate of robot2 is revoked");
}

fn eventually(mut is_so: impl FnMut() -> bool) {
    let until = Instant::now() + PATIENCE;
    while !is_so() {
        assert!(Instant::now() < until, "it never is so");
        thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_recorded_handshake_is_refused() {
    let mut home = Home::new();
    let between = TcpListener::bind("127.0.0.1:0").unwrap();
    let through = format!("tcp://{}", between.local_addr().unwrap());
    let to = home.address().to_owned();
    let recording = thread::spawn(move || record(&between, &to));
    home.fleet.join("robot2");
    let mut command = home.fleet.fipad("robot2", &[]);
    command.args(["--peer", &through]);
    let robot2 = Daemon::start(command);
    let echo = robot2.attach("echo", "echo@robot2");
    home.daemon.wait_for("echo@robot2");
    drop(echo);
    robot2.signal(Signal::TERM);
    assert_eq!(robot2.into_process().wait().code, Some(0));
    let recorded = recording.join().unwrap();
    assert!(recorded.len() > 1000, "{}", recorded.len());

    let mut replay = TcpStream::connect(home.address()).unwrap();
    replay.write_all(&recorded).unwrap();
    let _ = io::copy(&mut replay, &mut io::sink());
    refused(&mut home.daemon, "it is a recording");
    home.stays_untouched();
}

/// Passes on what two sides write to each other; what the caller wrote.
fn record(between: &TcpListener, to: &str) -> Vec<u8> {
    let (mut caller, _) = between.accept().unwrap();
    let mut called = TcpStream::connect(to).unwrap();
    let (mut back, mut from) = (caller.try_clone().unwrap(), called.try_clone().unwrap());
    thread::spawn(move || {
        let _ = io::copy(&mut from, &mut back);
        let _ = back.shutdown(Shutdown::Write);
    });
    let mut recorded = Vec::new();
    let mut chunk = [0; 4096];
    while let Ok(octets @ 1..) = caller.read(&mut chunk) {
        recorded.extend_from_slice(&chunk[..octets]);
        if called.write_all(&chunk[..octets]).is_err() {
            break;
        }
    }
    let _ = called.shutdown(Shutdown::Write);
    recorded
}

#[test]
fn a_recorded_handshake_over_quic_is_refused() {
    let mut home = Home::new();
    let [_, quic] = home.endpoints();
    let to = quic.strip_prefix("quic://").unwrap().parse().unwrap();
    let recorder = Recorder::before(to);
    home.fleet.join("robot2");
    let mut command = home.fleet.fipad("robot2", &[]);
    command.args(["--peer", &format!("quic://{}", recorder.at)]);
    let robot2 = Daemon::start(command);
    let echo = robot2.attach("echo", "echo@robot2");
    home.daemon.wait_for("echo@robot2");
    drop(echo);
    robot2.signal(Signal::TERM);
    assert_eq!(robot2.into_process().wait().code, Some(0));
    let recorded = recorder.stop();
    assert!(recorded.len() > 5, "{}", recorded.len());

    let replay = UdpSocket::bind("127.0.0.1:0").unwrap();
    let from = format!("quic://{}", replay.local_addr().unwrap());
    let replaying = thread::spawn(move || {
        // For a while the packets are those of a connection that has just ended.
        for _ in 0..4 {
            for packet in &recorded {
                replay.send_to(packet, to).unwrap();
            }
            thread::sleep(Duration::from_secs(1));
        }
    });
    let who = refused(&mut home.daemon, "it is a recording, or the radio is bad");
    assert_eq!(who, from);
    replaying.join().unwrap();
    home.stays_untouched();
}

/// Passes on packets between one caller and a robot, and keeps what the caller sends.
struct Recorder {
    at: SocketAddr,
    ends: Arc<AtomicBool>,
    recording: thread::JoinHandle<Vec<Vec<u8>>>,
}

impl Recorder {
    fn before(to: SocketAddr) -> Recorder {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket
            .set_read_timeout(Some(Duration::from_millis(50)))
            .unwrap();
        let (at, ends) = (socket.local_addr().unwrap(), Arc::<AtomicBool>::default());
        let until = Arc::clone(&ends);
        let recording = thread::spawn(move || record_packets(&socket, to, &until));
        Recorder {
            at,
            ends,
            recording,
        }
    }

    fn stop(self) -> Vec<Vec<u8>> {
        self.ends.store(true, Ordering::Relaxed);
        self.recording.join().unwrap()
    }
}

fn record_packets(socket: &UdpSocket, to: SocketAddr, ends: &AtomicBool) -> Vec<Vec<u8>> {
    let mut caller = None;
    let mut recorded = Vec::new();
    let mut packet = [0; 1 << 16];
    while !ends.load(Ordering::Relaxed) {
        let Ok((octets, from)) = socket.recv_from(&mut packet) else {
            continue;
        };
        let packet = &packet[..octets];
        if from != to {
            caller = Some(from);
            recorded.push(packet.to_vec());
        }
        if let Some(next) = if from == to { caller } else { Some(to) } {
            socket.send_to(packet, next).unwrap();
        }
    }
    recorded
}

#[test]
fn a_robot_under_another_name_is_refused() {
    let mut home = Home::new();
    let robot2 = home.fleet.join("robot2");
    for endpoint in home.endpoints() {
        let answer = Intrusion::honest("robot3", "arm@robot3").secretly(&endpoint, Some(&robot2));
        assert_eq!(answer.receipt, None);
        assert_eq!(
            answer.goodbye.unwrap(),
            "the name is not that of the certificate"
        );
        refused(
            &mut home.daemon,
            "it has the certificate of robot2, and calls itself robot3",
        );
    }
    home.stays_untouched();
}

#[test]
fn a_robot_registers_no_names_of_others_and_sends_in_none() {
    let mut home = Home::new();
    let robot2 = home.fleet.join("robot2");
    let thief = Intrusion {
        name: "robot2",
        agent: "drive@robot1",
        from: "arm@robot1",
        to: "sink@robot1",
    };
    for endpoint in home.endpoints() {
        let answer = thief.secretly(&endpoint, Some(&robot2));
        let (outcome, reason) = answer.receipt.unwrap();
        assert_eq!(outcome, "refused");
        assert_eq!(reason, "arm@robot1 is a name of robot1, not of robot2");
        let who = refused(
            &mut home.daemon,
            "drive@robot1 is a name of robot1, not of robot2",
        );
        assert_eq!(who, "robot2");
    }
    home.stays_untouched();
}
