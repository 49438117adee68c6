//! Names in a fleet: whose they are, and who gets one when it is free.

use std::collections::BTreeMap;

use bytes::BytesMut;
use fipa_acl::{AgentId, Envelope, FipaTime, Letter, Representation, Slots, Text};
use fipa_directory::{Entry, InstanceId, Location, Now, Source, State};
use fipa_link::{DirectoryFrame, DirectoryItem, Event, Frame, Hello, Link, LinkConfig, Role};
use fipa_mts::{
    Action, Config, ConnId, Connected, Ended, Machine, Mts, Notice, Output, RegisterError,
    Registration, Rule, Rules, Submission,
};

const NOW: Now = Now {
    mono: std::time::Duration::from_secs(1000),
    unix_millis: 1_795_341_600_000,
};

/// The robot `here` of a fleet, and others at the ends of links.
struct World {
    mts: Mts,
    robots: BTreeMap<u8, Robot>,
    refused: Vec<String>,
    registered: Vec<Result<(), RegisterError>>,
}

struct Robot {
    link: Link,
    to_us: BytesMut,
    from_us: BytesMut,
    version: u64,
    goodbye: Option<String>,
    heard: Vec<Frame>,
}

fn instance(id: u8) -> InstanceId {
    InstanceId::from_bytes([id; 16])
}

impl World {
    fn new(known: &[&str]) -> World {
        let mut config = Config::new(instance(100), "here");
        config.fleet = Some(known.iter().map(|name| Text::from(*name)).collect());
        World {
            mts: Mts::new(config),
            robots: BTreeMap::new(),
            refused: Vec::new(),
            registered: Vec::new(),
        }
    }

    /// A robot calls that has the certificate `certified`, and says that it is `name`.
    fn call(&mut self, id: u8, certified: &str, name: &str) {
        self.call_as(id, instance(id), certified, name);
    }

    fn call_as(&mut self, id: u8, instance: InstanceId, certified: &str, name: &str) {
        let hello = Hello {
            version: Hello::VERSION,
            role: Role::Daemon,
            instance,
            name: Text::from(name),
            scope: Text::default(),
            endpoints: Vec::new(),
            max_letter: 1 << 20,
            unix_millis: NOW.unix_millis,
            checks: false,
        };
        let robot = Robot {
            link: Link::new(LinkConfig::new(hello), NOW),
            to_us: BytesMut::new(),
            from_us: BytesMut::new(),
            version: 0,
            goodbye: None,
            heard: Vec::new(),
        };
        self.robots.insert(id, robot);
        let connected = Connected {
            conn: ConnId(id.into()),
            dialled: None,
            control: false,
            same_host: false,
            remote: Text::from("tcp://10.0.0.7:50000"),
            identity: Some(Text::from(certified)),
            lanes: false,
        };
        self.mts.connected(NOW, connected);
        self.exchange();
    }

    fn say(&mut self, id: u8, frame: Frame) {
        self.robots.get_mut(&id).unwrap().link.send(NOW, frame);
        self.exchange();
    }

    fn tell(&mut self, id: u8, items: Vec<DirectoryItem>) {
        let robot = self.robots.get_mut(&id).unwrap();
        robot.version += 1;
        let frame = DirectoryFrame {
            version: robot.version,
            snapshot: robot.version == 1,
            more: false,
            items,
        };
        self.say(id, Frame::Directory(frame));
    }

    fn put(&mut self, id: u8, name: &str) {
        let item = DirectoryItem::Put {
            owner: instance(id),
            source: Source::Local,
            state: State::Alive,
            age_millis: 0,
            entry: Entry::new(name),
        };
        self.tell(id, vec![item]);
    }

    fn remove(&mut self, id: u8, name: &str) {
        let item = DirectoryItem::Remove {
            owner: instance(id),
            name: Text::from(name),
        };
        self.tell(id, vec![item]);
    }

    fn end(&mut self, id: u8) {
        self.say(id, Frame::Goodbye(Text::from("the service ends")));
        let ended = Ended {
            reason: "",
            orderly: true,
            all_written: true,
        };
        self.mts.closed(NOW, ConnId(id.into()), ended);
        self.robots.remove(&id);
        self.exchange();
    }

