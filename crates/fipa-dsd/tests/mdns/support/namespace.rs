//! Network namespaces that vanish with the process that holds them.
use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Names the test that a process inside a namespace was started for.
const INSIDE: &str = "FIPA_DSD_INSIDE";
/// How long a test inside a namespace may take.
const TEST_WITHIN: Duration = Duration::from_secs(240);

/// Runs `body` in a namespace of its own, where only loopback exists and is up: this test process
/// is started again for `test`.
pub(crate) fn isolated(test: &str, body: impl FnOnce()) {
    if std::env::var(INSIDE).is_ok_and(|inside| inside == test) {
        return body();
    }
    if !can_unshare() {
        return;
    }
    let mut child = Command::new("unshare")
        .args([
            "-n",
            "--",
            "sh",
            "-c",
            "ip link set lo up && exec \"$0\" \"$@\"",
        ])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", test, "--nocapture", "--include-ignored"])
        .env(INSIDE, test)
        .spawn()
        .unwrap();
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > TEST_WITHIN {
            let _ = child.kill();
            let _ = child.wait();
            panic!("{test} takes too long");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(status.success(), "{test} failed inside its namespace");
}

/// Whether namespaces can be made; says so if not, and fails where nothing may be skipped.
pub(crate) fn can_unshare() -> bool {
    let tried = Command::new("unshare")
        .args([
            "-n",
            "--",
            "sh",
            "-c",
            "ip link set lo up && nsenter --version",
        ])
        .output();
    let able = matches!(&tried, Ok(Output { status, .. }) if status.success());
    if !able {
        let needed = "needs root, unshare, nsenter and ip for network namespaces";
        assert!(
            std::env::var_os("FIPA_TEST_ALL").is_none_or(|v| v != "1"),
            "{needed}"
        );
        println!("skipped: {needed}");
    }
    able
}

/// A network namespace, with loopback up.
pub(crate) struct Namespace {
    holder: Child,
}

impl Namespace {
    pub(crate) fn new() -> Namespace {
        let holder = Command::new("unshare")
            .args(["-n", "--", "sleep", "300"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let namespace = Namespace { holder };
        namespace.wait_until_apart();
        namespace.ip("link set lo up");
        namespace
    }

    /// The process id by which `ip` finds the namespace.
    pub(crate) fn pid(&self) -> u32 {
        self.holder.id()
    }

    /// A command that will run in the namespace.
    pub(crate) fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("nsenter");
        command
            .args(["-t", &self.pid().to_string(), "-n", "--"])
            .arg(program);
        command
    }

    /// Runs `ip` with these words in the namespace.
    pub(crate) fn ip(&self, words: &str) {
        let output = self
            .command("ip")
            .args(words.split_whitespace())
            .output()
            .unwrap();
        assert!(output.status.success(), "ip {words}: {output:?}");
    }

    /// Joins this namespace to `other` by a pair of interfaces of these names, both up.
    pub(crate) fn connect(&self, name: &str, other: &Namespace, other_name: &str) {
        let other_pid = other.pid();
        self.ip(&format!(
            "link add {name} type veth peer name {other_name} netns {other_pid}"
        ));
        self.ip(&format!("link set {name} up"));
        other.ip(&format!("link set {other_name} up"));
    }

    /// The process exists before it has left our namespace.
    fn wait_until_apart(&self) {
        let ours = fs::read_link("/proc/self/ns/net").unwrap();
        let theirs = format!("/proc/{}/ns/net", self.pid());
        let begun = Instant::now();
        while fs::read_link(&theirs).is_ok_and(|theirs| theirs == ours) {
            assert!(
                begun.elapsed() < Duration::from_secs(10),
                "no namespace was made"
            );
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}
