//! What single values look like, the same for every source.

use fipa::{
    Action, Fingerprint, NamePattern, Network, NetworkError, ParseFingerprintError, PatternError,
    Text,
};
use fipa_directory::{Address, ParseAddressError};
use fipa_dsd::{InterfaceSelector, ParseSelectorError};
use hiac::links::{Endpoint as HiacEndpoint, EndpointError as HiacEndpointError};
use hiac::station::Workgroup;
use hiac::{Address as HiacAddress, AddressError, Mask, MaskError};
use robot_text::links::{Endpoint, EndpointError};

use super::FleetMode;

/// The scope is announced in a TXT string of 255 octets that begins with `scope=`.
const LONGEST_SCOPE: usize = 249;

/// A year.
const MOST_HOURS: u64 = 366 * 24;

/// Links count the octets of a frame in 32 bits; this leaves room for what stands before a letter.
const LARGEST_LETTER: u64 = 4_000_000_000;

/// A name that every representation of a message can carry.
pub(crate) fn name(text: &str) -> Result<String, String> {
    if Text::from(text).is_word() {
        Ok(text.to_owned())
    } else {
        Err(format!(
            "{text:?} is not a name; a name is one ASCII word such as robot1, without spaces and \
             parentheses, and does not begin with a digit, -, @, # or \""
        ))
    }
}

/// A scope that can be announced.
pub(crate) fn scope(text: &str) -> Result<String, String> {
    match text.len() {
        ..=LONGEST_SCOPE => Ok(text.to_owned()),
        length => Err(format!(
            "the scope has {length} octets; at most {LONGEST_SCOPE} can be announced"
        )),
    }
}

/// The name of a resource that agents share.
pub(crate) fn resource(text: &str) -> Result<String, String> {
    match text.is_empty() || text.contains(char::is_control) {
        false => Ok(text.to_owned()),
        true => Err("a resource has a name of one line".to_owned()),
    }
}

/// An endpoint to listen on.
pub(crate) fn listen_address(text: &str) -> Result<Address, String> {
    match address(text)? {
        Address::Http { .. } => Err(format!("{text:?}: letters over HTTP are taken at --http")),
        address => Ok(address),
    }
}

fn address(text: &str) -> Result<Address, String> {
    text.parse()
        .map_err(|error: ParseAddressError| error.to_string().replace(char::is_control, "?"))
}

/// Where letters are taken over HTTP.
pub(crate) fn http_endpoint(text: &str) -> Result<String, String> {
    let bare = text.strip_prefix("http://").unwrap_or(text);
    match bare.parse() {
        Ok(Address::Tcp { .. }) if !bare.contains("://") => Ok(bare.to_owned()),
        _ => Err(format!(
            "{text:?} is not HOST:PORT, such as 192.168.1.5:7778"
        )),
    }
}

/// The path of a URL.
pub(crate) fn http_path(text: &str) -> Result<String, String> {
    let is_path = text.starts_with('/') && text.bytes().all(|octet| octet.is_ascii_graphic());
    match is_path && !text.contains(['?', '#']) {
        true => Ok(text.to_owned()),
        false => Err(format!("{text:?} is not a path, such as /acc")),
    }
}

/// An endpoint to connect to: one with a port.
pub(crate) fn peer_address(text: &str) -> Result<Address, String> {
    match address(text)? {
        Address::Tcp { port: 0, .. }
        | Address::Quic { port: 0, .. }
        | Address::Http { port: 0, .. } => Err(format!("{text:?}: nobody can connect to port 0")),
        address => Ok(address),
    }
}

/// Who is let in.
pub(crate) fn fleet_mode(text: &str) -> Result<FleetMode, String> {
    match text {
        "open" => Ok(FleetMode::Open),
        "fleet" => Ok(FleetMode::Fleet),
        "pinned" => Ok(FleetMode::Pinned),
        _ => Err(format!("{text:?} is none of open, fleet and pinned")),
    }
}

/// The fingerprint of a certificate.
pub(crate) fn fingerprint(text: &str) -> Result<Fingerprint, String> {
    text.parse()
        .map_err(|error: ParseFingerprintError| error.to_string())
}

/// A pattern of names.
pub(crate) fn name_pattern(text: &str) -> Result<NamePattern, String> {
    text.parse()
        .map_err(|error: PatternError| error.to_string())
}

/// Addresses of peers.
pub(crate) fn network(text: &str) -> Result<Network, String> {
    text.parse()
        .map_err(|error: NetworkError| error.to_string())
}

