use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use fipa_directory::Address;
use tokio::task::JoinSet;

use crate::Stream;
use crate::{tcp, unix};

/// How long one address may take.
const PATIENCE: Duration = Duration::from_secs(3);

/// How long an address is tried before the next is tried beside it (RFC 8305).
const STAGGER: Duration = Duration::from_millis(250);

/// None of the addresses was reached.
#[derive(Debug, thiserror::Error)]
#[error("{}", describe(.0))]
pub struct DialError(Vec<(Address, io::Error)>);

impl DialError {
    /// Whether some host answered that nobody listens there.
    pub fn is_refused(&self) -> bool {
        let refused = |error: &io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
        self.0.iter().any(|(_, error)| refused(error))
    }
}

fn describe(failures: &[(Address, io::Error)]) -> String {
    let each = failures
        .iter()
        .map(|(address, e)| format!("{address}: {e}"));
    match each.collect::<Vec<_>>().join("; ") {
        none if none.is_empty() => "no address is known".to_owned(),
        each => each,
    }
}

/// Opens a stream to the first of the addresses that answers. They are tried in their order, each
/// a quarter of a second after the one before, or as soon as that one fails.
pub async fn dial(addresses: &[Address]) -> Result<(Stream, Address), DialError> {
    first_of(addresses, |address| async move { connect(&address).await }).await
}

/// The same for a stream that is secured: an address at which no robot of the fleet answers counts
/// as one that was not reached.
#[cfg(feature = "tls")]
pub async fn dial_secured(
    addresses: &[Address],
    tls: &crate::Tls,
) -> Result<(Stream, Address), DialError> {
    first_of(addresses, |address| {
        let tls = tls.clone();
        async move { tls.connect(connect(&address).await?).await }
    })
    .await
}

/// The same for a link, which is secured where there is a fleet, and may go over QUIC.
#[cfg(feature = "quic")]
pub async fn dial_link(
    addresses: &[Address],
    quic: &crate::Quic,
) -> Result<(Stream, Address), DialError> {
    first_of(addresses, |address| {
        let quic = quic.clone();
        async move {
            if let Address::Quic { host, port } = &address {
                return connect_by(host, *port, |at| quic.connect(at)).await;
            }
            let stream = connect(&address).await?;
            match quic.tls() {
                Some(tls) => tls.connect(stream).await,
                None => Ok(stream),
            }
        }
    })
    .await
}

async fn first_of<C>(
    addresses: &[Address],
    connect: impl Fn(Address) -> C,
) -> Result<(Stream, Address), DialError>
where
    C: Future<Output = io::Result<Stream>> + Send + 'static,
{
    let mut attempts = JoinSet::new();
    let mut failures = Vec::new();
    let mut rest = addresses.iter();
    loop {
        match rest.next() {
            Some(address) => {
                let (address, connected) = (address.clone(), connect(address.clone()));
                attempts.spawn(async move { (address, connected.await) });
            }
            None if attempts.is_empty() => return Err(DialError(failures)),
            None => {}
        }
        let waits = rest.len() > 0;
        tokio::select! {
            Some(Ok((address, result))) = attempts.join_next() => match result {
                Ok(stream) => return Ok((stream, address)),
                Err(error) => failures.push((address, error)),
            },
            () = tokio::time::sleep(STAGGER), if waits => {}
        }
    }
}

async fn connect(address: &Address) -> io::Result<Stream> {
    let attempt = async {
        match address {
            Address::Unix(path) => unix::connect(path).await,
            Address::Http { .. } | Address::Other { .. } => {
                Err(io::Error::other("letters are posted there, it is no link"))
            }
            Address::Quic { .. } => Err(io::Error::other(
                "QUIC is for links, and spoken by programs that were built with it",
            )),
            Address::Tcp { host, port } => connect_by(host, *port, tcp::connect).await,
        }
    };
    match tokio::time::timeout(PATIENCE, attempt).await {
        Ok(result) => result,
        Err(_) => Err(io::Error::new(
            io::ErrorKind::TimedOut,
            "no answer within 3 s",
        )),
    }
}

/// Connects to the first address of a host that answers.
async fn connect_by<C>(
    host: &str,
    port: u16,
    connect: impl Fn(SocketAddr) -> C,
) -> io::Result<Stream>
where
    C: Future<Output = io::Result<Stream>>,
{
    let mut last = io::Error::other("the host name has no address");
    let found: Vec<SocketAddr> = tokio::net::lookup_host((host, port)).await?.collect();
    for address in found {
        match connect(address).await {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}
