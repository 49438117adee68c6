//! Runs a state machine: sockets, timers and waiting callers around one lock that is never held
//! over a wait.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::{Expression, Letter, Message, Text};
use fipa_directory::{Address, Change, ChangeKind, InstanceId, Now};
use fipa_link::{CallBack, CallBackResult, CalledBack, Facts, ReceiverOutcome};
use fipa_mts::{
    Announced, ConnId, Connected, DialId, Ended, Machine, Notice, Output, PostFailure, PostId,
    PostedLetter, RegisterError, SentLetter, TakenOver, Urgency,
};
use fipa_outbox::Store;
use fipa_transport::http::HttpClient;
use fipa_transport::{Buffers, Driver, End, Handle, Listener, Stream};
use tokio::sync::{Notify, mpsc, oneshot};
use tokio::task::JoinSet;

use crate::GreetError;
use crate::clock::Clock;
use crate::conversations::Talk;
use crate::greet::greet_by;
use crate::http;
use crate::letters::PlugIns;
use crate::restraint::Restraint;
use crate::room::Place;
use crate::security::Security;
use crate::sniffer::Tap;

/// A machine with what runs it.
pub(crate) struct Node<M> {
    state: Mutex<State<M>>,
    clock: Clock,
    security: Security,
    buffers: Arc<Buffers>,
    runtime: tokio::runtime::Handle,
    timer: Arc<Notify>,
    http: HttpClient,
    questions: Arc<Questions>,
}

/// Who waits for an answer to a question of the platform itself, by the tag of the answer.
pub(crate) type Questions = Mutex<HashMap<Expression, oneshot::Sender<Message>>>;

struct State<M> {
    machine: M,
    handles: HashMap<ConnId, Arc<Handle>>,
    /// The certificates that were shown on connections which are open.
    certificates: HashMap<ConnId, Vec<u8>>,
    next_conn: u64,
    /// When the timer task is going to call.
    scheduled: Option<Duration>,
    hub: Hub,
    /// Where letters for robots that are away are stored, if anywhere.
    store: Option<Store>,
    plug_ins: Arc<PlugIns>,
}

/// Who waits for what.
#[derive(Default)]
pub(crate) struct Hub {
    next_ticket: u64,
    outcomes: HashMap<u64, (oneshot::Sender<Vec<ReceiverOutcome>>, Option<Place>)>,
    registrations: HashMap<u64, oneshot::Sender<Result<(), RegisterError>>>,
    leaves: HashMap<u64, oneshot::Sender<Vec<Letter>>>,
    mail: HashMap<Text, Arc<Notify>>,
    changes: Vec<mpsc::UnboundedSender<Change>>,
    notices: Vec<mpsc::UnboundedSender<Notice>>,
    restraint: Restraint,
    facts: Vec<oneshot::Sender<Facts>>,
    call_backs: HashMap<u64, oneshot::Sender<CalledBack>>,
    verify: Option<mpsc::UnboundedSender<Announced>>,
    talks: Vec<Weak<Talk>>,
    tap: Option<Tap>,
    /// Somebody who waited for mail was woken.
    woken: bool,
    ended: bool,
}

impl<M: Machine> State<M> {
    /// When the timer task is to call.
    fn poll_timeout(&self) -> Option<Duration> {
        let due = self.hub.restraint.due();
        self.machine.poll_timeout().into_iter().chain(due).min()
    }
}

impl Hub {
    /// A ticket for a letter, and where its outcomes will come. Until then it takes its place.
    pub(crate) fn expect_outcome(
        &mut self,
        place: Option<Place>,
    ) -> (u64, oneshot::Receiver<Vec<ReceiverOutcome>>) {
        let (sender, receiver) = oneshot::channel();
        self.next_ticket += 1;
        self.outcomes.insert(self.next_ticket, (sender, place));
        (self.next_ticket, receiver)
    }

    /// A ticket for a registration, and where its answer will come.
    pub(crate) fn expect_registration(
        &mut self,
    ) -> (u64, oneshot::Receiver<Result<(), RegisterError>>) {
        let (sender, receiver) = oneshot::channel();
        self.next_ticket += 1;
        self.registrations.insert(self.next_ticket, sender);
        (self.next_ticket, receiver)
    }