/// What a rule is about.
pub(crate) fn action(text: &str) -> Result<Action, String> {
    match text {
        "send" => Ok(Action::Send),
        "register" => Ok(Action::Register),
        _ => Err(format!("{text:?} is neither send nor register")),
    }
}

/// An interface or a network.
pub(crate) fn interface(text: &str) -> Result<InterfaceSelector, String> {
    text.parse()
        .map_err(|error: ParseSelectorError| error.to_string().replace(char::is_control, "?"))
}

/// A place of agents that speak the text format.
pub(crate) fn text_endpoint(text: &str) -> Result<Endpoint, String> {
    text.parse()
        .map_err(|error: EndpointError| error.to_string().replace(char::is_control, "?"))
}

/// What an agent of the text format is called there, and before the @ of its name in the fleet.
pub(crate) fn text_agent(text: &str) -> Result<String, String> {
    match robot_text::is_name(text) {
        true => name(text),
        false => Err(format!(
            "{text:?} is no name of a text agent; one has 1 to 64 letters, digits and _ - . @"
        )),
    }
}

/// A place of HIAC stations.
pub(crate) fn hiac_endpoint(text: &str) -> Result<HiacEndpoint, String> {
    text.parse()
        .map_err(|error: HiacEndpointError| error.to_string().replace(char::is_control, "?"))
}

/// The own HIAC address, level 0 under the mask behind it.
pub(crate) fn hiac_workgroup(text: &str) -> Result<Workgroup, String> {
    let (address, mask) = text
        .split_once('/')
        .ok_or_else(|| format!("{text:?} is not ADDRESS/MASK, such as 20:C4:D2:00/00:00:00:FF"))?;
    let address = hiac_address(address)?;
    let mask = Mask::new(hiac_address(mask)?.0).map_err(|error: MaskError| error.to_string())?;
    match mask.level(address) {
        0 => Ok(Workgroup { address, mask }),
        level => Err(format!(
            "{address} is level {level:X} under {mask}; an employer is level 0"
        )),
    }
}

/// A HIAC address.
pub(crate) fn hiac_address(text: &str) -> Result<HiacAddress, String> {
    text.parse()
        .map_err(|error: AddressError| format!("{text:?}: {error}"))
}

/// Yes or no, where it is not a matter of being there.
pub(super) fn flag(text: &str) -> Result<bool, String> {
    match text {
        "true" | "1" => Ok(true),
        "false" | "0" => Ok(false),
        _ => Err(format!("{text:?} is neither true nor false")),
    }
}

/// A UDP port in decimal.
pub(super) fn port_text(text: &str) -> Result<u16, String> {
    port(number(text)?)
}

/// A UDP port.
pub(crate) fn port(number: u64) -> Result<u16, String> {
    match u16::try_from(number) {
        Ok(port) if port != 0 => Ok(port),
        _ => Err(format!("{number} is not a port; ports are 1 to 65535")),
    }
}

/// A number of things in decimal.
pub(super) fn count_text(text: &str) -> Result<usize, String> {
    count(number(text)?)
}

/// A number of things.
pub(crate) fn count(number: u64) -> Result<usize, String> {
    usize::try_from(number).map_err(|_| format!("{number} is too many"))
}

/// The size of the largest letter in decimal.
pub(super) fn letter_size_text(text: &str) -> Result<usize, String> {
    letter_size(number(text)?)
}

/// The size of the largest letter.
pub(crate) fn letter_size(number: u64) -> Result<usize, String> {
    match usize::try_from(number) {
        Ok(size) if (1..=LARGEST_LETTER).contains(&number) => Ok(size),
        _ => Err(format!(
            "{number} is no size of a letter; sizes are 1 to {LARGEST_LETTER}"
        )),
    }
}

/// A number of letters or octets that may be 0.
pub(crate) fn amount(number: u64) -> Result<usize, String> {
    usize::try_from(number).map_err(|_| format!("{number} is too large"))
}

/// How long a letter is stored.
pub(crate) fn hours(number: u64) -> Result<u64, String> {
    match number {
        1..=MOST_HOURS => Ok(number),
        _ => Err(format!(
            "{number} is no time to store a letter; it is 1 to {MOST_HOURS} hours"
        )),
    }
}

fn number(text: &str) -> Result<u64, String> {
    text.parse()
        .map_err(|_| format!("{text:?} is not a whole number"))
}
