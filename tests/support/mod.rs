//! Daemons, commands and networks of the tests: real processes, which end with the test.

// Each test program uses its own part of this.
#![allow(dead_code)]

pub(crate) mod cpp;
pub(crate) mod daemon;
pub(crate) mod namespace;
pub(crate) mod process;
pub(crate) mod radio;

use std::time::Duration;

/// How long anything is waited for that must come.
pub(crate) const PATIENCE: Duration = Duration::from_secs(15);

/// Says that a test is left out, and fails it where nothing may be left out.
pub(crate) fn skipped(needed: &str) {
    let all = std::env::var_os("FIPA_TEST_ALL").is_some_and(|all| all == "1");
    assert!(!all, "needs {needed}");
    println!("skipped: needs {needed}");
}
