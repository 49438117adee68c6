use std::net::IpAddr;

use fipa_directory::{Location, MESSAGE_TRANSPORT};

use super::*;
use crate::MdnsConfig;

/// An announcer on a simulated clock, and what the library was told.
struct Board {
    announcer: Announcer,
    now: Instant,
}

fn entry(name: &str, address: &str) -> Entry {
    let mut entry = Entry::new(name);
    entry.locations = vec![Location {
        address: address.into(),
        signature: MESSAGE_TRANSPORT.into(),
    }];
    entry
}

fn reach(hosts: &[&str]) -> Reach {
    let hosts: Vec<IpAddr> = hosts.iter().map(|host| host.parse().unwrap()).collect();
    let loopback = hosts.iter().all(IpAddr::is_loopback);
    Reach { hosts, loopback }
}

impl Board {
    fn new(most: usize, scope: &str) -> Board {
        let config = MdnsConfig {
            instance: InstanceId::from_bytes([0xab; 16]),
            name: "robot".to_owned(),
            scope: scope.to_owned(),
            endpoints: vec!["10.0.0.1:7000".parse().unwrap()],
            interfaces: Vec::new(),
            agents: most,
            port: 5353,
        };
        let rule = Rule::new(&config, &[]).unwrap();
        let service_type = ServiceType::of_scope(scope);
        let reach = reach(&["10.0.0.1"]);
        Board {
            announcer: Announcer::new(config.instance, service_type, most, rule, reach),
            now: Instant::now(),
        }
    }

    fn put(&mut self, name: &str) -> Result<(), LeftOut> {
        let entry = entry(name, "tcp://0.0.0.0:7000");
        self.announcer.put(self.now, entry)
    }

    fn remove(&mut self, name: &str) {
        self.announcer.remove(self.now, name);
    }

    /// What the library is told within a time: `+` and the label with the locator, or `-`.
    fn told(&mut self, within: Duration) -> Vec<String> {
        let until = self.now + within;
        let mut told = Vec::new();
        loop {
            while let Some(order) = self.announcer.order(self.now) {
                told.push(match order {
                    Order::Register(service) => {
                        let label = service.get_fullname().split("._fipa").next();
                        let locator = service.get_property_val_str("LOCATOR").unwrap();
                        let locator = locator.split(' ').next().unwrap();
                        format!("+{} {locator}", label.unwrap())
                    }
                    Order::Unregister(fullname) => {
                        format!("-{}", fullname.split("._fipa").next().unwrap())
                    }
                });
                self.announcer.done(self.now);
            }
            match self.announcer.poll_timeout() {
                Some(at) if at <= until => self.now = self.now.max(at),
                _ => break,
            }
        }
        self.now = until;
        told
    }

    fn soon(&mut self) -> Vec<String> {
        self.told(Duration::from_millis(10))
    }
}

const HERE: &str = "tcp://10.0.0.1:7000";

#[test]
fn an_agent_is_announced_and_says_goodbye() {
    let mut board = Board::new(5, "");
    assert_eq!(board.put("drive.left@robot"), Ok(()));
    assert_eq!(board.soon(), [format!("+drive?left@robot {HERE}")]);
    // Nothing changed, nothing is told.
    assert_eq!(board.put("drive.left@robot"), Ok(()));
    assert_eq!(board.soon(), [""; 0]);
    board.remove("drive.left@robot");
    assert_eq!(board.soon(), ["-drive?left@robot"]);
    board.remove("drive.left@robot");
    assert_eq!(board.soon(), [""; 0]);
}

#[test]
fn each_agent_has_a_host_name_of_its_own_and_port_0() {
    let mut board = Board::new(5, "");
    board.put("a").unwrap();
    board.put("b").unwrap();
    let mut hosts = Vec::new();
    while let Some(Order::Register(service)) = board.announcer.order(board.now) {
        assert_eq!(service.get_port(), 0);
        assert_eq!(service.get_type(), "_fipa_service_directory._udp.local.");
        assert!(!service.requires_probe());
        hosts.push(service.get_hostname().to_owned());
        board.announcer.done(board.now);
    }
    hosts.dedup();
    assert_eq!(hosts.len(), 2);
    assert!(hosts[0].starts_with("fipa-abababababababab-"), "{hosts:?}");
}