    /// A ticket for an agent's leave, and where what waits for it will come.
    pub(crate) fn expect_leave(&mut self) -> (u64, oneshot::Receiver<Vec<Letter>>) {
        let (sender, receiver) = oneshot::channel();
        self.next_ticket += 1;
        self.leaves.insert(self.next_ticket, sender);
        (self.next_ticket, receiver)
    }

    /// Where the facts will come that a daemon is asked for.
    pub(crate) fn expect_facts(&mut self) -> oneshot::Receiver<Facts> {
        let (sender, receiver) = oneshot::channel();
        self.facts.push(sender);
        receiver
    }

    /// A ticket for a question whether others reach us, and where its answer will come.
    pub(crate) fn expect_call_back(&mut self) -> (u64, oneshot::Receiver<CalledBack>) {
        let (sender, receiver) = oneshot::channel();
        // Who is too old for the question never answers it.
        self.call_backs.retain(|_, waiter| !waiter.is_closed());
        self.next_ticket += 1;
        self.call_backs.insert(self.next_ticket, sender);
        (self.next_ticket, receiver)
    }

    /// What is notified when mail for this agent comes.
    pub(crate) fn on_mail(&mut self, name: &Text) -> Arc<Notify> {
        Arc::clone(self.mail.entry(name.clone()).or_default())
    }

    pub(crate) fn forget_mail(&mut self, name: &Text) {
        self.mail.remove(name);
    }

    pub(crate) fn changes(&mut self) -> mpsc::UnboundedReceiver<Change> {
        let (sender, receiver) = mpsc::unbounded_channel();
        self.changes.retain(|listener| !listener.is_closed());
        if !self.ended {
            self.changes.push(sender);
        }
        receiver
    }

    /// The conversations of an agent are told from now on who goes.
    pub(crate) fn tell_departures(&mut self, talk: Weak<Talk>) {
        self.talks.retain(|talk| talk.strong_count() > 0);
        self.talks.push(talk);
    }

    pub(crate) fn notices(&mut self) -> mpsc::UnboundedReceiver<Notice> {
        let (sender, receiver) = mpsc::unbounded_channel();
        self.notices.retain(|listener| !listener.is_closed());
        if !self.ended {
            self.notices.push(sender);
        }
        receiver
    }

    /// Logs a notice and hands it to whoever listens, unless there are too many of its kind.
    fn tell(&mut self, now: Now, notice: &Notice) {
        self.tell_left_out(now);
        match self.restraint.allows(now.mono, notice) {
            true => self.say(notice),
            // Who asks for more wants to drown in it.
            false => tracing::debug!("{notice}"),
        }
    }

    fn take_notice(&mut self, now: Now, notice: &Notice) {
        self.tell(now, notice);
        if let Notice::DaemonGivenUp { .. } = notice {
            self.end();
        }
    }

    /// Tells how many notices were too many, when it is time for that.
    fn tell_left_out(&mut self, now: Now) {
        for notice in self.restraint.left_out(now.mono) {
            self.say(&notice);
        }
    }

    fn say(&mut self, notice: &Notice) {
        tracing::info!("{notice}");
        self.notices
            .retain(|listener| listener.send(notice.clone()).is_ok());
    }

    /// Nothing will come any more; whoever waits is told.
    pub(crate) fn end(&mut self) {
        for notice in self.restraint.left_out_so_far() {
            self.say(&notice);
        }
        self.ended = true;
        self.outcomes.clear();
        self.registrations.clear();
        self.leaves.clear();
        self.facts.clear();
        self.call_backs.clear();
        self.changes.clear();
        self.notices.clear();
        self.tap = None;
        self.mail
            .values()
            .for_each(|notify| notify.notify_waiters());
    }

    /// Whoever watches what passes from now on, in place of whoever did before.
    pub(crate) fn set_tap(&mut self, tap: Tap) {
        self.tap = (!self.ended).then_some(tap);
    }

    pub(crate) fn tap(&self) -> Option<&Tap> {
        self.tap.as_ref()
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.ended
    }

    pub(crate) fn verifications(&mut self) -> mpsc::UnboundedReceiver<Announced> {
        let (sender, receiver) = mpsc::unbounded_channel();
        self.verify = Some(sender);
        receiver
    }
}

