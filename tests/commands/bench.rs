//! `fipa bench`, alone and between two processes.

use rustix::process::Signal;
use serde_json::Value;

use crate::support::daemon::tool;
use crate::support::process::{Process, keys, run};

fn holds(line: &Value) {
    for figures in [line, &line["raw"]] {
        let times = &figures["rtt_us"];
        assert_eq!(keys(times), ["min", "p50", "mean", "stddev", "p99", "max"]);
        assert!(times["p50"].as_f64() > Some(0.0), "{line}");
        assert!(figures["letters_per_second"].as_f64() > Some(0.0), "{line}");
        assert!(figures["mb_per_second"].as_f64() > Some(0.0), "{line}");
    }
    assert_eq!(keys(&line["ratio"]), ["rtt", "letters", "mb"]);
}

#[test]
fn each_transport_is_measured_beside_a_bare_socket() {
    let ended = run(tool(&["bench", "--seconds", "0.05", "--json"]));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let lines = ended.json();
    let transports: Vec<_> = lines.iter().map(|line| &line["transport"]).collect();
    assert_eq!(transports, ["tcp", "quic", "http"]);
    lines.iter().for_each(holds);
}

#[test]
fn another_process_is_the_other_end_until_it_is_interrupted() {
    let mut other = Process::start(tool(&["bench", "--serve", "127.0.0.1:0", "--json"]));
    let ready = other.json();
    assert_eq!(ready["event"], "ready");
    let address = ready["address"].as_str().unwrap().to_owned();
    let args = ["bench", &address, "--transport", "tcp", "--seconds", "0.05"];
    let shown = run(tool(&args));
    assert_eq!(shown.code, Some(0), "{shown:?}");
    assert!(shown.output[3].starts_with("tcp "), "{shown:?}");
    holds(&run(tool(&[&args[..], &["--json"]].concat())).only_json());
    other.signal(Signal::TERM);
    assert_eq!(other.wait().code, Some(0));
    let nobody = run(tool(&["bench", &address]));
    assert_eq!(nobody.code, Some(3), "{nobody:?}");
    assert!(nobody.only_error().contains("fipa bench --serve"));
}

#[test]
fn what_is_no_place_is_wrong_usage() {
    for args in [["bench", "robot2"], ["bench", "--serve=robot1"]] {
        assert_eq!(run(tool(&args)).code, Some(2), "{args:?}");
    }
}
