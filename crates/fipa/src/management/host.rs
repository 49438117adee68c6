//! Runs the AMS and the DF of a message transport service.

use std::collections::HashMap;
use std::sync::{Arc, PoisonError, Weak};
use std::time::Duration;

use fipa_acl::{AgentId, Expression, Letter, Message, Text};
use fipa_directory::{Address, Change, ChangeKind, Now, Source};
use fipa_management::{
    Ams, AmsConfig, Df, DfConfig, DfOutput, DirectoryView, KnownAgent, Origin, client,
};
use fipa_mts::{Machine, Mts, RegisterError, Submission};
use tokio::sync::{Notify, mpsc, oneshot};
use tokio::task::JoinHandle;

use super::platforms;
use super::view::View;
use crate::node::{Hub, Node, Questions};
use crate::{agent, sending};

/// How long the outcome of an answer is waited for.
const TIMEOUT: Duration = Duration::from_secs(10);

/// What the AMS needs to ask others.
#[derive(Clone)]
pub(super) struct Desk {
    node: Weak<Node<Mts>>,
    name: Text,
    questions: Arc<Questions>,
}

/// Starts the AMS and the DF; `unique` is a word that no other run has.
pub(crate) fn start(node: &Arc<Node<Mts>>, unique: &str) -> Result<JoinHandle<()>, RegisterError> {
    let own = node.with(|_, mts, _| {
        let platform = mts.service_name();
        let own = ["ams", "df"].map(|role| Text::from(format!("{role}@{platform}")));
        own.iter().try_for_each(|name| mts.host(name)).map(|()| own)
    })?;
    let [ams, df] = &own;
    let (mails, changes) = node.with(|_, _, hub| {
        let mails = [hub.on_mail(ams), hub.on_mail(df)];
        (mails, hub.changes())
    });
    let host = Host {
        ams: Ams::new(AmsConfig::new(ams)),
        df: Df::new(DfConfig::new(df, unique)),
        desk: desk(node),
        own,
    };
    Ok(tokio::spawn(host.run(mails, changes)))
}

fn desk(node: &Arc<Node<Mts>>) -> Desk {
    let platform = node.with(|_, mts, _| mts.service_name());
    let questions = node.questions();
    Desk {
        node: Arc::downgrade(node),
        name: Text::from(format!("ams@{platform}")),
        questions,
    }
}

/// Looks after the agents of a platform that is none of ours, until the task is aborted. `name` is
/// its name if that is known.
pub(crate) fn start_platform(
    node: &Arc<Node<Mts>>,
    url: Address,
    name: Option<Text>,
) -> JoinHandle<()> {
    tokio::spawn(platforms::follow(desk(node), url, name))
}

impl Desk {
    pub(super) fn with<R>(&self, call: impl FnOnce(Now, &mut Mts, &mut Hub) -> R) -> Option<R> {
        Some(self.node.upgrade()?.with(call))
    }

    /// Whether the service is there.
    pub(super) fn is_open(&self) -> bool {
        self.with(|_, _, hub| !hub.has_ended()).unwrap_or(false)
    }

