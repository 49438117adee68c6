//! The fleet that the daemon belongs to, if it does.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use fipa::{FleetError, Folder, Membership, Platform, default_folder};
use fipa_directory::Address;
use tokio::time::Interval;

use crate::options::{FleetMode, Options};

/// How often it is looked at whether more is revoked.
const LOOK: Duration = Duration::from_secs(2);

/// After so many looks, whether certificates on open links have expired.
const LOOKS: u32 = 30;

/// Why the daemon does not run as a robot of its fleet.
#[derive(Debug, thiserror::Error)]
pub(crate) enum MembershipError {
    #[error(transparent)]
    Fleet(#[from] FleetError),
    #[error(
        "--require-fleet: {0} is open to everybody, as this machine is in no fleet (`fipa key`)"
    )]
    Required(Address),
}

/// The membership of this machine, kept up to date with its folder.
pub(crate) struct Watched {
    folder: Folder,
    membership: Arc<Membership>,
    ticks: Interval,
    looks: u32,
}

/// The fleet that is to be spoken for.
pub(crate) fn load(options: &Options) -> Result<Option<Watched>, MembershipError> {
    let loaded = match options.fleet_mode {
        Some(FleetMode::Open) => None,
        _ => read(options)?,
    };
    let http = options
        .http
        .as_ref()
        .map(|at| format!("http://{at}").parse());
    let http = http.and_then(Result::ok);
    let mut places = options.listen.iter().chain(&http);
    let open = places.find(|address| !address.is_loopback());
    match (&loaded, open) {
        (None, Some(open)) if options.require_fleet => {
            return Err(MembershipError::Required(open.clone()));
        }
        (None, Some(open)) => tracing::warn!(
            "anybody who reaches {open} can send letters and register agents: this daemon is in no \
             fleet (`fipa key`)"
        ),
        _ => {}
    }
    Ok(loaded)
}

fn read(options: &Options) -> Result<Option<Watched>, MembershipError> {
    let usual = || default_folder(|name| std::env::var_os(name));
    let demanded = options.fleet.is_some() || options.fleet_mode.is_some();
    let Some(path) = options.fleet.clone().or_else(usual) else {
        return match demanded {
            true => Err(FleetError::NotInFleet(PathBuf::from("the home directory")).into()),
            false => Ok(None),
        };
    };
    let folder = Folder::new(path);
    if !folder.is_joined() && !demanded {
        return Ok(None);
    }
    let mut membership = folder.membership()?;
    if options.fleet_mode == Some(FleetMode::Pinned) {
        membership = membership.pinned(options.pinned.iter().copied());
    }
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH);
    let own = membership.certificate().der();
    if let Err(refusal) = membership.check(&[own], since_epoch.unwrap_or_default()) {
        tracing::warn!("the others will not let this daemon in: {refusal}");
    }
    Ok(Some(Watched {
        folder,
        membership: Arc::new(membership),
        ticks: tokio::time::interval(LOOK),
        looks: 0,
    }))
}

impl Watched {
    pub(crate) fn membership(&self) -> Arc<Membership> {
        Arc::clone(&self.membership)
    }

    /// Waits a moment, then has the platform heed what was revoked meanwhile. Cancel-safe.
    pub(crate) async fn look(&mut self, platform: &Platform) {
        self.ticks.tick().await;
        self.looks = (self.looks + 1) % LOOKS;
        match self.folder.read_revoked(&self.membership) {
            Ok(news) if news || self.looks == 0 => platform.check_fleet(),
            Ok(_) => {}
            Err(error) => tracing::warn!("what is revoked cannot be read: {error}"),
        }
        self.keep();
    }

    /// Keeps what others told to be revoked.
    fn keep(&self) {
        let Some(revoked) = self.membership.revoked() else {
            return;
        };
        let kept = self.folder.revoked();
        if kept.is_ok_and(|kept| kept.is_none_or(|kept| kept.len() < revoked.len()))
            && let Err(error) = self.folder.keep_revoked(&revoked)
        {
            tracing::warn!("what is revoked cannot be kept: {error}");
        }
    }
}
