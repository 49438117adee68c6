//! Letters that pass are treated like all others: a service that is watched looks at each letter
//! closely, and does and says the same as one that is not.

use std::collections::BTreeMap;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{AgentId, Envelope, FipaTime, Received, Representation, Slots, Text};
use fipa_codec::{Output as Encoded, bit_efficient};
use fipa_directory::{Entry, InstanceId, Now, Source, State};
use fipa_link::{
    DirectoryFrame, DirectoryItem, Event, Frame, Hello, LetterFrame, Link, LinkConfig, Outcome,
    ReceiverOutcome, Role,
};
use fipa_mts::{Action, Config, ConnId, Connected, Ended, Machine, Mts, Output, Rule, Rules};
use proptest::prelude::*;

/// Who is at the other ends: two services and a program.
const PARTNERS: usize = 3;
const PROGRAM: usize = 2;

/// Agents, and who has each at the beginning.
const AGENTS: [(&str, usize); 5] = [
    ("a@one", 0),
    ("b@two", 1),
    ("c@two", 1),
    ("d@here", PROGRAM),
    ("roams", 1),
];

/// The agent that goes from one to another.
const ROAMS: usize = 4;

/// What is done to the service.
#[derive(Clone, Debug)]
enum Step {
    /// Letters from a partner, at once: the agent that sends, the one that gets, and how many.
    Letters {
        partner: usize,
        from: usize,
        to: usize,
        count: usize,
        octets: usize,
        again: bool,
        odd: usize,
    },
    /// A partner gives receipts for what it has got, the oldest first or last.
    Receipts {
        partner: usize,
        count: usize,
        newest: bool,
        told: usize,
    },
    Wait(u64),
    /// The agent that roams goes to another service, or nowhere.
    Move(Option<usize>),
    /// A link breaks, and there is another one.
    Break(usize),
    /// A link is written to as far as it takes it.
    Drain(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let partner = || 0..PARTNERS;
    let letters = (
        prop_oneof![2 => Just(0_usize), 1 => partner()],
        prop_oneof![3 => Just(0_usize), 1 => 0..AGENTS.len()],
        prop_oneof![2 => Just(ROAMS), 3 => 0..AGENTS.len() + 1],
        1..6_usize,
        prop_oneof![8 => 0..200_usize, 1 => 3000..9000_usize, 1 => 20_000..70_000_usize],
        prop::bool::weighted(0.1),
        prop_oneof![12 => Just(0_usize), 4 => 1..5_usize],
    );
    let letters =
        letters.prop_map(
            |(partner, from, to, count, octets, again, odd)| Step::Letters {
                partner,
                from,
                to,
                count,
                octets,
                again,
                odd,
            },
        );
    let told = prop_oneof![6 => Just(0_usize), 1 => 1..4_usize];
    let receipts = (partner(), 1..9_usize, any::<bool>(), told);
    let receipts = receipts.prop_map(|(partner, count, newest, told)| Step::Receipts {
        partner,
        count,
        newest,
        told,
    });
    let step = prop_oneof![
        8 => letters,
        6 => receipts,
        2 => (0..4000_u64).prop_map(Step::Wait),
        2 => prop::option::of(0..2_usize).prop_map(Step::Move),
        1 => partner().prop_map(Step::Break),
        2 => partner().prop_map(Step::Drain),
    ];
    prop::collection::vec(step, 1..40)
}

/// A service, and what it says.
struct World {
    mts: Mts,
    now: Now,
    ends: Vec<End>,
    conns: u64,
    /// What was written to each connection, and what was to be done, in its order.
    said: BTreeMap<ConnId, Vec<u8>>,
    done: Vec<String>,
}

/// The other end of a connection.
struct End {
    conn: ConnId,
    link: Link,
    unread: BytesMut,
    /// Letters that have come and have no receipt yet.
    letters: Vec<u64>,
    next: u64,
    version: u64,
}

fn instance(partner: usize) -> InstanceId {
    InstanceId::from_bytes([partner as u8 + 8; 16])
}

fn link(partner: usize, now: Now) -> Link {
    let hello = Hello {
        version: Hello::VERSION,
        role: if partner == PROGRAM {
            Role::Program
        } else {
            Role::Daemon
        },
        instance: instance(partner),
        name: Text::from(format!("partner{partner}")),
        scope: Text::default(),
        endpoints: vec![Text::from(format!("tcp://192.0.2.{partner}:4000"))],
        max_letter: 1 << 16,
        unix_millis: now.unix_millis,
        checks: partner == 1,
    };
    Link::new(LinkConfig::new(hello), now)
}

impl World {
    /// With queues of peers that get full.
    fn new(watched: bool) -> World {
        World::with(watched, 1 << 17)
    }

