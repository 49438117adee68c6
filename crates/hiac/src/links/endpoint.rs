//! Where stations are reached, as a URL.

use std::fmt;
use std::format;
use std::path::PathBuf;
use std::str::FromStr;
use std::string::{String, ToString};
use std::vec::Vec;

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
    /// `tls://HOST:PORT?ca=FILE`: such a stream under TLS; `ca` verifies who listens there.
    TlsDial(String, TlsFiles),
    /// `tls://HOST:PORT?listen&cert=FILE&key=FILE`: such streams under TLS; with `ca` they are
    /// taken only of those that have a certificate of it.
    TlsListen(String, TlsFiles),
    /// `serial:///dev/…?baud=115200`: a serial line.
    Serial {
        /// The device.
        path: PathBuf,
        /// The rate in baud.
        baud: u32,
    },
}

/// The files that TLS needs, each in PEM.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TlsFiles {
    /// `cert`: the own certificate, and those between it and the authority.
    pub certificate: Option<PathBuf>,
    /// `key`: the private key of the own certificate.
    pub key: Option<PathBuf>,
    /// `ca`: the certificates of the authorities that the other end's certificate must come from.
    pub authorities: Option<PathBuf>,
}

/// A text that is no [`Endpoint`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum EndpointError {
    /// No such place.
    Form(String),
    /// A dialled TLS stream without authorities: who is there could not be verified.
    NoAuthorities(String),
    /// A place that listens has no certificate with its key, or there is one without the other.
    NoCertificate(String),
    /// The crate is built without the feature `tls`.
    NoTls(String),
}

impl fmt::Display for EndpointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EndpointError::Form(url) => write!(
                f,
                "{url:?} is no place for HIAC stations: tcp://HOST:PORT, tls://HOST:PORT?ca=FILE, \
                 either with listen (and for tls cert=FILE and key=FILE), or \
                 serial:///dev/…?baud=RATE, with address=20:C4:D2:05 or role=employee behind ? or &"
            ),
            EndpointError::NoAuthorities(url) => write!(
                f,
                "{url:?} needs ca=FILE, the certificates of the authorities in PEM: without them \
                 who is there cannot be verified"
            ),
            EndpointError::NoCertificate(url) => write!(
                f,
                "{url:?} needs cert=FILE and key=FILE together, the own certificate and its \
                 private key in PEM"
            ),
            EndpointError::NoTls(url) => write!(f, "{url:?}: this program is built without TLS"),
        }
    }
}

impl std::error::Error for EndpointError {}

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(url: &str) -> Result<Endpoint, EndpointError> {
        let endpoint = parse(url).ok_or_else(|| EndpointError::Form(url.to_string()))?;
        let (listens, files) = match &endpoint.place {
            Place::TlsDial(_, files) => (false, files),
            Place::TlsListen(_, files) => (true, files),
            _ => return Ok(endpoint),
        };
        let url = url.to_string();
        if !cfg!(feature = "tls") {
            return Err(EndpointError::NoTls(url));
        }
        match (files.certificate.is_some(), files.key.is_some()) {
            (true, false) | (false, true) => Err(EndpointError::NoCertificate(url)),
            (false, false) if listens => Err(EndpointError::NoCertificate(url)),
            _ if !listens && files.authorities.is_none() => Err(EndpointError::NoAuthorities(url)),
            _ => Ok(endpoint),
        }
    }
}

impl Endpoint {
    /// How a link of this endpoint is opened.
    pub(super) fn link(&self) -> LinkConfig {
        LinkConfig {
            role: self.role,
            closes: !matches!(self.place, Place::Serial { .. }),
            place: match &self.place {
                Place::TcpDial(place) => Some(format!("tcp://{place}")),
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
    let mut files = TlsFiles::default();
    for part in query.split('&').filter(|part| !part.is_empty()) {
        match part.split_once('=') {
            None if part == "listen" => listen = true,
            Some(("baud", rate)) => baud = Some(rate.parse().ok()?),
            Some(("role", "employee")) => role = Role::Employee,
            Some(("role", "employer")) => role = Role::Employer,
            Some(("address", text)) => address = Some(text.parse().ok()?),
            Some(("cert", file)) if !file.is_empty() => files.certificate = Some(file.into()),
            Some(("key", file)) if !file.is_empty() => files.key = Some(file.into()),
            Some(("ca", file)) if !file.is_empty() => files.authorities = Some(file.into()),
            _ => return None,
        }
    }
    let plain = files == TlsFiles::default();
    let place = match (scheme, listen, baud) {
        ("tls", false, None) => Place::TlsDial(host_and_port(place)?, files),
        ("tls", true, None) => Place::TlsListen(host_and_port(place)?, files),
        _ if !plain => return None,
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
        let mut query: Vec<String> = Vec::new();
        match &self.place {
            Place::TcpDial(place) => write!(f, "tcp://{place}")?,
            Place::TcpListen(place) => {
                write!(f, "tcp://{place}")?;
                query.push("listen".to_string());
            }
            Place::TlsDial(place, files) => {
                write!(f, "tls://{place}")?;
                query.extend(files.query());
            }
            Place::TlsListen(place, files) => {
                write!(f, "tls://{place}")?;
                query.push("listen".to_string());
                query.extend(files.query());
            }
            Place::Serial { path, baud } => {
                write!(f, "serial://{}", path.display())?;
                query.push(format!("baud={baud}"));
            }
        }
        query.extend(self.address.map(|address| format!("address={address}")));
        if self.role == Role::Employee {
            query.push("role=employee".to_string());
        }
        match query.is_empty() {
            true => Ok(()),
            false => write!(f, "?{}", query.join("&")),
        }
    }
}

impl TlsFiles {
    fn query(&self) -> impl Iterator<Item = String> {
        let files = [
            ("cert", &self.certificate),
            ("key", &self.key),
            ("ca", &self.authorities),
        ];
        files
            .into_iter()
            .filter_map(|(key, file)| Some(format!("{key}={}", file.as_ref()?.display())))
    }
}
