//! `fipa key`: the key of a fleet, and the robots that belong to it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use clap::Subcommand;
use fipa_acl::FipaTime;
use fipa_fleet::{
    Certificate, FleetError, Folder, Installed, Membership, ROBOT_DAYS, Refusal, Revocations,
    check_name, default_folder, write_secret,
};
use serde_json::{Value, json};

use crate::{Failure, streams};

/// The options of `fipa key`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a new fleet: the key that decides who belongs to it
    Init(Init),
    /// Make the file for a robot, by its name; or, on the robot, take such a file in
    Join(Join),
    /// Show the fleet, its robots, and which of them this machine is
    Show(Show),
    /// Revoke what was made for a robot; or take in a list of what is revoked
    Revoke(Revoke),
}

#[derive(Debug, clap::Args)]
struct Place {
    /// The folder of the fleet [default: fipa/fleet in $XDG_CONFIG_HOME or ~/.config]
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// Print JSON, one object a line
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct Init {
    #[command(flatten)]
    place: Place,
}

#[derive(Debug, clap::Args)]
struct Join {
    /// The robot's name, which is that of its daemon; or a file NAME.fleet
    #[arg(value_name = "NAME|FILE")]
    what: String,
    /// Where to write the file for the robot [default: this machine joins itself]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// For how many days the robot may belong to the fleet
    #[arg(long, value_name = "DAYS", default_value_t = ROBOT_DAYS, value_parser = clap::value_parser!(u32).range(1..=36500))]
    days: u32,
    #[command(flatten)]
    place: Place,
}

#[derive(Debug, clap::Args)]
struct Show {
    #[command(flatten)]
    place: Place,
}

#[derive(Debug, clap::Args)]
struct Revoke {
    /// The robot's name; or a file LIST.pem
    #[arg(value_name = "NAME|FILE")]
    what: String,
    /// Where to write the list of all that is revoked, for robots that no daemon tells
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    place: Place,
}

/// What is told, as text and as JSON.
struct Told(String, Value);

/// Runs the command.
pub fn run(args: &Args) -> Result<(), Failure> {
    let (place, told) = match &args.command {
        Command::Init(args) => (&args.place, init(&args.place)),
        Command::Join(args) => (&args.place, join(args)),
        Command::Show(args) => (&args.place, show(&args.place)),
        Command::Revoke(args) => (&args.place, revoke(args)),
    };
    let told = told?;
    streams::write_output(|output| {
        for Told(text, json) in told {
            match place.json {
                true => writeln!(output, "{json}")?,
                false => writeln!(output, "{text}")?,
            }
        }
        Ok(())
    })
}

impl Place {
    fn folder(&self) -> Result<Folder, Failure> {
        let usual = || default_folder(|name| std::env::var_os(name));
        let path = self.dir.clone().or_else(usual);
        path.map(Folder::new).ok_or_else(|| {
            Failure::environment("there is no home directory: say by --dir where the fleet is kept")
        })
    }
}

fn init(place: &Place) -> Result<Vec<Told>, Failure> {
    let folder = place.folder()?;
    let key = folder.init(now()).map_err(failure)?;
    let (at, fleet) = (folder.path().display(), key.fingerprint().to_string());
    let text = format!(
        "the fleet {fleet} has its key in {at}: keep a copy of that folder, and give it to nobody"
    );
    Ok(vec![Told(
        text,
        json!({"fleet": fleet, "dir": at.to_string()}),
    )])
}

fn join(args: &Join) -> Result<Vec<Told>, Failure> {
    let folder = args.place.folder()?;
    if is_file(&args.what) {
        if args.out.is_some() {
            return Err(Failure::malformed(
                "--out goes with a name: the file for that robot",
            ));
        }
        return install(&folder, Path::new(&args.what));
    }
    let made = folder
        .issue(&args.what, args.days, now())
        .map_err(failure)?;
    let Some(out) = &args.out else {
        folder.keep(&made).map_err(failure)?;
        return Ok(vec![joined(&folder, &made)]);
    };
    write_secret(out, &made.to_pem()).map_err(|error| in_file(out, &error))?;
    let (name, out) = (made.name(), out.display().to_string());
    let text = format!(
        "{out} makes a machine the robot {name}: copy it there, run `fipa key join` with it, and \
         delete it here"
    );
    let value = json!({"robot": name, "file": out, "fingerprint": fingerprint(&made)});
    Ok(vec![Told(text, value)])
}

/// A name has no slash and does not end as these do.
fn is_file(what: &str) -> bool {
    what.contains('/') || what.ends_with(".fleet") || what.ends_with(".pem")
}

fn install(folder: &Folder, file: &Path) -> Result<Vec<Told>, Failure> {
    let text = fs::read_to_string(file).map_err(|error| in_file(file, &error))?;
    match folder.install(&text).map_err(failure)? {
        Installed::Robot(_) => {
            let membership = folder.membership().map_err(failure)?;
            Ok(vec![joined(folder, &membership)])
        }
        Installed::Revocations { news } => {
            let text = match news {
                true => "more is revoked now",
                false => "all of it was known to be revoked",
            };
            Ok(vec![Told(text.to_owned(), json!({"news": news}))])
        }
        _ => Ok(Vec::new()),
    }
}

fn joined(folder: &Folder, membership: &Membership) -> Told {
    let (name, fleet) = (membership.name(), membership.fleet().to_string());
    let at = folder.path().display().to_string();
    let text = format!("this machine is the robot {name} of the fleet {fleet}, by {at}");
    let value =
        json!({"robot": name, "fleet": fleet, "dir": at, "fingerprint": fingerprint(membership)});
    Told(text, value)
}

fn show(place: &Place) -> Result<Vec<Told>, Failure> {
    let folder = place.folder()?;
    let mut told = Vec::new();
    let membership = match folder.membership() {
        Ok(membership) => Some(membership),
        Err(FleetError::NotInFleet(_)) => None,
        Err(error) => return Err(failure(error)),
    };
    let key = match folder.fleet_key() {
        Ok(key) => Some(key),
        Err(FleetError::NoFleetKey(_)) => None,
        Err(error) => return Err(failure(error)),
    };
    let own = membership.as_ref().map(Membership::certificate);
    let fleet = membership
        .as_ref()
        .map(Membership::fleet)
        .or_else(|| key.as_ref().map(|key| key.fingerprint()));
    let Some(fleet) = fleet else {
        let at = folder.path().display();
        return Err(Failure::no(format_args!(
            "there is no fleet in {at}: `fipa key init` makes one, `fipa key join FILE` joins one"
        )));
    };
    let here = own.map_or("no robot of it".to_owned(), |own| {
        format!("the robot {}", own.name())
    });
    let holds = if key.is_some() {
        ", and holds its key"
    } else {
        ""
    };
    told.push(Told(
        format!("fleet {fleet}; this machine is {here}{holds}"),
        json!({"fleet": fleet.to_string(), "key": key.is_some(), "robot": own.map(Certificate::name)}),
    ));
    let revoked = folder.revoked().map_err(failure)?;
    let mut robots = folder.issued().map_err(failure)?;
    if let Some(own) = own.filter(|own| !robots.contains(own)) {
        robots.push(own.clone());
    }
    told.extend(
        robots
            .iter()
            .map(|robot| about(robot, own, revoked.as_ref(), membership.as_ref())),
    );
    Ok(told)
}

fn about(
    robot: &Certificate,
    own: Option<&Certificate>,
    revoked: Option<&Revocations>,
    membership: Option<&Membership>,
) -> Told {
    let name = robot.name();
    let known = membership.map(|fleet| fleet.check(&[robot.der()], now()));
    let expired = robot.valid_until().is_some_and(|end| end < now());
    let state = match known {
        _ if revoked.is_some_and(|list| list.holds(robot)) => "revoked",
        Some(Err(Refusal::Revoked(_))) => "revoked",
        Some(Err(Refusal::NotYetValid { .. })) => "not-yet-valid",
        _ if expired => "expired",
        _ => "valid",
    };
    let until = robot.valid_until().map(|until| {
        let millis = i64::try_from(until.as_millis()).unwrap_or(i64::MAX);
        FipaTime::from_unix_millis(millis).to_string()
    });
    let shown = until.as_deref().unwrap_or("?");
    let fingerprint = robot.fingerprint().to_string();
    let here = if own == Some(robot) { " (here)" } else { "" };
    let text = format!("{name}{here}: {state}, until {shown}, fingerprint {fingerprint}");
    let value = json!({
        "robot": name, "state": state, "until": until, "fingerprint": fingerprint,
        "here": own == Some(robot),
    });
    Told(text, value)
}

fn revoke(args: &Revoke) -> Result<Vec<Told>, Failure> {
    let folder = args.place.folder()?;
    if is_file(&args.what) {
        return install(&folder, Path::new(&args.what));
    }
    check_name(&args.what).map_err(Failure::malformed)?;
    let list = folder.revoke(&args.what, now()).map_err(failure)?;
    if let Some(out) = &args.out {
        write_secret(out, &list.to_pem()).map_err(|error| in_file(out, &error))?;
    }
    let (name, count) = (&args.what, list.len());
    let text = format!(
        "{name} is revoked; a daemon that runs with this folder tells the others, to the rest bring \
         the list (--out)"
    );
    Ok(vec![Told(text, json!({"revoked": name, "count": count}))])
}

fn fingerprint(membership: &Membership) -> String {
    membership.certificate().fingerprint().to_string()
}

fn now() -> Duration {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH);
    since_epoch.unwrap_or_default()
}

fn in_file(file: &Path, error: &io::Error) -> Failure {
    Failure::environment(format_args!("{}: {error}", file.display()))
}

fn failure(error: FleetError) -> Failure {
    match error {
        FleetError::Name(_) | FleetError::Malformed(_) | FleetError::Own(_) => {
            Failure::malformed(error)
        }
        FleetError::UnknownRobot(_) | FleetError::OlderList => Failure::no(error),
        _ => Failure::environment(error),
    }
}
