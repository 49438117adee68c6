//! Processes that end with the test, and what they write.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::PATIENCE;

/// A running process.
pub(crate) struct Process {
    shown: String,
    child: Child,
    input: Option<ChildStdin>,
    output: Receiver<String>,
    errors: Receiver<String>,
}

/// What a process that has ended wrote.
#[derive(Debug)]
pub(crate) struct Ended {
    /// The exit code; `None` when a signal ended it.
    pub(crate) code: Option<i32>,
    pub(crate) output: Vec<String>,
    pub(crate) errors: Vec<String>,
}

impl Process {
    pub(crate) fn start(mut command: Command) -> Process {
        let shown = format!("{command:?}");
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{shown}: {error}"));
        Process {
            input: child.stdin.take(),
            output: lines(child.stdout.take().unwrap()),
            errors: lines(child.stderr.take().unwrap()),
            child,
            shown,
        }
    }

    /// The next line on standard output, which must come.
    pub(crate) fn line(&mut self) -> String {
        self.line_within(PATIENCE)
    }

    /// The next line on standard output, which must come within that time.
    pub(crate) fn line_within(&mut self, within: Duration) -> String {
        match self.output.recv_timeout(within) {
            Ok(line) => line,
            Err(error) => self.give_up(error),
        }
    }

    /// The next line on standard output, or `None` when it ends instead.
    pub(crate) fn line_or_end(&mut self) -> Option<String> {
        match self.output.recv_timeout(PATIENCE) {
            Ok(line) => Some(line),
            Err(RecvTimeoutError::Disconnected) => None,
            Err(error) => self.give_up(error),
        }
    }

    /// The next line on standard output, as JSON.
    pub(crate) fn json(&mut self) -> Value {
        json(&self.line())
    }

    /// The next line on standard error, which must come.
    pub(crate) fn error_line(&mut self) -> String {
        match self.errors.recv_timeout(PATIENCE) {
            Ok(line) => line,
            Err(error) => self.give_up(error),
        }
    }

    /// Writes a line to its standard input.
    pub(crate) fn tell(&mut self, line: impl std::fmt::Display) {
        self.write(format!("{line}\n").as_bytes());
    }

    /// Writes to its standard input.
    pub(crate) fn write(&mut self, octets: &[u8]) {
        let input = self.input.as_mut().expect("the input is open");
        input.write_all(octets).unwrap();
    }

    /// Writes all of its standard input. It must read that before it writes much.
    pub(crate) fn feed(&mut self, octets: &[u8]) {
        self.write(octets);
        self.close_input();
    }

    /// Ends its standard input.
    pub(crate) fn close_input(&mut self) {
        self.input = None;
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Ends it as a crash does.
    pub(crate) fn kill(mut self) {
        self.end();
    }

    /// Waits until it has ended by itself. Its standard input stays as it is.
    pub(crate) fn wait(self) -> Ended {
        self.wait_within(PATIENCE)
    }

    /// Waits until it has ended by itself, which must be within that time.
    pub(crate) fn wait_within(mut self, within: Duration) -> Ended {
        let until = Instant::now() + within;
        let output = self.rest(&self.output, until);
        let errors = self.rest(&self.errors, until);
        // Both ended, which they do with the process.
        let code = self.child.wait().unwrap().code();
        Ended {
            code,
            output,
            errors,
        }
    }

    fn rest(&self, lines: &Receiver<String>, until: Instant) -> Vec<String> {
        let mut rest = Vec::new();
        loop {
            match lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(line) => rest.push(line),
                Err(RecvTimeoutError::Disconnected) => return rest,
                Err(RecvTimeoutError::Timeout) => {
                    panic!("{} does not end; it wrote {rest:?}", self.shown)
                }
            }
        }
    }

    fn give_up(&mut self, error: RecvTimeoutError) -> ! {
        self.end();
        let errors: Vec<String> = self.errors.iter().collect();
        panic!("{} wrote no such line: {error}; {errors:?}", self.shown);
    }

    fn end(&mut self) {
        // It may have ended by itself. A stopped process dies of this as well.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}

impl Ended {
    /// Everything on standard output, as JSON a line.
    pub(crate) fn json(&self) -> Vec<Value> {
        self.output.iter().map(|line| json(line)).collect()
    }

    /// The only line on standard output, as JSON.
    pub(crate) fn only_json(&self) -> Value {
        assert_eq!(self.output.len(), 1, "{self:?}");
        json(&self.output[0])
    }

    /// The only line on standard error.
    pub(crate) fn only_error(&self) -> &str {
        assert_eq!(self.errors.len(), 1, "{self:?}");
        &self.errors[0]
    }
}

/// Runs a command to its end, without input.
pub(crate) fn run(command: Command) -> Ended {
    let mut process = Process::start(command);
    process.close_input();
    process.wait()
}

/// The keys of an object, in their order.
pub(crate) fn keys(value: &Value) -> Vec<&str> {
    let object = value.as_object().expect("an object");
    object.keys().map(String::as_str).collect()
}

fn json(line: &str) -> Value {
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{line:?}: {error}"))
}

fn lines(stream: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut stream = BufReader::new(stream);
        let mut line = Vec::new();
        while stream.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
            let text = String::from_utf8_lossy(&line);
            let text = text.strip_suffix('\n').unwrap_or(&text).to_owned();
            if sender.send(text).is_err() {
                return;
            }
            line.clear();
        }
    });
    receiver
}
