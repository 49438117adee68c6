use std::collections::BTreeMap;
use std::time::Duration;

use fipa::{OutboxConfig, Rules};
use fipa_daemon::options::{DEFAULT_CONFIG, FleetMode, Options};
use fipa_gateway::HiacNames;
use hiac::Mask;
use hiac::station::Workgroup;
use tempfile::TempDir;

use crate::given::{Given, env, file, line, write};

/// That of a certificate.
const FINGERPRINT: &str = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

fn texts(values: &[impl ToString]) -> Vec<String> {
    values.iter().map(ToString::to_string).collect()
}

#[test]
fn nothing_said_gives_the_defaults() {
    let options = line(&[]).options();
    assert_eq!(options, Options::default());
    assert_eq!(texts(&options.listen), ["tcp://127.0.0.1:0"]);
    assert_eq!(options.name, None);
    assert_eq!(options.mdns_agents, 200);
    assert_eq!(options.mdns_port, 5353);
    assert_eq!(options.max_letter, 268_435_456);
    assert_eq!(options.control, fipa::default_control_path());
}

#[test]
fn the_stronger_source_wins_for_each_option_by_itself() {
    let given = Given {
        line: &["--name", "line", "--peer", "a:1"],
        file: Some("name = 'file'\nscope = 'file'\npeer = 'b:1'\nlisten = 'b:2'\njson = false"),
        env: &[
            ("FIPAD_NAME", "env"),
            ("FIPAD_SCOPE", "env"),
            ("FIPAD_LISTEN", "c:2"),
            ("FIPAD_MAX_LETTER", "9"),
            ("FIPAD_JSON", "true"),
        ],
    };
    let options = given.options();
    assert_eq!(options.name.as_deref(), Some("line"));
    assert_eq!(texts(&options.peer), ["tcp://a:1"]);
    assert_eq!(options.scope, "file");
    assert_eq!(texts(&options.listen), ["tcp://b:2"]);
    assert!(!options.json);
    assert_eq!(options.max_letter, 9);
    assert_eq!(options.mdns_port, 5353);
}

