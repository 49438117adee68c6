//! What the README shows is what there is.

use std::fs;
use std::path::Path;

use clap::Parser as _;

fn read(path: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

#[test]
fn the_library_example_is_the_program_that_is_tested() {
    let readme = read("README.md");
    let example = read("examples/request.rs");
    let block = readme
        .split("```rust\n")
        .nth(1)
        .unwrap()
        .split("```")
        .next()
        .unwrap();
    assert!(block.lines().count() > 5);
    let flat = |text: &str| text.split_whitespace().collect::<String>();
    assert!(
        flat(&example).contains(&flat(block)),
        "the block is not in the example:\n{block}"
    );
}

#[test]
fn every_command_is_one_that_the_programs_take() {
    let readme = read("README.md");
    let commands = readme.lines().filter_map(|line| line.strip_prefix("    "));
    let mut seen = 0;
    for command in commands.filter(|line| line.starts_with("fipa")) {
        let words = words(command);
        seen += 1;
        if words[0] == "fipad" {
            let parsed = fipa_daemon::options::parse(words.iter().map(Into::into), |_| None);
            assert!(parsed.is_ok(), "{command}: {parsed:?}");
        } else {
            let parsed = fipa_cli::Cli::try_parse_from(&words);
            assert!(parsed.is_ok(), "{command}: {}", parsed.unwrap_err());
        }
    }
    assert!(seen > 8, "only {seen} commands were found");
}

/// Splits as a shell does that knows single quotes.
fn words(command: &str) -> Vec<String> {
    let mut words = Vec::new();
    for (number, part) in command.split('\'').enumerate() {
        if number % 2 == 1 {
            words.push(part.to_owned());
        } else {
            words.extend(part.split_whitespace().map(str::to_owned));
        }
    }
    words
}
