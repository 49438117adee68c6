//! A bad radio between two hosts: what it carries comes late, and some of it never.

use std::collections::VecDeque;
use std::io::{ErrorKind, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use tun_rs::{DeviceBuilder, SyncDevice};

use super::namespace::Namespace;
use super::skipped;

/// Packets that are on their way in one direction, at most: more are dropped, as by any radio.
const UNDER_WAY: usize = 8192;

/// Octets of a packet, at most.
const PACKET: usize = 1500;

/// What a radio does to packets, in each direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quality {
    /// The share of packets that are lost.
    pub(crate) loss: f64,
    /// How long a packet is under way.
    pub(crate) delay: Duration,
}

/// Two hosts at 10.0.0.1 and 10.0.0.2, and the radio between them: a program of the test that
/// carries packets, as not every kernel can lose any by itself.
pub(crate) struct Radio {
    ended: Arc<AtomicBool>,
    lost: Arc<AtomicU64>,
    carrier: Option<JoinHandle<()>>,
    pub(crate) one: Namespace,
    pub(crate) two: Namespace,
}

impl Radio {
    /// Which packets are lost depends on the seed. `None` where there can be no radio, which has
    /// been said then.
    pub(crate) fn new(quality: Quality, seed: u64) -> Option<Radio> {
        let (one, two) = (Namespace::new()?, Namespace::new()?);
        let antennas = [(&one, "10.0.0.1"), (&two, "10.0.0.2")].map(|(host, address)| {
            let antenna = host.run_inside(antenna);
            antenna.inspect(|_| host.add_address(address))
        });
        let [Ok(first), Ok(second)] = antennas else {
            skipped("tun devices, to lose packets");
            return None;
        };
        let (ended, lost) = (Arc::default(), Arc::default());
        let mut carrier = Carrier {
            antennas: [first, second],
            under_way: [VecDeque::new(), VecDeque::new()],
            random: fastrand::Rng::with_seed(seed),
            quality,
            lost: Arc::clone(&lost),
        };
        let until = Arc::clone(&ended);
        Some(Radio {
            ended,
            lost,
            carrier: Some(std::thread::spawn(move || carrier.run(&until))),
            one,
            two,
        })
    }

    /// The packets that were lost so far.
    pub(crate) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

impl Drop for Radio {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        // It has nothing to tell, and when it panicked that was shown.
        let _ = self.carrier.take().map(JoinHandle::join);
    }
}

/// The interface of a host towards the radio.
fn antenna() -> Result<SyncDevice> {
    let mtu = u16::try_from(PACKET).unwrap();
    let antenna = DeviceBuilder::new().name("wire").mtu(mtu).build_sync()?;
    antenna.set_nonblocking(true)?;
    Ok(antenna)
}

struct Carrier {
    antennas: [SyncDevice; 2],
    /// Towards each host: when each packet is there.
    under_way: [VecDeque<(Instant, Vec<u8>)>; 2],
    random: fastrand::Rng,
    quality: Quality,
    lost: Arc<AtomicU64>,
}

impl Carrier {
    fn run(&mut self, ended: &AtomicBool) {
        while !ended.load(Ordering::Relaxed) {
            self.wait();
            for from in 0..2 {
                self.take(from);
            }
            for to in 0..2 {
                self.hand_over(to);
            }
        }
    }

    /// Waits until there is something to carry, but not for long.
    fn wait(&self) {
        let mut wait = Duration::from_millis(50);
        for (due, _) in self.under_way.iter().filter_map(VecDeque::front) {
            wait = wait.min(due.saturating_duration_since(Instant::now()));
        }
        let wait = Timespec::try_from(wait).unwrap();
        let [one, two] = &self.antennas;
        let mut antennas = [one, two].map(|antenna| PollFd::new(antenna, PollFlags::IN));
        // Whatever it says, reading and writing say more.
        let _ = poll(&mut antennas, Some(&wait));
    }

    fn take(&mut self, from: usize) {
        let mut packet = [0; PACKET];
        let way = &mut self.under_way[1 - from];
        loop {
            let octets = match self.antennas[from].recv(&mut packet) {
                Ok(octets) => octets,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => panic!("nothing comes from host {}: {error}", from + 1),
            };
            if way.len() == UNDER_WAY || self.random.f64() < self.quality.loss {
                self.lost.fetch_add(1, Ordering::Relaxed);
            } else {
                way.push_back((Instant::now() + self.quality.delay, packet[..octets].into()));
            }
        }
    }

    fn hand_over(&mut self, to: usize) {
        let now = Instant::now();
        let way = &mut self.under_way[to];
        while let Some((_, packet)) = way.pop_front_if(|(due, _)| *due <= now) {
            if self.antennas[to].send(&packet).is_err() {
                // The host has no room for it.
                self.lost.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}
