//! Two services that dial each other at the same time have two links; one is kept.

use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::Frame;

use super::Mts;
use super::connections::{DUPLICATE, Partner};
use crate::machine::{ConnId, Output};

impl Mts {
    /// Of several links the service with the smaller id keeps the one that it has had longest. Each
    /// side tells the other when it has just one: a stream can end on one side only.
    pub(super) fn keep_one_link(&mut self, now: Now, instance: InstanceId) {
        if self.config.instance > instance {
            return;
        }
        let links = match self.peers.get(instance) {
            Some(peer) => peer.links.clone(),
            None => return,
        };
        for conn in links.into_iter().skip(1) {
            self.send(now, conn, Frame::Goodbye(Text::from_static(DUPLICATE)));
            if let Some(open) = self.conns.get_mut(&conn) {
                open.retired = true;
            }
        }
    }

    /// The partner keeps another link: this one closes once its receipts are in.
    pub(super) fn retire(&mut self, now: Now, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        open.retired = true;
        let decider = match open.partner {
            Partner::Daemon { instance, .. } => self.config.instance < instance,
            _ => false,
        };
        if open.outstanding.is_empty() && open.passing == 0 && !decider {
            self.outputs.push_back(Output::Close(conn));
            self.drop_conn(now, conn, DUPLICATE);
        }
    }

    /// Whether there is no other link to the same peer that is in use.
    pub(super) fn is_only_link(&self, conn: ConnId) -> bool {
        let Some(Partner::Daemon { instance, .. }) = self.conns.get(&conn).map(|c| &c.partner)
        else {
            return false;
        };
        let in_use = |link: &ConnId| self.conns.get(link).is_some_and(|open| !open.retired);
        self.peers
            .get(*instance)
            .is_some_and(|peer| !peer.links.iter().any(|link| *link != conn && in_use(link)))
    }

    /// The partner has no link but this one: the others are dead, and nobody told us. Not so one
    /// that we have claimed meanwhile: the partner will give this one up for it.
    pub(super) fn keep_this_link(&mut self, now: Now, conn: ConnId) {
        let Some(open) = self.conns.get_mut(&conn) else {
            return;
        };
        open.retired = false;
        let Partner::Daemon { instance, .. } = open.partner else {
            return;
        };
        let links = match self.peers.get(instance) {
            Some(peer) => peer.links.clone(),
            None => return,
        };
        let claimed = |link: &ConnId| self.conns.get(link).is_some_and(|open| open.claimed);
        let others = links.iter().filter(|link| **link != conn && !claimed(link));
        let others: Vec<ConnId> = others.copied().collect();
        for other in others {
            self.outputs.push_back(Output::Close(other));
            self.drop_conn(
                now,
                other,
                "the other side does not have this link any more",
            );
        }
        self.flush_waiting(now, instance);
    }
}
