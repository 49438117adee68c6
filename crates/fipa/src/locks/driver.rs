use std::collections::{BTreeSet, HashMap};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Waker};
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_directory::Change;
use fipa_locking::{Algorithm, FailureReason, LossReason, Output, Record, RequestError};
use fipa_mts::Notice;
use tokio::sync::{Notify, mpsc, oneshot, watch};

use super::keep::{Keep, Keeping, Kept};
use super::lives::Lives;
use super::request::Participants;
use super::{LockError, Machine};
use crate::agent::Inbox;
use crate::conversations::Talk;
use crate::platform::Inner;
use crate::room::Room;
use crate::{Agent, DEFAULT_TIMEOUT, sending};

/// Messages that wait for the agent's user at most while mail is taken in for its locks; then the
/// mailbox fills, and the senders are told.
const MOST_WAITING: usize = 1000;

/// What the agent wants of its locks.
pub(super) enum Command {
    Request {
        resource: Text,
        id: u64,
        algorithm: Algorithm,
        heartbeat: Duration,
        participants: Participants,
        answer: oneshot::Sender<Result<Granted, LockError>>,
    },
    Release {
        resource: Text,
        id: u64,
        /// Dropped when it is known what became of all that is said because of this.
        told: Option<mpsc::Sender<()>>,
    },
    Own {
        resource: Text,
        record: Record,
        keep: Arc<dyn Keep>,
        answer: oneshot::Sender<Result<(), RequestError>>,
    },
}

/// A resource is held.
pub(super) struct Granted {
    pub(super) fencing: Option<u64>,
    pub(super) lost: watch::Receiver<Option<LossReason>>,
}

/// A resource that is wanted or held.
struct Active {
    id: u64,
    participants: Participants,
    stage: Stage,
}

enum Stage {
    Waiting(oneshot::Sender<Result<Granted, LockError>>),
    Held(watch::Sender<Option<LossReason>>),
}

/// A message that did not reach an agent.
struct Undelivered {
    to: Text,
    conversation: Text,
}

/// Feeds the state machine of an agent's locks, and does what it wants done.
pub(super) struct Driver {
    platform: Arc<Inner>,
    name: Text,
    mail: Arc<Notify>,
    inbox: Arc<Mutex<Inbox>>,
    talk: Arc<Talk>,
    /// For what the locks say, which does not wait for what the agent's user sends.
    room: Room,
    machine: Machine,
    active: HashMap<Text, Active>,
    lives: Lives,
    keeping: Keeping,
    ended: bool,
    commands: mpsc::UnboundedReceiver<Command>,
    messages: mpsc::UnboundedReceiver<Message>,
    changes: mpsc::UnboundedReceiver<Change>,
    notices: mpsc::UnboundedReceiver<Notice>,
    undelivered: mpsc::UnboundedReceiver<Undelivered>,
    undelivered_to: mpsc::UnboundedSender<Undelivered>,
}

impl Driver {
    /// A driver that misses nothing from now on.
    pub(super) fn new(
        agent: &Agent,
        machine: Machine,
        commands: mpsc::UnboundedReceiver<Command>,
    ) -> Driver {
        let (sender, messages) = mpsc::unbounded_channel();
        let mut inbox = agent.inbox.lock().unwrap_or_else(PoisonError::into_inner);
        inbox.locks = Some(sender);
        drop(inbox);
        let platform = Arc::clone(&agent.platform);
        let (changes, notices, lives) = platform.backend.with(|_, machine, hub| {
            let lives = Lives::new(machine.directory());
            (hub.changes(), hub.notices(), lives)
        });
        let (undelivered_to, undelivered) = mpsc::unbounded_channel();
        Driver {
            platform,
            name: agent.name.clone(),
            mail: Arc::clone(&agent.mail),
            inbox: Arc::clone(&agent.inbox),
            talk: Arc::clone(&agent.talk),
            room: Room::default(),
            machine,
            active: HashMap::new(),
            lives,
            keeping: Keeping::default(),
            ended: false,
            commands,
            messages,
            changes,
            notices,
            undelivered,
            undelivered_to,
        }
    }

