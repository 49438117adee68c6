use std::collections::{BTreeSet, HashMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use fipa_acl::{Expression, Message, Text};
use fipa_directory::Now;
use fipa_protocol::{Library, Outcome};

use crate::conversation::{Conversation, id_text};
use crate::event::{Event, EventKind};
use crate::verdict::Verdict;

/// How much a monitor remembers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Conversations at a time, those that have ended included; the messages of further ones are
    /// not monitored.
    pub max_conversations: usize,
    /// Conversations that have ended and are kept, so that a late message is known as such.
    pub max_ended: usize,
    /// How long those are kept.
    pub keep_ended: Duration,
    /// After how long a silence a conversation counts as over: timed out, or done where it may
    /// end.
    pub idle: Duration,
}

impl Default for Config {
    fn default() -> Config {
        Config {
            max_conversations: 200_000,
            max_ended: 1_000,
            keep_ended: Duration::from_secs(60),
            idle: Duration::from_secs(3600),
        }
    }
}

/// The conversations of an agent, or of everybody: each message, in and out, is judged by the
/// protocol that it bears.
///
/// Whoever runs it hands in every message with the time, calls
/// [`handle_timeout`](Self::handle_timeout) when [`poll_timeout`](Self::poll_timeout) says so, and
/// takes the events. It only tells; whether a violating message is taken or sent all the same is
/// for the agent to decide.
#[derive(Debug)]
pub struct Monitor {
    library: Arc<Library>,
    own: Option<Text>,
    config: Config,
    places: Vec<Option<Watched>>,
    free: Vec<usize>,
    by_id: HashMap<Text, usize>,
    /// One for each conversation that has not ended; none is later than when it is due.
    timers: BTreeSet<(Duration, usize)>,
    /// Those that have ended, the oldest first.
    ended: VecDeque<(Duration, usize)>,
    events: VecDeque<Event>,
}

#[derive(Debug)]
struct Watched {
    id: Text,
    conversation: Conversation,
    last: Duration,
    timer: Duration,
    ended: bool,
}

impl Monitor {
    /// A monitor without conversations. `own` is the agent whose it is; without one, it is that of
    /// somebody who sees everybody's messages.
    pub fn new(library: Arc<Library>, own: Option<Text>, config: Config) -> Monitor {
        Monitor {
            library,
            own,
            config,
            places: Vec::new(),
            free: Vec::new(),
            by_id: HashMap::new(),
            timers: BTreeSet::new(),
            ended: VecDeque::new(),
            events: VecDeque::new(),
        }
    }

    /// What a message would be, without taking it: asked before it is sent.
    pub fn judge_outgoing(&self, now: Now, message: &Message) -> Verdict {
        let Some(id) = &message.conversation_id else {
            return Verdict::NotMonitored;
        };
        match self.find(id) {
            Some(watched) => watched.conversation.judge(&self.library, now, message),
            None => match self.begin(message) {
                Some(conversation) => conversation.judge(&self.library, now, message),
                None => Verdict::NotMonitored,
            },
        }
    }

    /// Judges a message that was received or sent, and takes it if it is accepted.
    pub fn observe(&mut self, now: Now, message: &Message) -> Verdict {
        let Some(id) = &message.conversation_id else {
            return Verdict::NotMonitored;
        };
        match self.place(id) {
            Some(at) => self.go_on(now, at, message),
            None => self.start(now, message),
        }
    }

    fn go_on(&mut self, now: Now, at: usize, message: &Message) -> Verdict {
        let Some(Some(watched)) = self.places.get_mut(at) else {
            return Verdict::NotMonitored;
        };
        let verdict = watched.conversation.observe(&self.library, now, message);
        if let Verdict::Accepted { state } = &verdict {
            watched.last = now.mono;
            let kind = EventKind::Updated {
                state: state.clone(),
            };
            self.changed(now, at, kind);
        }
        verdict
    }

    fn start(&mut self, now: Now, message: &Message) -> Verdict {
        let Some(mut conversation) = self.begin(message) else {
            return Verdict::NotMonitored;
        };
        let verdict = conversation.observe(&self.library, now, message);
        let (Some(initiator), Some(id)) = (conversation.initiator(), conversation.id()) else {
            return verdict;
        };
        // The same octets as in the conversation: looking one up is looking at the other.
        let (initiator, id) = (initiator.clone(), id.clone());
        let kind = EventKind::Started {
            protocol: conversation.protocol().name().clone(),
            initiator,
        };
        let timer = now.mono.saturating_add(self.config.idle);
        let watched = Some(Watched {
            id: id.clone(),
            conversation,
            last: now.mono,
            timer,
            ended: false,
        });
        let at = match self.free.pop() {
            Some(at) => at,
            None => {
                self.places.push(None);
                self.places.len() - 1
            }
        };
        if let Some(place) = self.places.get_mut(at) {
            *place = watched;
        }
        self.timers.insert((timer, at));
        self.by_id.insert(id, at);
        self.changed(now, at, kind);
        verdict
    }

