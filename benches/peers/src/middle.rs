//! What stands in the middle, as a process: this program once more, or a server of the system.

use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

/// Holds which middle, in processes that are one.
const MARK: &str = "PEERS_MIDDLE";

/// A process in the middle; it ends with this value.
pub(crate) struct Middle {
    process: Child,
    /// Where it is reached, as it says itself.
    pub(crate) address: String,
}

/// Which middle this process is to be, if one.
pub(crate) fn name() -> Option<String> {
    std::env::var(MARK).ok()
}

impl Middle {
    /// Starts this program as the middle of this name, which prints its address once it is ready.
    pub(crate) fn start(name: &str) -> Middle {
        let mut process = Command::new(std::env::current_exe().expect("this program"))
            .env(MARK, name)
            .stdout(Stdio::piped())
            .spawn()
            .expect("a middle");
        let mut address = String::new();
        let output = process.stdout.take().expect("piped");
        BufReader::new(output)
            .read_line(&mut address)
            .expect("ready");
        Middle {
            process,
            address: address.trim().to_owned(),
        }
    }

    /// Starts a server that listens at a port which it is told, and waits until it does. `None`
    /// without such a program.
    pub(crate) fn serve(program: &str, options: impl Fn(u16) -> Vec<String>) -> Option<Middle> {
        let port = free_port();
        let process = Command::new(program)
            .args(options(port))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let address = format!("127.0.0.1:{port}");
        let middle = Middle { process, address };
        for _ in 0..500 {
            if TcpStream::connect(&middle.address).is_ok() {
                return Some(middle);
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("{program} does not listen");
    }

    /// Its process.
    pub(crate) fn process(&self) -> u32 {
        self.process.id()
    }
}

impl Drop for Middle {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A port of this host that nobody has.
pub(crate) fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    listener.local_addr().expect("bound").port()
}

/// What the threads of a process have run so far, in nanoseconds.
pub(crate) struct Ran(HashMap<String, u64>);

impl Ran {
    /// Asks the system.
    pub(crate) fn of(process: u32) -> Ran {
        let threads = std::fs::read_dir(format!("/proc/{process}/task")).expect("a process");
        let ran = threads.flatten().filter_map(|thread| {
            // A thread may end while it is asked for.
            let told = std::fs::read_to_string(thread.path().join("schedstat")).ok()?;
            let nanos = told.split_whitespace().next()?.parse().ok()?;
            Some((thread.file_name().into_string().ok()?, nanos))
        });
        Ran(ran.collect())
    }

    /// What they have run since then, system calls included.
    pub(crate) fn since(&self, earlier: &Ran) -> f64 {
        let ran = self.0.iter().map(|(thread, nanos)| {
            let before = earlier.0.get(thread).copied().unwrap_or_default();
            nanos.saturating_sub(before)
        });
        ran.sum::<u64>() as f64
    }
}
