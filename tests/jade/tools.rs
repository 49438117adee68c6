//! Letters that are posted by hand, with curl and Python; and the commands for other platforms.

use std::process::Command;

use fipa::blocking::Platform;
use fipa::{Message, Performative};

use crate::agents::{HTTP, http_of};
use crate::fake::Jade;
use crate::support::daemon::Place;
use crate::support::{PATIENCE, skipped};

const BODY: &str = "--B\r\nContent-Type: application/xml\r\n\r\n<?xml version=\"1.0\"?>\
    <envelope><params index=\"1\"><to><agent-identifier><name>arm@robot1</name></agent-identifier>\
    </to><from><agent-identifier><name>a@hand</name></agent-identifier></from>\
    <acl-representation>fipa.acl.rep.string.std</acl-representation></params></envelope>\r\n\
    --B\r\nContent-Type: application/text\r\n\r\n(inform :content \"by hand\")\r\n--B--\r\n";

/// Runs a program and tells what it prints; `None` if it is not there.
fn output(program: &str, words: &[&str]) -> Option<String> {
    let output = Command::new(program).args(words).output().ok()?;
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn curl_posts_a_letter_and_gets_the_status_of_its_faults() {
    let place = Place::new();
    let daemon = place.start_with(
        "robot1",
        &[
            "--no-mdns",
            "--http",
            "127.0.0.1:0",
            "--max-letter",
            "1000000",
        ],
    );
    let url = http_of(&daemon);
    let (letter, large) = (place.path("letter"), place.path("large"));
    std::fs::write(&letter, BODY).unwrap();
    let zeros = std::fs::File::create(&large).unwrap();
    zeros.set_len(1 << 30).unwrap();
    let mut arm = daemon.attach_with(&["listen", "--as", "arm@robot1", "--json"]);
    let data = |path: &std::path::Path| format!("@{}", path.display());
    let status = |words: &[&str]| {
        let mut all = vec!["-s", "-o", "/dev/null", "-w", "%{http_code}", "-m", "30"];
        all.extend(words);
        output("curl", &all)
    };
    let mixed = "Content-Type: multipart/mixed; boundary=B";
    let Some(taken) = status(&["-H", mixed, "--data-binary", &data(&letter), &url]) else {
        return skipped("curl");
    };
    assert_eq!(taken, "200");
    assert_eq!(arm.json()["message"]["content"], "by hand");
    let chunks = [
        "-H",
        "Transfer-Encoding: chunked",
        "-H",
        mixed,
        "--data-binary",
        &data(&letter),
        &url,
    ];
    assert_eq!(status(&chunks).unwrap(), "200");
    assert_eq!(arm.json()["message"]["content"], "by hand");
    for (words, wanted) in [
        (
            vec![
                "-H",
                "Content-Type: multipart/mixed",
                "--data-binary",
                &data(&letter),
                &url,
            ],
            "400",
        ),
        (
            vec![
                "-H",
                mixed,
                "-X",
                "PUT",
                "--data-binary",
                &data(&letter),
                &url,
            ],
            "405",
        ),
        (
            vec![
                "-H",
                mixed,
                "-T",
                &large.display().to_string(),
                "-X",
                "POST",
                &url,
            ],
            "413",
        ),
        (vec![&url], "200"),
    ] {
        assert_eq!(status(&words).unwrap(), wanted, "{words:?}");
    }
}

#[test]
fn python_posts_letters_over_one_connection() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &HTTP);
    let url = http_of(&daemon);
    let mut arm = daemon.attach_with(&["listen", "--as", "arm@robot1", "--json"]);
    let program = "import http.client, sys\n\
        host = sys.argv[1].split('/')[2]\n\
        connection = http.client.HTTPConnection(host)\n\
        for _ in range(3):\n    \
            connection.request('POST', '/acc', sys.argv[2].encode(), {'Content-Type': 'multipart/mixed; boundary=\"B\"'})\n    \
            answer = connection.getresponse()\n    \
            print(answer.status, len(answer.read()))\n";
    let Some(said) = output("python3", &["-c", program, &url, BODY]) else {
        return skipped("python3");
    };
    assert_eq!(said, "200 0\n".repeat(3));
    for _ in 0..3 {
        assert_eq!(arm.json()["message"]["content"], "by hand");
    }
}

