//! Links over QUIC: whom they let in, and how octets move on their streams.

mod support;

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use bytes::{Bytes, BytesMut};
use fipa_directory::Address;
use fipa_fleet::{FleetKey, Membership};
use fipa_transport::{Buffers, Driver, End, Handle, LANES, Listener, Quic, Stream, Tls, dial_link};
use tokio::net::UdpSocket;
use tokio::sync::mpsc;

use self::support::{careless, spawn};

const PATIENCE: Duration = Duration::from_secs(20);

fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap()
}

fn fleet() -> FleetKey {
    FleetKey::generate(now()).unwrap()
}

fn member(fleet: &FleetKey, name: &str) -> Membership {
    fleet.issue(name, 30, now(), &[], None).unwrap()
}

fn robot(membership: Membership) -> Quic {
    let tls = Tls::new(Arc::new(membership)).unwrap();
    Quic::new(Some(tls)).unwrap()
}

fn anybody() -> Quic {
    Quic::new(None).unwrap()
}

async fn listener(quic: &Quic) -> (Listener, Address) {
    let any = Address::quic("127.0.0.1", 0);
    let listener = Listener::bind_link(&any, quic).await.unwrap();
    let address = listener.address().clone();
    (listener, address)
}

async fn accept(listener: &Listener) -> Result<Stream, String> {
    let calling = listener.accept().await.unwrap();
    assert!(calling.is_calling());
    calling.settle().await.map_err(|error| error.to_string())
}

async fn dial(addresses: &[Address], quic: &Quic) -> Result<Stream, String> {
    let dialled = dial_link(addresses, quic).await;
    dialled
        .map(|(stream, _)| stream)
        .map_err(|error| error.to_string())
}

/// Both ends of a connection at work, or why there is none.
async fn meet(caller: &Quic, called: &Quic, says: Says) -> Result<(Ran, Ran), (String, String)> {
    let (listener, address) = listener(called).await;
    meet_at(caller, &[address], &listener, says).await
}

async fn meet_at(
    caller: &Quic,
    addresses: &[Address],
    listener: &Listener,
    says: Says,
) -> Result<(Ran, Ran), (String, String)> {
    let [from_caller, from_called] = says;
    let calling = async {
        let dialled = dial(addresses, caller).await;
        dialled.map(|stream| run(stream, from_caller))
    };
    let being_called = async {
        let accepted = accept(listener).await;
        accepted.map(|stream| run(stream, from_called))
    };
    match tokio::join!(calling, being_called) {
        (Ok(one), Ok(two)) => Ok((one, two)),
        (one, two) => Err((one.err().unwrap_or_default(), two.err().unwrap_or_default())),
    }
}

/// What each side says, on the main stream and on the lanes.
type Says = [[Vec<u8>; 1 + LANES]; 2];

fn words(of: &str) -> [Vec<u8>; 1 + LANES] {
    std::array::from_fn(|stream| format!("{of} on {stream}").into_bytes())
}

fn greetings() -> Says {
    [words("one"), words("two")]
}

/// Gives what it has, and tells what comes and how it ends.
struct Both {
    parts: Mutex<[VecDeque<Bytes>; 1 + LANES]>,
    told: mpsc::UnboundedSender<Told>,
    holds: Arc<AtomicBool>,
}

#[derive(Debug)]
enum Told {
    Octets(usize, Bytes),
    Closed(String, bool),
}

impl Both {
    fn come(&self, stream: usize, octets: &mut BytesMut) {
        let _ = self
            .told
            .send(Told::Octets(stream, octets.split().freeze()));
    }

    fn give(&self, stream: usize, parts: &mut VecDeque<Bytes>) -> bool {
        parts.append(&mut self.parts.lock().unwrap()[stream]);
        false
    }
}

impl Driver for Both {
    fn received(&self, octets: &mut BytesMut) {
        self.holds.store(false, Ordering::Relaxed);
        self.come(0, octets);
    }

    fn received_on(&self, lane: usize, octets: &mut BytesMut) -> bool {
        if lane + 1 < LANES && self.holds.load(Ordering::Relaxed) {
            return false;
        }
        self.come(1 + lane, octets);
        true
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        self.give(0, parts)
    }

    fn transmit_on(&self, lane: usize, parts: &mut VecDeque<Bytes>) -> bool {
        self.give(1 + lane, parts)
    }

