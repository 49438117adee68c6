use std::time::Duration;

use fipa_acl::Text;
use fipa_locking::LossReason;
use tokio::sync::{mpsc, watch};

use super::Machine;
use super::driver::{Command, Granted};

/// How long a release waits until the others have been told.
const FAREWELL: Duration = Duration::from_secs(1);

/// A request or a grant, given back when it is dropped.
pub(super) struct Hold {
    pub(super) commands: mpsc::UnboundedSender<Command>,
    pub(super) machine: Machine,
    pub(super) resource: Text,
    /// Tells it from other requests of the resource.
    pub(super) id: u64,
}

impl Drop for Hold {
    fn drop(&mut self) {
        self.give_back(None);
    }
}

impl Hold {
    fn give_back(&self, told: Option<mpsc::Sender<()>>) {
        // With the driver everything has ended.
        let _ = self.commands.send(Command::Release {
            resource: self.resource.clone(),
            id: self.id,
            told,
        });
    }
}

/// A resource that is held: until this is dropped or [released](Guard::release), the agent goes,
/// or it is [lost](Guard::lost).
#[must_use = "the resource is given back when the guard is dropped"]
pub struct Guard {
    hold: Hold,
    fencing: Option<u64>,
    lost: watch::Receiver<Option<LossReason>>,
}

impl Guard {
    pub(super) fn new(hold: Hold, granted: Granted) -> Guard {
        Guard {
            hold,
            fencing: granted.fencing,
            lost: granted.lost,
        }
    }

    /// The resource.
    pub fn resource(&self) -> &Text {
        &self.hold.resource
    }

    /// The number of this grant, greater than that of every earlier one: whatever the lock guards
    /// can refuse who comes with a lower one than it has seen. `None`: the owner issues none (it
    /// is of another make, or the algorithm is a plain one), and nothing guards against a holder
    /// that was taken for dead.
    pub fn fencing(&self) -> Option<u64> {
        self.fencing
    }

    /// Whether it is held now: not lost, and its lease runs by the own clock. Right even where
    /// [`lost`](Self::lost) could not be told in time because the program kept its threads busy.
    pub fn is_held(&self) -> bool {
        let machine = &self.hold.machine;
        let holds = machine.lock().holds(machine.now(), self.resource());
        holds && self.lost.borrow().is_none() && self.lost.has_changed().is_ok()
    }

    /// Waits until it is lost, and says why. Whatever uses the resource stops then: within a
    /// heartbeat another agent may have it. Cancel-safe.
    pub async fn lost(&self) -> LossReason {
        let mut lost = self.lost.clone();
        match lost.wait_for(Option::is_some).await {
            Ok(reason) => reason.unwrap_or(LossReason::Disconnected),
            // The agent has gone.
            Err(_) => LossReason::Disconnected,
        }
    }

    /// Gives it back, and waits until those who are to know have been told, a second at most.
    /// Dropping the guard gives it back as well, without waiting.
    pub async fn release(self) {
        let (told, mut all_told) = mpsc::channel(1);
        self.hold.give_back(Some(told));
        // Whoever was not told finds out by asking.
        let _ = tokio::time::timeout(FAREWELL, all_told.recv()).await;
    }
}