    /// Runs until the platform has ended, or the agent goes.
    pub(super) async fn run(mut self) {
        let mail = Arc::clone(&self.mail);
        while !self.ended {
            // Asked for before looking, so that no notice falls between.
            let notified = mail.notified();
            tokio::pin!(notified);
            notified.as_mut().enable();
            self.catch_up();
            let wake = self.machine.lock().poll_timeout();
            let wake = wake.map(|at| self.machine.clock.instant(at));
            let timeout = async {
                match wake {
                    Some(at) => tokio::time::sleep_until(at.into()).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                // Who is gone is known before what it said last is heard.
                biased;
                change = self.changes.recv() => match change {
                    Some(change) => self.directory_changed(&change),
                    None => self.end(),
                },
                Some(notice) = self.notices.recv() => self.noticed(&notice),
                Some(message) = self.messages.recv() => self.heard(&message),
                Some(command) = self.commands.recv() => self.obey(command),
                Some(undelivered) = self.undelivered.recv() => self.not_delivered(&undelivered),
                kept = self.keeping.next() => self.kept(kept),
                () = notified => {}
                () = timeout => {}
            }
            self.settle(None);
        }
    }

    /// Handles what has come so far, and then what did not come in time: no flood of messages
    /// keeps a lease from ending, and no answer that is here counts as missing.
    fn catch_up(&mut self) {
        let mut inbox = self.inbox.lock().unwrap_or_else(PoisonError::into_inner);
        let has_room = |inbox: &Inbox| inbox.kept() < MOST_WAITING;
        let is_read = inbox.take_in(&self.platform, &self.talk, has_room);
        drop(inbox);
        if is_read {
            self.talk.mail_is_read(&self.platform);
        }
        for _ in 0..self.changes.len() {
            if let Ok(change) = self.changes.try_recv() {
                self.directory_changed(&change);
            }
        }
        for _ in 0..self.messages.len() {
            if let Ok(message) = self.messages.try_recv() {
                self.heard(&message);
            }
        }
        let now = self.machine.now();
        let mut machine = self.machine.lock();
        if machine.poll_timeout().is_some_and(|at| at <= now) {
            machine.handle_timeout(now);
        }
        drop(machine);
        self.settle(None);
    }

    fn end(&mut self) {
        self.ended = true;
        self.machine.lock().disconnected();
    }

    fn noticed(&mut self, notice: &Notice) {
        if let Notice::DaemonLost { .. } | Notice::DaemonGivenUp { .. } = notice {
            // It deregisters us, and with that the others take us for dead.
            self.lives.doubt();
            self.machine.lock().disconnected();
        }
    }

    fn directory_changed(&mut self, change: &Change) {
        let now = self.machine.now();
        let gone = self.lives.follow(change);
        if let Some(gone) = gone.filter(|gone| *gone != self.name) {
            self.machine.lock().agent_gone(now, &gone);
        }
        let record = &change.record;
        let concerned = self.active.iter();
        let concerned = concerned.filter(|(_, active)| active.participants.include(record));
        for (resource, active) in concerned {
            let names = self.names(&active.participants);
            let mut machine = self.machine.lock();
            machine.set_participants(now, resource, names);
        }
    }

    /// Who may want a resource, as the directory has it.
    fn names(&self, participants: &Participants) -> BTreeSet<Text> {
        self.platform.backend.with(|_, machine, _| {
            let records = machine.directory().iter();
            let included = records.filter(|record| participants.include(record));
            included.map(|record| record.entry.name.clone()).collect()
        })
    }

    fn heard(&mut self, message: &Message) {
        let sender = message.sender.as_ref();
        if sender.is_some_and(|sender| !self.lives.is_gone(&sender.name)) {
            let now = self.machine.now();
            self.machine.lock().handle(now, message);
        }
    }

    fn not_delivered(&mut self, undelivered: &Undelivered) {
        let now = self.machine.now();
        let Undelivered { to, conversation } = undelivered;
        self.machine.lock().delivery_failed(now, to, conversation);
    }

    fn kept(&mut self, kept: Kept) {
        let now = self.machine.now();
        let (resource, fencing) = (kept.resource, kept.record.fencing);
        if let Err(error) = &kept.result {
            tracing::error!("the number {fencing} of {resource} cannot be kept: {error}");
        }
        let mut machine = self.machine.lock();
        match kept.result {
            Ok(()) => machine.persisted(now, &resource, fencing),
            Err(_) => machine.persist_failed(now, &resource, fencing),
        }
    }

    fn obey(&mut self, command: Command) {
        let now = self.machine.now();
        match command {
            Command::Request {
                resource,
                id,
                algorithm,
                heartbeat,
                participants,
                answer,
            } => {
                let names = self.names(&participants);
                let mut machine = self.machine.lock();
                let name = resource.clone();
                let asked = machine.request_with_heartbeat(now, name, algorithm, heartbeat, names);
                drop(machine);
                match asked {
                    Ok(()) => {
                        let stage = Stage::Waiting(answer);
                        let active = Active {
                            id,
                            participants,
                            stage,
                        };
                        self.active.insert(resource, active);
                    }
                    // Whoever has given up does not want to know any more.
                    Err(error) => drop(answer.send(Err(error.into()))),
                }
            }
            Command::Release { resource, id, told } => {
                if self.active.get(&resource).is_some_and(|a| a.id == id) {
                    self.active.remove(&resource);
                    self.machine.lock().release(now, &resource);
                    self.settle(told);
                }
            }
            Command::Own {
                resource,
                record,
                keep,
                answer,
            } => {
                let owned = self.machine.lock().own(now, resource.clone(), record);
                if owned.is_ok() {
                    self.keeping.add(resource, keep);
                }
                let _ = answer.send(owned);
            }
        }
    }

    /// Does what the machine wants done; `told` is dropped when that has been done.
    fn settle(&mut self, told: Option<mpsc::Sender<()>>) {
        loop {
            let Some(output) = self.machine.lock().poll_output() else {
                return;
            };
            match output {
                Output::Send(message) => self.send(message, told.clone()),
                Output::Granted { resource, fencing } => self.granted(&resource, fencing),
                Output::Lost { resource, reason } => {
                    let active = self.active.remove(&resource);
                    if let Some(Stage::Held(lost)) = active.map(|active| active.stage) {
                        lost.send_replace(Some(reason));
                    }
                }
                Output::Failed { resource, reason } => self.failed(&resource, reason),
                Output::Persist { resource, record } => self.keeping.put(resource, record),
            }
        }
    }

    fn granted(&mut self, resource: &Text, fencing: Option<u64>) {
        let Some(active) = self.active.get_mut(resource) else {
            return;
        };
        let (sender, lost) = watch::channel(None);
        let waiting = std::mem::replace(&mut active.stage, Stage::Held(sender));
        if let Stage::Waiting(answer) = waiting {
            // Whoever has given up gives it back.
            let _ = answer.send(Ok(Granted { fencing, lost }));
        }
    }

    fn failed(&mut self, resource: &Text, reason: FailureReason) {
        let active = self.active.remove(resource);
        if let Some(Stage::Waiting(answer)) = active.map(|active| active.stage) {
            let _ = answer.send(Err(LockError::Failed(reason)));
        }
    }

    fn send(&self, message: Message, told: Option<mpsc::Sender<()>>) {
        let (platform, room) = (Arc::clone(&self.platform), self.room.clone());
        let undelivered = self.undelivered_to.clone();
        let mut sending: Pin<Box<dyn Future<Output = ()> + Send>> = Box::pin(async move {
            let id = message.conversation_id.as_ref();
            let conversation = id.and_then(|id| id.as_str()).map(Text::from);
            let outcomes = sending::send(&platform, &room, message, DEFAULT_TIMEOUT).await;
            for failed in outcomes.iter().filter(|o| !o.outcome.is_success()) {
                // The driver may have ended.
                let _ = undelivered.send(Undelivered {
                    to: failed.to.clone(),
                    conversation: conversation.clone().unwrap_or_default(),
                });
            }
            drop(told);
        });
        // Begun here, so that messages leave in their order; what becomes of them is waited for
        // elsewhere.
        let mut context = Context::from_waker(Waker::noop());
        if sending.as_mut().poll(&mut context).is_pending() {
            tokio::spawn(sending);
        }
    }
}
