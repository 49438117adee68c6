use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

use fipa_acl::Text;

/// A transport address: where a message transport service listens.
///
/// `tcp://HOST:PORT` (HOST a name, an IPv4 address or an IPv6 address in brackets),
/// `quic://HOST:PORT` for links over QUIC (RFC 9000), `http://HOST[:PORT][/PATH]` for the message
/// transport protocol over HTTP (FIPA SC00084F), `unix://PATH` for a socket on this machine, or
/// `SCHEME://HOST:PORT` for a transport that a program may have plugged in, such as
/// `udt://192.168.1.5:4100`.
///
/// ```
/// use fipa_directory::Address;
/// let address: Address = "tcp://[::1]:4100".parse().unwrap();
/// assert!(address.is_loopback());
/// assert!("tcp://robot1".parse::<Address>().is_err());
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Address {
    /// A TCP endpoint.
    Tcp {
        /// Name or IP address, without brackets.
        host: String,
        /// 0 stands for a free port where one listens.
        port: u16,
    },
    /// A UDP endpoint at which QUIC is spoken.
    Quic {
        /// Name or IP address, without brackets.
        host: String,
        /// 0 stands for a free port where one listens.
        port: u16,
    },
    /// Where letters are posted over HTTP.
    Http {
        /// Name or IP address, without brackets.
        host: String,
        /// 80 where the URL names none; 0 stands for a free port where one listens.
        port: u16,
        /// The path, which begins with a slash, and the query if there is one.
        path: String,
    },
    /// A Unix socket.
    Unix(String),
    /// Where letters are taken one by one, by a transport that is not built in.
    Other {
        /// What stands before `://`: lower-case letters, digits, `+`, `-` and `.`.
        scheme: String,
        /// Name or IP address, without brackets.
        host: String,
        /// 0 stands for a free port where one listens.
        port: u16,
    },
}

/// The port of an HTTP URL that names none.
const HTTP_PORT: u16 = 80;

/// The text is not an address that can be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseAddressError {
    /// There is no `HOST:PORT`.
    #[error("{0:?} is not HOST:PORT; an address is like tcp://192.168.1.5:4100")]
    Shape(String),
    /// The scheme is none of those that are built in.
    #[error(
        "{0:?} is no transport of this program; there are tcp://, quic://, http:// and unix://"
    )]
    Scheme(String),
}

impl Address {
    /// A TCP endpoint.
    pub fn tcp(host: impl Into<String>, port: u16) -> Address {
        Address::Tcp {
            host: host.into(),
            port,
        }
    }

    /// A UDP endpoint at which QUIC is spoken.
    pub fn quic(host: impl Into<String>, port: u16) -> Address {
        Address::Quic {
            host: host.into(),
            port,
        }
    }

    /// Where letters are posted over HTTP; the path begins with a slash.
    pub fn http(host: impl Into<String>, port: u16, path: impl Into<String>) -> Address {
        Address::Http {
            host: host.into(),
            port,
            path: path.into(),
        }
    }

    /// Whether letters are posted there over HTTP.
    pub fn is_http(&self) -> bool {
        matches!(self, Address::Http { .. })
    }

    /// Whether a link can be opened there; elsewhere letters are handed over one by one.
    pub fn is_link(&self) -> bool {
        matches!(
            self,
            Address::Tcp { .. } | Address::Quic { .. } | Address::Unix(_)
        )
    }

    /// The name or IP address of the host; a Unix socket has none.
    pub fn host(&self) -> Option<&str> {
        match self {
            Address::Tcp { host, .. }
            | Address::Quic { host, .. }
            | Address::Http { host, .. }
            | Address::Other { host, .. } => Some(host),
            Address::Unix(_) => None,
        }
    }

    /// Whether it can be reached from this machine only.
    pub fn is_loopback(&self) -> bool {
        match self.host() {
            None => true,
            Some(host) => {
                host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
            }
        }
    }

    /// Whether it means something only together with an interface of its reader: 169.254.0.0/16
    /// (RFC 3927) and fe80::/10 (RFC 4291).
    pub fn is_link_local(&self) -> bool {
        let Some(host) = self.host() else {
            return false;
        };
        let ip = host.split('%').next().unwrap_or_default();
        match ip.parse() {
            Ok(IpAddr::V4(ip)) => ip.is_link_local(),
            Ok(IpAddr::V6(ip)) => ip.is_unicast_link_local(),
            Err(_) => false,
        }
    }

