//! `fipa key`: fleets as other programs script them.

use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

use serde_json::Value;

use crate::support::daemon::tool;
use crate::support::process::{Ended, keys, run};

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Place {
        Place(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn key(&self, folder: &str, words: &[&str]) -> Ended {
        let mut command = tool(&["key"]);
        command
            .args(words)
            .arg("--json")
            .arg("--dir")
            .arg(self.path(folder));
        command.current_dir(self.0.path());
        let ended = run(command);
        let all = format!("{ended:?}");
        assert!(!all.contains("PRIVATE KEY"), "{all}");
        ended
    }

    fn told(&self, folder: &str, words: &[&str]) -> Vec<Value> {
        let ended = self.key(folder, words);
        assert_eq!(ended.code, Some(0), "{ended:?}");
        ended.json()
    }
}

#[test]
fn a_robot_joins_is_shown_and_is_revoked() {
    let place = Place::new();
    let made = &place.told("operator", &["init"])[0];
    assert_eq!(keys(made), ["fleet", "dir"]);
    let fleet = &made["fleet"];
    let file = &place.told("operator", &["join", "robot1", "--out", "robot1.fleet"])[0];
    assert_eq!(keys(file), ["robot", "file", "fingerprint"]);
    let mode = std::fs::metadata(place.path("robot1.fleet"))
        .unwrap()
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o600);

    let joined = &place.told("robot1", &["join", "robot1.fleet"])[0];
    assert_eq!(keys(joined), ["robot", "fleet", "dir", "fingerprint"]);
    assert_eq!(
        (&joined["robot"], &joined["fleet"]),
        (&"robot1".into(), fleet)
    );
    assert_eq!(joined["fingerprint"], file["fingerprint"]);

    let shown = place.told("operator", &["show"]);
    assert_eq!(keys(&shown[0]), ["fleet", "key", "robot"]);
    assert_eq!(
        (&shown[0]["key"], &shown[0]["robot"]),
        (&true.into(), &Value::Null)
    );
    assert_eq!(
        keys(&shown[1]),
        ["robot", "state", "until", "fingerprint", "here"]
    );
    assert_eq!(shown[1]["state"], "valid");
    assert_eq!(shown[1]["here"], false);

    let revoked = &place.told("operator", &["revoke", "robot1", "--out", "list.pem"])[0];
    assert_eq!(revoked["count"], 1);
    assert_eq!(place.told("operator", &["show"])[1]["state"], "revoked");
    assert_eq!(
        place.told("robot1", &["show"])[1]["state"],
        "valid",
        "it was not told"
    );
    assert_eq!(
        place.told("robot1", &["revoke", "list.pem"])[0]["news"],
        true
    );
    let shown = place.told("robot1", &["show"]);
    assert_eq!(
        (&shown[1]["state"], &shown[1]["here"]),
        (&"revoked".into(), &true.into())
    );
}

#[test]
fn a_name_joins_the_machine_of_the_operator_itself() {
    let place = Place::new();
    place.told("operator", &["init"]);
    let joined = &place.told("operator", &["join", "laptop", "--days", "2"])[0];
    assert_eq!(joined["robot"], "laptop");
    assert_eq!(place.told("operator", &["show"])[0]["robot"], "laptop");
}

#[test]
fn what_cannot_be_done_says_so() {
    let place = Place::new();
    place.told("operator", &["init"]);
    std::fs::write(place.path("other.fleet"), "hello").unwrap();
    for (folder, words, code, said) in [
        ("operator", &["init"][..], 3, "is not overwritten"),
        ("nobody", &["show"], 1, "there is no fleet in"),
        (
            "nobody",
            &["join", "robot1"],
            3,
            "make one by `fipa key init`",
        ),
        (
            "nobody",
            &["join", "missing.fleet"],
            3,
            "missing.fleet: No such file",
        ),
        (
            "nobody",
            &["join", "other.fleet"],
            2,
            "it is neither the file of a robot nor",
        ),
        ("operator", &["join", "a b"], 2, "is no name for a robot"),
        ("operator", &["join", "x", "--days", "0"], 2, "--days"),
        (
            "operator",
            &["join", "other.fleet", "--out", "y"],
            2,
            "--out goes with a name",
        ),
        (
            "operator",
            &["revoke", "robot7"],
            1,
            "no certificate was made for robot7",
        ),
        ("operator", &[], 2, "subcommand"),
    ] {
        let mut command = tool(&["key"]);
        command.args(words).current_dir(place.0.path());
        if !words.is_empty() {
            command.arg("--dir").arg(place.path(folder));
        }
        let ended = run(command);
        assert_eq!(ended.code, Some(code), "{words:?}: {ended:?}");
        assert!(ended.only_error().contains(said), "{ended:?}");
    }
}
