//! Where stations are reached, as a URL.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::string::{String, ToString};

use crate::Address;
use crate::station::{LinkConfig, Role};

/// The baud rate of a serial line where the URL has none.
const BAUD: u32 = 115_200;

/// A place where stations come from, and what they are to be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Where.
    pub place: Place,
    /// What the own end is; an employer unless the URL says `role=employee`.
    pub role: Role,
    /// The address that the employee there gets.
    pub address: Option<Address>,
}

/// A socket or a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
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
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EndpointError(String);

impl fmt::Display for EndpointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:?} is no place for HIAC stations: tcp://HOST:PORT, tcp://HOST:PORT?listen or \
             serial:///dev/…?baud=RATE, with address=20:C4:D2:05 or role=employee behind ? or &",
            self.0
        )
    }
}

impl std::error::Error for EndpointError {}

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(url: &str) -> Result<Endpoint, EndpointError> {
        parse(url).ok_or_else(|| EndpointError(url.to_string()))
    }
}

impl Endpoint {
    /// How a link of this endpoint is opened.
    pub(super) fn link(&self) -> LinkConfig {
        LinkConfig {
            role: self.role,
            closes: !matches!(self.place, Place::Serial { .. }),
            place: match &self.place {
                Place::TcpDial(place) => Some(std::format!("tcp://{place}")),
                _ => None,
            },
            address: self.address,
        }
    }
}

fn parse(url: &str) -> Option<Endpoint> {
    let (scheme, rest) = url.split_once("://")?;
    let (place, query) = rest.split_once('?').unwrap_or((rest, ""));
    let (mut listen, mut baud, mut role, mut address) = (false, None, Role::Employer, None);
    for part in query.split('&').filter(|part| !part.is_empty()) {
        match part.split_once('=') {
            None if part == "listen" => listen = true,
            Some(("baud", rate)) => baud = Some(rate.parse().ok()?),
            Some(("role", "employee")) => role = Role::Employee,
            Some(("role", "employer")) => role = Role::Employer,
            Some(("address", text)) => address = Some(text.parse().ok()?),
            _ => return None,
        }
    }
    let place = match (scheme, listen, baud) {
        ("tcp", false, None) => Place::TcpDial(host_and_port(place)?),
        ("tcp", true, None) => Place::TcpListen(host_and_port(place)?),
        ("serial", false, baud) if place.starts_with('/') => Place::Serial {
            path: place.into(),
            baud: baud.unwrap_or(BAUD),
        },
        _ => return None,
    };
    Some(Endpoint {
        place,
        role,
        address,
    })
}

fn host_and_port(place: &str) -> Option<String> {
    let (host, port) = place.rsplit_once(':')?;
    let valid = !host.is_empty() && port.parse::<u16>().is_ok();
    valid.then(|| place.to_string())
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = '?';
        match &self.place {
            Place::TcpDial(place) => write!(f, "tcp://{place}")?,
            Place::TcpListen(place) => {
                separator = '&';
                write!(f, "tcp://{place}?listen")?;
            }
            Place::Serial { path, baud } => {
                separator = '&';
                write!(f, "serial://{}?baud={baud}", path.display())?;
            }
        }
        if let Some(address) = self.address {
            write!(f, "{separator}address={address}")?;
            separator = '&';
        }
        match self.role {
            Role::Employee => write!(f, "{separator}role=employee"),
            Role::Employer => Ok(()),
        }
    }
}
