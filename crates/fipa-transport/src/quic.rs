//! QUIC (RFC 9000): links that outlive a change of address, and on which a lost packet holds up only
//! what it was part of.
//!
//! ```text
//!   main stream        both ways    all but letters
//!   lanes 0, 1, 2      one each way letters of that urgency, behind one octet: the number
//! ```
//!
//! Robots of a fleet show each other the same certificates as over TCP. Without a fleet the traffic
//! is encrypted by a key that is made at each start, and **nobody knows who is at the other end**.
//!
//! A connection between the same two may be resumed from a ticket (RFC 8446, 2.2), which saves
//! signatures and no check: the certificate of the first handshake is judged again. A server takes a
//! ticket once, and nothing before the handshake is over (no 0-RTT).
//!
//! Who dials does so from a socket that is bound to no address: when that of the robot changes, the
//! next packet leaves from the new one, and the other side follows it (connection migration, RFC
//! 9000, section 9). It does not work the other way round: who was dialled is dialled anew.

mod calling;
mod congestion;
mod keys;
mod link;
mod words;

use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use quinn::crypto::rustls::QuicClientConfig;
use quinn::{ClientConfig, Connection, Endpoint, EndpointConfig, TransportConfig, VarInt};
use socket2::{Domain, Protocol, Socket, Type};

pub(crate) use self::calling::{Calling, Server};
use self::congestion::Patience;
use self::keys::Keys;
pub(crate) use self::link::{QuicLink, pump};
use crate::stream::Kind;
use crate::tls::Verdict;
use crate::{KeyError, LANES, Stream, Tls};

/// How long it may take until a connection is there.
const TIMEOUT: Duration = Duration::from_secs(5);

/// A connection over which nothing comes for so long is lost. The heartbeat of a link gives it up
/// earlier, as it does over TCP.
const IDLE: Duration = Duration::from_secs(75);

/// Something goes out so often, that a way through a firewall is not forgotten.
const KEEP_ALIVE: Duration = Duration::from_secs(10);

/// Octets of a stream that the other side may send before it hears that they were read: at 10 MB/s,
/// as many as are under way in a fifth of a second. There is no bound for all streams together: a lane
/// that waits for what comes on the main stream must not keep it from coming.
const WINDOW: VarInt = VarInt::from_u32(2 << 20);

/// Addresses of which tickets are kept.
const MAX_KNOWN: usize = 256;

/// Octets that the kernel is asked to keep of what is to be read or written.
const SOCKET_BUFFER: usize = 2 << 20;

/// The name that a client asks for: who is there is what the certificate says.
const NOBODY: &str = "fleet.invalid";

/// Why a connection is closed.
const DONE: VarInt = VarInt::from_u32(0);
const BROKEN_OFF: VarInt = VarInt::from_u32(1);
const NOT_LET_IN: VarInt = VarInt::from_u32(2);

/// Opens and accepts links over QUIC.
#[derive(Clone, Debug)]
pub struct Quic(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    keys: Keys,
    transport: Arc<TransportConfig>,
    /// The sockets that dial, of IPv4 and IPv6.
    sockets: Mutex<[Option<Endpoint>; 2]>,
    known: Mutex<HashMap<SocketAddr, Known>>,
}

/// What is kept of an address that was dialled: tickets, and what became of the certificate there.
#[derive(Clone, Debug)]
struct Known {
    config: ClientConfig,
    verdict: Arc<Verdict>,
}

impl Quic {
    /// Links as a robot of a fleet; without one with anybody, who may be anybody.
    pub fn new(tls: Option<Tls>) -> Result<Quic, KeyError> {
        let keys = Keys::new(tls)?;
        // What can fail, fails here and not at the first caller.
        keys.client(&Arc::default())?;
        keys.server(&Arc::default())?;
        Ok(Quic(Arc::new(Inner {
            keys,
            transport: Arc::new(transport()?),
            sockets: Mutex::default(),
            known: Mutex::default(),
        })))
    }

    /// What secures streams over TCP, where there is a fleet.
    pub(crate) fn tls(&self) -> Option<&Tls> {
        self.0.keys.tls()
    }

    pub(crate) async fn connect(&self, to: SocketAddr) -> io::Result<Stream> {
        let settled = async { self.settle(self.bare(to).await?, true).await };
        within(settled, "no answer within 5 s").await
    }

    /// A connection without streams, of which nobody has looked who is there.
    pub(crate) async fn bare(&self, to: SocketAddr) -> io::Result<Connection> {
        let known = self.known(to).map_err(io::Error::other)?;
        known.verdict.forget();
        let connecting = self.socket(to)?.connect_with(known.config, to, NOBODY);
        let connected = connecting.map_err(io::Error::other)?.await;
        connected.map_err(|error| words::of_handshake(&error, &known.verdict))
    }

    /// Looks at who is there, and opens the streams.
    async fn settle(&self, connection: Connection, dialled: bool) -> io::Result<Stream> {
        let shown = keys::shown(&connection);
        let name = match self.0.keys.judge(shown.as_deref()) {
            Ok(name) => name,
            Err(refusal) => {
                connection.close(NOT_LET_IN, b"");
                return Err(io::Error::other(refusal));
            }
        };
        let link = QuicLink::open(connection, dialled, name, shown).await?;
        Ok(Stream(Kind::Quic(Box::new(link))))
    }

