//! What the doctor has found out, before anything is concluded from it.

use fipa::{CalledBack, Facts, GreetError, Greeting, HeardDaemon, InterfaceProbe};

/// Everything that was found out.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    /// What the daemon of this host told, or why there is nothing.
    pub(super) daemon: Result<Facts, String>,
    /// The interfaces of this host, or why they are not known.
    pub(super) interfaces: Result<Vec<InterfaceProbe>, String>,
    /// Agent names that more than one platform holds.
    pub(super) doubles: Vec<String>,
    /// What came of calling the daemon of this host at its own endpoints.
    pub(super) own: Vec<Call>,
    /// What came of calling others.
    pub(super) calls: Vec<Call>,
    /// What came of having others call the daemon of this host.
    pub(super) backs: Vec<Back>,
    /// Whom the question is about; `None`: everybody.
    pub(super) wanted: Option<Wanted>,
}

/// An attempt to be greeted.
#[derive(Clone, Debug)]
pub(super) struct Call {
    /// Who was called, for people.
    pub(super) whom: String,
    /// Where.
    pub(super) addresses: Vec<String>,
    /// Whether a robot of another make is called, which takes letters and does not greet.
    pub(super) other_make: bool,
    /// What came of it.
    pub(super) result: Result<Greeting, GreetError>,
}

/// An attempt to have another daemon call the one of this host.
#[derive(Clone, Debug)]
pub(super) struct Back {
    /// Who was to call.
    pub(super) whom: String,
    /// Its answer; `None`: there was none.
    pub(super) answer: Option<CalledBack>,
}

/// Whom the question is about.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    /// As it was asked for.
    pub(super) name: String,
    /// Whether anybody knows where it is.
    pub(super) known: bool,
}

impl Evidence {
    /// The daemons that answered on some interface, ours aside, with the names of the interfaces.
    pub(super) fn heard(&self) -> impl Iterator<Item = (&InterfaceProbe, &HeardDaemon)> {
        let own = self.daemon.as_ref().ok().map(|facts| facts.instance);
        let all = self.interfaces.iter().flatten();
        all.flat_map(|interface| interface.heard.iter().map(move |heard| (interface, heard)))
            .filter(move |(_, heard)| Some(heard.instance) != own)
    }
}