    fn exchange(&mut self) {
        loop {
            let mut moved = false;
            for (id, robot) in &mut self.robots {
                let conn = ConnId((*id).into());
                while let Some(part) = robot.link.poll_transmit() {
                    moved = true;
                    robot.to_us.extend_from_slice(&part);
                }
                self.mts.received(NOW, conn, &mut robot.to_us);
                while let Some(part) = self.mts.poll_transmit(NOW, conn) {
                    moved = true;
                    robot.from_us.extend_from_slice(&part);
                }
                while let Some(event) = robot.link.receive(NOW, &mut robot.from_us).unwrap() {
                    match event {
                        Event::Frame(Frame::Goodbye(reason)) => {
                            robot.goodbye = Some(reason.to_string());
                        }
                        Event::Frame(frame) => robot.heard.push(frame),
                        _ => {}
                    }
                }
            }
            while let Some(output) = self.mts.poll_output() {
                match output {
                    Output::Notice(Notice::Refused { who, reason }) => {
                        self.refused.push(format!("{who}: {reason}"));
                    }
                    Output::Registered { result, .. } => self.registered.push(result),
                    _ => {}
                }
            }
            if !moved {
                return;
            }
        }
    }

    /// Who has a name, by the numbers of the robots.
    fn holders(&self, name: &str) -> Vec<u8> {
        let records = self.mts.directory().find_all(name);
        records
            .iter()
            .map(|record| record.owner.as_bytes()[0])
            .collect()
    }
}

#[test]
fn a_robot_has_its_own_names_and_none_of_others() {
    let mut world = World::new(&["robot3"]);
    world.call(1, "robot1", "robot1");
    world.call(2, "mts@host.two", "mts@host.two");
    world.put(1, "arm@robot1");
    world.put(2, "arm@mts@host.two");
    for (stolen, owner) in [
        ("x@here", "here"),
        ("x@robot1", "robot1"),
        ("robot1", "robot1"),
        ("x@robot3", "robot3"),
    ] {
        world.put(2, stolen);
        assert_eq!(world.holders(stolen), [0_u8; 0], "{stolen}");
        let told = format!("mts@host.two: {stolen} is a name of {owner}, not of mts@host.two");
        assert_eq!(world.refused.pop(), Some(told));
    }
    assert_eq!(world.holders("arm@robot1"), [1]);
    assert_eq!(world.holders("arm@mts@host.two"), [2]);
}

#[test]
fn a_robot_that_was_not_known_gets_its_names_when_it_comes() {
    let mut world = World::new(&[]);
    world.call(1, "robot1", "robot1");
    world.put(1, "arm@robot2");
    assert_eq!(
        world.holders("arm@robot2"),
        [1],
        "nobody knows of a robot2 yet"
    );
    world.call(2, "robot2", "robot2");
    assert_eq!(world.holders("arm@robot2"), [0_u8; 0]);
    assert_eq!(
        world.refused,
        ["robot1: arm@robot2 is a name of robot2, not of robot1"]
    );
    world.put(2, "arm@robot2");
    assert_eq!(world.holders("arm@robot2"), [2]);
}

#[test]
fn a_name_of_no_robot_is_that_of_who_has_it_until_it_is_free() {
    let mut world = World::new(&[]);
    for (id, name) in [(1, "robot1"), (2, "robot2"), (3, "robot3")] {
        world.call(id, name, name);
    }
    world.put(1, "planner");
    world.put(2, "planner");
    world.put(3, "planner");
    assert_eq!(world.holders("planner"), [1]);
    assert_eq!(world.refused[0], "robot2: planner is an agent of robot1");
    world.remove(2, "planner");
    world.remove(1, "planner");
    assert_eq!(world.holders("planner"), [3], "it moved");
    world.put(1, "planner");
    world.end(3);
    assert_eq!(world.holders("planner"), [1]);
}

#[test]
fn an_agent_here_bears_no_name_of_another_robot() {
    let mut world = World::new(&["robot2"]);
    for (ticket, name) in [(1, "arm@robot2"), (2, "arm@here"), (3, "planner")] {
        world.mts.register(NOW, ticket, Registration::new(name));
    }
    world.call(1, "robot1", "robot1");
    let refused = RegisterError::Refused(Text::from("arm@robot2 is a name of robot2, not of here"));
    assert_eq!(world.registered, [Err(refused), Ok(()), Ok(())]);
    world.put(1, "planner");
    assert_eq!(world.holders("planner"), [100], "who is here has it");
}

