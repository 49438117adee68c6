//! Performs one operation a number of times, for tools that count instructions.
//!
//! Without arguments it prints the names of the operations.

use std::process::ExitCode;

use fipa_benches::operations::{Operation, operations};

/// Octets of the contents.
const CONTENTS: [usize; 3] = [1, 1 << 10, 1 << 20];

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let Some(name) = arguments.next() else {
        print_names();
        return ExitCode::SUCCESS;
    };
    let times = arguments.next().and_then(|times| times.parse::<u32>().ok());
    let (Some(mut operation), Some(times)) = (named(&name), times) else {
        eprintln!("usage: once [OPERATION TIMES]");
        return ExitCode::FAILURE;
    };
    for _ in 0..times {
        (operation.run)();
    }
    ExitCode::SUCCESS
}

fn print_names() {
    for octets in CONTENTS {
        for operation in operations(octets) {
            println!("{}", name_of(&operation, octets));
        }
    }
}

/// Only the contents that are asked for are made: what is set up is counted too.
fn named(name: &str) -> Option<Operation> {
    let octets = name.rsplit('/').next()?.parse().ok()?;
    operations(octets)
        .into_iter()
        .find(|operation| name_of(operation, octets) == name)
}

fn name_of(operation: &Operation, octets: usize) -> String {
    format!("{}/{}/{octets}", operation.task.as_str(), operation.by)
}
