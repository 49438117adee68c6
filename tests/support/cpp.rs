//! What stands for a robot with the C++ `fipa_services`: python-zeroconf and plain sockets.

use std::collections::VecDeque;
use std::process::Command;

use serde_json::Value;

use super::namespace::Namespace;
use super::process::Process;
use super::skipped;

/// The signature of the recorded locations.
pub(crate) const SIGNATURE: &str = "fipa::services::transports::MessageTransport";

/// A robot that announces agents, looks for others, takes letters and sends some.
pub(crate) struct CppRobot {
    process: Process,
    /// What was read and not looked for yet.
    early: VecDeque<Value>,
    /// Where it takes letters.
    pub(crate) port: u64,
}

impl CppRobot {
    /// Starts a robot with this address; `None` where there can be none, which has been said then.
    pub(crate) fn start(namespace: &Namespace, address: &str) -> Option<CppRobot> {
        let mut python = Command::new("python3");
        let tried = python.args(["-c", "import zeroconf"]).output();
        if !tried.is_ok_and(|output| output.status.success()) {
            skipped("python3 with zeroconf");
            return None;
        }
        let mut command = Command::new("python3");
        command.args(["-c", include_str!("cpp_robot.py"), address]);
        let mut process = Process::start(namespace.enter(&command));
        let port = process.json()["listens"].as_u64().unwrap();
        Some(CppRobot {
            process,
            early: VecDeque::new(),
            port,
        })
    }

    /// Announces an agent in the recorded form of a client of the C++ transport.
    pub(crate) fn publish(&mut self, label: &str, locator: &str) {
        let mut strings = vec![format!("TYPE={SIGNATURE}")];
        let chunks = locator.as_bytes().chunks(192);
        strings.extend(chunks.map(|chunk| format!("LOCATOR={}", str::from_utf8(chunk).unwrap())));
        strings.push("DESCRIPTION=Message client of mts-0".to_owned());
        strings.push("TIMESTAMP=20261122-06:53:02:938849".to_owned());
        self.command(&format!("publish {label} {}", strings.join("|")));
    }

    /// Says goodbye to an agent.
    pub(crate) fn withdraw(&mut self, label: &str) {
        self.command(&format!("withdraw {label}"));
    }

    /// Sends a letter to `tcp://HOST:PORT` on a connection of its own.
    pub(crate) fn send(&mut self, address: &str, letter: &[u8]) {
        let place = address.strip_prefix("tcp://").unwrap().replace(':', " ");
        let octets: String = letter.iter().map(|octet| format!("{octet:02x}")).collect();
        self.command(&format!("send {place} {octets}"));
    }

    /// The next letter that it was sent.
    pub(crate) fn letter(&mut self) -> Vec<u8> {
        let told = self.wait_for(|told| told["letter"].is_string());
        let hex = told["letter"].as_str().unwrap().as_bytes();
        let octet = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap();
        hex.chunks(2).map(octet).collect()
    }

    /// The TXT strings of an agent that others announce.
    pub(crate) fn found(&mut self, label: &str) -> Vec<String> {
        let told = self.wait_for(|told| told["found"] == label);
        let strings = told["strings"].as_array().unwrap().iter();
        strings.map(|s| s.as_str().unwrap().to_owned()).collect()
    }

    /// Waits until an agent that others announced is gone.
    pub(crate) fn gone(&mut self, label: &str) {
        self.wait_for(|told| told["gone"] == label);
    }

    /// Ends it as a crash does.
    pub(crate) fn kill(self) {
        self.process.kill();
    }

    fn command(&mut self, command: &str) {
        self.process.tell(command);
        self.wait_for(|told| told["done"].is_string());
    }

    fn wait_for(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        if let Some(at) = self.early.iter().position(&wanted) {
            return self.early.remove(at).unwrap();
        }
        loop {
            let told = self.process.json();
            if wanted(&told) {
                return told;
            }
            self.early.push_back(told);
        }
    }
}
