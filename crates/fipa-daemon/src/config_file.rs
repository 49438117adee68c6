//! The configuration file: TOML with the long options' names as keys.
//!
//! **Knows** where in the file something stands and what type it has. **Never knows** which values
//! an option takes; `options::value` does.

mod entry;
mod outbox;
mod place;
mod rules;
mod suggestion;

use std::fs;
use std::path::{Path, PathBuf};

use fipa::Text;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::options::{Layer, OptionsError, value};
use entry::Entry;
use place::Place;
use suggestion::nearest;

/// The commented default configuration.
pub const DEFAULT_CONFIG: &str = include_str!("default_config.toml");

/// The keys, in the order of the options.
pub(crate) const KEYS: [&str; 24] = [
    "name",
    "listen",
    "http",
    "http-path",
    "advertise",
    "scope",
    "fleet",
    "fleet-mode",
    "pinned",
    "require-fleet",
    "interface",
    "no-mdns",
    "mdns-agents",
    "mdns-port",
    "peer",
    "control",
    "json",
    "owns",
    "hiac",
    "hiac-address",
    "text",
    "log-letters",
    "max-letter",
    "state",
];

/// The tables, which have no option.
const TABLES: [&str; 5] = [
    "hiac-devices",
    "hiac-aliases",
    "text-agents",
    "rules",
    "outbox",
];

/// What a file says.
pub(crate) fn load(file: &Path) -> Result<Layer, OptionsError> {
    let octets = fs::read(file).map_err(|source| OptionsError::Unreadable {
        file: file.to_owned(),
        source,
    })?;
    read(&octets).map_err(|(place, problem)| OptionsError::File {
        file: file.to_owned(),
        line: place.line,
        column: place.column,
        problem,
    })
}

fn read(octets: &[u8]) -> Result<Layer, (Place, String)> {
    let text = str::from_utf8(octets).map_err(|error| {
        let place = Place::of(octets, error.valid_up_to());
        (place, "not UTF-8".to_owned())
    })?;
    parse(text).map_err(|wrong| (Place::of(octets, wrong.at), wrong.problem))
}

/// Something that cannot be used, and its offset in the file.
struct Wrong {
    at: usize,
    problem: String,
}

impl Wrong {
    /// A key that is none of those that are known.
    fn key(key: &Spanned<impl AsRef<str>>, known: &[&'static str]) -> Wrong {
        let name = key.get_ref().as_ref();
        let mut problem = format!("unknown key {name:?}");
        if let Some(known) = nearest(name, known) {
            problem += &format!(" (did you mean {known:?}?)");
        }
        Wrong {
            at: key.span().start,
            problem,
        }
    }

    fn syntax(error: &toml::de::Error, end: usize) -> Wrong {
        Wrong {
            at: error.span().map_or(end, |span| span.start),
            problem: error.message().replace(char::is_control, " "),
        }
    }
}

fn parse(text: &str) -> Result<Layer, Wrong> {
    let table = DeTable::parse(text).map_err(|error| Wrong::syntax(&error, text.len()))?;
    let mut entries: Vec<_> = table.get_ref().iter().collect();
    // The table is sorted by key, but people mend a file from its beginning.
    entries.sort_by_key(|(key, _)| key.span().start);
    let mut layer = Layer::default();
    for (key, value) in entries {
        put(&mut layer, key, value)?;
    }
    Ok(layer)
}

fn put(
    layer: &mut Layer,
    key: &Spanned<impl AsRef<str>>,
    value: &Spanned<DeValue<'_>>,
) -> Result<(), Wrong> {
    let entry = Entry {
        key: key.get_ref().as_ref(),
        value,
    };
    match entry.key {
        "name" => layer.name = Some(entry.text(or_default(value::name))?),
        "listen" => layer.listen = Some(entry.listen()?),
        "http" => layer.http = Some(entry.text(or_default(value::http_endpoint))?),
        "http-path" => layer.http_path = Some(entry.text(value::http_path)?),
        "advertise" => layer.advertise = Some(entry.list(value::peer_address)?),
        "scope" => layer.scope = Some(entry.text(value::scope)?),
        "fleet" => layer.fleet = Some(entry.text(|path| Ok(PathBuf::from(path)))?),
        "fleet-mode" => layer.fleet_mode = entry.text(optional(value::fleet_mode))?,
        "pinned" => layer.pinned = Some(entry.list(value::fingerprint)?),
        "require-fleet" => layer.require_fleet = Some(entry.flag()?),
        "rules" => layer.rules = Some(rules::read(&entry)?),
        "interface" => layer.interface = Some(entry.list(value::interface)?),
        "no-mdns" => layer.no_mdns = Some(entry.flag()?),
        "mdns-agents" => layer.mdns_agents = Some(entry.number(value::count)?),
        "mdns-port" => layer.mdns_port = Some(entry.number(value::port)?),
        "peer" => layer.peer = Some(entry.list(value::peer_address)?),
        "control" => layer.control = Some(entry.text(|path| Ok(PathBuf::from(path)))?),
        "owns" => layer.owns = Some(entry.list(value::resource)?),
        "json" => layer.json = Some(entry.flag()?),
        "hiac" => layer.hiac = Some(entry.list(value::hiac_endpoint)?),
        "hiac-address" => layer.hiac_address = entry.text(optional(value::hiac_workgroup))?,
        "hiac-devices" => {
            let devices = entry.strings(value::hiac_address, value::name)?;
            layer.hiac_names.get_or_insert_default().devices = devices;
        }
        "hiac-aliases" => {
            let agent = |text: &str| value::name(text).map(Text::from);
            let aliases = entry.strings(value::hiac_address, agent)?;
            layer.hiac_names.get_or_insert_default().aliases = aliases;
        }
        "text" => layer.text = Some(entry.list(value::text_endpoint)?),
        "log-letters" => layer.log_letters = Some(entry.text(|path| Ok(PathBuf::from(path)))?),
        "text-agents" => {
            layer.text_agents = Some(entry.strings(value::text_agent, value::text_endpoint)?);
        }
        "max-letter" => layer.max_letter = Some(entry.number(value::letter_size)?),
        "state" => layer.state = Some(entry.text(|path| Ok(PathBuf::from(path)))?),
        "outbox" => layer.outbox = Some(outbox::read(&entry)?),
        _ => return Err(Wrong::key(key, &[&KEYS[..], &TABLES].concat())),
    }
    Ok(())
}

/// Empty text says nothing.
fn optional<T>(
    read: impl Fn(&str) -> Result<T, String>,
) -> impl Fn(&str) -> Result<Option<T>, String> {
    move |text| match text {
        "" => Ok(None),
        text => read(text).map(Some),
    }
}

/// Empty text stands for the default, so that there is a default to show.
fn or_default(
    read: impl Fn(&str) -> Result<String, String>,
) -> impl Fn(&str) -> Result<String, String> {
    move |text| match text {
        "" => Ok(String::new()),
        text => read(text),
    }
}
