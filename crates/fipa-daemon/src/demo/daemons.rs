//! The demo's daemons: processes of this very program, in a place of their own.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fipa::Platform;
use tokio::io::{AsyncBufReadExt, BufReader};

/// Where the demo's daemons live: a folder for their control sockets, and an mDNS port that no
/// other daemon speaks on.
pub(super) struct Place {
    folder: PathBuf,
    mdns_port: u16,
}

/// A daemon of the demo; it ends with this value.
pub(super) struct Daemon {
    process: Child,
    control: PathBuf,
    pub(super) endpoint: String,
}

impl Place {
    pub(super) fn new() -> Result<Place, String> {
        let folder = std::env::temp_dir().join(format!("fipad-demo-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let mdns_port = fipa_dsd::free_mdns_port().map_err(|e| format!("no free port: {e}"))?;
        Ok(Place { folder, mdns_port })
    }

    /// Starts a daemon and waits until it is ready.
    pub(super) async fn start(&self, name: &str, peers: &[&str]) -> Result<Daemon, String> {
        let control = self.folder.join(format!("{name}.sock"));
        let program = std::env::current_exe().map_err(|e| e.to_string())?;
        let mut command = Command::new(program);
        command
            .args([
                "--json",
                "--name",
                name,
                "--listen",
                "127.0.0.1:0",
                "--control",
            ])
            .arg(&control)
            .args(["--mdns-port", &self.mdns_port.to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::piped());
        for peer in peers {
            command.args(["--peer", peer]);
        }
        // A daemon of the user is configured by these; those of the demo are not.
        for (key, _) in std::env::vars_os() {
            if key.to_string_lossy().starts_with("FIPAD_") {
                command.env_remove(key);
            }
        }
        // Nor is the fleet of the machine that of the demo.
        command.env("FIPAD_FLEET_MODE", "open");
        command.env("FIPA_LOG", "error");
        let mut process = command.spawn().map_err(|e| format!("fipad: {e}"))?;
        let ready = ready(&mut process).await;
        let mut daemon = Daemon {
            process,
            control,
            endpoint: String::new(),
        };
        let ready: serde_json::Value = serde_json::from_str(&ready?).map_err(|e| e.to_string())?;
        match ready["endpoints"][0].as_str() {
            Some(endpoint) => daemon.endpoint = endpoint.to_owned(),
            None => return Err(format!("{name} did not say where it listens")),
        }
        Ok(daemon)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // What is left in the temporary folder of the machine does no harm.
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// The line by which a daemon says that it is ready.
async fn ready(process: &mut Child) -> Result<String, String> {
    let output = process.stdout.take().ok_or("fipad has no output")?;
    let output = tokio::process::ChildStdout::from_std(output).map_err(|e| e.to_string())?;
    let mut lines = BufReader::new(output).lines();
    match tokio::time::timeout(Duration::from_secs(5), lines.next_line()).await {
        Ok(Ok(Some(line))) => {
            // Later lines tell of conflicts, which the demo has none of; they must not block it.
            tokio::spawn(async move { while let Ok(Some(_)) = lines.next_line().await {} });
            Ok(line)
        }
        Ok(_) => Err("fipad ended before it was ready".to_owned()),
        Err(_) => Err("fipad was not ready within 5 s".to_owned()),
    }
}

impl Daemon {
    pub(super) async fn attach(&self) -> Result<Platform, String> {
        let attached = Platform::attach_to(&self.control).await;
        attached.map_err(|error| error.to_string())
    }

    /// Makes it stand still, as a robot does whose computer hangs.
    pub(super) fn stop(&self) {
        let pid = rustix::process::Pid::from_child(&self.process);
        // The next step shows whether it stands still.
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::STOP);
    }

    /// Kills it, without a word to anybody.
    pub(super) fn end(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.end();
    }
}
