//! Programs on the control socket, and the agents that they attach.

use fipa_acl::Text;
use fipa_directory::Now;
use fipa_link::{Frame, Outcome};

use super::connections::Outstanding;
use super::{Mts, Timer};
use crate::Mailbox;
use crate::machine::{ConnId, Output, Registration};
use crate::mailbox::TIDY;

/// An agent that is registered here.
#[derive(Debug)]
pub(super) enum Local {
    /// It lives in this process.
    Mailbox(Mailbox),
    /// A program attached it.
    Program(ConnId),
}

impl Mts {
    /// Tells that a letter has come into a mailbox.
    pub(super) fn mail_has_come(&mut self, now: Now, name: &Text) {
        self.outputs.push_back(Output::Mail(name.clone()));
        if self.lately.note(name) {
            self.timer(now.mono + TIDY, Timer::Mailboxes);
        }
    }

    /// Letters that still wait give the buffers back that they came in.
    pub(super) fn tidy_mailboxes(&mut self) {
        for name in self.lately.take() {
            if let Some(Local::Mailbox(mailbox)) = self.locals.get_mut(&name) {
                mailbox.detach();
            }
        }
    }

    pub(super) fn attach(
        &mut self,
        now: Now,
        conn: ConnId,
        request: u64,
        name: Text,
        kind: Text,
        description: Text,
    ) {
        let registration = Registration {
            name,
            kind,
            description,
        };
        let refusal = match self.add_local(now, registration, Local::Program(conn)) {
            Ok(()) => Text::default(),
            Err(error) => Text::from(error.to_string()),
        };
        // The directory goes out first: who was told that it is attached can be found.
        self.publish_changes(now);
        self.send(now, conn, Frame::Answer { request, refusal });
    }

    /// Whether the program at the end of this connection has attached the agent.
    pub(super) fn holds(&self, conn: ConnId, name: &str) -> bool {
        matches!(self.locals.get(name), Some(Local::Program(holder)) if *holder == conn)
    }

    pub(super) fn detach(&mut self, now: Now, conn: ConnId, request: u64, name: &str) {
        let refusal = match self.holds(conn, name) {
            true => {
                self.remove_local(now, name);
                Text::default()
            }
            false => Text::from(format!("this connection does not hold {name}")),
        };
        self.publish_changes(now);
        self.send(now, conn, Frame::Answer { request, refusal });
    }

    /// A program's connection ended: its agents go, and so does what was on its way to them.
    pub(super) fn program_ended(&mut self, now: Now, conn: ConnId, lost: Outstanding) {
        let held = |local: &Local| matches!(local, Local::Program(holder) if *holder == conn);
        let mut names: Vec<Text> = self
            .locals
            .iter()
            .filter(|(_, local)| held(local))
            .map(|(name, _)| name.clone())
            .collect();
        names.sort();
        for name in names {
            self.remove_local(now, &name);
        }
        let mut lost: Vec<u64> = lost.into_iter().collect();
        lost.sort_unstable();
        for id in lost {
            let reason = "its program ended before it said that it took the letter";
            self.finish(now, id, Outcome::Timeout, Text::from_static(reason));
        }
    }
}
