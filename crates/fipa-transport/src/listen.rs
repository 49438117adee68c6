use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use fipa_directory::Address;

use crate::Stream;
use crate::{tcp, unix};

/// A bound endpoint that accepts streams.
#[derive(Debug)]
pub struct Listener {
    socket: Socket,
    address: Address,
}

#[derive(Debug)]
enum Socket {
    Tcp(tokio::net::TcpListener),
    Unix(tokio::net::UnixListener, PathBuf),
    #[cfg(feature = "quic")]
    Quic(Box<crate::quic::Server>),
}

/// An endpoint cannot be bound.
#[derive(Debug, thiserror::Error)]
#[error("cannot listen at {address}: {source}")]
pub struct BindError {
    /// The endpoint.
    pub address: Address,
    /// What the system said.
    pub source: io::Error,
}

impl Listener {
    /// Binds an endpoint. Port 0 takes a free port; a host name is looked up and its first address
    /// is taken. A Unix socket is for this user only.
    pub async fn bind(address: &Address) -> Result<Listener, BindError> {
        let failed = |source| BindError {
            address: address.clone(),
            source,
        };
        let (socket, address) = match address {
            Address::Tcp { host, port } => {
                let wanted = resolve(host, *port).await.map_err(failed)?;
                let listener = tcp::bind(wanted).map_err(failed)?;
                let bound = listener.local_addr().map_err(failed)?;
                let address = Address::tcp(bound.ip().to_string(), bound.port());
                (Socket::Tcp(listener), address)
            }
            Address::Quic { .. } => {
                let reason = "this endpoint needs keys for QUIC, or a program that speaks it";
                return Err(failed(io::Error::other(reason)));
            }
            Address::Http { .. } => {
                let reason = "letters over HTTP are taken by a server of their own";
                return Err(failed(io::Error::other(reason)));
            }
            Address::Other { .. } => {
                return Err(failed(io::Error::other("no transport of this kind")));
            }
            Address::Unix(path) => {
                let path = PathBuf::from(path);
                let listener = unix::bind(&path).map_err(failed)?;
                (Socket::Unix(listener, path), address.clone())
            }
        };
        Ok(Listener { socket, address })
    }

    /// The same, where QUIC is spoken as well. What [`accept`](Self::accept) gives there is still
    /// to be [settled](Stream::settle).
    #[cfg(feature = "quic")]
    pub async fn bind_link(address: &Address, quic: &crate::Quic) -> Result<Listener, BindError> {
        let Address::Quic { host, port } = address else {
            return Listener::bind(address).await;
        };
        let bind = async {
            let wanted = resolve(host, *port).await?;
            let server = crate::quic::Server::bind(quic, wanted)?;
            let bound = server.address()?;
            io::Result::Ok((server, bound))
        };
        let (server, bound) = bind.await.map_err(|source| BindError {
            address: address.clone(),
            source,
        })?;
        Ok(Listener {
            socket: Socket::Quic(Box::new(server)),
            address: Address::quic(bound.ip().to_string(), bound.port()),
        })
    }

    /// Where it is bound, with the port that it got.
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// The next stream. Cancel-safe.
    pub async fn accept(&self) -> io::Result<Stream> {
        match &self.socket {
            Socket::Tcp(listener) => tcp::stream(listener.accept().await?.0),
            Socket::Unix(listener, _) => unix::stream(listener.accept().await?.0),
            #[cfg(feature = "quic")]
            Socket::Quic(server) => server.accept().await,
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Socket::Unix(_, path) = &self.socket {
            // A newer socket may have taken the place; then this removes a file that is only a
            // name, and the next start says so. Nothing better can be done while ending.
            let _ = std::fs::remove_file(path);
        }
    }
}

async fn resolve(host: &str, port: u16) -> io::Result<SocketAddr> {
    let mut found = tokio::net::lookup_host((host, port)).await?;
    found
        .next()
        .ok_or_else(|| io::Error::other("the host name has no address"))
}