    fn closed(&self, end: &End, all_written: bool) {
        let _ = self.told.send(Told::Closed(end.to_string(), all_written));
    }
}

/// A connection at work.
struct Ran {
    identity: Option<String>,
    remote: String,
    same_host: bool,
    driver: Arc<Both>,
    handle: Arc<Handle>,
    told: mpsc::UnboundedReceiver<Told>,
    come: [Vec<u8>; 1 + LANES],
}

/// The driver is asked by the test as well.
struct Shared(Arc<Both>);

impl Driver for Shared {
    fn received(&self, octets: &mut BytesMut) {
        self.0.received(octets);
    }
    fn received_on(&self, lane: usize, octets: &mut BytesMut) -> bool {
        self.0.received_on(lane, octets)
    }
    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        self.0.transmit(parts)
    }
    fn transmit_on(&self, lane: usize, parts: &mut VecDeque<Bytes>) -> bool {
        self.0.transmit_on(lane, parts)
    }
    fn closed(&self, end: &End, all_written: bool) {
        self.0.closed(end, all_written);
    }
}

fn run(stream: Stream, says: [Vec<u8>; 1 + LANES]) -> Ran {
    let (told, receiver) = mpsc::unbounded_channel();
    let driver = Arc::new(Both {
        parts: Mutex::new(
            says.map(|octets| octets.chunks(70_001).map(Bytes::copy_from_slice).collect()),
        ),
        told,
        holds: Arc::default(),
    });
    assert!(stream.has_lanes());
    Ran {
        identity: stream.identity().map(str::to_owned),
        remote: stream.remote(),
        same_host: stream.same_host(),
        handle: spawn(
            stream,
            &Arc::new(Buffers::default()),
            Shared(Arc::clone(&driver)),
        ),
        driver,
        told: receiver,
        come: Default::default(),
    }
}

impl Ran {
    fn say(&self, stream: usize, octets: &[u8]) {
        let part = Bytes::copy_from_slice(octets);
        self.driver.parts.lock().unwrap()[stream].push_back(part);
        self.handle.transmit();
    }

    async fn next(&mut self) -> Option<(String, bool)> {
        let told = tokio::time::timeout(PATIENCE, self.told.recv()).await;
        match told.unwrap().unwrap() {
            Told::Octets(stream, octets) => {
                self.come[stream].extend_from_slice(&octets);
                None
            }
            Told::Closed(reason, all_written) => Some((reason, all_written)),
        }
    }

    /// Waits until so many octets have come on a stream.
    async fn hear(&mut self, stream: usize, octets: usize) -> &[u8] {
        while self.come[stream].len() < octets {
            if let Some(end) = self.next().await {
                panic!("{end:?}");
            }
        }
        &self.come[stream]
    }

    /// Waits for the end.
    async fn end(&mut self) -> (String, bool) {
        loop {
            if let Some(end) = self.next().await {
                return end;
            }
        }
    }
}

#[tokio::test]
async fn robots_of_a_fleet_meet_and_know_whom_they_met() {
    let fleet = fleet();
    let (one, two) = (
        robot(member(&fleet, "robot1")),
        robot(member(&fleet, "robot2")),
    );
    let (dialled, accepted) = meet(&one, &two, greetings()).await.unwrap();
    assert_eq!(dialled.identity.as_deref(), Some("robot2"));
    assert_eq!(accepted.identity.as_deref(), Some("robot1"));
    assert!(dialled.same_host && accepted.same_host);
    assert!(dialled.remote.starts_with("quic://127.0.0.1:"));
}

#[tokio::test]
async fn without_a_fleet_anybody_meets_anybody_and_knows_nothing_of_them() {
    let (mut one, mut two) = meet(&anybody(), &anybody(), greetings()).await.unwrap();
    assert_eq!((&one.identity, &two.identity), (&None, &None));
    for stream in 0..=LANES {
        let (from_two, from_one) = (words("two"), words("one"));
        assert_eq!(
            one.hear(stream, from_two[stream].len()).await,
            from_two[stream]
        );
        assert_eq!(
            two.hear(stream, from_one[stream].len()).await,
            from_one[stream]
        );
    }
}

