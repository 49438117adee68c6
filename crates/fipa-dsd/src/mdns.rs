//! Discovery by multicast DNS; the only place that knows `mdns-sd`.
//!
//! The library announces the daemon and searches for others. The directory of C++ robots is read and
//! told by sockets of our own: of a TXT key that stands in several strings the library hands over
//! only the first, it asks for every instance anew each two minutes, and as it takes notice of the
//! first packet only of what somebody knows already, it would tell the rest to all again and again.
mod agents;
mod announce;
mod announcer;
mod ears;
mod heard;
mod peers;
mod start;
mod txt;

pub(crate) use ears::{GROUP, GROUP_V6, open as open_at_group, open_v6 as open_at_group_v6};

use std::collections::VecDeque;
use std::future::pending;
use std::time::Duration;

use fipa_directory::InstanceId;
use mdns_sd::{DaemonEvent, Error, Receiver, ServiceDaemon, ServiceEvent, ServiceInfo};
use tokio::time::{Instant, sleep, sleep_until, timeout};

use self::announce::SERVICE_TYPE;
use self::announcer::Announcer;
use self::ears::Ears;
use self::heard::Heard;
use self::peers::Peers;
use crate::interface::Rule;
use crate::service_directory::browser::Browser;
use crate::service_directory::responder::Responder;
use crate::{DiscoveryEvent, MdnsConfig, MdnsError};

/// How often the own announcement is repeated unless told otherwise.
const REPEAT_EVERY: Duration = Duration::from_secs(30);
/// How long those in doubt have to be heard again once the search was begun anew; what `mdns-sd`
/// still knows it tells at once.
const DOUBT_FOR: Duration = Duration::from_secs(5);
/// How long a peer has to answer [`Mdns::verify`]. It is asked at once and one second later.
const VERIFY_FOR: Duration = Duration::from_secs(3);
/// How long [`Mdns::shutdown`] may take.
const SHUTDOWN_WITHIN: Duration = Duration::from_secs(2);
/// Goodbyes are sent a second time after 120 ms at most; the sockets must live until then.
const SECOND_GOODBYE: Duration = Duration::from_millis(150);
/// How long to wait before a command is offered again to a full queue.
const RETRY_PAUSE: Duration = Duration::from_millis(10);

/// A daemon's announcement of itself and its search for others.
///
/// Agents of this daemon are given to [`set_agents`](Mdns::set_agents) and
/// [`announce_agent`](Mdns::announce_agent), to be announced to C++ robots.
///
/// The announcement is repeated, the search renewed where it breaks off, and agents announced
/// while [`next`](Mdns::next) is polled. Dropping sends a single goodbye that nobody waits for; use
/// [`shutdown`](Mdns::shutdown) to be sure of it.
pub struct Mdns {
    daemon: Running,
    service: ServiceInfo,
    monitor: Receiver<DaemonEvent>,
    events: Receiver<ServiceEvent>,
    peers: Peers,
    rule: Rule,
    announcer: Announcer,
    /// `None` if the scope makes no service type.
    browser: Option<Browser>,
    /// The same.
    responder: Option<Responder>,
    ears: Ears,
    /// Whether there is an interface where nothing can be heard; that is told once.
    deaf: bool,
    /// When the agents or the search for them need attention.
    agents_at: Instant,
    /// When the interfaces are looked at again.
    rescan_at: Instant,
    queue: VecDeque<DiscoveryEvent>,
    repeat_every: Duration,
    repeat_at: Instant,
    /// When those still in doubt are given up.
    doubt_until: Option<Instant>,
    stopped: bool,
}

impl Mdns {
    /// Announces the daemon and begins to look for others.
    ///
    /// Returns when the announcement was sent, which takes some milliseconds of blocking. Needs
    /// no runtime.
    ///
    /// # Errors
    ///
    /// If the configuration is wrong, a selector matches no interface, the UDP port cannot be
    /// opened, or nothing could be announced anywhere.
    pub fn start(config: MdnsConfig) -> Result<Mdns, MdnsError> {
        start::start(config)
    }

    /// Waits for the next event; `None` once mDNS has stopped for good. Cancel-safe.
    ///
    /// Must be called within a tokio runtime with time enabled.
    pub async fn next(&mut self) -> Option<DiscoveryEvent> {
        loop {
            if let Some(event) = self.queue.pop_front() {
                return Some(event);
            }
            if self.stopped {
                return None;
            }
            match self.happening().await {
                Happening::Service(Ok(event)) => self.on_service_event(event),
                Happening::Service(Err(_)) => self.search_again().await,
                Happening::Daemon(Ok(event)) => self.on_daemon_event(event),
                Happening::Daemon(Err(_)) => self.stopped = true,
                Happening::Packet(packet) => self.on_packet(&packet),
                Happening::AgentsDue => self.attend_to_agents(),
                Happening::RepeatDue => self.repeat(),
                Happening::DoubtOver => {
                    self.doubt_until = None;
                    let lost = self.peers.drop_doubtful();
                    self.report_lost(lost);
                }
            }
        }
    }

    /// Asks the network whether a peer is still there. If it does not answer within 3 s,
    /// [`DiscoveryEvent::Lost`] follows; otherwise nothing does.
    ///
    /// Call it when a connection to the peer has failed: without a goodbye it takes two minutes
    /// until the loss is noticed. A living peer whose answers were lost is found again when it
    /// repeats its announcement.
    ///
    /// # Errors
    ///
    /// If no such peer is known, or the question could not be asked.
    pub fn verify(&self, instance: InstanceId) -> Result<(), MdnsError> {
        let mut asked = Err(MdnsError::UnknownPeer(instance));
        for fullname in self.peers.fullnames(instance) {
            self.daemon
                .0
                .verify(fullname.to_owned(), VERIFY_FOR)
                .map_err(refused)?;
            asked = Ok(());
        }
        asked
    }

