//! What holds between the crates: who may depend on whom, and who may know what.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// The groups of crates, each above those that follow.
const GROUPS: [&[&str]; 6] = [TESTS, PROGRAMS, DOOR, SOCKETS, MACHINES, DATA];
const TESTS: &[&str] = &["fipa-sim", "fipa-benches", "microcontroller"];
const PROGRAMS: &[&str] = &["fipa-programs", "fipa-daemon", "fipa-cli", "fipa-json"];
const DOOR: &[&str] = &["fipa"];
/// Those that talk to the system: sockets, mDNS, files.
const SOCKETS: &[&str] = &["fipa-transport", "fipa-dsd", "fipa-outbox"];
const MACHINES: &[&str] = &[
    "fipa-mts",
    "fipa-link",
    "fipa-directory",
    "fipa-fleet",
    "fipa-conversation",
    "fipa-locking",
    "fipa-gateway",
    "fipa-management",
    "hiac",
    "robot-text",
];
const DATA: &[&str] = &[
    "fipa-codec",
    "fipa-protocol",
    "fipa-sl",
    "fipa-actions",
    "fipa-acl",
];

/// Those that have a module that reads XML.
const XML: &[&str] = &["fipa-codec", "fipa-protocol"];

/// State machines that bring their own sockets and serial lines, in a module and a feature of that
/// name.
const WITH_LINKS: &[&str] = &["hiac", "robot-text"];
const LINKS: &str = "links";

#[rustfmt::skip]
const SOCKET_TYPES: &[&str] = &[
    "TcpStream", "TcpListener", "TcpSocket", "UdpSocket",
    "UnixStream", "UnixListener", "UnixDatagram",
];

/// Words of the code, or dependencies, that only some crates may have.
struct Reserved {
    words: &'static [&'static str],
    to: &'static [&'static [&'static str]],
}

const RESERVED_WORDS: [Reserved; 5] = [
    Reserved {
        words: SOCKET_TYPES,
        to: &[SOCKETS, TESTS],
    },
    // Clocks and threads.
    Reserved {
        words: &["Instant::now", "SystemTime::now", "thread::"],
        to: &[TESTS, PROGRAMS, DOOR, SOCKETS],
    },
    Reserved {
        words: &["mdns_sd", "simple_dns"],
        to: &[&["fipa-dsd"]],
    },
    Reserved {
        words: &["quick_xml"],
        to: &[XML],
    },
    Reserved {
        words: &["serde_json", "toml::"],
        to: &[PROGRAMS, TESTS],
    },
];

const RESERVED_DEPENDENCIES: [Reserved; 5] = [
    Reserved {
        words: &["mdns-sd", "simple-dns"],
        to: &[&["fipa-dsd"]],
    },
    Reserved {
        words: &["quick-xml"],
        to: &[XML],
    },
    Reserved {
        words: &["redb"],
        to: &[&["fipa-outbox"]],
    },
    Reserved {
        words: &["serde", "serde_json", "toml"],
        to: &[PROGRAMS, TESTS],
    },
    // Whoever has one of these waits, logs or talks to the system.
    Reserved {
        words: &["tokio", "tracing", "socket2", "if-addrs", "rustix"],
        to: &[PROGRAMS, DOOR, SOCKETS, TESTS],
    },
];

/// Lines of the longest file.
const LONGEST: usize = 800;

/// A crate of the workspace.
#[derive(Default)]
struct Crate {
    name: String,
    manifest: String,
    /// Those of the program itself: what only its tests need is free, and so is what only its
    /// links need.
    dependencies: Vec<String>,
    /// Its sources, tests of their own aside.
    sources: Vec<(PathBuf, String)>,
}

#[test]
fn dependencies_point_down_and_not_in_circles() {
    let crates = workspace();
    hold(upward(&crates));
    hold(circles(&crates));
}

#[test]
fn only_those_know_of_sockets_clocks_mdns_and_json_whose_task_that_is() {
    let crates = workspace();
    hold(strange_words(&crates));
    hold(strange_dependencies(&crates));
    hold(xml_elsewhere(&crates));
}