impl<M: Machine + Send + 'static> Node<M> {
    /// Starts to run a machine on the runtime that this is called in. Whoever waits in the hub
    /// already misses nothing.
    pub(crate) fn start(clock: Clock, machine: M, hub: Hub, security: Security) -> Arc<Node<M>> {
        let timer = Arc::new(Notify::new());
        let node = Arc::new(Node {
            state: Mutex::new(State {
                machine,
                handles: HashMap::new(),
                certificates: HashMap::new(),
                next_conn: 0,
                scheduled: None,
                hub,
                store: None,
                plug_ins: Arc::default(),
            }),
            clock,
            security,
            buffers: Arc::default(),
            runtime: tokio::runtime::Handle::current(),
            timer: Arc::clone(&timer),
            http: HttpClient::new(),
            questions: Arc::default(),
        });
        tokio::spawn(run_timers(Arc::downgrade(&node), timer));
        node.with(|_, _, _| ());
        node
    }

    /// Hands something to the machine and does what it wants done.
    pub(crate) fn with<R>(self: &Arc<Self>, call: impl FnOnce(Now, &mut M, &mut Hub) -> R) -> R {
        let mut state = self.lock();
        let state = &mut *state;
        let result = call(self.clock.now(), &mut state.machine, &mut state.hub);
        self.act(state, None);
        result
    }

    /// Gives the machine its store.
    pub(crate) fn set_store(&self, store: Store) {
        self.lock().store = Some(store);
    }

    /// Gives the machine the transports that are plugged in.
    pub(crate) fn plug_in(&self, plug_ins: PlugIns) {
        self.lock().plug_ins = Arc::new(plug_ins);
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.lock().hub.has_ended()
    }

    /// Writes what waits for the disk, and closes the store.
    pub(crate) async fn close_store(&self) {
        let store = self.lock().store.take();
        if let Some(store) = store {
            // The thread of the store may be about to tell the machine something.
            let closed = self.runtime.spawn_blocking(move || store.close());
            let _ = closed.await;
        }
    }

    pub(crate) fn questions(&self) -> Arc<Questions> {
        Arc::clone(&self.questions)
    }

    /// Runs a stream that was accepted.
    pub(crate) fn accepted(self: &Arc<Self>, stream: Stream, control: bool) {
        self.open(stream, None, control);
    }

    /// Accepts streams until the task is aborted.
    pub(crate) async fn accept_from(self: Arc<Self>, listener: Listener, control: bool) {
        loop {
            match listener.accept().await {
                Ok(stream) if control || !self.security.is_on() && !stream.is_calling() => {
                    self.accepted(stream, control);
                }
                Ok(stream) => {
                    tokio::spawn(Arc::clone(&self).greet(stream));
                }
                Err(error) => {
                    // Out of file descriptors, or a connection that ended before it was taken:
                    // neither gets better by trying again at once.
                    tracing::warn!("cannot accept at {}: {error}", listener.address());
                    tokio::time::sleep(Duration::from_millis(100)).await;
                }
            }
        }
    }

    /// Lets a caller show who it is.
    async fn greet(self: Arc<Self>, stream: Stream) {
        let remote = stream.remote();
        match self.security.accept(stream).await {
            Ok(Some(stream)) => self.accepted(stream, false),
            Ok(None) => {}
            Err(reason) if reason.is_empty() => tracing::debug!("refused {remote} again"),
            Err(reason) => self.with(|now, _, hub| {
                let (who, reason) = (Text::from(remote), Text::from(reason));
                hub.tell(now, &Notice::Refused { who, reason });
            }),
        }
    }

    /// Waits until no connection is open any more.
    pub(crate) async fn wait_closed(&self) {
        while !self.lock().handles.is_empty() {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State<M>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn open(self: &Arc<Self>, stream: Stream, dialled: Option<(DialId, Address)>, control: bool) {
        let handle = Arc::new(Handle::default());
        let mut state = self.lock();
        let state = &mut *state;
        state.next_conn += 1;
        let conn = ConnId(state.next_conn);
        state.handles.insert(conn, Arc::clone(&handle));
        let connected = Connected {
            conn,
            dialled,
            control,
            same_host: stream.same_host(),
            remote: Text::from(stream.remote()),
            identity: stream.identity().map(Text::from),
            lanes: stream.has_lanes(),
        };
        if let Some(certificate) = stream.certificate() {
            state.certificates.insert(conn, certificate.to_vec());
        }
        state.machine.connected(self.clock.now(), connected);
        self.act(state, Some(conn));
        let driver = Connection {
            node: Arc::clone(self),
            conn,
            woken: AtomicBool::new(false),
        };
        let buffers = Arc::clone(&self.buffers);
        self.runtime
            .spawn(fipa_transport::pump(stream, handle, buffers, driver));
    }

    async fn dial(self: Arc<Self>, dial: DialId, addresses: Vec<Address>, link: bool) {
        match self.security.dial(&addresses, link).await {
            Ok((stream, address)) => self.open(stream, Some((dial, address)), false),
            Err(error) => {
                let reason = error.to_string();
                self.with(|now, machine, _| machine.dial_failed(now, dial, &reason));
            }
        }
    }

    async fn post(self: Arc<Self>, letter: PostedLetter) {
        let result = http::post(&self.http, &letter).await;
        self.posted(letter.post, result);
    }

    /// Begins to post a letter behind those that were begun before.
    fn post_in_series(self: &Arc<Self>, letter: &PostedLetter) {
        let (node, post) = (Arc::clone(self), letter.post);
        let tell = move |result| node.posted(post, result);
        http::post_in_series(&self.http, letter, &self.runtime, tell);
    }

    fn posted(self: &Arc<Self>, post: PostId, result: Result<TakenOver, PostFailure>) {
        self.with(|now, machine, _| machine.posted(now, post, result));
    }

    async fn hand_over(self: Arc<Self>, plug_ins: Arc<PlugIns>, letter: SentLetter) {
        let post = letter.post;
        let result = plug_ins.send(letter).await;
        self.posted(post, result.map(|()| TakenOver::default()));
    }

    /// Calls a service at each of these addresses.
    async fn call_back(self: Arc<Self>, call: u64, whom: InstanceId, addresses: Vec<Address>) {
        let calls: JoinSet<CallBack> = addresses
            .into_iter()
            .map(|address| call_at(address, whom, self.security.clone()))
            .collect();
        let calls = calls.join_all().await;
        self.with(|now, machine, _| machine.called_back(now, call, calls));
    }

    /// Does what the machine wants done. A connection that is at work needs no waking.
    fn act(self: &Arc<Self>, state: &mut State<M>, at_work: Option<ConnId>) {
        while let Some(output) = state.machine.poll_output() {
            match output {
                Output::Dial {
                    dial,
                    addresses,
                    link,
                } => {
                    let dialled = Arc::clone(self).dial(dial, addresses, link);
                    self.runtime.spawn(dialled);
                }
                Output::Post(letter) if letter.in_series => self.post_in_series(&letter),
                Output::Post(letter) => {
                    self.runtime.spawn(Arc::clone(self).post(*letter));
                }
                Output::Send(letter) => {
                    let plug_ins = Arc::clone(&state.plug_ins);
                    self.runtime
                        .spawn(Arc::clone(self).hand_over(plug_ins, *letter));
                }
                Output::CallBack {
                    call,
                    whom,
                    addresses,
                } => {
                    let calling = Arc::clone(self).call_back(call, whom, addresses);
                    self.runtime.spawn(calling);
                }
                Output::Transmit(conn) if Some(conn) == at_work => {}
                Output::Transmit(conn) => {
                    if let Some(handle) = state.handles.get(&conn) {
                        handle.transmit();
                    }
                }
                Output::Close(conn) => {
                    if let Some(handle) = state.handles.get(&conn) {
                        handle.close();
                    }
                }
                Output::Finish(conn) => {
                    if let Some(handle) = state.handles.get(&conn) {
                        handle.finish();
                    }
                }
                Output::Abort(conn) => {
                    if let Some(handle) = state.handles.get(&conn) {
                        handle.abort();
                    }
                }
                Output::Store(letter) => {
                    if let Some(store) = &state.store {
                        store.put(letter);
                    }
                }
                Output::Unstore(key) => {
                    if let Some(store) = &state.store {
                        store.remove(key);
                    }
                }
                Output::Revoked(list) => self.learn_revoked(state, &list),
                Output::Notice(notice) => state.hub.take_notice(self.clock.now(), &notice),
                output => tell(&mut state.hub, output),
            }
        }
        let next = state.poll_timeout();
        let sooner = match (next, state.scheduled) {
            (Some(next), Some(scheduled)) => next < scheduled,
            (next, scheduled) => next.is_some() && scheduled.is_none(),
        };
        if sooner {
            state.scheduled = next;
            self.timer.notify_one();
        }
    }
}

/// Finds out whether a service answers at an address.
async fn call_at(address: Address, whom: InstanceId, security: Security) -> CallBack {
    let (result, reason) = match greet_by(std::slice::from_ref(&address), security).await {
        Ok(greeting) if greeting.instance == whom => (CallBackResult::Answered, String::new()),
        Ok(greeting) => {
            let reason = format!("{} answers there", greeting.name);
            (CallBackResult::Stranger, reason)
        }
        Err(error) => {
            let result = match error {
                GreetError::Refused(_) => CallBackResult::Refused,
                GreetError::Unreachable(_) => CallBackResult::NotReached,
                GreetError::Strange(_) | GreetError::Keyless | GreetError::Mute => {
                    CallBackResult::Stranger
                }
            };
            let reason = error.to_string();
            let place = format!("{address}: ");
            let reason = reason.strip_prefix(&place).unwrap_or(&reason);
            (result, reason.to_owned())
        }
    };
    CallBack {
        address: address.to_text(),
        result,
        reason: Text::from(reason),
    }
}

impl<M: Machine + Send + 'static> Node<M> {
    /// Heeds what is known to be revoked, and what has expired.
    #[cfg(feature = "tls")]
    pub(crate) fn check_fleet(self: &Arc<Self>) {
        let mut state = self.lock();
        self.check_links(&mut state);
        self.act(&mut state, None);
    }

    /// Another robot tells what is revoked.
    fn learn_revoked(&self, state: &mut State<M>, list: &[u8]) {
        match self.security.learn_revoked(list) {
            Ok(true) => self.check_links(state),
            Ok(false) => {}
            Err(reason) => tracing::warn!("a list of what is revoked is of no use: {reason}"),
        }
    }

    /// Ends links with robots whose certificates are not good any more, and tells the others of
    /// what is revoked.
    fn check_links(&self, state: &mut State<M>) {
        let now = self.clock.now();
        let Some(revoked) = self.security.revoked() else {
            return;
        };
        for (conn, certificate) in &state.certificates {
            let Err((who, reason)) = self.security.check(certificate, now) else {
                continue;
            };
            if let Some(handle) = state.handles.get(conn) {
                state.hub.tell(now, &Notice::Refused { who, reason });
                handle.abort();
            }
        }
        state.machine.revoked(now, revoked);
    }
}