#[test]
fn a_robot_is_who_its_certificate_says_and_nobodys_run() {
    let mut world = World::new(&[]);
    world.call(1, "robot1", "robot1");
    world.put(1, "arm@robot1");
    world.call(2, "robot2", "robot1");
    world.call_as(3, instance(1), "robot3", "robot3");
    for id in [2, 3] {
        let goodbye = world.robots[&id].goodbye.as_deref();
        assert_eq!(goodbye, Some("the name is not that of the certificate"));
    }
    assert_eq!(
        world.refused,
        [
            "tcp://10.0.0.7:50000: it has the certificate of robot2, and calls itself robot1",
            "tcp://10.0.0.7:50000: robot3 says that it is the running service of robot1",
        ]
    );
    assert_eq!(world.holders("arm@robot1"), [1]);
}

#[test]
fn agents_without_a_key_are_known_and_written_to_where_a_rule_admits_their_address() {
    let found = |rules: Rules| {
        let mut world = World::new(&["robot2"]);
        let mut config = world.mts.config().clone();
        config.rules = rules;
        world.mts = Mts::new(config);
        let neighbour = |name: &str| {
            let mut entry = Entry::new(name);
            entry.locations = vec![Location {
                address: Text::from("tcp://10.0.0.9:7000"),
                signature: Text::from("fipa::services::MessageTransport"),
            }];
            entry
        };
        world.mts.neighbour_found(NOW, neighbour("arm@rover"));
        world.mts.neighbour_found(NOW, neighbour("arm@robot2"));
        world.exchange();
        let names = world
            .mts
            .directory()
            .iter()
            .map(|record| record.entry.name.to_string());
        (names.collect::<Vec<_>>(), world.refused)
    };
    let admit = |address: &str| {
        let mut rule = Rule::allow([Action::Send, Action::Register]);
        rule.address = Some(address.parse().unwrap());
        Rules::new([rule])
    };
    let no_rule =
        "arm@rover: it has no key of the fleet, and no rule of the configuration admits it";
    for strangers in [Rules::default(), admit("10.0.1.0/24")] {
        let (known, refused) = found(strangers);
        assert!(known.is_empty(), "{known:?}");
        assert_eq!(refused[0], no_rule);
    }
    let (known, refused) = found(admit("10.0.0.0/24"));
    assert_eq!(known, ["arm@rover"], "the name of a robot is that robot's");
    assert_eq!(refused.len(), 1);
}

#[test]
fn a_letter_leaves_without_a_key_only_to_where_a_rule_admits_it() {
    let sent = |rules: Rules| {
        let mut config = Config::new(instance(100), "here");
        config.fleet = Some(Vec::new());
        config.rules = rules;
        let mut mts = Mts::new(config);
        let mut to = AgentId::new("arm@rover");
        to.addresses = vec![Text::from("tcp://10.0.0.9:7000")];
        let envelope = Envelope::new(Slots {
            to: vec![to.clone()],
            from: Some(AgentId::new("me@here")),
            acl_representation: Some(Representation::BitEfficient),
            date: Some(FipaTime::from_unix_millis(0)),
            intended_receiver: vec![to],
            ..Slots::default()
        });
        let payload = bytes::Bytes::from_static(b"hi");
        let letter = Letter { envelope, payload };
        mts.submit(
            NOW,
            Submission::new(1, letter, std::time::Duration::from_secs(5)),
        );
        let mut dials = Vec::new();
        while let Some(output) = mts.poll_output() {
            if let Output::Dial { dial, link, .. } = output {
                dials.push(link);
                if link {
                    mts.dial_failed(NOW, dial, "nobody there speaks TLS");
                }
            }
        }
        dials
    };
    let mut rule = Rule::allow([Action::Send]);
    rule.address = Some("10.0.0.9".parse().unwrap());
    assert_eq!(
        sent(Rules::new([rule])),
        [true, false],
        "as a robot first, then plainly"
    );
    assert_eq!(sent(Rules::default()), [true], "and never plainly");
}

#[test]
fn what_is_revoked_is_told_to_all_robots_once() {
    let mut world = World::new(&[]);
    world.call(1, "robot1", "robot1");
    let list = bytes::Bytes::from_static(b"a signed list");
    world.mts.revoked(NOW, list.clone());
    world.mts.revoked(NOW, list.clone());
    world.call(2, "robot2", "robot2");
    world.exchange();
    let told = Frame::Revoked(list);
    for robot in world.robots.values() {
        let lists = robot.heard.iter().filter(|frame| **frame == told);
        assert_eq!(lists.count(), 1);
    }
}
