//! The codecs on the message of fipa_acl's benchmark, beside Protocol Buffers, MessagePack and a
//! copy of the content, in one run.

use fipa_benches::operations::{self, Operation, Task};
use fipa_benches::rivals;
use fipa_benches::rounds::Rounds;

/// Octets of the contents.
const CONTENTS: [(&str, usize); 3] = [("1 B", 1), ("1 KB", 1 << 10), ("1 MB", 1 << 20)];

fn main() {
    println!("content  task    by                             ns   /prost  /memcpy");
    for (content, octets) in CONTENTS {
        for task in [Task::Encode, Task::Decode] {
            compare(content, octets, task);
        }
    }
}

fn compare(content: &str, octets: usize, task: Task) {
    let make = || group(octets, task);
    let (group, rounds) = (make(), Rounds::run(make));
    let place = |by| group.iter().position(|operation| operation.by == by);
    let (prost, memcpy) = (place("prost"), place("memcpy"));
    for (at, operation) in group.iter().enumerate() {
        let ratio = |other: Option<usize>| rounds.ratio(at, other.expect("measured"));
        println!(
            "{content:7}  {:6}  {:23} {:10.0}  {:7.2}  {:7.2}",
            task.as_str(),
            operation.by,
            rounds.median(at),
            ratio(prost),
            ratio(memcpy),
        );
    }
    println!();
}

fn group(octets: usize, task: Task) -> Vec<Operation> {
    let all = operations::operations(octets)
        .into_iter()
        .chain(rivals::operations(octets));
    all.filter(|operation| operation.task == task).collect()
}