#[test]
fn every_crate_inherits_the_lints_of_the_workspace() {
    hold(without_lints(&workspace()));
}

#[test]
fn no_file_is_too_long() {
    let folders = ["benches", "crates", "examples", "tests"].map(|folder| root().join(folder));
    let sources: Vec<_> = folders
        .iter()
        .flat_map(|folder| rust_files(folder))
        .collect();
    assert!(sources.len() > 100, "only {} files", sources.len());
    hold(too_long(&sources));
}

#[test]
fn the_checks_find_what_they_look_for() {
    let bad = Crate {
        name: "fipa-codec".to_owned(),
        manifest: "[lints.rust]\nunsafe_code = \"allow\"".to_owned(),
        dependencies: ["fipa-acl", "fipa-mts", "tokio"].map(str::to_owned).into(),
        sources: vec![(
            PathBuf::from("lib.rs"),
            "// Not an Instant::now.\nuse std::net::TcpStream;\n".to_owned(),
        )],
    };
    let unknown = Crate {
        name: "fipa-new".to_owned(),
        ..Crate::default()
    };
    let crates = [bad, unknown];
    assert_eq!(
        upward(&crates),
        ["fipa-codec depends on fipa-mts", "fipa-new is in no group"]
    );
    assert_eq!(strange_words(&crates), ["fipa-codec, lib.rs: TcpStream"]);
    assert_eq!(strange_dependencies(&crates), ["fipa-codec: tokio"]);
    assert_eq!(without_lints(&crates), ["fipa-codec", "fipa-new"]);
    let names_xml = |path: &str| Crate {
        sources: vec![(PathBuf::from(path), "use quick_xml::Reader;".to_owned())],
        ..Crate::default()
    };
    let crates = ["src/load.rs", "src/xml.rs", "src/xml/tags.rs"].map(names_xml);
    assert_eq!(xml_elsewhere(&crates), ["src/load.rs"]);
    let lines = |n| [(PathBuf::from("a.rs"), "\n".repeat(n))];
    assert_eq!(too_long(&lines(800)), [""; 0]);
    assert_eq!(too_long(&lines(801)), ["a.rs: 801 lines"]);

    let depends = |name: &str, on: &str| Crate {
        name: name.to_owned(),
        dependencies: vec![on.to_owned()],
        ..Crate::default()
    };
    let chain = [depends("a", "b"), depends("b", "c"), depends("c", "d")];
    assert_eq!(circles(&chain), [""; 0]);
    let circle = [depends("a", "b"), depends("b", "c"), depends("c", "b")];
    assert_eq!(circles(&circle), ["b", "c"]);
}

fn hold(complaints: Vec<String>) {
    assert!(complaints.is_empty(), "{complaints:#?}");
}

/// Dependencies on a crate of a higher group, and crates of none.
fn upward(crates: &[Crate]) -> Vec<String> {
    let group = |name: &str| GROUPS.iter().position(|group| group.contains(&name));
    let mut complaints = Vec::new();
    for one in crates {
        let Some(own) = group(&one.name) else {
            complaints.push(format!("{} is in no group", one.name));
            continue;
        };
        for other in &one.dependencies {
            if group(other).is_some_and(|other| other < own) {
                complaints.push(format!("{} depends on {other}", one.name));
            }
        }
    }
    complaints
}

/// The crates that are reached from themselves.
fn circles(crates: &[Crate]) -> Vec<String> {
    let dependencies = |name: &str| {
        let one = crates.iter().find(|one| one.name == name);
        one.map_or(&[][..], |one| &one.dependencies[..])
    };
    let in_circle = |start: &Crate| {
        let mut reached: Vec<&String> = start.dependencies.iter().collect();
        let mut at = 0;
        while let Some(name) = reached.get(at).copied() {
            for next in dependencies(name) {
                if !reached.contains(&next) {
                    reached.push(next);
                }
            }
            at += 1;
        }
        reached.contains(&&start.name)
    };
    let found = crates.iter().filter(|one| in_circle(one));
    found.map(|one| one.name.clone()).collect()
}