    /// Whether it is of use to another host.
    pub fn is_for_others(&self) -> bool {
        !self.is_loopback() && !self.is_link_local()
    }

    /// The address as text that entries and receipts carry.
    pub fn to_text(&self) -> Text {
        Text::from(self.to_string())
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scheme, host, port, path) = match self {
            Address::Tcp { host, port } => ("tcp", host, port, ""),
            Address::Quic { host, port } => ("quic", host, port, ""),
            Address::Http { host, port, path } => ("http", host, port, path.as_str()),
            Address::Other { scheme, host, port } => (scheme.as_str(), host, port, ""),
            Address::Unix(path) => return write!(f, "unix://{path}"),
        };
        match host.contains(':') {
            true => write!(f, "{scheme}://[{host}]:{port}{path}"),
            false => write!(f, "{scheme}://{host}:{port}{path}"),
        }
    }
}

impl FromStr for Address {
    type Err = ParseAddressError;

    /// Reads an address; a bare `HOST:PORT` means TCP.
    fn from_str(text: &str) -> Result<Address, ParseAddressError> {
        let shape = || ParseAddressError::Shape(text.to_owned());
        match text.split_once("://") {
            Some(("unix", "")) => Err(shape()),
            Some(("unix", path)) => Ok(Address::Unix(path.to_owned())),
            Some(("tcp", authority)) => tcp(authority).ok_or_else(shape),
            Some(("quic", authority)) => match host_and_port(authority) {
                Some((host, Some(port))) => Ok(Address::quic(host, port)),
                _ => Err(shape()),
            },
            Some((scheme, rest)) if scheme.eq_ignore_ascii_case("http") => {
                http(rest).ok_or_else(shape)
            }
            Some((scheme, authority)) => {
                let other = is_scheme(scheme).then(|| other(scheme, authority));
                let strange = || ParseAddressError::Scheme(format!("{scheme}://"));
                other.flatten().ok_or_else(strange)
            }
            None => tcp(text).ok_or_else(shape),
        }
    }
}

fn tcp(authority: &str) -> Option<Address> {
    let (host, port) = host_and_port(authority)?;
    Some(Address::tcp(host, port?))
}

fn other(scheme: &str, authority: &str) -> Option<Address> {
    let (host, port) = host_and_port(authority)?;
    Some(Address::Other {
        scheme: scheme.to_owned(),
        host: host.to_owned(),
        port: port?,
    })
}

/// Whether a scheme is written as URLs have it (RFC 3986, section 3.1), in lower case.
fn is_scheme(text: &str) -> bool {
    let inner = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || b"+-.".contains(&c);
    text.starts_with(|c: char| c.is_ascii_lowercase()) && text.bytes().all(inner)
}

fn http(rest: &str) -> Option<Address> {
    // Nothing behind a # is ever sent.
    let rest = rest.split('#').next().unwrap_or_default();
    let end = rest.find(['/', '?']).unwrap_or(rest.len());
    let (authority, path) = rest.split_at(end);
    let (host, port) = host_and_port(authority)?;
    if !path.bytes().all(|octet| octet.is_ascii_graphic()) {
        return None;
    }
    let path = match path.starts_with('/') {
        true => path.to_owned(),
        false => format!("/{path}"),
    };
    Some(Address::http(host, port.unwrap_or(HTTP_PORT), path))
}

fn host_and_port(authority: &str) -> Option<(&str, Option<u16>)> {
    let (host, port) = match authority.rsplit_once(':') {
        Some((_, in_brackets)) if in_brackets.ends_with(']') => (authority, None),
        Some((host, port)) => (host, Some(port)),
        None => (authority, None),
    };
    let host = match host.strip_prefix('[') {
        Some(bracketed) => bracketed.strip_suffix(']')?,
        None if host.contains(':') => return None,
        None => host,
    };
    let is_odd = |c: char| c.is_control() || matches!(c, '/' | '@' | ' ');
    if host.is_empty() || host.contains(is_odd) {
        return None;
    }
    let Some(port) = port else {
        return Some((host, None));
    };
    if port.is_empty() || !port.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    Some((host, Some(port.parse().ok()?)))
}
