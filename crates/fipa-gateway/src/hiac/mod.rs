//! HIAC devices as agents of the fleet.
//!
//! ```text
//!   fleet ── ACL ──▶ deliver ──▶ Station: command, question, information
//!         ◀─ ACL ── HiacOutput ◀── event ◀── Station: confirmation, answer, signal …
//! ```
//!
//! **Knows** which ACL message stands for which packet, both ways. **Never knows** a link: the
//! station that it is handed does.

mod conversations;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use fipa_acl::{Message, Performative, Text};
use hiac::content::MessageKind;
use hiac::station::{Event, Failure, LinkId, Options, Role, SendError, Sender, Station, Ticket};
use hiac::{Address, Content};

use self::conversations::Conversations;

/// How long an agent of the fleet has for its answer to a device, which waits 5 seconds.
const PATIENCE: Duration = Duration::from_millis(4500);

/// What the description of a device in the directory begins with; its address follows.
pub const HIAC_DEVICE: &str = "HIAC device ";

/// What is known of devices before they come.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HiacNames {
    /// What devices are called, by address, in place of the name that they tell.
    pub devices: BTreeMap<Address, String>,
    /// Agents of the fleet, by the addresses under which devices speak to them.
    pub aliases: BTreeMap<Address, Text>,
}

/// What a gateway wants done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HiacOutput {
    /// An agent of this name is there.
    Register {
        /// Its name in the fleet.
        name: Text,
        /// What the directory tells of it.
        description: String,
    },
    /// It is not there any more.
    Deregister(Text),
    /// Send this message; its sender is a device.
    Send(Box<Message>),
}

#[derive(Debug)]
struct Device {
    name: Text,
    link: LinkId,
}

/// The devices that a station employs, and the fleet that they talk to.
#[derive(Debug)]
pub struct HiacGateway {
    robot: Text,
    names: HiacNames,
    devices: BTreeMap<Address, Device>,
    conversations: Conversations,
    outputs: VecDeque<HiacOutput>,
}

impl HiacGateway {
    /// A gateway without devices; `robot` is what stands behind the @ of their names.
    pub fn new(robot: impl Into<Text>, names: HiacNames) -> HiacGateway {
        HiacGateway {
            robot: robot.into(),
            names,
            devices: BTreeMap::new(),
            conversations: Conversations::default(),
            outputs: VecDeque::new(),
        }
    }

    /// The station has something to tell.
    pub fn event(&mut self, now: Duration, station: &mut Station, event: Event) {
        match event {
            Event::Connected {
                link,
                role: Role::Employer,
                own,
                partner,
                name,
            } => self.connected(station, link, own, partner, name),
            Event::Disconnected {
                role: Role::Employer,
                partner,
                ..
            } => self.gone(partner),
            Event::Moved { link, partner, .. } => self.moved(link, partner),
            Event::Signal {
                from,
                number,
                arguments,
            } => {
                let arguments: String = arguments.iter().map(|o| format!("{o:02x}")).collect();
                let text = format!("{number} {arguments}");
                self.publish(from.address, text.into_bytes());
            }
            Event::Message {
                from,
                kind,
                reference,
                octets,
            } => self.message(now, station, from, kind, reference, octets),
            Event::Written(ticket) => {
                if let Some((to, request)) = self.conversations.request(ticket) {
                    let (to, request) = (to.clone(), request.clone());
                    self.reply(&to, &request, Performative::Agree, b"");
                }
            }
            Event::Confirmed(ticket) => {
                if let Some((to, request)) = self.conversations.requested(ticket) {
                    self.reply(&to, &request, Performative::Inform, b"done");
                }
            }
            Event::Answered {
                ticket,
                kind,
                octets,
            } => {
                if let Some((to, query)) = self.conversations.queried(ticket) {
                    let performative = match kind {
                        MessageKind::Answer => Performative::Inform,
                        _ => Performative::Failure,
                    };
                    self.reply(&to, &query, performative, &octets);
                }
            }
            Event::Failed(ticket, failure) => self.failed(ticket, &failure),
            _ => {}
        }
    }