    fn with(watched: bool, queue_octets: usize) -> World {
        let now = Now {
            mono: Duration::from_secs(1000),
            unix_millis: 1_795_341_600_000,
        };
        let mut config = Config::new(InstanceId::from_bytes([5; 16]), "middle");
        config.queue_octets = queue_octets;
        let mut deny = Rule::deny([Action::Send]);
        deny.agent = Some("c@two".parse().unwrap());
        deny.to = Some("a@one".parse().unwrap());
        config.rules = Rules::new([deny]);
        let mut world = World {
            mts: Mts::new(config),
            now,
            ends: Vec::new(),
            conns: 0,
            said: BTreeMap::new(),
            done: Vec::new(),
        };
        world.mts.sniff(now, watched);
        for partner in 0..PARTNERS {
            let end = End {
                conn: ConnId(0),
                link: link(partner, now),
                unread: BytesMut::new(),
                letters: Vec::new(),
                next: 10,
                version: 1,
            };
            world.ends.push(end);
            world.connect(partner);
        }
        world
    }

    fn connect(&mut self, partner: usize) {
        self.conns += 1;
        let conn = ConnId(self.conns);
        let end = &mut self.ends[partner];
        end.conn = conn;
        end.link = link(partner, self.now);
        end.unread.clear();
        self.mts.connected(
            self.now,
            Connected {
                conn,
                dialled: None,
                control: partner == PROGRAM,
                same_host: false,
                remote: Text::from("tcp://192.0.2.9:1"),
                identity: None,
                lanes: false,
            },
        );
        // Who has not heard the other's hello does not know of checksums.
        self.hand_over(partner, usize::MAX);
        self.drain(partner);
        let names = AGENTS.iter().filter(|(_, at)| *at == partner);
        let names: Vec<&str> = names.map(|(name, _)| *name).collect();
        if partner == PROGRAM {
            for name in names {
                self.ends[partner].link.send(
                    self.now,
                    Frame::Attach {
                        request: 1,
                        name: Text::from(name),
                        kind: Text::from("fipa-agent"),
                        description: Text::default(),
                    },
                );
            }
        } else {
            self.ends[partner].version += 1;
            let items = names.iter().map(|name| put(partner, name)).collect();
            self.tell(partner, true, items);
        }
        self.hand_over(partner, usize::MAX);
    }

    fn tell(&mut self, partner: usize, snapshot: bool, items: Vec<DirectoryItem>) {
        let end = &mut self.ends[partner];
        let frame = DirectoryFrame {
            version: end.version,
            snapshot,
            more: false,
            items,
        };
        end.link.send(self.now, Frame::Directory(frame));
    }

    /// The service reads what a partner says, in pieces of so many octets.
    fn hand_over(&mut self, partner: usize, piece: usize) {
        let end = &mut self.ends[partner];
        let conn = end.conn;
        let said = std::iter::from_fn(|| end.link.poll_transmit()).collect::<Vec<_>>();
        let said = said.concat();
        let mut octets = BytesMut::new();
        for piece in said.chunks(piece.min(said.len()).max(1)) {
            octets.extend_from_slice(piece);
            self.mts.received(self.now, conn, &mut octets);
        }
        self.settle();
    }

    fn settle(&mut self) {
        while let Some(output) = self.mts.poll_output() {
            match output {
                Output::Transmit(_) | Output::Sniffed(_) | Output::Notice(_) => {}
                Output::Directory(change) => {
                    self.done
                        .push(format!("{:?} {}", change.kind, change.record.entry.name));
                }
                output => self.done.push(format!("{output:?}")),
            }
        }
    }

    /// The service writes to a partner, which hears it.
    fn drain(&mut self, partner: usize) {
        self.sip(partner, usize::MAX);
    }

