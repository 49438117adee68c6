//! The agents: those of this daemon are announced, those of C++ robots are found.
use std::collections::HashSet;
use std::time::Duration;

use fipa_acl::Text;
use fipa_directory::Entry;
use tokio::time::Instant;

use super::Mdns;
use super::announcer::Order;
use super::ears::Packet;
use crate::interface::usable_interfaces;
use crate::service_directory::browser::Output;
use crate::service_directory::responder::Send;
use crate::{AgentsReport, DiscoveryEvent, LeftOut, MdnsError};

/// How often the interfaces are looked at, as the library does it.
const RESCAN_EVERY: Duration = Duration::from_secs(5);

impl Mdns {
    /// Announces an agent to C++ robots, or what has changed of it.
    ///
    /// Its locations are announced as they are, but in the order in which a C++ robot is to try
    /// them, with the addresses of this host for `0.0.0.0` and `::`, and without those that only
    /// this host can use while others hear the announcement.
    ///
    /// # Errors
    ///
    /// Why it is not announced. It is remembered nevertheless, and announced when that changes,
    /// until [`withdraw_agent`](Mdns::withdraw_agent).
    pub fn announce_agent(&mut self, entry: Entry) -> Result<(), LeftOut> {
        let now = Instant::now();
        self.agents_at = now;
        self.announcer.put(entry)
    }

    /// Says goodbye to an agent of this daemon. Nothing happens if there is no such agent.
    pub fn withdraw_agent(&mut self, name: &str) {
        let now = Instant::now();
        self.agents_at = now;
        self.announcer.remove(name);
    }

    /// Announces these agents and no others.
    pub fn set_agents(&mut self, entries: impl IntoIterator<Item = Entry>) -> AgentsReport {
        let now = Instant::now();
        self.agents_at = now;
        let entries: Vec<Entry> = entries.into_iter().collect();
        let names: HashSet<&str> = entries.iter().map(|entry| entry.name.as_str()).collect();
        let stays = |name: &str| names.contains(name);
        self.announcer.retain(stays);
        for entry in entries.iter().cloned() {
            // Who is left out stands in the report.
            let _ = self.announcer.put(entry);
        }
        self.announcer.report()
    }

    /// Which agents of this daemon are announced, and which are not.
    pub fn agents_report(&self) -> AgentsReport {
        self.announcer.report()
    }

    /// Asks the network whether an agent of a C++ robot is still announced. If nobody answers
    /// within 2 s, [`DiscoveryEvent::AgentGone`] follows; otherwise nothing does.
    ///
    /// Call it when a connection to the agent has failed: without a goodbye it takes more than an
    /// hour until the loss is noticed.
    ///
    /// # Errors
    ///
    /// If no such agent is known.
    pub fn verify_agent(&mut self, name: &str) -> Result<(), MdnsError> {
        let now = Instant::now();
        self.agents_at = now;
        let browser = self.browser.as_mut();
        match browser.is_some_and(|browser| browser.verify(now.into_std(), name)) {
            true => Ok(()),
            false => Err(MdnsError::UnknownAgent(Text::from(name))),
        }
    }

    pub(super) fn on_packet(&mut self, packet: &Packet) {
        let now = Instant::now();
        if let Some(browser) = &mut self.browser
            && !browser.handle_packet(now.into_std(), &packet.octets, packet.on_loopback)
        {
            tracing::trace!("not a packet of DNS at the port of mDNS");
        }
        if let Some(responder) = &mut self.responder {
            responder.handle_packet(now.into_std(), &packet.octets, packet.from);
        }
        self.attend_to_search(now);
        self.attend_to_announcements(now);
    }

    pub(super) fn attend_to_agents(&mut self) {
        let now = Instant::now();
        if self.rescan_at <= now {
            self.rescan_at = now + RESCAN_EVERY;
            self.rescan(now);
        }
        self.agents_at = now + RESCAN_EVERY;
        if let Some(browser) = &mut self.browser {
            browser.handle_timeout(now.into_std());
        }
        self.attend_to_search(now);
        self.attend_to_announcements(now);
    }

    /// Passes on that daemons are lost, and that with them all their agents are.
    pub(super) fn report_lost(&mut self, events: impl IntoIterator<Item = DiscoveryEvent>) {
        let now = Instant::now();
        for event in events {
            if let (DiscoveryEvent::Lost(instance), Some(browser)) = (&event, &mut self.browser) {
                browser.forget(*instance);
            }
            self.queue.push_back(event);
        }
        self.attend_to_search(now);
    }

    /// Does what the search asks for.
    fn attend_to_search(&mut self, now: Instant) {
        let Some(browser) = &mut self.browser else {
            return;
        };
        while let Some(output) = browser.poll_output() {
            match output {
                Output::Packet(packet) => self.ears.send(&packet),
                Output::Event(event) => self.queue.push_back(event),
            }
        }
        let due = Instant::from_std(browser.poll_timeout());
        self.agents_at = self.agents_at.min(due.max(now));
    }

    /// Tells others of the own agents what is due.
    fn attend_to_announcements(&mut self, now: Instant) {
        let Some(responder) = &mut self.responder else {
            return;
        };
        while let Some(order) = self.announcer.poll_order() {
            match order {
                Order::Announce(told) => responder.put(now.into_std(), told),
                Order::Withdraw(label) => responder.remove(now.into_std(), &label),
            }
        }
        responder.handle_timeout(now.into_std());
        while let Some(packet) = responder.poll_output() {
            match packet {
                Send::ToAll(packet) => self.ears.send(&packet),
                Send::To(to, packet) => self.ears.send_to(to, &packet),
            }
        }
        if let Some(due) = responder.poll_timeout() {
            self.agents_at = self.agents_at.min(Instant::from_std(due).max(now));
        }
    }

    /// Says goodbye to all agents; called again, whatever of that is due.
    pub(super) fn withdraw_all(&mut self) {
        let now = Instant::now();
        if let Some(responder) = &mut self.responder {
            responder.remove_all(now.into_std());
        }
        self.attend_to_announcements(now);
    }

    fn rescan(&mut self, now: Instant) {
        let interfaces = match usable_interfaces() {
            Ok(interfaces) => interfaces,
            Err(error) => return self.warn(error.to_string()),
        };
        let reach = self.rule.reach(&interfaces);
        if let Some(responder) = &mut self.responder {
            responder.set_addresses(reach.ipv4());
        }
        self.announcer.set_reach(reach);
        let Some(browser) = &mut self.browser else {
            return;
        };
        let posts = self.rule.listening_posts(&interfaces);
        let (new, failed) = self.ears.listen_at(&posts);
        if new {
            browser.ask_anew(now.into_std());
            if let Some(responder) = &mut self.responder {
                responder.announce_anew(now.into_std());
            }
        }
        let was_deaf = std::mem::replace(&mut self.deaf, failed.is_some());
        if let Some(error) = failed.filter(|_| !was_deaf) {
            self.warn(format!(
                "C++ robots are not heard and told everywhere: {error}"
            ));
        }
    }
}
