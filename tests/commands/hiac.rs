//! `fipa hiac` between pipes.

use crate::support::daemon::tool;
use crate::support::process::{Ended, Process};

fn piped(args: &[&str], octets: &[u8]) -> Ended {
    let mut process = Process::start(tool(args));
    process.feed(octets);
    process.wait()
}

#[test]
fn a_stream_of_packets_is_shown_as_json_and_written_again() {
    let lines = [
        r#"{"type":"SIG","priority":0,"confirm":false,"check":"sum","full-addressing":false,"target":"5","source":"3","data":"01f9"}"#,
        r#"{"type":"ALIVE"}"#,
        r#"{"type":"MSG","priority":3,"confirm":true,"check":"crc32","full-addressing":true,"psn":7,"fragment":{"index":0,"more":false},"target":"20:C4:D2:05","source":"20:C4:D2:00","data":"0301"}"#,
        r#"{"type":9,"priority":7,"confirm":false,"check":"sum","full-addressing":false,"target":"FF","source":"0","data":""}"#,
    ];
    let script = r#""$0" hiac encode --mask 00:00:00:FF | "$0" hiac decode --mask 00:00:00:FF -"#;
    let mut pipeline = std::process::Command::new("sh");
    pipeline.args(["-c", script, env!("CARGO_BIN_EXE_fipa")]);
    let mut process = Process::start(pipeline);
    process.feed(lines.join("\n").as_bytes());
    let ended = process.wait();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert_eq!(ended.output, lines);
}

#[test]
fn what_is_not_said_has_its_default() {
    let json = r#"{"type":"SIG","target":"20:C4:D2:05","source":"20:C4:D2:00"}"#;
    let script = r#""$0" hiac encode | "$0" hiac decode"#;
    let mut pipeline = std::process::Command::new("sh");
    pipeline.args(["-c", script, env!("CARGO_BIN_EXE_fipa")]);
    let mut process = Process::start(pipeline);
    process.feed(json.as_bytes());
    let expected = r#"{"type":"SIG","priority":4,"confirm":false,"check":"sum","full-addressing":true,"target":"20:C4:D2:05","source":"20:C4:D2:00","data":""}"#;
    assert_eq!(process.wait().output, [expected]);
}

#[test]
fn what_cannot_be_read_stands_in_its_place_and_the_exit_code_is_1() {
    let signal = [0xF8, 0x11, 0x00, 0x05, 0x03, 0x01, 0x01, 0x1B, 0xF9];
    let wrong = [0xF8, 0x11, 0x00, 0x05, 0x03, 0x01, 0x01, 0x1C, 0xF9];
    let stream = [&[0x01, 0xF9][..], &wrong, &[0xF8, 0x11], &signal, &[0x77]].concat();
    let ended = piped(&["hiac", "decode", "--mask", "00:00:00:FF"], &stream);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let readable = r#"{"type":"SIG","priority":0,"confirm":false,"check":"sum","full-addressing":false,"target":"5","source":"3","data":"01"}"#;
    assert_eq!(
        ended.output,
        [
            r#"{"error":"checksum","octets":"1100050301011c"}"#,
            r#"{"error":"unfinished","octets":"11"}"#,
            readable,
        ]
    );
    assert_eq!(ended.only_error(), "fipa hiac: 2 packets could not be read");

    let ended = piped(&["hiac", "decode"], &signal);
    assert_eq!(
        ended.output,
        [r#"{"error":"mask","octets":"1100050301011b"}"#]
    );

    let mut long = vec![0xF8];
    long.resize(70_000, 0x11);
    long.extend(&signal);
    let ended = piped(&["hiac", "decode", "--mask", "00:00:00:FF"], &long);
    let octets = "11".repeat(65_536);
    let too_long = format!(r#"{{"error":"too-long","octets":"{octets}"}}"#);
    assert_eq!(ended.output, [too_long.as_str(), readable]);
}

#[test]
fn a_packet_that_cannot_be_written_ends_it_with_2_and_says_where() {
    for (json, said) in [
        (r#"{"type":"SIG"}"#, "1:1: target: missing"),
        (
            r#"{"type":"SIGH","target":"1","source":"0"}"#,
            "1:1: type: expected",
        ),
        (
            r#"{"type":16,"target":"1","source":"0"}"#,
            "1:1: type: expected",
        ),
        (r#"{"type":"ALIVE","data":""}"#, "1:1: data: unknown key"),
        (
            r#"{"type":"SIG","target":"5","source":"3"}"#,
            "1:1: target: an address is four octets",
        ),
        (
            r#"{"type":"SIG","full-addressing":false,"target":"5","source":"3"}"#,
            "1:1: it has level addresses, and the mask is not known",
        ),
        (
            r#"{"type":"SIG","target":"20:C4:D2:05","source":"20:C4:D2:00","confirm":true}"#,
            "1:1: only a numbered packet is confirmed",
        ),
        (
            r#"{"type":"SIG","target":"20:C4:D2:05","source":"20:C4:D2:00","psn":1}"#,
            "1:1: psn and fragment go together",
        ),
        (
            r#"{"type":"SIG","target":"20:C4:D2:05","source":"20:C4:D2:00","data":"012"}"#,
            "1:1: data: expected two hexadecimal digits",
        ),
    ] {
        let ended = piped(&["hiac", "encode"], json.as_bytes());
        assert_eq!(ended.code, Some(2), "{json}: {ended:?}");
        let error = ended.only_error();
        assert!(error.starts_with(&format!("fipa hiac: {said}")), "{error}");
    }
    let ended = piped(&["hiac", "decode", "--mask", "00:00:00:05"], b"");
    assert_eq!(ended.code, Some(2), "{ended:?}");
}