#[test]
fn a_name_with_capitals_is_told_twice() {
    let mut board = Board::new(5, "");
    board.put("Arm@robot").unwrap();
    let announcement = format!("+Arm@robot {HERE}");
    assert_eq!(board.soon().join(" "), announcement);
    assert_eq!(board.told(2 * SECOND_TIME).join(" "), announcement);
    assert_eq!(board.told(2 * SECOND_TIME), [""; 0]);
    // Not so if it leaves before.
    board.remove("Arm@robot");
    board.put("Arm@robot").unwrap();
    assert_eq!(
        board.told(AFTER_GOODBYE * 2),
        ["-Arm@robot".to_owned(), announcement]
    );
    board.remove("Arm@robot");
    assert_eq!(board.told(2 * SECOND_TIME), ["-Arm@robot"]);
}

#[test]
fn who_comes_back_waits_for_the_second_goodbye() {
    let mut board = Board::new(5, "");
    board.put("a").unwrap();
    board.soon();
    board.remove("a");
    board.put("a").unwrap();
    assert_eq!(board.told(Duration::from_millis(200)), ["-a"]);
    assert_eq!(
        board.told(Duration::from_millis(200)),
        [format!("+a {HERE}")]
    );
    board.remove("a");
    board.put("a").unwrap();
    board.remove("a");
    let told = board.told(Duration::from_secs(1));
    assert!(told.iter().all(|told| told == "-a"), "{told:?}");
}

#[test]
fn beyond_the_limit_agents_wait_their_turn() {
    let mut board = Board::new(2, "");
    let results: Vec<_> = ["a", "b", "c", "d"].map(|name| board.put(name)).into();
    let limit = Err(LeftOut::Limit(2));
    assert_eq!(results, [Ok(()), Ok(()), limit.clone(), limit]);
    let report = board.announcer.report();
    assert_eq!((report.announced, report.waiting), (2, 2));
    board.soon();
    board.remove("d");
    assert_eq!(board.soon(), [""; 0]);
    board.remove("a");
    assert_eq!(board.soon(), ["-a".to_owned(), format!("+c {HERE}")]);
    let report = board.announcer.report();
    assert_eq!((report.announced, report.waiting), (2, 0));
}

#[test]
fn none_is_announced_where_none_may_be() {
    let mut board = Board::new(0, "");
    assert_eq!(board.put("a"), Err(LeftOut::Limit(0)));
    let mut board = Board::new(5, "two words");
    assert_eq!(board.put("a"), Err(LeftOut::Scope));
    assert_eq!(board.soon(), [""; 0]);
}

#[test]
fn a_name_without_a_label_of_its_own_is_left_out() {
    let mut board = Board::new(5, "");
    let long = "a".repeat(64);
    assert_eq!(board.put(&long), Err(LeftOut::NameLength(64)));
    assert_eq!(board.put("a.b"), Ok(()));
    let taken = LeftOut::NameTaken("a.b".into());
    assert_eq!(board.put("A?b"), Err(taken.clone()));
    let report = board.announcer.report();
    let expected = [
        (Text::from("A?b"), taken),
        (Text::from(&long), LeftOut::NameLength(64)),
    ];
    assert_eq!(report.left_out, expected);
    board.soon();
    board.remove("a.b");
    let told = board.told(Duration::from_secs(1));
    assert_eq!(told, ["-a?b".to_owned(), format!("+A?b {HERE}")]);
}

#[test]
fn a_change_of_address_reaches_all() {
    let mut board = Board::new(5, "");
    board.put("a").unwrap();
    let local = entry("local", "tcp://127.0.0.1:1");
    let result = board.announcer.put(board.now, local);
    assert_eq!(result, Err(LeftOut::NoLocation));
    board.soon();
    board.announcer.set_reach(board.now, reach(&["10.0.0.2"]));
    assert_eq!(board.soon(), ["+a tcp://10.0.0.2:7000"]);
    board.announcer.set_reach(board.now, reach(&["127.0.0.1"]));
    let expected = ["+a tcp://127.0.0.1:7000", "+local tcp://127.0.0.1:1"];
    assert_eq!(board.soon(), expected);
    board.announcer.set_reach(board.now, reach(&["10.0.0.2"]));
    assert_eq!(board.soon(), ["+a tcp://10.0.0.2:7000", "-local"]);
}

#[test]
fn the_goodbyes_of_all_are_known_by_the_names_of_the_library() {
    let mut board = Board::new(5, "");
    board.put("a\\b").unwrap();
    board.put("c").unwrap();
    let mut fullnames = Vec::new();
    while let Some(Order::Register(service)) = board.announcer.order(board.now) {
        fullnames.push(service.get_fullname().to_owned());
        board.announcer.done(board.now);
    }
    assert_eq!(board.announcer.fullnames(), fullnames);
}