    /// Asks somebody, and waits for the answer, or tells why none comes.
    pub(super) async fn ask(
        &self,
        question: Message,
        patience: Duration,
    ) -> Result<Message, String> {
        let (sender, answer) = oneshot::channel();
        let question = question.from_agent(AgentId::new(&self.name));
        let asked = self.with(|now, mts, hub| {
            let (ticket, outcomes) = hub.expect_outcome(None);
            let tag = Expression::from(format!("{}-{:x}-{ticket}", self.name, now.unix_millis));
            let question = question
                .conversation_id(tag.clone())
                .reply_with(tag.clone());
            self.lock().insert(tag.clone(), sender);
            submit(now, mts, ticket, question);
            (tag, outcomes)
        });
        let (tag, outcomes) = asked.ok_or("the platform has ended")?;
        let answered = async {
            let outcomes = outcomes.await.unwrap_or_default();
            let failed = outcomes.iter().find(|told| !told.outcome.is_success());
            if let Some(failed) = failed {
                return Err(failed.reason.to_string());
            }
            let ended = |_| "the platform has ended".to_owned();
            answer.await.map_err(ended)
        };
        let answered = tokio::time::timeout(patience, answered).await;
        self.lock().remove(&tag);
        answered.unwrap_or_else(|_| Err(format!("no answer came within {} s", patience.as_secs())))
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<Expression, oneshot::Sender<Message>>> {
        self.questions
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands an answer to whoever waits for it.
    fn take_answer(&self, message: Message) -> Option<Message> {
        let Some(waiting) = message
            .in_reply_to
            .as_ref()
            .and_then(|tag| self.lock().remove(tag))
        else {
            return Some(message);
        };
        // Whoever waited has given up.
        let _ = waiting.send(message);
        None
    }
}

fn submit(now: Now, mts: &mut Mts, ticket: u64, message: Message) {
    match sending::letter(message, now.unix_millis) {
        Ok(letter) => mts.submit(now, Submission::new(ticket, letter, TIMEOUT)),
        Err(reason) => tracing::debug!("an answer of the management cannot be written: {reason}"),
    }
}

struct Host {
    ams: Ams,
    df: Df,
    desk: Desk,
    own: [Text; 2],
}

impl Host {
    async fn run(
        mut self,
        [ams, df]: [Arc<Notify>; 2],
        mut changes: mpsc::UnboundedReceiver<Change>,
    ) {
        loop {
            let (ams, df) = (ams.notified(), df.notified());
            tokio::pin!(ams, df);
            // Asked for before looking, so that no notice falls between.
            ams.as_mut().enable();
            df.as_mut().enable();
            let Some(wait) = self.turn() else {
                return;
            };
            let time = async {
                match wait {
                    Some(wait) => tokio::time::sleep(wait).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = &mut ams => {}
                () = &mut df => {}
                () = time => {}
                change = changes.recv() => match change {
                    Some(change) => self.directory_changed(&change),
                    None => return,
                },
            }
        }
    }

    /// Does everything that is to be done now, and tells how long nothing is; `None` once the
    /// service is gone.
    fn turn(&mut self) -> Option<Option<Duration>> {
        let desk = self.desk.clone();
        desk.with(|now, mts, hub| {
            let own = self.own.clone();
            for name in &own {
                while let Some(letter) = mts.take_mail(name) {
                    self.take(now, mts, hub, name, &letter);
                }
            }
            self.df.handle_timeout(now);
            self.send_all(now, mts, hub);
            let next = self.df.poll_timeout();
            next.map(|at| at.saturating_sub(now.mono))
        })
    }

    fn take(&mut self, now: Now, mts: &mut Mts, hub: &mut Hub, to: &Text, letter: &Letter) {
        let message = match agent::read(letter) {
            Ok(message) => message,
            Err(reason) => {
                tracing::info!("a letter for {to} cannot be read: {reason}");
                return;
            }
        };
        let Some(message) = self.desk.take_answer(message) else {
            return;
        };
        let origin = origin_of(letter);
        if *to == self.own[0]
            && origin == Origin::Local
            && let Some(url) = client::requested_platform(&message)
        {
            self.add_platform(url, message);
            return;
        }
        let mut view = View {
            now,
            mts,
            own: &self.own,
            same_host: origin == Origin::Local || is_of_this_host(letter),
        };
        if *to == self.own[0] {
            if let Some(answer) = self.ams.handle(origin, &message, &mut view) {
                let (ticket, _) = hub.expect_outcome(None);
                submit(now, mts, ticket, answer);
            }
        } else {
            self.df.handle(now, origin, &message, &view);
            self.send_all(now, mts, hub);
        }
    }

    /// Our own addition: who is attached here may have another platform looked after.
    fn add_platform(&self, url: Text, request: Message) {
        let desk = self.desk.clone();
        let told = {
            let desk = desk.clone();
            move |result| {
                let answer = client::platform_answer(&desk.name, &request, result);
                desk.with(|now, mts, hub| {
                    let (ticket, _) = hub.expect_outcome(None);
                    answer
                        .into_iter()
                        .for_each(|one| submit(now, mts, ticket, one));
                });
            }
        };
        tokio::spawn(platforms::add(desk, url, told));
    }

    fn send_all(&mut self, now: Now, mts: &mut Mts, hub: &mut Hub) {
        while let Some(output) = self.df.poll_output() {
            match output {
                DfOutput::Send(message) => {
                    let (ticket, _) = hub.expect_outcome(None);
                    submit(now, mts, ticket, *message);
                }
                DfOutput::Federation { parent, result } => match result {
                    Ok(()) => tracing::info!("federated with {parent}"),
                    Err(reason) => tracing::warn!("not federated with {parent}: {reason}"),
                },
            }
        }
    }

    fn directory_changed(&mut self, change: &Change) {
        let entry = &change.record.entry;
        let agent = KnownAgent {
            name: &entry.name,
            kind: &entry.kind,
            local: change.record.source == Source::Local,
        };
        let desk = self.desk.clone();
        desk.with(|now, mts, hub| {
            let is_there = mts.directory().find(agent.name).is_some();
            match change.kind {
                ChangeKind::Added => {
                    let view = View {
                        now,
                        mts,
                        own: &self.own,
                        same_host: false,
                    };
                    if let Some(agent) = view.find(agent.name) {
                        self.df.agent_known(agent, &view);
                    }
                }
                ChangeKind::Removed if !is_there => {
                    self.df.agent_gone(agent);
                    self.ams.agent_gone(agent.name);
                }
                _ => {}
            }
            self.send_all(now, mts, hub);
        });
    }
}

/// Whether an agent of this platform wrote the letter: the newest stamp is ours, and tells by which
/// way it came.
fn origin_of(letter: &Letter) -> Origin {
    let newest = letter.envelope.stamps().last();
    match newest.and_then(|stamp| stamp.via.as_deref()) {
        None | Some("unix") => Origin::Local,
        Some(_) => Origin::Foreign,
    }
}

/// Whether the sender says that it is reached over loopback, or posted the letter: who did that where
/// nothing but loopback is bound is on this host, and elsewhere nobody is told of loopback.
fn is_of_this_host(letter: &Letter) -> bool {
    let newest = letter.envelope.stamps().last();
    if newest.and_then(|stamp| stamp.via.as_deref()) == Some("http") {
        return true;
    }
    let mut addresses = letter
        .envelope
        .from()
        .into_iter()
        .flat_map(|from| &from.addresses);
    addresses.any(|url| {
        url.parse()
            .is_ok_and(|address: Address| address.is_loopback())
    })
}
