//! Rules of the operator: who may send to whom, and who may register.

use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

use fipa_directory::{Pattern, PatternError};

/// The rules of a service, in their order: the first one that fits decides. What none fits is
/// allowed, except to partners without a key where there is a fleet: these need a rule that allows
/// it and says by their address whom it means.
///
/// ```
/// use fipa_mts::{Action, Rule, Rules};
/// let mut deny = Rule::deny([Action::Send]);
/// deny.agent = Some(".*@visitor".parse().unwrap());
/// deny.to = Some("motors@.*".parse().unwrap());
/// let rules = Rules::new([deny]);
/// assert_eq!(rules.len(), 1);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rules(Vec<Rule>);

/// One rule. It fits what fits everything that it names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rule {
    /// Whether it allows, or denies.
    pub allow: bool,
    /// What it allows or denies.
    pub actions: Vec<Action>,
    /// The agent that sends or is registered.
    pub agent: Option<NamePattern>,
    /// The agent that is sent to; with it, the rule is about sending alone.
    pub to: Option<NamePattern>,
    /// The robot that the request comes from, which its certificate names. A rule that allows
    /// something to a robot by name allows it under names of other robots as well.
    pub robot: Option<NamePattern>,
    /// Where the partner without a key is, or the robot that the request comes from.
    pub address: Option<Network>,
}

/// What rules are about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// A letter from one agent to another.
    Send,
    /// An agent in the directory.
    Register,
}

/// A regular expression that all of a name must match.
#[derive(Clone, Debug)]
pub struct NamePattern {
    text: String,
    pattern: Pattern,
}

/// The addresses that begin with the same bits: `10.0.0.0/8`, or a single one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network {
    address: IpAddr,
    prefix: u8,
}

/// The text is no network.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no network: an IP address, or one with the bits that count, as in 10.0.0.0/8")]
pub struct NetworkError(String);

/// What somebody asks for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request<'a> {
    pub(crate) action: Action,
    pub(crate) agent: &'a str,
    pub(crate) to: Option<&'a str>,
    pub(crate) robot: Option<&'a str>,
    pub(crate) address: Option<IpAddr>,
    /// It concerns somebody without a key, and there is a fleet.
    pub(crate) keyless: bool,
}

/// What the rules say to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Judgement {
    /// A rule allows it; whether to this robot by name.
    Allowed { by_name: bool },
    /// The rule of this number, counted from 1, denies it.
    Denied(usize),
    /// No rule fits.
    Silent,
}

impl Rules {
    /// These rules, in this order.
    pub fn new(rules: impl IntoIterator<Item = Rule>) -> Rules {
        Rules(rules.into_iter().collect())
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn judge(&self, request: &Request<'_>) -> Judgement {
        let mut rules = self.0.iter().enumerate();
        match rules.find(|(_, rule)| rule.fits(request)) {
            Some((_, rule)) if rule.allow => Judgement::Allowed {
                by_name: rule.robot.is_some(),
            },
            Some((at, _)) => Judgement::Denied(at + 1),
            None => Judgement::Silent,
        }
    }

    /// Whether some rule allows a partner without a key at this address anything at all.
    pub(crate) fn may_admit(&self, address: Option<IpAddr>) -> bool {
        let admits = |rule: &Rule| rule.allow && rule.robot.is_none() && rule.is_at(address);
        self.0
            .iter()
            .any(|rule| rule.address.is_some() && admits(rule))
    }
}

impl Rule {
    /// A rule that allows all of these.
    pub fn allow(actions: impl IntoIterator<Item = Action>) -> Rule {
        Rule::new(true, actions)
    }

    /// A rule that denies all of these.
    pub fn deny(actions: impl IntoIterator<Item = Action>) -> Rule {
        Rule::new(false, actions)
    }

    fn new(allow: bool, actions: impl IntoIterator<Item = Action>) -> Rule {
        Rule {
            allow,
            actions: actions.into_iter().collect(),
            agent: None,
            to: None,
            robot: None,
            address: None,
        }
    }

    fn fits(&self, request: &Request<'_>) -> bool {
        let is = |pattern: &Option<NamePattern>, name: Option<&str>| match (pattern, name) {
            (None, _) => true,
            (Some(pattern), Some(name)) => pattern.matches(name),
            (Some(_), None) => false,
        };
        // Who has no key is nobody in particular: only where it is tells it apart.
        let unmeant = request.keyless && self.allow && self.address.is_none();
        self.actions.contains(&request.action)
            && !unmeant
            && is(&self.agent, Some(request.agent))
            && is(&self.to, request.to)
            && is(&self.robot, request.robot)
            && self.is_at(request.address)
    }

    fn is_at(&self, address: Option<IpAddr>) -> bool {
        match (self.address, address) {
            (None, _) => true,
            (Some(network), Some(address)) => network.contains(address),
            (Some(_), None) => false,
        }
    }
}

impl NamePattern {
    fn matches(&self, name: &str) -> bool {
        self.pattern.matches(name)
    }
}

impl FromStr for NamePattern {
    type Err = PatternError;

    fn from_str(text: &str) -> Result<NamePattern, PatternError> {
        Ok(NamePattern {
            text: text.to_owned(),
            pattern: Pattern::new(text)?,
        })
    }
}

impl PartialEq for NamePattern {
    fn eq(&self, other: &NamePattern) -> bool {
        self.text == other.text
    }
}

impl Eq for NamePattern {}

impl Network {
    /// Whether the address is one of it. IPv4 in IPv6 is IPv4.
    pub fn contains(&self, address: IpAddr) -> bool {
        match (self.address, address.to_canonical()) {
            (IpAddr::V4(own), IpAddr::V4(other)) => {
                let shift = 32 - u32::from(self.prefix);
                let first = |ip: std::net::Ipv4Addr| u64::from(ip.to_bits()) >> shift;
                first(own) == first(other)
            }
            (IpAddr::V6(own), IpAddr::V6(other)) => {
                let shift = 128 - u32::from(self.prefix);
                let first = |ip: std::net::Ipv6Addr| ip.to_bits().checked_shr(shift).unwrap_or(0);
                first(own) == first(other)
            }
            _ => false,
        }
    }
}

impl FromStr for Network {
    type Err = NetworkError;