/// Posts badly: without a boundary, with PUT, with a length that is too small; and at the same time
/// with one that is too large, and one octet a second.
const BAD: &str = r#"
import http.client, select, socket, sys, threading
host, port = sys.argv[1].split('/')[2].split(':')
body = sys.argv[2].encode()
mixed = {'Content-Type': 'multipart/mixed; boundary="B"'}
def status(answer):
    return answer.split(b' ')[1].decode() if answer else 'closed'
def ask(method, headers):
    connection = http.client.HTTPConnection(host, int(port))
    connection.request(method, '/acc', body, headers)
    return str(connection.getresponse().status)
def slowly(length, first, said):
    stream = socket.create_connection((host, int(port)))
    head = 'POST /acc HTTP/1.1\r\nHost: h\r\nContent-Type: multipart/mixed; boundary="B"\r\n'
    stream.sendall((head + 'Content-Length: %d\r\n\r\n' % length).encode() + body[:first])
    for octet in body[first:] + bytes(60):
        if select.select([stream], [], [], 1)[0]:
            break
        if first < len(body):
            stream.sendall(bytes([octet]))
    said.append(status(stream.recv(1000)))
slow, long = [], []
threads = [threading.Thread(target=slowly, args=args) for args in
    [(len(body), 1, slow), (len(body) + 10, len(body), long)]]
for thread in threads: thread.start()
print(ask('POST', {'Content-Type': 'multipart/mixed'}), ask('PUT', mixed),
    ask('POST', dict(mixed, **{'Content-Length': '20'})))
for thread in threads: thread.join()
print(*slow, *long)
"#;