    /// The service writes so many parts of what waits.
    fn sip(&mut self, partner: usize, parts: usize) {
        let end = &mut self.ends[partner];
        let said = self.said.entry(end.conn).or_default();
        for _ in 0..parts {
            let Some(part) = self.mts.poll_transmit(self.now, end.conn) else {
                break;
            };
            said.extend_from_slice(&part);
            end.unread.extend_from_slice(&part);
        }
        while let Ok(Some(event)) = end.link.receive(self.now, &mut end.unread) {
            if let Event::Frame(Frame::Letter(letter)) = event {
                end.letters.push(letter.id);
            }
        }
        self.settle();
    }

    fn step(&mut self, step: &Step) {
        match *step {
            Step::Letters {
                partner,
                from,
                to,
                count,
                octets,
                again,
                odd,
            } => {
                for _ in 0..count {
                    let now = self.now;
                    let end = &mut self.ends[partner];
                    end.next += if odd == 4 { 0 } else { 3 };
                    let id = end.next - if again { 3 } else { 0 };
                    let parts = letter(partner, id, from, to, octets, odd, now).into();
                    let ttl_millis = if odd == 2 { 500 } else { 5000 };
                    let frame = LetterFrame {
                        id,
                        ttl_millis,
                        parts,
                    };
                    end.link.send(now, Frame::Letter(frame));
                }
                self.hand_over(partner, if odd == 3 { 100 } else { usize::MAX });
            }
            Step::Receipts {
                partner,
                count,
                newest,
                told,
            } => {
                self.drain(partner);
                let end = &mut self.ends[partner];
                for _ in 0..count.min(end.letters.len()) {
                    let at = if newest { end.letters.len() - 1 } else { 0 };
                    let id = end.letters.remove(at);
                    let outcomes = receipt(told).into();
                    end.link.send(self.now, Frame::Receipt { id, outcomes });
                }
                self.hand_over(partner, usize::MAX);
            }
            Step::Wait(millis) => {
                let until = self.now.plus(Duration::from_millis(millis));
                while let Some(at) = self.mts.poll_timeout().filter(|at| *at <= until.mono) {
                    let left = at.saturating_sub(self.now.mono);
                    self.now = self.now.plus(left.max(Duration::from_millis(1)));
                    self.mts.handle_timeout(self.now);
                    self.settle();
                }
                self.now = Now {
                    mono: self.now.mono.max(until.mono),
                    unix_millis: self.now.unix_millis.max(until.unix_millis),
                };
            }
            Step::Move(to) => {
                for partner in 0..PROGRAM {
                    self.ends[partner].version += 1;
                    let item = match to == Some(partner) {
                        true => put(partner, "roams"),
                        false => DirectoryItem::Remove {
                            owner: instance(partner),
                            name: Text::from("roams"),
                        },
                    };
                    self.tell(partner, false, vec![item]);
                    self.hand_over(partner, usize::MAX);
                }
            }
            Step::Break(partner) => {
                let ended = Ended {
                    reason: "it broke",
                    orderly: false,
                    all_written: false,
                };
                let conn = self.ends[partner].conn;
                self.mts.closed(self.now, conn, ended);
                self.settle();
                self.ends[partner].letters.clear();
                self.connect(partner);
            }
            Step::Drain(partner) => self.drain(partner),
        }
    }
}

fn put(owner: usize, name: &str) -> DirectoryItem {
    DirectoryItem::Put {
        owner: instance(owner),
        source: Source::Local,
        state: State::Alive,
        age_millis: 0,
        entry: Entry::new(name),
    }
}

/// A letter as a partner writes it.
fn letter(
    partner: usize,
    id: u64,
    from: usize,
    to: usize,
    octets: usize,
    odd: usize,
    now: Now,
) -> Bytes {
    // One more than there are: nobody.
    let name = |at: usize| AGENTS.get(at).map_or("nobody", |(name, _)| *name);
    let date = FipaTime::from_unix_millis(now.unix_millis);
    let mut envelope = Envelope::new(Slots {
        to: vec![AgentId::new(name(to))],
        from: Some(AgentId::new(name(from))),
        acl_representation: Some(Representation::BitEfficient),
        payload_length: Some(octets as u64),
        date: Some(date),
        intended_receiver: vec![AgentId::new(name(to))],
        ..Slots::default()
    });
    if odd == 1 {
        let other = AgentId::new(name((to + 1) % AGENTS.len()));
        envelope.base.intended_receiver.push(other);
    }
    if partner != PROGRAM {
        envelope.overlays.push(Slots {
            received: Some(Received {
                by: Text::from(format!("partner{partner}")),
                from: None,
                date,
                id: Some(Text::from(format!("{}:{id}", instance(partner)))),
                via: None,
                user_defined: Vec::new(),
            }),
            ..Slots::default()
        });
    }
    let mut head = Encoded::new();
    bit_efficient::encode_envelope(&envelope, &mut head).unwrap();
    [head.take_bytes(), Bytes::from(vec![id as u8; octets])]
        .concat()
        .into()
}

fn receipt(told: usize) -> ReceiverOutcome {
    let outcomes = [
        (Outcome::Delivered, ""),
        (Outcome::Unknown, "no such agent"),
        (Outcome::Refused, "the agent's mailbox is full"),
        (Outcome::Sent, ""),
    ];
    let (outcome, reason) = outcomes[told];
    ReceiverOutcome {
        to: Text::from("whoever"),
        outcome,
        via: None,
        reason: Text::from(reason),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(384))]

