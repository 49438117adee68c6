//! `fipa text` between pipes.

use crate::support::daemon::tool;
use crate::support::process::{Ended, Process};

fn piped(args: &[&str], octets: &[u8]) -> Ended {
    let mut process = Process::start(tool(args));
    process.feed(octets);
    process.wait()
}

#[test]
fn a_stream_of_text_messages_is_shown_as_json_and_written_again() {
    let stream = b"{O: MAITRE ; D: ESCLAVE ; X=1 ; A: COM}\r\n{Z:9;Q:;b=;D:B;U=7;O:A}{O:E;S:PANNE}";
    let decoded = piped(&["text", "decode"], stream);
    assert_eq!(decoded.code, Some(0), "{decoded:?}");
    let lines = [
        r#"{"origin":"MAITRE","destination":"ESCLAVE","reference":"1","action":"COM"}"#,
        r#"{"origin":"A","destination":"B","urgency":7,"question":"","other":{"Z":"9","b":""}}"#,
        r#"{"origin":"E","status":"PANNE"}"#,
    ];
    assert_eq!(decoded.output, lines);
    let encoded = piped(&["text", "encode", "-"], lines.join("\n").as_bytes());
    assert_eq!(encoded.code, Some(0), "{encoded:?}");
    assert_eq!(
        encoded.output,
        ["{O:MAITRE;D:ESCLAVE;X=1;A:COM}{O:A;D:B;U=7;Q:;Z:9;b:}{O:E;S:PANNE}"]
    );
}

#[test]
fn what_cannot_be_read_stands_in_its_place_and_the_exit_code_is_1() {
    let ended = piped(&["text", "decode"], b"..}{O:A;D:B{D:B;A:x}{D:B}\xff");
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert_eq!(
        ended.output,
        [
            r#"{"error":"unfinished","octets":"7b4f3a413b443a42"}"#,
            r#"{"destination":"B","action":"x"}"#,
            r#"{"error":"kind","octets":"7b443a427d"}"#,
        ]
    );
    assert_eq!(
        ended.only_error(),
        "fipa text: 2 messages could not be read"
    );
}

#[test]
fn a_message_that_cannot_be_written_ends_it_with_2_and_says_where() {
    for (json, said) in [
        (
            "{\"destination\":\"B\",\"action\":\"x\"}\n {\"action\":\"x\"}",
            "2:2: O, D or X is empty",
        ),
        ("{\"destination\":\"B\"}", "1:1: exactly one of action"),
        (
            "{\"destination\":\"B\",\"action\":\"a;b\"}",
            "1:1: A: \"a;b\" is not",
        ),
        (
            "{\"destination\":\"B\",\"action\":\"x\",\"urgency\":10}",
            "1:1: urgency: expected",
        ),
        ("{\"to\":\"B\"}", "1:1: to: unknown key"),
        ("{\"action\":", "1:10: EOF"),
    ] {
        let ended = piped(&["text", "encode"], json.as_bytes());
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert!(
            ended
                .only_error()
                .starts_with(&format!("fipa text: {said}")),
            "{ended:?}"
        );
    }
}