/// Tells whoever waits for it.
fn tell(hub: &mut Hub, output: Output) {
    match output {
        Output::Outcome { ticket, outcomes } => {
            if let Some((waiter, _place)) = hub.outcomes.remove(&ticket) {
                // Whoever gave up waiting does not want to know any more.
                let _ = waiter.send(outcomes);
            }
        }
        Output::Registered { ticket, result } => {
            if let Some(waiter) = hub.registrations.remove(&ticket) {
                let _ = waiter.send(result);
            }
        }
        Output::Left {
            ticket, letters, ..
        } => {
            if let Some(waiter) = hub.leaves.remove(&ticket) {
                let _ = waiter.send(letters);
            }
        }
        Output::Mail(name) => {
            if let Some(notify) = hub.mail.get(&name) {
                notify.notify_waiters();
                hub.woken = true;
            }
        }
        Output::Directory(change) => {
            if change.kind == ChangeKind::Removed {
                let talks = hub.talks.iter().filter_map(Weak::upgrade);
                talks.for_each(|talk| talk.departed(&change.record.entry.name));
            }
            hub.changes
                .retain(|listener| listener.send(change.clone()).is_ok());
        }
        Output::Facts(facts) => {
            // Whoever gave up waiting does not want to know any more.
            let waiting = std::mem::take(&mut hub.facts).into_iter();
            waiting.for_each(|waiter| drop(waiter.send((*facts).clone())));
        }
        Output::Sniffed(sniffed) => {
            if let Some(tap) = &mut hub.tap {
                tap.tell(*sniffed);
            }
        }
        Output::CalledBack { ticket, called } => {
            if let Some(waiter) = hub.call_backs.remove(&ticket) {
                let _ = waiter.send(called);
            }
        }
        Output::Verify(announced) => {
            if let Some(verify) = &hub.verify {
                let _ = verify.send(announced);
            }
        }
        Output::Dial { .. }
        | Output::Notice(_)
        | Output::Post(_)
        | Output::Send(_)
        | Output::CallBack { .. }
        | Output::Transmit(_)
        | Output::Close(_)
        | Output::Finish(_)
        | Output::Abort(_)
        | Output::Store(_)
        | Output::Unstore(_)
        | Output::Revoked(_) => {}
    }
}