/// Words in the code of crates that have nothing to do with them.
fn strange_words(crates: &[Crate]) -> Vec<String> {
    let mut complaints = Vec::new();
    for one in crates {
        for word in strange(&RESERVED_WORDS, one) {
            for (path, text) in &one.sources {
                if is_links(one, path) {
                    continue;
                }
                let mut code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
                if code.any(|line| line.contains(word)) {
                    let path = path.display();
                    complaints.push(format!("{}, {path}: {word}", one.name));
                }
            }
        }
    }
    complaints
}

/// Whether a source belongs to the links of a crate that has some.
fn is_links(one: &Crate, path: &Path) -> bool {
    let has_links = WITH_LINKS.contains(&&*one.name);
    has_links && path.components().any(|part| part.as_os_str() == LINKS)
}

fn strange_dependencies(crates: &[Crate]) -> Vec<String> {
    let mut complaints = Vec::new();
    for one in crates {
        for word in strange(&RESERVED_DEPENDENCIES, one) {
            if one.dependencies.iter().any(|name| name == word) {
                complaints.push(format!("{}: {word}", one.name));
            }
        }
    }
    complaints
}

/// Sources that name the reader of XML, and are not of a module `xml`.
fn xml_elsewhere(crates: &[Crate]) -> Vec<String> {
    let sources = crates.iter().flat_map(|one| one.sources.iter());
    let naming = sources.filter(|(_, text)| text.contains("quick_xml::"));
    let outside = naming.filter(|(path, _)| {
        let parts = path.iter().filter_map(|part| part.to_str());
        !parts
            .into_iter()
            .any(|part| part == "xml" || part == "xml.rs")
    });
    outside
        .map(|(path, _)| path.display().to_string())
        .collect()
}

/// What is reserved to other crates than this one.
fn strange<'a>(rules: &'a [Reserved], one: &Crate) -> impl Iterator<Item = &'a str> {
    rules
        .iter()
        .filter(|rule| !rule.to.iter().any(|names| names.contains(&&*one.name)))
        .flat_map(|rule| rule.words.iter().copied())
}

fn without_lints(crates: &[Crate]) -> Vec<String> {
    let inherits = |one: &&Crate| one.manifest.contains("[lints]\nworkspace = true\n");
    let found = crates.iter().filter(|one| !inherits(one));
    found.map(|one| one.name.clone()).collect()
}

fn too_long(sources: &[(PathBuf, String)]) -> Vec<String> {
    let lines = sources
        .iter()
        .map(|(path, text)| (path, text.lines().count()));
    let found = lines.filter(|(_, lines)| *lines > LONGEST);
    found
        .map(|(path, lines)| format!("{}: {lines} lines", path.display()))
        .collect()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn workspace() -> Vec<Crate> {
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--no-deps",
            "--offline",
        ])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let crates: Vec<Crate> = packages.iter().map(read_crate).collect();
    for name in GROUPS.concat() {
        assert!(crates.iter().any(|one| one.name == name), "{name} is gone");
    }
    crates
}

fn read_crate(package: &Value) -> Crate {
    let manifest = Path::new(package["manifest_path"].as_str().unwrap());
    let dependencies = package["dependencies"].as_array().unwrap();
    let name = package["name"].as_str().unwrap().to_owned();
    let only_for_links = |dependency: &&Value| {
        WITH_LINKS.contains(&&*name) && dependency["optional"] == Value::Bool(true)
    };
    Crate {
        manifest: std::fs::read_to_string(manifest).unwrap(),
        dependencies: dependencies
            .iter()
            .filter(|dependency| dependency["kind"] != "dev" && !only_for_links(dependency))
            .map(|dependency| dependency["name"].as_str().unwrap().to_owned())
            .collect(),
        sources: rust_files(&manifest.with_file_name("src")),
        name,
    }
}

/// The sources in a folder and those below; none where there is no such folder.
fn rust_files(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            // What a workspace of its own has built.
            if !path.ends_with("target") {
                files.extend(rust_files(&path));
            }
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            files.push((path, text));
        }
    }
    files
}
