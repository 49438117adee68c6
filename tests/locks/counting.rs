//! A counter that each agent reads and writes back: what is not excluded gets lost.

use std::thread;
use std::time::Instant;

use crate::robots::{BOTH, Robots};

/// Each of three agents counts so often; the file must hold three times that.
fn count(times: usize, options: &[&str]) {
    let robots = Robots::start();
    for algorithm in BOTH {
        let file = robots.place.path(algorithm);
        std::fs::write(&file, "0\n").unwrap();
        let shown = file.display();
        let script = format!("read n < {shown}; sleep 0.001; echo $((n + 1)) > {shown}");
        let options = [&["--algorithm", algorithm], options].concat();
        let began = Instant::now();
        thread::scope(|scope| {
            for at in 0..3 {
                let (member, script, options) = (robots.member(at), &script, &options);
                scope.spawn(move || {
                    for _ in 0..times {
                        let ended = member.run(options, script);
                        assert_eq!(ended.code, Some(0), "{ended:?}");
                    }
                });
            }
        });
        let entries = times * 3;
        println!("{algorithm}: {entries} entries in {:?}", began.elapsed());
        let counted = std::fs::read_to_string(&file).unwrap();
        assert_eq!(counted.trim(), entries.to_string(), "{algorithm}");
    }
    // Every grant had a number of its own.
    let last = robots.listed(2);
    assert_eq!(last["fencing"], times * 3 * BOTH.len(), "{last}");
}

#[test]
fn three_agents_that_count_lose_no_count() {
    count(12, &[]);
}

#[test]
#[ignore = "takes a minute"]
fn three_agents_that_count_two_hundred_times_each_lose_no_count() {
    count(200, &[]);
}