    fn known(&self, to: SocketAddr) -> Result<Known, KeyError> {
        let mut known = lock(&self.0.known);
        if let Some(known) = known.get(&to) {
            return Ok(known.clone());
        }
        let verdict = Arc::<Verdict>::default();
        let client = QuicClientConfig::try_from(self.0.keys.client(&verdict)?);
        let client = client.map_err(|error| KeyError::new(&error))?;
        let mut config = ClientConfig::new(Arc::new(client));
        config.transport_config(Arc::clone(&self.0.transport));
        if known.len() >= MAX_KNOWN {
            known.clear();
        }
        let new = Known { config, verdict };
        known.insert(to, new.clone());
        Ok(new)
    }

    /// The socket that reaches an address; it is bound to none of its own.
    pub(crate) fn socket(&self, to: SocketAddr) -> io::Result<Endpoint> {
        let own: IpAddr = match to {
            SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
            SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
        };
        let mut sockets = lock(&self.0.sockets);
        let socket = &mut sockets[usize::from(to.is_ipv6())];
        if let Some(socket) = socket {
            return Ok(socket.clone());
        }
        let new = endpoint(SocketAddr::new(own, 0), None)?;
        *socket = Some(new.clone());
        Ok(new)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

async fn within<T>(
    attempt: impl Future<Output = io::Result<T>>,
    or: &'static str,
) -> io::Result<T> {
    match tokio::time::timeout(TIMEOUT, attempt).await {
        Ok(result) => result,
        Err(_) => Err(io::Error::new(io::ErrorKind::TimedOut, or)),
    }
}

fn transport() -> Result<TransportConfig, KeyError> {
    let mut transport = TransportConfig::default();
    let idle = IDLE.try_into().map_err(|error| KeyError::new(&error))?;
    transport
        .max_idle_timeout(Some(idle))
        .keep_alive_interval(Some(KEEP_ALIVE))
        .congestion_controller_factory(Arc::new(Patience))
        .stream_receive_window(WINDOW)
        .max_concurrent_bidi_streams(1_u32.into())
        .max_concurrent_uni_streams(VarInt::from_u32(LANES as u32))
        .datagram_receive_buffer_size(None);
    Ok(transport)
}

/// A UDP socket of QUIC; with a configuration it takes calls.
pub(crate) fn endpoint(
    at: SocketAddr,
    server: Option<quinn::ServerConfig>,
) -> io::Result<Endpoint> {
    let socket = Socket::new(Domain::for_address(at), Type::DGRAM, Some(Protocol::UDP))?;
    if at.is_ipv6() {
        // [::] and 0.0.0.0 are two endpoints; each is listed for what it is.
        socket.set_only_v6(true)?;
    }
    // The kernel gives as much as it may.
    let _ = socket.set_recv_buffer_size(SOCKET_BUFFER);
    let _ = socket.set_send_buffer_size(SOCKET_BUFFER);
    socket.bind(&at.into())?;
    let runtime = Arc::new(quinn::TokioRuntime);
    Endpoint::new(EndpointConfig::default(), server, socket.into(), runtime)
}

#[cfg(test)]
mod tests {
    use fipa_directory::Address;
    use fipa_fleet::{FleetKey, Membership};

    use super::*;
    use crate::Listener;

    fn member(fleet: &FleetKey, name: &str) -> Membership {
        fleet.issue(name, 30, now(), &[], None).unwrap()
    }

    fn now() -> Duration {
        let now = std::time::SystemTime::now();
        now.duration_since(std::time::UNIX_EPOCH).unwrap()
    }

    fn robot(membership: Membership) -> Quic {
        Quic::new(Some(Tls::new(Arc::new(membership)).unwrap())).unwrap()
    }

    /// Has somebody call, say one octet and hear one; whether a certificate was looked at anew, or
    /// why the caller was not let in.
    async fn call(caller: &Quic, listener: &Listener, at: SocketAddr) -> Result<bool, String> {
        let accepted = async {
            let stream = listener.accept().await.unwrap().settle().await;
            let Kind::Quic(mut link) = stream.map_err(|error| error.to_string())?.0 else {
                unreachable!("it was bound so");
            };
            link.say(b"!").await;
            Ok::<_, String>(link)
        };
        let calling = async {
            let Kind::Quic(mut link) = caller.connect(at).await?.0 else {
                unreachable!("it was dialled so");
            };
            link.say(b"?").await;
            // The ticket has come before that.
            link.hear(1).await;
            io::Result::Ok(link)
        };
        let (accepted, called) = tokio::join!(accepted, calling);
        accepted?;
        let (name, looked) = (called.unwrap(), caller.known(at).unwrap().verdict.name());
        assert_eq!(name.name(), Some("robot1"));
        Ok(looked.is_some())
    }

    #[tokio::test]
    async fn a_connection_is_resumed_as_long_as_the_certificate_is_good() {
        let fleet = FleetKey::generate(now()).unwrap();
        let (one, two) = (member(&fleet, "robot1"), member(&fleet, "robot2"));
        let gone = [two.certificate().clone()];
        let revoked = fleet.revoke(&gone, None, now()).unwrap();
        let (one, two) = (robot(one), robot(two));
        let any = Address::quic("127.0.0.1", 0);
        let listener = Listener::bind_link(&any, &one).await.unwrap();
        let Address::Quic { port, .. } = *listener.address() else {
            unreachable!("it was bound so");
        };
        let at = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        assert_eq!(call(&two, &listener, at).await, Ok(true));
        assert_eq!(call(&two, &listener, at).await, Ok(false), "it is resumed");
        one.tls()
            .unwrap()
            .membership()
            .learn(revoked.der())
            .unwrap();
        let refused = call(&two, &listener, at).await.unwrap_err();
        assert_eq!(refused, "the certificate of robot2 is revoked");
    }
}