    #[test]
    fn a_service_that_is_not_watched_says_what_one_that_is_watched_says(steps in steps()) {
        let mut worlds = [World::new(false), World::new(true)];
        for step in steps {
            worlds.iter_mut().for_each(|world| world.step(&step));
            let [here, there] = &worlds;
            prop_assert_eq!(&here.done, &there.done, "after {:?}", step);
            prop_assert_eq!(here.mts.letters_under_way(), there.mts.letters_under_way());
            for (conn, said) in &here.said {
                prop_assert!(*said == there.said[conn], "to {:?} after {:?}", conn, step);
            }
        }
        for partner in 0..PARTNERS {
            worlds.iter_mut().for_each(|world| world.drain(partner));
        }
        let end = Step::Wait(20_000);
        worlds.iter_mut().for_each(|world| world.step(&end));
        let [here, there] = &worlds;
        prop_assert!(here.said == there.said, "at the end");
        prop_assert_eq!(&here.done, &there.done);
        prop_assert_eq!(here.mts.letters_under_way(), 0);
    }
}

/// So many letters that the last ones wait until receipts for the first ones come.
#[test]
fn letters_that_have_to_wait_for_receipts_go_out_in_the_same_order() {
    let mut worlds = [World::new(false), World::new(true)];
    let letters = |from, count| Step::Letters {
        partner: 0,
        from,
        to: 1,
        count,
        octets: 10,
        again: false,
        odd: 0,
    };
    let receipts = |count| Step::Receipts {
        partner: 1,
        count,
        newest: false,
        told: 0,
    };
    let mut steps = Vec::new();
    for _ in 0..28 {
        steps.extend([letters(0, 300), Step::Drain(1)]);
    }
    steps.extend([letters(3, 5), letters(0, 5), receipts(40), letters(3, 5)]);
    steps.extend([receipts(200), Step::Drain(1), letters(0, 20), receipts(500)]);
    for step in &steps {
        worlds.iter_mut().for_each(|world| world.step(step));
        let [here, _] = &worlds;
        // No more are written without a receipt.
        assert!(here.ends[1].letters.len() <= 8192);
    }
    let [here, there] = &worlds;
    assert_eq!(here.mts.letters_under_way(), there.mts.letters_under_way());
    assert!(here.said == there.said && here.done == there.done);
    let end = [receipts(usize::MAX), receipts(usize::MAX), Step::Drain(0)];
    for step in &end {
        worlds.iter_mut().for_each(|world| world.step(step));
    }
    let [here, there] = &worlds;
    assert!(here.said == there.said && here.done == there.done);
    assert_eq!(here.mts.letters_under_way(), 0);
}

/// A part was written, which has made room, and those that have waited for it are not asked yet.
#[test]
fn a_letter_does_not_overtake_those_that_wait() {
    let mut worlds = [World::with(false, 1 << 24), World::with(true, 1 << 24)];
    let letters = |octets, count| Step::Letters {
        partner: 0,
        from: 0,
        to: 1,
        count,
        octets,
        again: false,
        odd: 0,
    };
    for world in &mut worlds {
        world.step(&letters(60_000, 40));
        // What stands before the first letter, and that.
        world.sip(1, 2);
        assert!(world.mts.letters_under_way() >= 40);
        world.step(&letters(10, 5));
        world.drain(1);
        let numbers = &world.ends[1].letters;
        assert_eq!(numbers.len(), 45);
        assert!(numbers.is_sorted(), "{numbers:?}");
    }
    let [here, there] = &worlds;
    assert!(here.said == there.said && here.done == there.done);
}
