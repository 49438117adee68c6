//! What the fuzz targets check, of their corpora and of everything that was recorded.

use std::path::{Path, PathBuf};

use fipa_codec::fuzzing;

/// A target and what it calls.
type Target = (&'static str, fn(&[u8]));

const TARGETS: [Target; 8] = [
    ("bit_efficient_message", fuzzing::bit_efficient_message),
    ("bit_efficient_letter", fuzzing::bit_efficient_letter),
    ("code_table", fuzzing::code_table),
    ("string_message", fuzzing::string_message),
    ("xml_message", fuzzing::xml_message),
    ("xml_letter", fuzzing::xml_letter),
    ("payload", fuzzing::payload),
    ("roundtrip", fuzzing::roundtrip),
];

#[test]
fn corpora_do_no_harm() {
    for (name, body) in TARGETS {
        let files = files(&here().join("fuzz/corpus").join(name));
        assert!(!files.is_empty(), "no corpus of {name}");
        run(body, name, &files);
    }
}

#[test]
fn recordings_do_no_harm() {
    let files = files(&here().join("../../tests/vectors"));
    assert!(files.len() > 500, "only {} recordings", files.len());
    for (name, body) in TARGETS {
        run(body, name, &files);
    }
}

#[test]
fn every_target_is_run_here() {
    let mut targets: Vec<_> = files(&here().join("fuzz/fuzz_targets"))
        .iter()
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    let mut names = TARGETS.map(|(name, _)| name);
    targets.sort();
    names.sort();
    assert_eq!(targets, names);
}

/// Tells which file it was if a body panics.
fn run(body: fn(&[u8]), name: &str, files: &[PathBuf]) {
    for file in files {
        let octets = std::fs::read(file).unwrap();
        let outcome = std::panic::catch_unwind(|| body(&octets));
        assert!(outcome.is_ok(), "{name} with {}", file.display());
    }
}

fn here() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// All files in a folder and in the folders within it.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found
}
