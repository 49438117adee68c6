use std::net::IpAddr;

use fipa_directory::{Location, MESSAGE_TRANSPORT};

use super::*;

struct Board(Announcer);

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
        let instance = InstanceId::from_bytes([0xab; 16]);
        let service_type = ServiceType::of_scope(scope);
        let reach = reach(&["10.0.0.1"]);
        Board(Announcer::new(instance, service_type, most, reach))
    }

    fn put(&mut self, name: &str) -> Result<(), LeftOut> {
        self.0.put(entry(name, "tcp://0.0.0.0:7000"))
    }

    fn remove(&mut self, name: &str) {
        self.0.remove(name);
    }

    fn set_reach(&mut self, hosts: &[&str]) {
        self.0.set_reach(reach(hosts));
    }

    /// What the network is told: `+` and the label with the first location, or `-` and the label.
    fn told(&mut self) -> Vec<String> {
        let orders = std::iter::from_fn(|| self.0.poll_order());
        let told = orders.map(|order| match order {
            Order::Announce(told) => {
                let locator = told.strings.iter().find(|(key, _)| key == "LOCATOR");
                let locator = str::from_utf8(&locator.unwrap().1).unwrap();
                let first = locator.split(' ').next().unwrap();
                format!("+{} {first}", told.label)
            }
            Order::Withdraw(label) => format!("-{label}"),
        });
        told.collect()
    }
}

const HERE: &str = "tcp://10.0.0.1:7000";

#[test]
fn an_agent_is_announced_and_says_goodbye() {
    let mut board = Board::new(5, "");
    assert_eq!(board.put("drive.left@robot"), Ok(()));
    assert_eq!(board.told(), [format!("+drive?left@robot {HERE}")]);
    // Nothing changed, nothing is told.
    assert_eq!(board.put("drive.left@robot"), Ok(()));
    assert_eq!(board.told(), [""; 0]);
    board.remove("drive.left@robot");
    assert_eq!(board.told(), ["-drive?left@robot"]);
    board.remove("drive.left@robot");
    assert_eq!(board.told(), [""; 0]);
}

#[test]
fn beyond_the_limit_agents_wait_their_turn() {
    let mut board = Board::new(2, "");
    let results: Vec<_> = ["a", "b", "c", "d"].map(|name| board.put(name)).into();
    let limit = Err(LeftOut::Limit(2));
    assert_eq!(results, [Ok(()), Ok(()), limit.clone(), limit]);
    let report = board.0.report();
    assert_eq!((report.announced, report.waiting), (2, 2));
    board.told();
    board.remove("d");
    assert_eq!(board.told(), [""; 0]);
    board.remove("a");
    assert_eq!(board.told(), ["-a".to_owned(), format!("+c {HERE}")]);
    let report = board.0.report();
    assert_eq!((report.announced, report.waiting), (2, 0));
}

#[test]
fn none_is_announced_where_none_may_be() {
    let mut board = Board::new(0, "");
    assert_eq!(board.put("a"), Err(LeftOut::Limit(0)));
    let mut board = Board::new(5, "two words");
    assert_eq!(board.put("a"), Err(LeftOut::Scope));
    assert_eq!(board.told(), [""; 0]);
}

#[test]
fn a_name_without_a_label_of_its_own_is_left_out() {
    let mut board = Board::new(5, "");
    let long = "a".repeat(64);
    assert_eq!(board.put(&long), Err(LeftOut::NameLength(64)));
    assert_eq!(board.put("a.b"), Ok(()));
    let taken = LeftOut::NameTaken("a.b".into());
    assert_eq!(board.put("A?b"), Err(taken.clone()));
    let report = board.0.report();
    let expected = [
        (Text::from("A?b"), taken),
        (Text::from(&long), LeftOut::NameLength(64)),
    ];
    assert_eq!(report.left_out, expected);
    board.told();
    board.remove("a.b");
    let told = board.told();
    assert_eq!(told, ["-a?b".to_owned(), format!("+A?b {HERE}")]);
}

#[test]
fn a_change_of_address_reaches_all() {
    let mut board = Board::new(5, "");
    board.put("a").unwrap();
    let local = entry("local", "tcp://127.0.0.1:1");
    let result = board.0.put(local);
    assert_eq!(result, Err(LeftOut::NoLocation));
    board.told();
    board.set_reach(&["10.0.0.2"]);
    assert_eq!(board.told(), ["+a tcp://10.0.0.2:7000"]);
    board.set_reach(&["127.0.0.1"]);
    let expected = ["+a tcp://127.0.0.1:7000", "+local tcp://127.0.0.1:1"];
    assert_eq!(board.told(), expected);
    board.set_reach(&["10.0.0.2"]);
    assert_eq!(board.told(), ["+a tcp://10.0.0.2:7000", "-local"]);
}

#[test]
fn a_free_label_goes_to_one_of_those_who_lack_it_and_a_free_place_to_who_came_first() {
    let mut board = Board::new(2, "");
    board.put("a.b").unwrap();
    board.put("x").unwrap();
    let taken = |holder: &str| Err(LeftOut::NameTaken(holder.into()));
    assert_eq!(board.put("a?b"), taken("a.b"));
    assert_eq!(board.put("A.b"), taken("a.b"));
    assert_eq!(board.put("y"), Err(LeftOut::Limit(2)));
    assert_eq!(board.put("z"), Err(LeftOut::Limit(2)));
    board.told();
    // Whoever lacked the label comes before those who wait, and the next one lacks it on.
    board.remove("a.b");
    assert_eq!(board.told(), ["-a?b".to_owned(), format!("+A?b {HERE}")]);
    assert_eq!(board.put("a?b"), taken("A.b"));
    // Who lacks a label no longer does not come back with it.
    board.remove("a?b");
    board.remove("A.b");
    assert_eq!(board.told(), ["-A?b".to_owned(), format!("+y {HERE}")]);
    board.remove("x");
    assert_eq!(board.told(), ["-x".to_owned(), format!("+z {HERE}")]);
}

#[test]
fn of_ten_thousand_agents_each_that_leaves_lets_one_move_up_in_their_order() {
    let mut board = Board::new(200, "");
    let name = |i: usize| format!("agent-{i}");
    for i in 0..10_000 {
        let expected = if i < 200 {
            Ok(())
        } else {
            Err(LeftOut::Limit(200))
        };
        assert_eq!(board.put(&name(i)), expected);
    }
    assert_eq!(board.told().len(), 200);
    for i in 0..9_800 {
        board.remove(&name(i));
        let next = format!("+{} {HERE}", name(i + 200));
        assert_eq!(board.told(), [format!("-{}", name(i)), next]);
    }
    board.remove(&name(9_800));
    assert_eq!(board.told(), [format!("-{}", name(9_800))]);
    let report = board.0.report();
    assert_eq!((report.announced, report.waiting), (199, 0));
}
