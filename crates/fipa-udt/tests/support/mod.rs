//! The C++ program, and letters for it.

// Each test program uses its own part of this.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::Duration;

/// How long anything is waited for that must come.
pub(crate) const PATIENCE: Duration = Duration::from_secs(15);

/// The letters that a robot in C++ was recorded to send.
pub(crate) fn recordings() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/vectors/mts");
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "bin"))
        .collect();
    files.sort();
    assert!(files.len() > 5, "{files:?}");
    files
}

/// The program, compiled under a name of its own: tests run at the same time.
pub(crate) fn compiled(name: &str) -> PathBuf {
    let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer.cpp");
    let status = Command::new("c++")
        .arg("-o")
        .args([&program, &source])
        .args(["-ludt", "-lpthread"])
        .status()
        .unwrap();
    assert!(status.success());
    program
}

/// A child that does not outlive the test.
pub(crate) struct Running(pub(crate) Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Says that a test is left out, and fails it where nothing may be left out.
pub(crate) fn skipped(needed: &str) {
    let all = std::env::var_os("FIPA_TEST_ALL").is_some_and(|all| all == "1");
    assert!(!all, "needs {needed}");
    println!("skipped: needs {needed}");
}