impl<M> Drop for Node<M> {
    fn drop(&mut self) {
        // The timer task looks, and finds nobody.
        self.timer.notify_one();
    }
}

/// Calls the machine when its time has come, as long as it is there.
async fn run_timers<M: Machine + Send + 'static>(node: Weak<Node<M>>, timer: Arc<Notify>) {
    loop {
        let at = {
            let Some(node) = node.upgrade() else {
                return;
            };
            let mut state = node.lock();
            state.scheduled = state.poll_timeout();
            state.scheduled.map(|mono| node.clock.instant(mono))
        };
        let wait = async {
            match at {
                Some(at) => tokio::time::sleep_until(at.into()).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            () = wait => {
                if let Some(node) = node.upgrade() {
                    let mut state = node.lock();
                    let now = node.clock.now();
                    state.machine.handle_timeout(now);
                    state.hub.tell_left_out(now);
                    node.act(&mut state, None);
                }
            }
            () = timer.notified() => {}
        }
    }
}

/// A connection of a machine.
struct Connection<M> {
    node: Arc<Node<M>>,
    conn: ConnId,
    /// What was received last has woken an agent.
    woken: AtomicBool,
}

/// Octets that are handed to the socket in one go.
const BATCH: usize = 1 << 20;

impl<M: Machine + Send + 'static> Connection<M> {
    /// Adds what there is to write. Whether there may be more.
    fn give(
        &self,
        parts: &mut VecDeque<Bytes>,
        at_work: Option<ConnId>,
        poll: impl Fn(&mut M, Now) -> Option<Bytes>,
    ) -> bool {
        let mut octets: usize = parts.iter().map(Bytes::len).sum();
        if octets >= BATCH {
            return true;
        }
        let mut state = self.node.lock();
        let now = self.node.clock.now();
        while octets < BATCH
            && let Some(part) = poll(&mut state.machine, now)
        {
            octets += part.len();
            parts.push_back(part);
        }
        // What waited for room on the connection may have been refused.
        self.node.act(&mut state, at_work);
        octets >= BATCH
    }
}