    /// A message came for the agent that the fleet knows by this name.
    pub fn deliver(&mut self, now: Duration, station: &mut Station, to: &str, message: &Message) {
        let Some(address) = self.address_of(to) else {
            self.reply(to, message, Performative::Failure, GONE.as_bytes());
            return;
        };
        let octets = message.content.as_deref().unwrap_or_default();
        let options = Options::CONFIRMED;
        match &message.performative {
            Performative::Request => {
                let command = content(MessageKind::Command, octets);
                match station.send(now, None, address, &command, options) {
                    Ok(ticket) => self.conversations.begin_request(ticket, to, message),
                    Err(error) => self.cannot(to, message, error),
                }
            }
            Performative::QueryRef | Performative::QueryIf => {
                match station.question(now, None, address, octets, options) {
                    Ok(ticket) => self.conversations.begin_query(ticket, to, message),
                    Err(error) => self.cannot(to, message, error),
                }
            }
            Performative::Subscribe => {
                let (performative, reason) =
                    match self.conversations.subscribe(address, to, message) {
                        true => (Performative::Agree, ""),
                        false => (Performative::Refuse, "there are too many subscriptions"),
                    };
                self.reply(to, message, performative, reason.as_bytes());
            }
            Performative::Cancel => self.cancel(station, to, message),
            Performative::Inform => match self.conversations.answered(to, message) {
                Some((asker, reference)) => {
                    let sent = station.reply(now, &asker, MessageKind::Answer, reference, octets);
                    if let Err(error) = sent {
                        let reason = error.to_string();
                        self.warn(now, station, &asker, reference, &reason);
                        self.reply(to, message, Performative::Failure, reason.as_bytes());
                    }
                }
                None => {
                    let information = content(MessageKind::Information, octets);
                    match station.send(now, None, address, &information, options) {
                        Ok(ticket) => self.conversations.begin_inform(ticket, to, message),
                        Err(error) => self.cannot(to, message, error),
                    }
                }
            },
            // What follows it is the answer.
            Performative::Agree => {}
            performative => match self.conversations.answered(to, message) {
                Some((asker, reference)) => {
                    let said = message.content_str().unwrap_or_default();
                    let reason = format!("{} {said}", performative.as_str());
                    self.warn(now, station, &asker, reference, reason.trim());
                }
                None if performative_answers(performative) => {}
                None => self.reply(
                    to,
                    message,
                    Performative::NotUnderstood,
                    b"a device knows request, query-if, query-ref, inform, subscribe and cancel",
                ),
            },
        }
    }

    /// A message of the gateway did not reach whom it was for.
    pub fn undelivered(
        &mut self,
        now: Duration,
        station: &mut Station,
        message: &Message,
        reason: &str,
    ) {
        if let Some((asker, reference)) = self.conversations.question_of(message) {
            self.warn(now, station, &asker, reference, reason);
        }
    }

    /// An agent of the fleet is gone, and with it what it asked for.
    pub fn agent_gone(&mut self, name: &str) {
        self.conversations.forget_subscriber(name);
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called.
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.conversations.next_expiry()
    }

    /// The time has come.
    pub fn handle_timeout(&mut self, now: Duration, station: &mut Station) {
        for (asker, reference) in self.conversations.expire(now) {
            self.warn(now, station, &asker, reference, "no answer came in time");
        }
    }

    /// What is to be done next.
    pub fn poll_output(&mut self) -> Option<HiacOutput> {
        self.outputs.pop_front()
    }

    fn connected(
        &mut self,
        station: &Station,
        link: LinkId,
        own: Address,
        address: Address,
        told: Option<String>,
    ) {
        let groups = station.workgroups().iter();
        let mut level = groups
            .filter(|group| group.address == own)
            .map(|group| group.mask.level(address));
        let level = level.next().unwrap_or(address.0);
        let usable = |name: &String| self.fleet_name(name).is_word();
        let configured = self.names.devices.get(&address).cloned();
        let name = configured.or(told).filter(usable);
        let name = name.unwrap_or_else(|| format!("hiac-{level:X}"));
        let taken = |name: &Text| self.devices.values().any(|device| device.name == *name);
        let mut full = self.fleet_name(&name);
        if taken(&full) {
            full = self.fleet_name(&format!("{name}-{level:X}"));
        }
        let name = full.clone();
        self.devices.insert(address, Device { name: full, link });
        self.outputs.push_back(HiacOutput::Register {
            name,
            description: format!("{HIAC_DEVICE}{address}"),
        });
    }

    fn moved(&mut self, link: LinkId, new: Address) {
        let mut devices = self.devices.iter();
        let old = devices.find(|(_, device)| device.link == link);
        if let Some(old) = old.map(|(address, _)| *address)
            && let Some(device) = self.devices.remove(&old)
        {
            self.conversations.moved(old, new);
            self.devices.insert(new, device);
        }
    }