    fn from_str(text: &str) -> Result<Network, NetworkError> {
        let wrong = || NetworkError(text.to_owned());
        let (address, prefix) = match text.split_once('/') {
            Some((address, prefix)) => (address, Some(prefix)),
            None => (text, None),
        };
        let address: IpAddr = address.parse().map_err(|_| wrong())?;
        let longest = if address.is_ipv4() { 32 } else { 128 };
        let prefix = match prefix {
            None => longest,
            Some(digits) => digits.parse().map_err(|_| wrong())?,
        };
        match prefix <= longest {
            true => Ok(Network { address, prefix }),
            false => Err(wrong()),
        }
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.address, self.prefix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Action; 2] = [Action::Send, Action::Register];

    fn request<'a>(agent: &'a str, to: &'a str) -> Request<'a> {
        Request {
            action: Action::Send,
            agent,
            to: Some(to),
            robot: Some("robot1"),
            address: None,
            keyless: false,
        }
    }

    fn name(text: &str) -> Option<NamePattern> {
        Some(text.parse().unwrap())
    }

    #[test]
    fn the_first_rule_that_fits_decides() {
        let rules = Rules::new([
            Rule {
                to: name("lamp@.*"),
                ..Rule::allow([Action::Send])
            },
            Rule {
                agent: name(".*@robot1"),
                ..Rule::deny([Action::Send])
            },
        ]);
        let judged = |agent, to| rules.judge(&request(agent, to));
        assert_eq!(
            judged("a@robot1", "lamp@x"),
            Judgement::Allowed { by_name: false }
        );
        assert_eq!(judged("a@robot1", "motor@x"), Judgement::Denied(2));
        assert_eq!(judged("a@robot12", "motor@x"), Judgement::Silent);
    }

    #[test]
    fn a_rule_fits_when_all_that_it_names_does() {
        let rule = Rule {
            agent: name("a"),
            robot: name("robot1"),
            address: Some("10.0.0.0/8".parse().unwrap()),
            ..Rule::allow(BOTH)
        };
        let rules = Rules::new([rule]);
        let good = Request {
            address: Some("10.1.2.3".parse().unwrap()),
            ..request("a", "b")
        };
        assert_eq!(rules.judge(&good), Judgement::Allowed { by_name: true });
        for bad in [
            Request {
                agent: "ab",
                ..good
            },
            Request {
                robot: None,
                ..good
            },
            Request {
                robot: Some("robot2"),
                ..good
            },
            Request {
                address: None,
                ..good
            },
            Request {
                address: Some("11.1.2.3".parse().unwrap()),
                ..good
            },
        ] {
            assert_eq!(rules.judge(&bad), Judgement::Silent, "{bad:?}");
        }
        let register = Request {
            action: Action::Register,
            to: None,
            ..good
        };
        assert_eq!(rules.judge(&register), Judgement::Allowed { by_name: true });
    }

    #[test]
    fn who_has_no_key_is_admitted_by_address_alone() {
        let everybody = Rules::new([Rule::allow(BOTH)]);
        let there = Rules::new([Rule {
            address: Some("10.0.0.7".parse().unwrap()),
            ..Rule::allow(BOTH)
        }]);
        let at = |address: &str| Request {
            robot: None,
            address: Some(address.parse().unwrap()),
            keyless: true,
            ..request("a", "b")
        };
        assert_eq!(everybody.judge(&at("10.0.0.7")), Judgement::Silent);
        assert_eq!(
            there.judge(&at("10.0.0.7")),
            Judgement::Allowed { by_name: false }
        );
        assert_eq!(there.judge(&at("10.0.0.8")), Judgement::Silent);
        assert!(there.may_admit(Some("10.0.0.7".parse().unwrap())));
        assert!(!there.may_admit(Some("10.0.0.8".parse().unwrap())));
        assert!(!there.may_admit(None));
        assert!(!everybody.may_admit(Some("10.0.0.7".parse().unwrap())));
    }

    #[test]
    fn networks_are_the_bits_that_count() {
        let holds = |network: &str, address: &str| {
            let network: Network = network.parse().unwrap();
            network.contains(address.parse().unwrap())
        };
        for (network, address) in [
            ("10.0.0.0/8", "10.255.0.1"),
            ("0.0.0.0/0", "1.2.3.4"),
            ("::/0", "::1"),
            ("10.0.0.7", "10.0.0.7"),
            ("10.0.0.0/8", "::ffff:10.0.0.1"),
            ("fe80::/10", "fe80::1"),
        ] {
            assert!(holds(network, address), "{network} {address}");
        }
        for (network, address) in [
            ("10.0.0.0/8", "11.0.0.0"),
            ("10.0.0.7", "10.0.0.6"),
            ("::/0", "1.2.3.4"),
            ("fe80::/10", "fec0::1"),
        ] {
            assert!(!holds(network, address), "{network} {address}");
        }
        for wrong in [
            "",
            "10.0.0.0/33",
            "::/129",
            "10.0.0/8",
            "10.0.0.0/",
            "robot1",
            "1.2.3.4/-1",
        ] {
            assert!(wrong.parse::<Network>().is_err(), "{wrong}");
        }
    }
}
