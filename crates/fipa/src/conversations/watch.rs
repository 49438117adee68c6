//! The monitor of an agent: what it does with a violation, and who is told of it.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use fipa_acl::{Message, Text};
use fipa_conversation::{Config, Event, Monitor, Verdict, Violation};
use fipa_directory::Now;
use fipa_protocol::Library;
use tokio::sync::broadcast;

use crate::conversations::Talk;

/// What an agent does with messages that violate their interaction protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Monitoring {
    /// Nothing is judged.
    Off,
    /// Violations are told and logged; the messages are sent and handed on all the same.
    #[default]
    Advisory,
    /// An incoming message that violates its protocol is answered with `not-understood` and not
    /// handed on; an outgoing one is refused, with the explanation as the reason.
    Enforcing,
}

/// A message that violated its interaction protocol.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violated {
    /// The message.
    pub message: Message,
    /// Whether this agent sent it, or wanted to.
    pub is_outgoing: bool,
    /// Which rule it breaks, and what would have been legal.
    pub violation: Violation,
}

/// Something that happened in the conversations of an agent.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ConversationEvent {
    /// A message violated its protocol.
    Violated(Box<Violated>),
    /// A conversation began, moved on or ended.
    Progress(Event),
}

/// Conversations that are watched at a time, those that have ended lately included.
const MAX_CONVERSATIONS: usize = 100_000;

/// Events that a slow listener may be behind.
const BACKLOG: usize = 1024;

static PROTOCOLS: LazyLock<Arc<Library>> = LazyLock::new(|| Arc::new(Library::builtin()));

/// The monitor of one agent, made with its first conversation.
#[derive(Default)]
pub(crate) struct Watch {
    mode: AtomicU8,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    library: Option<Arc<Library>>,
    monitor: Option<Box<Monitor>>,
    listeners: Option<broadcast::Sender<ConversationEvent>>,
}

impl Watch {
    pub(crate) fn set_mode(&self, mode: Monitoring) {
        let code = match mode {
            Monitoring::Advisory => 0,
            Monitoring::Enforcing => 1,
            Monitoring::Off => 2,
        };
        self.mode.store(code, Ordering::Relaxed);
        if mode == Monitoring::Off {
            self.lock().monitor = None;
        }
    }

    pub(crate) fn mode(&self) -> Monitoring {
        match self.mode.load(Ordering::Relaxed) {
            0 => Monitoring::Advisory,
            1 => Monitoring::Enforcing,
            _ => Monitoring::Off,
        }
    }

    /// Conversations that are open are forgotten: they began by other rules.
    pub(crate) fn set_protocols(&self, library: Arc<Library>) {
        let mut state = self.lock();
        state.library = Some(library);
        state.monitor = None;
    }

    /// Judges a message; an error is one that must not go on.
    pub(crate) fn judge(
        &self,
        now: impl FnOnce() -> Now,
        own: &Text,
        message: &Message,
        is_outgoing: bool,
    ) -> Result<(), Box<Violation>> {
        let mode = self.mode();
        // What an agent says to itself was judged when it was sent.
        let is_own = || message.sender.as_ref().is_some_and(|s| s.name == *own);
        if mode == Monitoring::Off || message.conversation_id.is_none() || !is_outgoing && is_own()
        {
            return Ok(());
        }
        let mut state = self.lock();
        let Some(monitor) = state.monitor(own, message) else {
            return Ok(());
        };
        let now = now();
        if monitor.poll_timeout().is_some_and(|due| due <= now.mono) {
            monitor.handle_timeout(now);
        }
        let verdict = monitor.observe(now, message);
        state.tell();
        let Verdict::Violation(violation) = verdict else {
            return Ok(());
        };
        tracing::warn!("{own}: {violation}");
        if let Some(listeners) = &state.listeners {
            let violated = Violated {
                message: message.clone(),
                is_outgoing,
                violation: (*violation).clone(),
            };
            // Without a listener nobody wants to know.
            let _ = listeners.send(ConversationEvent::Violated(Box::new(violated)));
        }
        match mode {
            Monitoring::Enforcing => Err(violation),
            _ => Ok(()),
        }
    }