impl<M: Machine + Send + 'static> Driver for Connection<M> {
    fn received(&self, octets: &mut BytesMut) {
        let mut state = self.node.lock();
        let now = self.node.clock.now();
        state.machine.received(now, self.conn, octets);
        state.hub.woken = false;
        self.node.act(&mut state, Some(self.conn));
        self.woken.store(state.hub.woken, Ordering::Relaxed);
    }

    /// The receipt for a letter goes out together with the answer, if its agent gives one at once.
    fn gives_way(&self) -> bool {
        self.woken.load(Ordering::Relaxed)
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        self.give(parts, Some(self.conn), |machine, now| {
            machine.poll_transmit(now, self.conn)
        })
    }

    fn received_on(&self, lane: usize, octets: &mut BytesMut) -> bool {
        let Some(lane) = Urgency::ALL.get(lane) else {
            octets.clear();
            return true;
        };
        let mut state = self.node.lock();
        let now = self.node.clock.now();
        let wanted = state.machine.received_on(now, self.conn, *lane, octets);
        self.node.act(&mut state, Some(self.conn));
        wanted
    }

    fn transmit_on(&self, lane: usize, parts: &mut VecDeque<Bytes>) -> bool {
        let Some(lane) = Urgency::ALL.get(lane) else {
            return false;
        };
        // Room on a lane may be used by letters of another, to which its turn is to come again.
        self.give(parts, None, |machine, now| {
            machine.poll_transmit_on(now, self.conn, *lane)
        })
    }

    fn closed(&self, end: &End, all_written: bool) {
        let reason = end.to_string();
        let ended = Ended {
            reason: &reason,
            orderly: !matches!(end, End::Broken(_)),
            all_written,
        };
        let mut state = self.node.lock();
        state.handles.remove(&self.conn);
        state.certificates.remove(&self.conn);
        let now = self.node.clock.now();
        state.machine.closed(now, self.conn, ended);
        self.node.act(&mut state, Some(self.conn));
    }
}