#[test]
fn bad_letters_from_python_get_the_status_of_their_faults_and_nothing_leaks() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &HTTP);
    let open = || {
        let folder = format!("/proc/{}/fd", daemon.id());
        std::fs::read_dir(folder).unwrap().count()
    };
    let before = open();
    let Some(said) = output("python3", &["-c", BAD, &http_of(&daemon), BODY]) else {
        return skipped("python3");
    };
    assert_eq!(said, "400 405 400\n408 408\n");
    let begun = std::time::Instant::now();
    while open() > before {
        assert!(begun.elapsed() < PATIENCE, "connections are left open");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

#[test]
fn the_agents_of_jade_are_listed_and_reached_by_patterns_until_it_is_gone() {
    let (place, jade) = (Place::new(), Jade::start("platA"));
    let peer = ["--peer", jade.url()];
    let daemon = place.start_with("robot1", &[&HTTP[..], &peer].concat());
    daemon.wait_for("echo@platA");
    let found = daemon.run(&["agents", ".*", "--json"]).json();
    let names: Vec<_> = found.iter().map(|agent| agent["name"].clone()).collect();
    assert_eq!(names, ["echo@platA"], "its management is not listed");
    assert_eq!(found[0]["source"], "ams");
    assert_eq!(found[0]["locations"][0]["address"], jade.url());
    let sent = daemon.run(&[
        "send",
        "--to",
        "echo@.*",
        "--performative",
        "request",
        "--content",
        "hello",
        "--wait",
        "10",
        "--json",
    ]);
    assert_eq!(sent.code, Some(0), "{sent:?}");
    assert_eq!(sent.json()[0]["outcome"], "sent");
    assert_eq!(sent.json()[1]["message"]["content"], "hello");
    jade.end();
    let begun = std::time::Instant::now();
    while daemon.run(&["agents", "--json"]).code == Some(0) {
        assert!(begun.elapsed() < 4 * PATIENCE, "it is still listed");
        std::thread::sleep(std::time::Duration::from_millis(200));
    }
}

#[test]
fn a_platform_with_more_agents_than_jade_tells_unasked_is_listed_whole() {
    let (place, jade) = (Place::new(), Jade::start("platA"));
    jade.has_more_agents(500);
    let daemon = place.start_with("robot1", &[&HTTP[..], &["--peer", jade.url()]].concat());
    daemon.wait_for("agent499@platA");
    let found = daemon.run(&["agents", "agent.*@platA", "--json"]).json();
    assert_eq!(found.len(), 500);
    let listed = daemon.run(&["ams", "list", jade.url(), "--json"]).json();
    assert_eq!(listed.len(), 503);
}

#[test]
fn the_example_asks_an_agent_of_jade() {
    let jade = Jade::start("platA");
    let test = std::env::current_exe().unwrap();
    let example = test.ancestors().nth(2).unwrap().join("examples/jade");
    let said = output(&example.display().to_string(), &[jade.url(), "echo@platA"]);
    assert_eq!(said.as_deref(), Some("inform: hello\n"));
}

#[test]
fn our_own_platforms_are_added_by_their_url_and_name() {
    let place = Place::new();
    let (one, two) = (
        place.start_with("robot1", &HTTP),
        place.start_with("robot2", &HTTP),
    );
    let _echo = two.attach("echo", "echo@robot2");
    let url = format!("{}#robot2", http_of(&two));
    assert_eq!(one.run(&["platform", "add", &url]).output, ["robot2"]);
    let pinged = one.run(&["ping", "echo@robot2", "--count", "3", "--json"]);
    assert_eq!(pinged.only_json()["received"], 3);
    // The management is reached by its name there as well, and by no pattern.
    let found = one
        .run(&["df", "search", "--df", "df@robot2", "--json"])
        .json();
    let echo = found
        .iter()
        .find(|one| one["name"]["name"] == "echo@robot2");
    assert_eq!(echo.unwrap()["name"]["addresses"][0], http_of(&two));
    let all = [
        "send",
        "--to",
        "(ams|df)@.*",
        "--performative",
        "inform",
        "--json",
    ];
    assert_eq!(one.run(&all).only_json()["outcome"], "unknown");
}

#[test]
fn a_platform_is_added_and_its_management_asked_by_commands() {
    let (place, jade) = (Place::new(), Jade::start("platA"));
    let daemon = place.start_with("robot1", &HTTP);
    let listed = daemon.run(&["ams", "list", jade.url(), "--json"]);
    assert_eq!(listed.code, Some(0), "{listed:?}");
    let names: Vec<_> = listed
        .json()
        .iter()
        .map(|one| one["name"].clone())
        .collect();
    assert_eq!(names[2]["name"], "echo@platA");
    assert_eq!(names[2]["addresses"][0], jade.url());

    let added = daemon.run(&["platform", "add", jade.url()]);
    assert_eq!(
        (added.code, added.output),
        (Some(0), vec!["platA".to_owned()])
    );
    let found = daemon.run(&["agents", "echo.*", "--json"]).only_json();
    assert_eq!(found["source"], "ams");
    let nobody = daemon.run(&[
        "platform",
        "add",
        "http://127.0.0.1:1/acc",
        "--timeout",
        "1",
    ]);
    assert_eq!(nobody.code, Some(1), "{nobody:?}");
    let wrong = daemon.run(&["platform", "add", "tcp://127.0.0.1:1"]);
    assert_eq!(wrong.code, Some(2), "{wrong:?}");
}

#[test]
fn a_df_registers_with_another_one_whose_searches_then_come_to_it() {
    let place = Place::new();
    let parent = place.start_with("robot1", &HTTP);
    let child = place.start_with("robot2", &HTTP);
    let _drive = child.attach("echo", "drive@robot2");
    let url = format!("{}#robot1", http_of(&parent));
    assert_eq!(child.run(&["platform", "add", &url]).code, Some(0));
    let federated = child.run(&["df", "federate", "df@robot1"]);
    assert_eq!(federated.code, Some(0), "{federated:?}");
    let found = parent
        .run(&["df", "search", "--service-type", "fipa-df", "--json"])
        .only_json();
    assert_eq!(found["name"]["name"], "df@robot2");
    assert_eq!(found["name"]["addresses"][0], http_of(&child));
    let search = ["df", "search", "--service-name", "drive", "--json"];
    assert_eq!(parent.run(&search).code, Some(1));
    let deep = [&search[..], &["--depth", "1"]].concat();
    let found = parent.run(&deep).only_json();
    assert_eq!(found["name"]["name"], "drive@robot2");
    assert_eq!(found["name"]["addresses"][0], http_of(&child));
    let left = child.run(&["df", "federate", "df@robot1", "--leave"]);
    assert_eq!(left.code, Some(0), "{left:?}");
    assert_eq!(parent.run(&deep).code, Some(1));
}

#[test]
fn a_df_tells_all_that_it_knows_or_that_there_is_more() {
    const AGENTS: usize = 1500;
    let place = Place::new();
    let (one, two) = (
        place.start_with("robot1", &HTTP),
        place.start_with("robot2", &HTTP),
    );
    let url = format!("{}#robot2", http_of(&two));
    assert_eq!(one.run(&["platform", "add", &url]).code, Some(0));
    let platform = Platform::attach_to(&two.control).unwrap();
    let agent = platform.agent("clerk@robot2").unwrap();
    for n in 0..AGENTS {
        let register = Message::new(Performative::Request)
            .to("df@robot2")
            .ontology("fipa-agent-management")
            .language("fipa-sl0")
            .content(format!(
                "((action df@robot2 (register (df-agent-description \
                 :name (agent-identifier :name a{n}@robot2) \
                 :services (set (service-description :name s{n} :type many))))))"
            ));
        let answer = agent.request(register, PATIENCE).unwrap();
        assert_eq!(answer.performative, Performative::Inform);
    }
    let search = ["df", "search", "--service-type", "many", "--json"];
    let all = two.run(&search);
    assert_eq!((all.json().len(), all.errors), (AGENTS, vec![]));
    let some = one.run(&[&search[..], &["--df", "df@robot2"]].concat());
    assert_eq!((some.code, some.json().len()), (Some(0), 1000));
    let [said] = &some.errors[..] else {
        panic!("{:?}", some.errors);
    };
    assert!(
        said.contains("df@robot2 knows more than it tells at once"),
        "{said}"
    );
    let wanted = one.run(&[&search[..], &["--df", "df@robot2", "--max", "10"]].concat());
    assert_eq!((wanted.json().len(), wanted.errors), (10, vec![]));
}

#[test]
fn what_agents_offer_is_registered_found_and_told() {
    let place = Place::new();
    let daemon = place.start_with("robot1", &HTTP);
    let _drive = daemon.attach("echo", "drive@robot1");
    let search = ["df", "search", "--service-type", "transport", "--json"];
    assert_eq!(daemon.run(&search).code, Some(1));
    let subscribe = ["df", "subscribe", "--service-type", "transport", "--json"];
    let mut told = crate::support::process::Process::start(daemon.fipa(&subscribe));
    let register = [
        "df",
        "register",
        "--as",
        "drive@robot1",
        "--service-type",
        "transport",
        "--service-name",
        "drive",
        "--property",
        "load=20 kg",
        "--ontology",
        "logistics",
    ];
    let registered = daemon.run(&register);
    assert_eq!(registered.code, Some(0), "{registered:?}");
    let found = daemon.run(&search).only_json();
    assert_eq!(found["name"]["name"], "drive@robot1");
    assert_eq!(found["name"]["addresses"][0], http_of(&daemon));
    assert_eq!(found["services"][0]["name"], "drive");
    assert_eq!(found["services"][0]["properties"]["load"], "20 kg");
    // The second time it takes the place of the first, and expires.
    let again = [&register[..], &["--lease", "1"]].concat();
    assert_eq!(daemon.run(&again).code, Some(0));
    let found = daemon.run(&search).json();
    assert!(
        found.iter().all(|one| one["lease-until"].is_string()),
        "{found:?}"
    );
    assert_eq!(told.json()["name"]["name"], "drive@robot1");
    let begun = std::time::Instant::now();
    while daemon.run(&search).code == Some(0) {
        assert!(begun.elapsed() < PATIENCE, "it has not expired");
    }
    let nobody = daemon.run(&[
        "df",
        "register",
        "--as",
        "nobody@robot1",
        "--service-type",
        "t",
        "--service-name",
        "n",
    ]);
    assert_eq!(nobody.code, Some(1), "{nobody:?}");
}
