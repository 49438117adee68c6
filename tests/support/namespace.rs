//! Network namespaces: hosts of their own, joined by virtual wires.

use std::ffi::OsString;
use std::os::fd::AsFd;
use std::process::Command;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

use super::{PATIENCE, skipped};

/// A network namespace, with loopback up. It goes with this value.
pub(crate) struct Namespace(String);

impl Namespace {
    /// A host without any wire; `None` where there can be none, which has been said then.
    pub(crate) fn new() -> Option<Namespace> {
        static POSSIBLE: OnceLock<bool> = OnceLock::new();
        let possible = POSSIBLE.get_or_init(|| Namespace::make().is_ok());
        if !possible {
            skipped("root and ip, to make network namespaces");
            return None;
        }
        Some(Namespace::make().unwrap())
    }

    /// Two hosts at 10.0.0.1 and 10.0.0.2, at the ends of a wire.
    pub(crate) fn pair() -> Option<(Namespace, Namespace)> {
        let (one, two) = Namespace::unplugged_pair()?;
        two.plug_in();
        for host in [&one, &two] {
            host.wait_until_plugged();
        }
        Some((one, two))
    }

    /// The same; at the second host the wire is not plugged in.
    pub(crate) fn unplugged_pair() -> Option<(Namespace, Namespace)> {
        let (one, two) = (Namespace::new()?, Namespace::new()?);
        let wire = "link add wire type veth peer name wire netns";
        one.ip(&format!("{wire} {}", two.0)).unwrap();
        one.ip("addr add 10.0.0.1/24 dev wire").unwrap();
        two.ip("addr add 10.0.0.2/24 dev wire").unwrap();
        one.plug_in();
        Some((one, two))
    }

    /// So many hosts at 192.168.100.101 and so on, and behind them the bridge in which their wires
    /// end.
    pub(crate) fn bridged(count: u32) -> Option<Vec<Namespace>> {
        let bridge = Namespace::new()?;
        // Without a querier a bridge that snoops would drop multicast after a while.
        bridge
            .ip("link add bridge up type bridge mcast_snooping 0")
            .unwrap();
        let hosts = (1..=count).map(|number| {
            let host = Namespace::make().unwrap();
            let peer = format!("peer name port{number} netns {}", bridge.0);
            host.ip(&format!("link add wire type veth {peer}")).unwrap();
            bridge
                .ip(&format!("link set port{number} up master bridge"))
                .unwrap();
            host.ip(&format!(
                "addr add 192.168.100.{}/24 dev wire",
                100 + number
            ))
            .unwrap();
            host.plug_in();
            host.wait_until_plugged();
            host
        });
        let mut hosts: Vec<Namespace> = hosts.collect();
        hosts.push(bridge);
        Some(hosts)
    }

    /// Puts the wire in.
    pub(crate) fn plug_in(&self) {
        self.ip("link set wire up").unwrap();
    }

    /// Gives the host another address at its end of the wire.
    pub(crate) fn add_address(&self, address: &str) {
        self.ip(&format!("addr add {address}/24 dev wire")).unwrap();
    }

    /// Takes an address from the host's end of the wire.
    pub(crate) fn remove_address(&self, address: &str) {
        self.ip(&format!("addr del {address}/24 dev wire")).unwrap();
    }

    /// Gives the host an IPv6 address at its end of the wire, to be used at once.
    pub(crate) fn add_address_v6(&self, address: &str) {
        self.ip(&format!("addr add {address}/64 dev wire nodad"))
            .unwrap();
    }

    /// The kernel notices a little later that both ends of a wire are plugged in.
    fn wait_until_plugged(&self) {
        let until = Instant::now() + PATIENCE;
        while !self.ip("-o link show wire").unwrap().contains("state UP") {
            assert!(Instant::now() < until, "the wire stays down");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Has the kernel drop packets: a rule of nftables, for packets that pass a hook, `input`,
    /// `output` or, of a bridge, `forward`. Says where that cannot be, and returns whether it can.
    pub(crate) fn block(&self, hook: &str, rule: &str) -> bool {
        let family = if hook == "forward" { "bridge" } else { "inet" };
        let script = format!(
            "table {family} test {{ chain {hook} {{ type filter hook {hook} priority 0; {rule} drop; }}; }}"
        );
        let mut nft = Command::new("nft");
        let output = self.enter(nft.arg(script)).output();
        let able = output.is_ok_and(|output| output.status.success());
        if !able {
            skipped("nft, to block packets");
        }
        able
    }

    /// Gives the host an interface that leads nowhere.
    pub(crate) fn add_dead_end(&self, name: &str, address: &str) {
        let end = format!("{name}-end");
        self.ip(&format!("link add {name} up type veth peer name {end}"))
            .unwrap();
        self.ip(&format!("link set {end} up")).unwrap();
        self.ip(&format!("addr add {address}/24 dev {name}"))
            .unwrap();
    }

    /// The same command, run in the namespace.
    pub(crate) fn enter(&self, command: &Command) -> Command {
        let mut inside = Command::new("ip");
        inside.args(["netns", "exec", &self.0]);
        inside.arg(command.get_program()).args(command.get_args());
        for (key, value) in command.get_envs() {
            match value {
                Some(value) => inside.env(key, value),
                None => inside.env_remove(key),
            };
        }
        inside
    }

    /// Does something on the host: what it binds or dials is there.
    pub(crate) fn run_inside<T: Send>(&self, call: impl FnOnce() -> T + Send) -> T {
        let host = std::fs::File::open(format!("/run/netns/{}", self.0)).unwrap();
        // A thread of its own, as it does not come back.
        std::thread::scope(|scope| {
            let inside = scope.spawn(|| {
                let network = Some(LinkNameSpaceType::Network);
                move_into_link_name_space(host.as_fd(), network).unwrap();
                call()
            });
            inside.join().unwrap()
        })
    }

    fn make() -> Result<Namespace, String> {
        static NUMBER: AtomicU32 = AtomicU32::new(1);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("fipa-{}-{number}", std::process::id());
        ip(["netns", "add", &name].map(OsString::from))?;
        let namespace = Namespace(name);
        namespace.ip("link set lo up")?;
        Ok(namespace)
    }

    /// Runs `ip` with these words in the namespace.
    fn ip(&self, words: &str) -> Result<String, String> {
        let namespace = ["-n", &self.0].map(OsString::from);
        ip(namespace
            .into_iter()
            .chain(words.split(' ').map(OsString::from)))
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        // What cannot be taken away is left to the machine.
        let _ = ip(["netns", "delete", &self.0].map(OsString::from));
    }
}

fn ip(words: impl IntoIterator<Item = OsString>) -> Result<String, String> {
    let words: Vec<OsString> = words.into_iter().collect();
    match Command::new("ip").args(&words).output() {
        Ok(output) if output.status.success() => {
            Ok(String::from_utf8_lossy(&output.stdout).into_owned())
        }
        other => Err(format!("ip {words:?}: {other:?}")),
    }
}