#[test]
fn every_option_can_be_given_in_every_source() {
    let wanted = Options {
        name: Some("robot1".into()),
        listen: vec![
            "0.0.0.0:4100".parse().unwrap(),
            "unix:///a".parse().unwrap(),
        ],
        http: Some("robot1:7778".into()),
        http_path: "/mts".into(),
        advertise: vec!["tcp://robot1:4100".parse().unwrap()],
        scope: "plant".into(),
        fleet: Some("/etc/fleet".into()),
        fleet_mode: Some(FleetMode::Pinned),
        pinned: vec![FINGERPRINT.parse().unwrap()],
        require_fleet: true,
        rules: Rules::default(),
        interface: vec!["wlan0".parse().unwrap(), "10.0.0.0/8".parse().unwrap()],
        no_mdns: true,
        mdns_agents: 20,
        mdns_port: 5454,
        peer: vec!["tcp://[::1]:1".parse().unwrap(), "b:2".parse().unwrap()],
        control: "/run/x.sock".into(),
        json: true,
        owns: vec!["gripper".into(), "door".into()],
        hiac: vec![
            "tcp://127.0.0.1:0?listen".parse().unwrap(),
            "serial:///dev/ttyS0?baud=9600&address=20:C4:D2:05"
                .parse()
                .unwrap(),
        ],
        hiac_address: Some(Workgroup {
            address: "20:C4:D2:00".parse().unwrap(),
            mask: Mask::new(0xFF).unwrap(),
        }),
        hiac_names: HiacNames::default(),
        text: vec![
            "udp://127.0.0.1:5000".parse().unwrap(),
            "serial:///dev/ttyUSB0?baud=9600".parse().unwrap(),
        ],
        text_agents: BTreeMap::new(),
        log_letters: Some("/var/log/letters".into()),
        max_letter: 1000,
        state: Some("/var/lib/fipad".into()),
        outbox: OutboxConfig::default(),
    };
    let words = "--fleet /etc/fleet --fleet-mode pinned --require-fleet --pinned \
                 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef \
                 --name robot1 --listen tcp://0.0.0.0:4100 --listen unix:///a \
                 --http robot1:7778 --http-path /mts --advertise tcp://robot1:4100 \
                 --scope plant --interface wlan0 \
                 --interface 10.0.0.0/8 --no-mdns --mdns-agents 20 --mdns-port 5454 \
                 --peer [::1]:1 --peer b:2 \
                 --control /run/x.sock --json \
                 --owns gripper --owns door --hiac tcp://127.0.0.1:0?listen \
                 --hiac serial:///dev/ttyS0?baud=9600&address=20:C4:D2:05 \
                 --hiac-address 20:C4:D2:00/00:00:00:FF --text udp://127.0.0.1:5000 \
                 --text serial:///dev/ttyUSB0?baud=9600 --log-letters /var/log/letters \
                 --max-letter 1000 \
                 --state /var/lib/fipad";
    let words: Vec<&str> = words.split_whitespace().collect();
    assert_eq!(line(&words).options(), wanted);
    let text = r#"
        name = "robot1"
        listen = ["tcp://0.0.0.0:4100", "unix:///a"]
        http = "robot1:7778"
        http-path = "/mts"
        advertise = "tcp://robot1:4100"
        scope = "plant"
        fleet = "/etc/fleet"
        fleet-mode = "pinned"
        pinned = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef"
        require-fleet = true
        interface = ["wlan0", "10.0.0.0/8"]
        no-mdns = true
        mdns-agents = 20
        mdns-port = 5454
        peer = ["[::1]:1", "tcp://b:2"]
        control = "/run/x.sock"
        json = true
        owns = ["gripper", "door"]
        hiac = ["tcp://127.0.0.1:0?listen", "serial:///dev/ttyS0?baud=9600&address=20:C4:D2:05"]
        hiac-address = "20:C4:D2:00/00:00:00:FF"
        text = ["udp://127.0.0.1:5000", "serial:///dev/ttyUSB0?baud=9600"]
        log-letters = "/var/log/letters"
        max-letter = 1_000
        state = "/var/lib/fipad"
    "#;
    assert_eq!(file(text).options(), wanted);
    let variables = [
        ("FIPAD_NAME", "robot1"),
        ("FIPAD_LISTEN", "tcp://0.0.0.0:4100,unix:///a"),
        ("FIPAD_HTTP", "http://robot1:7778"),
        ("FIPAD_HTTP_PATH", "/mts"),
        ("FIPAD_ADVERTISE", "robot1:4100"),
        ("FIPAD_SCOPE", "plant"),
        ("FIPAD_FLEET", "/etc/fleet"),
        ("FIPAD_FLEET_MODE", "pinned"),
        ("FIPAD_PINNED", FINGERPRINT),
        ("FIPAD_REQUIRE_FLEET", "1"),
        ("FIPAD_INTERFACE", "wlan0 10.0.0.0/8"),
        ("FIPAD_NO_MDNS", "1"),
        ("FIPAD_MDNS_AGENTS", "20"),
        ("FIPAD_MDNS_PORT", "5454"),
        ("FIPAD_PEER", " [::1]:1 ,\n b:2,"),
        ("FIPAD_CONTROL", "/run/x.sock"),
        ("FIPAD_JSON", "true"),
        ("FIPAD_OWNS", "gripper,door"),
        (
            "FIPAD_HIAC",
            "tcp://127.0.0.1:0?listen serial:///dev/ttyS0?baud=9600&address=20:C4:D2:05",
        ),
        ("FIPAD_HIAC_ADDRESS", "20:C4:D2:00/00:00:00:FF"),
        (
            "FIPAD_TEXT",
            "udp://127.0.0.1:5000,serial:///dev/ttyUSB0?baud=9600",
        ),
        ("FIPAD_LOG_LETTERS", "/var/log/letters"),
        ("FIPAD_MAX_LETTER", "1000"),
        ("FIPAD_STATE", "/var/lib/fipad"),
    ];
    assert_eq!(env(&variables).options(), wanted);
}

#[test]
fn the_limits_of_what_is_stored_have_a_table_of_their_own() {
    let outbox = file("[outbox]\nletters = 5\nhours = 48").options().outbox;
    let wanted = OutboxConfig {
        letters: 5,
        age: Duration::from_secs(48 * 3600),
        ..OutboxConfig::default()
    };
    assert_eq!(outbox, wanted);
    let text = "outbox = { bytes = 6, total-bytes = 7 }";
    let outbox = file(text).options().outbox;
    assert_eq!((outbox.octets, outbox.total_octets), (6, 7));
}

#[test]
fn an_empty_list_or_text_in_the_file_wins_and_an_empty_variable_says_nothing() {
    let given = Given {
        file: Some("peer = []\nname = ''\ncontrol = ''\nlog-letters = ''\nstate = ''"),
        env: &[
            ("FIPAD_PEER", "a:1"),
            ("FIPAD_NAME", "env"),
            ("FIPAD_CONTROL", "/x"),
            ("FIPAD_LOG_LETTERS", "/y"),
            ("FIPAD_STATE", "/x"),
        ],
        ..Given::default()
    };
    assert_eq!(given.options(), Options::default());
    let empty = env(&[
        ("FIPAD_LISTEN", " , "),
        ("FIPAD_NAME", ""),
        ("FIPAD_JSON", ""),
    ]);
    assert_eq!(empty.options(), Options::default());
}