#[tokio::test]
async fn much_goes_both_ways_on_all_streams_and_the_end_is_an_end() {
    let much = |seed: u8| {
        std::array::from_fn(|stream| {
            let octet = |i: u32| (i / 251) as u8 ^ seed ^ stream as u8;
            (0..2_500_000_u32).map(octet).collect()
        })
    };
    let says: Says = [much(1), much(101)];
    let (mut one, mut two) = meet(&anybody(), &anybody(), says.clone()).await.unwrap();
    for (stream, said) in says[1].iter().enumerate() {
        assert!(one.hear(stream, said.len()).await == said);
    }
    // What was handed over before the end comes before the end.
    one.handle.finish();
    let (reason, _) = two.end().await;
    assert_eq!(reason, "the other side closed the connection");
    assert!(two.come == says[0]);
    let (reason, all_written) = one.end().await;
    assert_eq!((reason.as_str(), all_written), ("closed", true));
}

#[tokio::test]
async fn lanes_that_are_full_hold_up_no_other_and_go_on_when_they_are_wanted() {
    let (mut one, mut two) = meet(&anybody(), &anybody(), greetings()).await.unwrap();
    one.hear(0, 8).await;
    two.hear(1, 8).await;
    two.hear(2, 8).await;
    two.driver.holds.store(true, Ordering::Relaxed);
    let bulk = vec![7; 20 << 20];
    one.say(1, &bulk);
    one.say(2, &bulk);
    one.say(3, b", urgently");
    assert!(two.hear(3, 18).await.ends_with(b", urgently"));
    assert_eq!([two.come[1].len(), two.come[2].len()], [8, 8]);
    // Something else has come: they are offered again.
    one.say(0, b"!");
    assert!(two.hear(1, 8 + bulk.len()).await[8..] == bulk);
    assert!(two.hear(2, 8 + bulk.len()).await[8..] == bulk);
}

#[tokio::test]
async fn a_connection_that_is_broken_off_did_not_end() {
    let (one, mut two) = meet(&anybody(), &anybody(), greetings()).await.unwrap();
    one.handle.abort();
    let (reason, _) = two.end().await;
    assert_eq!(reason, "the other side broke off the connection");
}

#[tokio::test]
async fn a_connection_that_nobody_runs_did_not_end() {
    let called = anybody();
    let (listener, address) = listener(&called).await;
    let (caller, addresses) = (anybody(), [address]);
    let calling = async { run(dial(&addresses, &caller).await.unwrap(), words("one")) };
    let (mut one, accepted) = tokio::join!(calling, accept(&listener));
    drop(accepted.unwrap());
    let (reason, _) = one.end().await;
    assert_eq!(reason, "the other side broke off the connection");
}

#[tokio::test]
async fn a_stranger_is_refused_by_both_sides() {
    let (one, stranger) = (
        robot(member(&fleet(), "robot1")),
        robot(member(&fleet(), "robot2")),
    );
    let (dialled, accepted) = meet(&stranger, &one, greetings()).await.err().unwrap();
    let wrong = "it is not of this fleet: another key made its certificate";
    assert!(dialled.ends_with(wrong), "{dialled}");
    assert_eq!(
        accepted,
        "the other side does not accept our certificate: it is of another fleet"
    );
}

#[tokio::test]
async fn who_has_no_fleet_and_who_has_one_do_not_meet() {
    let one = robot(member(&fleet(), "robot1"));
    let (dialled, accepted) = meet(&anybody(), &one, greetings()).await.err().unwrap();
    assert!(
        dialled.ends_with("it wants a certificate of its fleet, and we have none"),
        "{dialled}"
    );
    assert_eq!(accepted, "it has no key: it showed no certificate");
    let (dialled, _) = meet(&one, &anybody(), greetings()).await.err().unwrap();
    assert!(
        dialled.ends_with("its certificate does not say which robot it is"),
        "{dialled}"
    );
}

/// Calls with a certificate, or none, and takes any; why it is not let in.
async fn call_carelessly(called: &Quic, shown: Option<(&[u8], &[u8])>) -> String {
    let (listener, address) = listener(called).await;
    let caller = careless::quic(shown, false);
    let calling = async {
        let connecting = caller.connect(socket_address(&address), "fleet.invalid");
        if let Ok(connection) = connecting.unwrap().await {
            connection.closed().await;
        }
    };
    let (accepted, ()) = tokio::join!(accept(&listener), calling);
    accepted.expect_err("a stranger was let in")
}

fn socket_address(address: &Address) -> SocketAddr {
    let Address::Quic { host, port } = address else {
        unreachable!("it was bound so");
    };
    SocketAddr::new(host.parse().unwrap(), *port)
}