    /// The conversation that a message could begin.
    fn begin(&self, message: &Message) -> Option<Conversation> {
        let protocol = self.library.get(message.protocol.as_ref()?)?;
        let room = self.by_id.len() < self.config.max_conversations;
        room.then(|| Conversation::new(Arc::clone(protocol), self.own.clone()))
    }

    /// Tells what happened, and whether that was the end.
    fn changed(&mut self, now: Now, at: usize, kind: EventKind) {
        let Some(Some(watched)) = self.places.get_mut(at) else {
            return;
        };
        self.events.push_back(Event {
            conversation: watched.id.clone(),
            kind,
        });
        if watched.ended {
            return;
        }
        if watched.conversation.is_closed()
            && let Some(outcome) = watched.conversation.outcome()
        {
            watched.ended = true;
            self.timers.remove(&(watched.timer, at));
            let kind = EventKind::Ended { outcome };
            self.events.push_back(Event {
                conversation: watched.id.clone(),
                kind,
            });
            self.ended.push_back((now.mono, at));
            self.forget(now);
            return;
        }
        let due = due(watched, &self.config);
        // A later one is found out when the time comes: silence is put off by every message.
        if due < watched.timer {
            self.timers.remove(&(watched.timer, at));
            watched.timer = due;
            self.timers.insert((due, at));
        }
    }

    /// Forgets what ended long ago, and the oldest of what is too much.
    fn forget(&mut self, now: Now) {
        while let Some((since, at)) = self.ended.front().copied() {
            let old = since.saturating_add(self.config.keep_ended) <= now.mono;
            if !old && self.ended.len() <= self.config.max_ended {
                return;
            }
            self.ended.pop_front();
            if let Some(watched) = self.places.get_mut(at).and_then(Option::take) {
                self.by_id.remove(&watched.id);
                self.free.push(at);
            }
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, on [`Now::mono`].
    pub fn poll_timeout(&self) -> Option<Duration> {
        let next = self.timers.first().map(|(due, _)| *due);
        let kept = self
            .ended
            .front()
            .map(|(since, _)| since.saturating_add(self.config.keep_ended));
        next.into_iter().chain(kept).min()
    }

    /// The time has come: answers are late, and conversations fell silent.
    pub fn handle_timeout(&mut self, now: Now) {
        while let Some((due_by, at)) = self.timers.first().copied() {
            if due_by > now.mono {
                break;
            }
            self.timers.pop_first();
            self.expire(now, at);
        }
        self.forget(now);
    }

    fn expire(&mut self, now: Now, at: usize) {
        let Some(Some(watched)) = self.places.get_mut(at) else {
            return;
        };
        let mut changed = watched.conversation.handle_timeout(now);
        if watched.last.saturating_add(self.config.idle) <= now.mono {
            watched.conversation.abandon(Outcome::TimedOut);
            changed = true;
        }
        watched.timer =
            due(watched, &self.config).max(now.mono.saturating_add(Duration::from_nanos(1)));
        self.timers.insert((watched.timer, at));
        if changed {
            let state = watched.conversation.state();
            self.changed(now, at, EventKind::Updated { state });
        }
    }

    /// An agent is gone, as the directory says: what waits for it ends.
    pub fn agent_gone(&mut self, now: Now, name: &str) {
        for at in 0..self.places.len() {
            let Some(Some(watched)) = self.places.get_mut(at) else {
                continue;
            };
            if !watched.ended && watched.conversation.agent_gone(name) {
                let state = watched.conversation.state();
                self.changed(now, at, EventKind::Updated { state });
            }
        }
    }

    /// How many sub-conversations a conversation will have; false if there is no such conversation.
    pub fn announce_sub_conversations(&mut self, id: &Expression, number: usize) -> bool {
        let found = self
            .place(id)
            .and_then(|at| self.places.get_mut(at)?.as_mut());
        let Some(watched) = found else {
            return false;
        };
        watched.conversation.announce_sub_conversations(number);
        true
    }

    /// A conversation, also one that has ended and is still kept.
    pub fn conversation(&self, id: &Expression) -> Option<&Conversation> {
        self.find(id).map(|watched| &watched.conversation)
    }

    /// What happened next, that nobody has been told yet.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Conversations that are known, those that have ended and are still kept included.
    pub fn len(&self) -> usize {
        self.by_id.len()
    }

    /// Whether no conversation is known.
    pub fn is_empty(&self) -> bool {
        self.by_id.is_empty()
    }

    fn find(&self, id: &Expression) -> Option<&Watched> {
        self.places.get(self.place(id)?)?.as_ref()
    }

    fn place(&self, id: &Expression) -> Option<usize> {
        let found = match id.as_str() {
            Some(id) => self.by_id.get(id),
            None => self.by_id.get(&id_text(id)),
        };
        found.copied()
    }
}

/// When something happens to a conversation by itself.
fn due(watched: &Watched, config: &Config) -> Duration {
    let silent = watched.last.saturating_add(config.idle);
    watched
        .conversation
        .soonest()
        .map_or(silent, |due| due.min(silent))
}