    /// An agent is gone.
    pub(crate) fn gone(&self, now: Now, name: &str) {
        let mut state = self.lock();
        if let Some(monitor) = &mut state.monitor {
            monitor.agent_gone(now, name);
            state.tell();
        }
    }

    /// Whether any conversation is known.
    pub(crate) fn is_busy(&self) -> bool {
        self.lock().monitor.is_some()
    }

    /// What comes from now on.
    fn listen(&self) -> broadcast::Receiver<ConversationEvent> {
        let mut state = self.lock();
        let make = || broadcast::Sender::new(BACKLOG);
        state.listeners.get_or_insert_with(make).subscribe()
    }

    /// Handles what is due, and says when something is due again.
    fn run_timers(&self, now: Now) -> Option<Duration> {
        let mut state = self.lock();
        let monitor = state.monitor.as_mut()?;
        monitor.handle_timeout(now);
        let next = monitor.poll_timeout();
        state.tell();
        next
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The monitor, if the message can belong to a conversation.
    fn monitor(&mut self, own: &Text, message: &Message) -> Option<&mut Monitor> {
        if self.monitor.is_none() {
            message.protocol.as_ref()?;
            let library = self.library.as_ref().unwrap_or(&PROTOCOLS);
            let config = Config {
                max_conversations: MAX_CONVERSATIONS,
                ..Config::default()
            };
            let monitor = Monitor::new(Arc::clone(library), Some(own.clone()), config);
            self.monitor = Some(Box::new(monitor));
        }
        self.monitor.as_deref_mut()
    }

    fn tell(&mut self) {
        let Some(monitor) = &mut self.monitor else {
            return;
        };
        while let Some(event) = monitor.poll_event() {
            if let Some(listeners) = &self.listeners {
                let _ = listeners.send(ConversationEvent::Progress(event));
            }
        }
    }
}

/// What happens in the conversations of an agent, as it happens.
///
/// Time-outs are found while somebody waits here, or with the next message. Whoever is more than
/// 1024 events behind misses the oldest.
pub struct ConversationEvents {
    events: broadcast::Receiver<ConversationEvent>,
    talk: Weak<Talk>,
}

impl ConversationEvents {
    pub(crate) fn new(talk: &Arc<Talk>) -> ConversationEvents {
        ConversationEvents {
            events: talk.watch.listen(),
            talk: Arc::downgrade(talk),
        }
    }

    /// The next event; `None` once the agent is gone. Cancel-safe.
    pub async fn next(&mut self) -> Option<ConversationEvent> {
        loop {
            let due = self.talk.upgrade().and_then(|talk| {
                let due = talk.watch.run_timers(talk.clock.now())?;
                Some(talk.clock.instant(due))
            });
            let wait = async {
                match due {
                    Some(due) => tokio::time::sleep_until(due.into()).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                biased;
                event = self.events.recv() => match event {
                    Ok(event) => return Some(event),
                    Err(broadcast::error::RecvError::Lagged(_)) => {}
                    Err(broadcast::error::RecvError::Closed) => return None,
                },
                () = wait => {}
            }
        }
    }
}

/// The messages of an agent that violate their protocols, as they come and go.
pub struct Violations(ConversationEvents);

impl Violations {
    pub(crate) fn new(talk: &Arc<Talk>) -> Violations {
        Violations(ConversationEvents::new(talk))
    }

    /// The next violation; `None` once the agent is gone. Cancel-safe.
    pub async fn next(&mut self) -> Option<Violated> {
        loop {
            if let ConversationEvent::Violated(violated) = self.0.next().await? {
                return Some(*violated);
            }
        }
    }
}
