use fipa_daemon::options::Invocation;

use crate::given::Given;

#[test]
fn there_are_two_subcommands_help_and_version() {
    // They read neither file nor environment.
    let parse = |word| {
        let given = Given {
            line: &[word],
            env: &[("FIPAD_JSON", "perhaps"), ("FIPAD_CONFIG", "/nowhere")],
            ..Given::default()
        };
        given.parse().unwrap()
    };
    assert_eq!(parse("demo"), Invocation::Demo);
    assert_eq!(parse("config"), Invocation::Config);
    let version = format!("fipad {}\n", env!("CARGO_PKG_VERSION"));
    assert_eq!(parse("--version"), Invocation::Help(version));
    let Invocation::Help(help) = parse("--help") else {
        panic!("no help");
    };
    assert!(help.contains("--listen <URL|HOST:PORT>"), "{help}");
    assert!(!help.contains("mdns-port"), "{help}");
}
