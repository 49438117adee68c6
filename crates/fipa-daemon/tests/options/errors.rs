use std::path::Path;

use fipa_daemon::options::parse;
use tempfile::TempDir;

use crate::given::{env, file, line, write};

#[test]
fn wrong_places_in_the_file_are_named() {
    for (text, message) in [
        (
            "\n  lisen = []",
            r#"2:3: unknown key "lisen" (did you mean "listen"?)"#,
        ),
        (
            "max_letter = 1",
            r#"1:1: unknown key "max_letter" (did you mean "max-letter"?)"#,
        ),
        ("# é\n[devices]\n", r#"2:2: unknown key "devices""#),
        (
            "http = '127.0.0.1'",
            r#"1:8: http: "127.0.0.1" is not HOST:PORT, such as 192.168.1.5:7778"#,
        ),
        (
            "http-path = 'acc'",
            r#"1:13: http-path: "acc" is not a path, such as /acc"#,
        ),
        (
            "json = 1\n'a' = 2",
            "1:8: json: this takes true or false, not a whole number",
        ),
        ("z = 1\na = 1", r#"1:1: unknown key "z""#),
        (
            "name = 7",
            "1:8: name: this takes a string, not a whole number",
        ),
        (
            "peer = 1.5",
            "1:8: peer: this takes a string or a list of strings, not a number with",
        ),
        (
            "peer = ['é:1', true]",
            "1:16: peer: this takes a list of strings only, not true or",
        ),
        (
            "listen = ['a:1',\n 'b']",
            r#"2:2: listen: "b" is not HOST:PORT"#,
        ),
        (
            "listen = 'http://a:1'",
            r#"1:10: listen: "http://a:1": letters over HTTP are taken at --http"#,
        ),
        (
            "listen = []",
            "1:10: listen: at least one endpoint is needed",
        ),
        (
            "[listen]\nx = 1",
            "1:1: listen: this takes a string or a list of strings, not a table",
        ),
        (
            "listen.x = 1",
            "1:1: listen: this takes a string or a list of strings, not a table",
        ),
        (
            "interface = '10.0.0.0/33'",
            "1:13: interface: `10.0.0.0/33` is neither",
        ),
        ("interface = \"a\\nb\"", "1:13: interface: `a?b` is neither"),
        (
            "advertise = 'a:0'",
            r#"1:13: advertise: "a:0": nobody can connect to port 0"#,
        ),
        (
            "name = 'two words'",
            r#"1:8: name: "two words" is not a name"#,
        ),
        (
            "mdns-agents = -1",
            "1:15: mdns-agents: -1 is negative or too large",
        ),
        ("mdns-port = 65536", "1:13: mdns-port: 65536 is not a port"),
        ("mdns-port = 0", "1:13: mdns-port: 0 is not a port"),
        (
            "[outbox]\nletter = 1",
            r#"2:1: unknown key "letter" (did you mean "letters"?)"#,
        ),
        (
            "[outbox]\nhours = 0",
            "2:9: hours: 0 is no time to store a letter; it is 1 to 8784 hours",
        ),
        (
            "[outbox]\nbytes = '1'",
            "2:9: bytes: this takes a whole number, not a string",
        ),
        (
            "outbox = 1",
            "1:10: outbox: this takes a table, not a whole number",
        ),
        (
            "max-letter = -1",
            "1:14: max-letter: -1 is negative or too large",
        ),
        (
            "max-letter = 0",
            "1:14: max-letter: 0 is no size of a letter",
        ),
        (
            "max-letter = '1'",
            "1:14: max-letter: this takes a whole number, not a string",
        ),
        ("json = true\njson = true", "2:1: duplicate key"),
        ("peer = [", "1:"),
        ("\nname = robot1", "2:8: "),
        ("name", "1:"),
    ] {
        let (code, said) = file(text).error();
        assert_eq!(code, 2, "{text}: {said}");
        let wanted = format!("fipad.toml:{message}");
        assert!(
            said.starts_with(&wanted),
            "{text}\n said {said}\nwanted {wanted}"
        );
    }
}

#[test]
fn a_file_that_is_no_text_is_malformed_and_one_that_is_missing_an_environment_failure() {
    let dir = TempDir::new().unwrap();
    let load = |path: &Path| {
        let args = [
            "fipad".into(),
            "--config".into(),
            path.as_os_str().to_owned(),
        ];
        let error = parse(args.into_iter(), |_| None).unwrap_err();
        (error.exit_code(), error.to_string())
    };
    let path = write(&dir, b"# \xc3\xa9\nname = '\xff'");
    let shown = path.display();
    assert_eq!(load(&path), (2, format!("{shown}:2:9: not UTF-8")));
    let missing = dir.path().join("no\nfile");
    let (code, message) = load(&missing);
    assert_eq!(code, 3);
    assert!(message.contains("no?file: No such file"), "{message}");
    assert_eq!(load(dir.path()).0, 3);
}

#[test]
fn wrong_options_are_one_line() {
    for (words, message) in [
        (
            &["--lisen", "a:1"][..],
            "unexpected argument '--lisen' found (did you mean '--listen'?)",
        ),
        (
            &["dmeo"],
            "unrecognized subcommand 'dmeo' (did you mean 'demo'?)",
        ),
        (
            &["--http", "https://a:1"],
            "invalid value 'https://a:1' for '--http <HOST:PORT>': \"https://a:1\" is not \
             HOST:PORT, such as 192.168.1.5:7778",
        ),
        (&["--store", "d"], "unexpected argument '--store' found"),
        (
            &["--owns", "a\nb"],
            "invalid value 'a b' for '--owns <RESOURCE>': a resource has a name of one line",
        ),
        (
            &["--listen"],
            "a value is required for '--listen <URL|HOST:PORT>' but none was supplied",
        ),
        (
            &["--listen", "robot1"],
            "invalid value 'robot1' for '--listen <URL|HOST:PORT>': \"robot1",
        ),
        (
            &["--peer", "a:0"],
            "invalid value 'a:0' for '--peer <URL>': \"a:0\": nobody can",
        ),
        (
            &["--interface", "10.0.0.0/33"],
            "invalid value '10.0.0.0/33' for '--interface <NAME|",
        ),
        (
            &["--name", "9lives"],
            "invalid value '9lives' for '--name <NAME>': \"9lives\" is not a",
        ),
        (
            &["--name", "zoë"],
            "invalid value 'zoë' for '--name <NAME>'",
        ),
        (&["--name", ""], "invalid value '' for '--name <NAME>'"),
        (
            &["--control", ""],
            "a value is required for '--control <PATH>'",
        ),
        (
            &["--name", "a", "--name", "b"],
            "the argument '--name <NAME>' cannot be used multiple",
        ),
        (
            &["--max-letter", "256M"],
            "invalid value '256M' for '--max-letter <BYTES>': \"256M\" is",
        ),
        (&["--max-letter", "-1"], "unexpected argument '-1' found"),
        (
            &["--name", "a\n\nb"],
            "invalid value 'a b' for '--name <NAME>'",
        ),
        (
            &["--mdns-agents", "all"],
            "invalid value 'all' for '--mdns-agents <N>': \"all\" is not a whole number",
        ),
        (
            &["--mdns-port", "0"],
            "invalid value '0' for '--mdns-port <PORT>': 0 is not a port",
        ),
        (
            &["--json", "demo"],
            "the subcommand 'demo' cannot be used with '--json'",
        ),
        (&["demo", "--json"], "unexpected argument '--json' found"),
        (
            &["--no-mdns=false"],
            "unexpected value 'false' for '--no-mdns' found",
        ),
    ] {
        let (code, said) = line(words).error();
        assert_eq!(code, 2, "{said}");
        assert!(said.starts_with(message), "{words:?}: {said}");
    }
    let scope = "s".repeat(250);
    assert_eq!(line(&["--scope", &scope]).error().0, 2);
    assert_eq!(line(&["--scope", &scope[1..]]).options().scope, &scope[1..]);
}

#[test]
fn a_wrong_variable_is_named() {
    for (name, value, message) in [
        ("FIPAD_NAME", "two words", r#""two words" is not a name"#),
        ("FIPAD_LISTEN", "a:1,b", r#""b" is not HOST:PORT"#),
        ("FIPAD_INTERFACE", "::/129", "`::/129` is neither"),
        (
            "FIPAD_NO_MDNS",
            "yes please",
            r#""yes please" is neither true nor false"#,
        ),
        ("FIPAD_MDNS_PORT", "x", r#""x" is not a whole number"#),
        (
            "FIPAD_MAX_LETTER",
            "5000000000",
            "5000000000 is no size of a letter",
        ),
    ] {
        let (code, said) = env(&[(name, value)]).error();
        assert_eq!(code, 2, "{said}");
        assert!(said.starts_with(&format!("{name}: {message}")), "{said}");
    }
}