    fn gone(&mut self, address: Address) {
        let Some(device) = self.devices.remove(&address) else {
            return;
        };
        self.conversations.forget_asker(address);
        for (to, subscription) in self.conversations.unsubscribe_all(address) {
            self.reply(&to, &subscription, Performative::Failure, GONE.as_bytes());
        }
        self.outputs.push_back(HiacOutput::Deregister(device.name));
    }

    fn message(
        &mut self,
        now: Duration,
        station: &mut Station,
        from: Sender,
        kind: MessageKind,
        reference: u8,
        octets: Vec<u8>,
    ) {
        let alias = self.names.aliases.get(&from.to).cloned();
        let device = self
            .devices
            .get(&from.address)
            .map(|device| device.name.clone());
        match (kind, alias, device) {
            (MessageKind::Question, Some(agent), Some(device)) => {
                let query = Message::new(Performative::QueryRef).to(agent.as_str());
                let id =
                    self.conversations
                        .asking(&device, agent, (from, reference), now + PATIENCE);
                let query = query.content(octets).conversation_id(id);
                self.send(&device, query);
            }
            (MessageKind::Question, ..) => {
                self.warn(
                    now,
                    station,
                    &from,
                    reference,
                    "nobody answers questions here",
                );
            }
            (MessageKind::Information | MessageKind::Warning, Some(agent), Some(device)) => {
                let inform = Message::new(Performative::Inform).to(agent.as_str());
                self.send(&device, inform.content(octets));
            }
            (MessageKind::Information | MessageKind::Warning, None, _) if reference == 0 => {
                self.publish(from.address, octets);
            }
            _ => {}
        }
    }

    fn publish(&mut self, device: Address, octets: Vec<u8>) {
        for (to, subscription) in self.conversations.subscriptions(device) {
            self.reply(&to, &subscription, Performative::Inform, &octets);
        }
    }

    fn failed(&mut self, ticket: Ticket, failure: &Failure) {
        if let Some((to, message)) = self.conversations.ended(ticket) {
            let reason = failure.to_string();
            self.reply(&to, &message, Performative::Failure, reason.as_bytes());
        }
    }

    fn cancel(&mut self, station: &mut Station, to: &str, message: &Message) {
        let cancelled = match self.conversations.cancel(to, message) {
            conversations::Cancelled::Query(ticket) => {
                station.forget_question(ticket);
                true
            }
            conversations::Cancelled::Subscription => true,
            conversations::Cancelled::Nothing => false,
        };
        match cancelled {
            true => self.reply(to, message, Performative::Inform, b"cancelled"),
            false => self.reply(to, message, Performative::Failure, b"nothing to cancel"),
        }
    }

    /// The hierarchy refuses; all else fails.
    fn cannot(&mut self, to: &str, message: &Message, error: SendError) {
        let performative = match error {
            SendError::NotPermitted => Performative::Refuse,
            _ => Performative::Failure,
        };
        self.reply(to, message, performative, error.to_string().as_bytes());
    }

    fn warn(
        &mut self,
        now: Duration,
        station: &mut Station,
        to: &Sender,
        reference: u8,
        reason: &str,
    ) {
        // A device that is gone waits for nothing.
        let _ = station.reply(now, to, MessageKind::Warning, reference, reason.as_bytes());
    }

    /// Answers for the device that the fleet knows as `from`. What cannot be answered is not.
    fn reply(&mut self, from: &str, message: &Message, performative: Performative, octets: &[u8]) {
        let mut reply = message.reply(performative);
        if reply.receiver.is_empty() {
            return;
        }
        if !octets.is_empty() {
            reply = reply.content(octets.to_vec());
        }
        self.send(from, reply);
    }

    fn send(&mut self, from: &str, message: Message) {
        let message = message.from_agent(from);
        self.outputs.push_back(HiacOutput::Send(Box::new(message)));
    }

    fn fleet_name(&self, name: &str) -> Text {
        Text::from(format!("{name}@{}", self.robot))
    }

    fn address_of(&self, name: &str) -> Option<Address> {
        let mut devices = self.devices.iter();
        let found = devices.find(|(_, device)| device.name.as_str() == name);
        found.map(|(address, _)| *address)
    }
}

fn content(kind: MessageKind, octets: &[u8]) -> Content<'_> {
    Content::Message {
        kind,
        reference: 0,
        octets,
    }
}

/// Whether it only ever answers something.
fn performative_answers(performative: &Performative) -> bool {
    matches!(
        performative,
        Performative::Failure | Performative::Refuse | Performative::NotUnderstood
    )
}

const GONE: &str = "the device is gone";
