//! Where a text platform is reached, as a URL.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// The baud rate of a serial line where the URL has none.
const BAUD: u32 = 115_200;

/// A place where text messages come in and go out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// `udp://HOST:PORT`: a socket for datagrams.
    Udp(String),
    /// `tcp://HOST:PORT`: a stream that is dialled, again every second.
    TcpDial(String),
    /// `tcp://HOST:PORT?listen`: streams that others dial.
    TcpListen(String),
    /// `serial:///dev/…?baud=115200`: a serial line.
    Serial {
        /// The device.
        path: PathBuf,
        /// The rate in baud.
        baud: u32,
    },
}

/// A text that is no [`Endpoint`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is no place for text messages: udp://HOST:PORT, tcp://HOST:PORT, \
     tcp://HOST:PORT?listen or serial:///dev/…?baud=RATE"
)]
pub struct EndpointError(String);

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(url: &str) -> Result<Endpoint, EndpointError> {
        parse(url).ok_or_else(|| EndpointError(url.to_owned()))
    }
}

fn parse(url: &str) -> Option<Endpoint> {
    let (scheme, rest) = url.split_once("://")?;
    let (place, query) = match rest.split_once('?') {
        Some((place, query)) => (place, Some(query)),
        None => (rest, None),
    };
    match (scheme, query) {
        ("udp", None) => host_and_port(place).map(Endpoint::Udp),
        ("tcp", None) => host_and_port(place).map(Endpoint::TcpDial),
        ("tcp", Some("listen")) => host_and_port(place).map(Endpoint::TcpListen),
        ("serial", query) if place.starts_with('/') => Some(Endpoint::Serial {
            path: place.into(),
            baud: match query {
                Some(query) => query.strip_prefix("baud=")?.parse().ok()?,
                None => BAUD,
            },
        }),
        _ => None,
    }
}

fn host_and_port(place: &str) -> Option<String> {
    let (host, port) = place.rsplit_once(':')?;
    let valid = !host.is_empty() && port.parse::<u16>().is_ok();
    valid.then(|| place.to_owned())
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Endpoint::Udp(place) => write!(f, "udp://{place}"),
            Endpoint::TcpDial(place) => write!(f, "tcp://{place}"),
            Endpoint::TcpListen(place) => write!(f, "tcp://{place}?listen"),
            Endpoint::Serial { path, baud } => {
                write!(f, "serial://{}?baud={baud}", path.display())
            }
        }
    }
}