#[test]
fn a_variable_names_the_file_unless_the_command_line_does() {
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "scope = 'variable'");
    let env = [("FIPAD_CONFIG", path.to_str().unwrap())];
    let scope = |file| {
        Given {
            env: &env,
            file,
            line: &[],
        }
        .options()
        .scope
    };
    assert_eq!(scope(None), "variable");
    assert_eq!(scope(Some("scope = 'line'")), "line");
}

#[test]
fn the_default_file_is_the_defaults() {
    // Keys follow their # at once, explanations after a space.
    let keys = DEFAULT_CONFIG
        .lines()
        .filter_map(|line| line.strip_prefix('#'));
    let keys: Vec<&str> = keys
        .filter(|line| line.starts_with(|c: char| c.is_alphabetic() || c == '['))
        // Rules are examples: by default there is none.
        .filter(|line| !line.starts_with("[["))
        .collect();
    assert_eq!(keys.len(), 32);
    let text = keys.join("\n");
    let given = Given {
        file: Some(&text),
        env: &[("FIPAD_SCOPE", "beaten"), ("FIPAD_NAME", "beaten")],
        ..Given::default()
    };
    assert_eq!(given.options(), Options::default());
    assert_eq!(file(DEFAULT_CONFIG).options(), Options::default());
}

#[test]
fn tables_of_the_file_name_hiac_devices_and_the_agents_that_they_know() {
    let text = r#"
        hiac = "tcp://127.0.0.1:0?listen"
        hiac-address = "20:C4:D2:00/00:00:00:FF"
        [hiac-devices]
        "20:C4:D2:05" = "drive"
        [hiac-aliases]
        "20:C4:D2:20" = "operator@station"
    "#;
    let names = file(text).options().hiac_names;
    let device = "20:C4:D2:05".parse().unwrap();
    let alias = "20:C4:D2:20".parse().unwrap();
    assert_eq!(names.devices[&device], "drive");
    assert_eq!(names.aliases[&alias].as_str(), "operator@station");
}

#[test]
fn hiac_stations_need_an_address_that_employs_and_employees_of_its_workgroup() {
    let group = "20:C4:D2:00/00:00:00:FF";
    for (words, said) in [
        (&["--hiac", "tcp://a:1"][..], "needs --hiac-address"),
        (&["--hiac-address", "20:C4:D2:05/00:00:00:FF"], "level 5"),
        (&["--hiac-address", "20:C4:D2:00/00:00:00:F1"], "no mask"),
        (
            &["--hiac", "udp://a:1", "--hiac-address", group],
            "no place",
        ),
        (
            &[
                "--hiac",
                "tcp://a:1?address=20:C4:D3:05",
                "--hiac-address",
                group,
            ],
            "no address of the workgroup",
        ),
    ] {
        let (code, message) = line(words).error();
        assert_eq!(code, 2);
        assert!(message.contains(said), "{message}");
    }
}

#[test]
fn a_table_of_the_file_says_which_text_agents_are_there_for_good() {
    let text = r#"
        text = ["udp://127.0.0.1:0", "serial:///dev/ttyUSB0"]
        [text-agents]
        "lamp" = "serial:///dev/ttyUSB0?baud=115200"
        "drive" = "udp://192.168.1.7:5000"
    "#;
    let agents = file(text).options().text_agents;
    assert_eq!(
        agents["lamp"].to_string(),
        "serial:///dev/ttyUSB0?baud=115200"
    );
    assert_eq!(agents["drive"].to_string(), "udp://192.168.1.7:5000");
    for (places, agent, said) in [
        (
            "[]",
            "'lamp' = 'serial:///dev/ttyUSB0'",
            "is no place of --text",
        ),
        (
            "'tcp://a:1'",
            "'lamp' = 'udp://127.0.0.1:5'",
            "to send from",
        ),
        (
            "'udp://127.0.0.1:0'",
            "'lamp' = 'udp://lamp:5'",
            "an IP address",
        ),
        (
            "'udp://127.0.0.1:0'",
            "'lamp' = 'udp://127.0.0.1:0'",
            "and a port",
        ),
        (
            "'tcp://a:1'",
            "'la mp' = 'tcp://a:1'",
            "is no name of a text agent",
        ),
        ("'tcp://a:1'", "'9' = 'tcp://a:1'", "is not a name"),
        (
            "'tcp://a:1'",
            "'lamp' = 'tcp://a'",
            "is no place for text messages",
        ),
    ] {
        let text = format!("text = {places}\n[text-agents]\n{agent}");
        let (code, message) = file(&text).error();
        assert_eq!(code, 2);
        assert!(message.contains(said), "{message}");
    }
}