    /// Sets how often the own announcement is repeated; without this call every 30 s. Times below
    /// one second are taken as one second.
    ///
    /// The repetition brings this daemon back to those who lost sight of it for a while: they do
    /// not ask for it again before half an hour has passed.
    pub fn set_repeat(&mut self, every: Duration) {
        self.repeat_every = every.max(Duration::from_secs(1));
        self.repeat_at = Instant::now() + self.repeat_every;
    }

    /// Says goodbye and waits until it was sent, at most 2 s.
    ///
    /// Must be called within a tokio runtime with time enabled.
    pub async fn shutdown(mut self) {
        self.withdraw_all();
        if timeout(SHUTDOWN_WITHIN, self.say_goodbye()).await.is_err() {
            tracing::warn!("mDNS did not shut down in time; the goodbye may be missing");
        }
    }

    async fn happening(&self) -> Happening {
        tokio::select! {
            event = self.events.recv_async() => Happening::Service(event.map_err(|_| Closed)),
            event = self.monitor.recv_async() => Happening::Daemon(event.map_err(|_| Closed)),
            packet = self.ears.hear() => Happening::Packet(packet),
            () = sleep_until(self.agents_at.min(self.rescan_at)) => Happening::AgentsDue,
            () = sleep_until(self.repeat_at) => Happening::RepeatDue,
            () = reached(self.doubt_until) => Happening::DoubtOver,
        }
    }

    fn on_service_event(&mut self, event: ServiceEvent) {
        match event {
            ServiceEvent::ServiceResolved(service) => {
                let now = std::time::Instant::now();
                let events = self.peers.heard(Heard::new(&service), now);
                self.queue.extend(events);
            }
            ServiceEvent::ServiceRemoved(_, fullname) => {
                let lost = self.peers.removed(&fullname);
                self.report_lost(lost);
            }
            other => tracing::trace!(?other, "mDNS search"),
        }
    }

    fn on_daemon_event(&mut self, event: DaemonEvent) {
        match event {
            DaemonEvent::Error(error) => self.warn(format!("mDNS: {error}")),
            DaemonEvent::NameChange(change) => {
                self.warn(format!(
                    "mDNS renamed `{}` to `{}`",
                    change.original, change.new_name
                ));
            }
            other => tracing::trace!(?other, "mDNS"),
        }
    }

    /// `mdns-sd` closes the channel of a listener who is slow; what it told meanwhile is lost.
    async fn search_again(&mut self) {
        match self.daemon.0.browse(SERVICE_TYPE) {
            Ok(events) => {
                self.events = events;
                self.peers.doubt_all();
                self.doubt_until = Some(Instant::now() + DOUBT_FOR);
                self.warn("the mDNS search broke off and was begun anew".to_owned());
            }
            // The channel stays closed, so that the next call comes here again.
            Err(Error::Again) => sleep(RETRY_PAUSE).await,
            Err(_) => self.stopped = true,
        }
    }

    fn repeat(&mut self) {
        let registered = self.daemon.0.register(self.service.clone());
        let pause = match &registered {
            Err(Error::Again) => RETRY_PAUSE,
            _ => self.repeat_every,
        };
        self.repeat_at = Instant::now() + pause;
        match registered {
            Ok(()) | Err(Error::Again | Error::DaemonShutdown) => {}
            Err(error) => self.warn(format!("cannot repeat the mDNS announcement: {error}")),
        }
    }

    fn warn(&mut self, text: String) {
        self.queue.push_back(DiscoveryEvent::Warning(text));
    }

    async fn say_goodbye(&mut self) {
        let fullname = self.service.get_fullname();
        if let Some(status) = patiently(|| self.daemon.0.unregister(fullname)).await {
            let _ = status.recv_async().await;
        }
        sleep(SECOND_GOODBYE).await;
        self.withdraw_all();
        if let Some(status) = patiently(|| self.daemon.0.shutdown()).await {
            let _ = status.recv_async().await;
        }
    }
}

impl Drop for Mdns {
    fn drop(&mut self) {
        // After `shutdown` there is nobody left to say goodbye to.
        self.withdraw_all();
    }
}

/// The thread of `mdns-sd`, which does not end by itself when its last handle is dropped.
struct Running(ServiceDaemon);

impl Drop for Running {
    fn drop(&mut self) {
        // After `shutdown` this fails, as it should.
        let _ = start::insist(|| self.0.shutdown());
    }
}

enum Happening {
    Service(Result<ServiceEvent, Closed>),
    Daemon(Result<DaemonEvent, Closed>),
    Packet(ears::Packet),
    AgentsDue,
    RepeatDue,
    DoubtOver,
}

struct Closed;

async fn reached(moment: Option<Instant>) {
    match moment {
        Some(moment) => sleep_until(moment).await,
        None => pending().await,
    }
}

/// Offers a command until it is taken; `None` if it cannot be.
async fn patiently<T>(mut command: impl FnMut() -> mdns_sd::Result<T>) -> Option<T> {
    loop {
        match command() {
            Ok(done) => return Some(done),
            Err(Error::Again) => sleep(RETRY_PAUSE).await,
            Err(_) => return None,
        }
    }
}

fn refused(error: Error) -> MdnsError {
    match error {
        Error::Again => MdnsError::Busy,
        Error::DaemonShutdown => MdnsError::Stopped,
        other => MdnsError::Refused(other.to_string()),
    }
}

#[cfg(test)]
mod tests;
