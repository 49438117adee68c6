//! `fipa hiac` between pipes, and on a stream.

use std::io::{Read, Write};
use std::net::TcpStream;

use crate::support::PATIENCE;
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

#[test]
fn a_device_waits_for_its_employer_and_answers_it() {
    let url = "tcp://127.0.0.1:0?listen";
    let mut device = Process::start(tool(&["hiac", "device", url, "--name", "drive", "--json"]));
    let listening = device.json();
    assert_eq!(listening["event"], "listening");
    let bound = listening["url"].as_str().unwrap();
    let place = bound
        .strip_prefix("tcp://")
        .and_then(|rest| rest.split('?').next())
        .unwrap();
    let mut employer = TcpStream::connect(place).unwrap();
    employer.set_read_timeout(Some(PATIENCE)).unwrap();
    employer
        .write_all(&octets("F8 1E 01 20 C4 D2 05 20 C4 D2 00 21 02 01 04 20 C4 D2 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 01 00 00 05 01 03 06 02 41 3E 07 01 00 09 F9"))
        .unwrap();
    // Its largest packet is 65536, and it has all types.
    assert_eq!(
        hear(&mut employer),
        "f81e0120c4d20020c4d2052803010420c4d2050204000000fccf030203e80404000100000501030602413e0701020a0564726976653cf9"
    );
    assert_eq!(device.json()["address"], "20:C4:D2:05");
    // A question with reference 1, to be confirmed; sum.
    employer
        .write_all(&octets("F8 13 4C 00 05 00 05 00 02 01 68 69 3D F9"))
        .unwrap();
    assert!(hear(&mut employer).starts_with("f81e4120c4d20020c4d2050701080100090100"));
    let answer = hear(&mut employer);
    // Confirmed and by level as the question, with its reference; CRC-32, since both can.
    assert!(answer.starts_with("f8134e000005050003016869"), "{answer}");
    assert_eq!(device.json()["event"], "question");
    device.signal(rustix::process::Signal::TERM);
    assert_eq!(device.wait().code, Some(0));
}

fn octets(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.bytes().filter(u8::is_ascii_hexdigit).collect();
    let pair = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.chunks(2).map(pair).collect()
}

/// The next packet that is not just a sign of life.
fn hear(stream: &mut TcpStream) -> String {
    loop {
        let mut packet = vec![0];
        stream.read_exact(&mut packet).unwrap();
        while packet.last() != Some(&0xF9) {
            let mut octet = [0];
            stream.read_exact(&mut octet).unwrap();
            packet.push(octet[0]);
        }
        if packet.len() > 2 {
            return packet.iter().map(|octet| format!("{octet:02x}")).collect();
        }
    }
}
