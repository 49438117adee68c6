use fipa::{Action, NamePattern, Network, Rule, Rules};
use toml::Spanned;
use toml::de::DeTable;

use super::Wrong;
use super::entry::Entry;
use super::suggestion::nearest;
use crate::options::value;

const KEYS: [&str; 6] = ["allow", "deny", "agent", "to", "robot", "address"];

/// The table of rules.
pub(super) fn read(entry: &Entry<'_>) -> Result<Rules, Wrong> {
    let rules = entry
        .tables()?
        .into_iter()
        .map(|(at, table)| rule(at, table));
    Ok(Rules::new(rules.collect::<Result<Vec<_>, Wrong>>()?))
}

fn rule(at: usize, table: &DeTable<'_>) -> Result<Rule, Wrong> {
    let wrong = |problem: &str| Wrong {
        at,
        problem: format!("rules: {problem}"),
    };
    let mut verb: Option<(bool, Vec<Action>)> = None;
    let (mut agent, mut to, mut robot): (Name, Name, Name) = (None, None, None);
    let mut address: Option<Network> = None;
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    for (key, value) in entries {
        let entry = Entry {
            key: key.get_ref(),
            value,
        };
        match entry.key {
            "allow" | "deny" if verb.is_some() => {
                return Err(wrong("a rule has one of allow and deny, once"));
            }
            "allow" => verb = Some((true, actions(&entry)?)),
            "deny" => verb = Some((false, actions(&entry)?)),
            "agent" => agent = Some(entry.text(value::name_pattern)?),
            "to" => to = Some(entry.text(value::name_pattern)?),
            "robot" => robot = Some(entry.text(value::name_pattern)?),
            "address" => address = Some(entry.text(value::network)?),
            _ => return Err(unknown(key)),
        }
    }
    let rule = match verb {
        Some((_, actions)) if actions.is_empty() => {
            return Err(wrong(
                "a rule says what it allows or denies: send, register or both",
            ));
        }
        Some((true, actions)) => Rule::allow(actions),
        Some((false, actions)) => Rule::deny(actions),
        None => return Err(wrong("a rule needs allow or deny")),
    };
    Ok(Rule {
        agent,
        to,
        robot,
        address,
        ..rule
    })
}

type Name = Option<NamePattern>;

fn actions(entry: &Entry<'_>) -> Result<Vec<Action>, Wrong> {
    entry.list(value::action)
}

fn unknown(key: &Spanned<impl AsRef<str>>) -> Wrong {
    let name = key.get_ref().as_ref();
    let mut problem = format!("rules: unknown key {name:?}");
    if let Some(known) = nearest(name, &KEYS) {
        problem += &format!(" (did you mean {known:?}?)");
    }
    Wrong {
        at: key.span().start,
        problem,
    }
}