#[tokio::test]
async fn whoever_has_no_good_certificate_is_told_why() {
    let fleet = fleet();
    let day = Duration::from_secs(24 * 3600);
    let (one, two, three) = (
        member(&fleet, "robot1"),
        member(&fleet, "robot2"),
        member(&fleet, "robot3"),
    );
    let late = fleet
        .issue("robot2", 1, now() - day * 9, &[], None)
        .unwrap();
    let early = fleet
        .issue("robot2", 9, now() + day * 9, &[], None)
        .unwrap();
    let wrong = member(&self::fleet(), "robot2");
    let gone = [two.certificate().clone()];
    let revoked = fleet.revoke(&gone, None, now()).unwrap();
    one.learn(revoked.der()).unwrap();
    let one = robot(one);
    let own = |m: &Membership| Some((m.certificate().der().to_vec(), m.private_key().to_vec()));
    let stolen = Some((
        three.certificate().der().to_vec(),
        two.private_key().to_vec(),
    ));
    for (shown, said) in [
        (None, "it has no key: it showed no certificate"),
        (
            own(&wrong),
            "it is not of this fleet: another key made its certificate",
        ),
        (own(&late), "the certificate of robot2 expired at"),
        (own(&early), "the certificate of robot2 is valid from"),
        (own(&two), "the certificate of robot2 is revoked"),
        (
            stolen,
            "it does not have the key of the certificate that it showed",
        ),
    ] {
        let shown = shown
            .as_ref()
            .map(|(certificate, key)| (&certificate[..], &key[..]));
        let told = call_carelessly(&one, shown).await;
        assert!(told.starts_with(said), "{told}, not {said}");
    }
}

#[tokio::test]
async fn nothing_is_taken_before_the_handshake_is_over() {
    let called = anybody();
    let (listener, address) = listener(&called).await;
    let caller = careless::quic(None, true);
    let at = socket_address(&address);
    let first = async {
        let connection = caller.connect(at, "fleet.invalid").unwrap().await.unwrap();
        // The ticket comes with what the server says first.
        connection.accept_uni().await.unwrap();
    };
    tokio::select! {
        () = first => {}
        other = accept(&listener) => panic!("{:?}", other.err()),
    }
    let second = caller.connect(at, "fleet.invalid").unwrap();
    assert!(
        second.into_0rtt().is_err(),
        "early data must not be offered"
    );
}

/// Passes packets on between a caller and a server; the server sees it at another port from when it
/// is told to move.
async fn forward(server: SocketAddr, moves: Arc<AtomicBool>) -> SocketAddr {
    let bind = || async { UdpSocket::bind("127.0.0.1:0").await.unwrap() };
    let (front, old, new) = (bind().await, bind().await, bind().await);
    let at = front.local_addr().unwrap();
    tokio::spawn(async move {
        let (mut here, mut there) = (vec![0; 65536], vec![0; 65536]);
        let mut caller = None;
        loop {
            let moved = moves.load(Ordering::Relaxed);
            let back = if moved { &new } else { &old };
            tokio::select! {
                got = front.recv_from(&mut here) => {
                    let (octets, from) = got.unwrap();
                    caller = Some(from);
                    let back = if moves.load(Ordering::Relaxed) { &new } else { &old };
                    back.send_to(&here[..octets], server).await.unwrap();
                }
                got = back.recv_from(&mut there) => {
                    let (octets, _) = got.unwrap();
                    front.send_to(&there[..octets], caller.unwrap()).await.unwrap();
                }
            }
        }
    });
    at
}

#[tokio::test]
async fn a_connection_goes_on_when_the_address_of_the_caller_changes() {
    let called = anybody();
    let (listener, address) = listener(&called).await;
    let moves = Arc::new(AtomicBool::new(false));
    let between = forward(socket_address(&address), Arc::clone(&moves)).await;
    let addresses = [Address::quic("127.0.0.1", between.port())];
    let met = meet_at(&anybody(), &addresses, &listener, greetings()).await;
    let (mut one, mut two) = met.unwrap();
    one.hear(0, 8).await;
    two.hear(0, 8).await;
    moves.store(true, Ordering::Relaxed);
    for (stream, told) in [(0, b", still"), (3, b", still")] {
        one.say(stream, told);
        two.hear(stream, 8 + told.len()).await;
        two.say(stream, told);
        one.hear(stream, 8 + told.len()).await;
    }
}
