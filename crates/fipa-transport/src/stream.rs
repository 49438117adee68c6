use std::io::{self, IoSlice};

use tokio::io::{Interest, Ready};
use tokio::net::TcpStream;
use tokio::net::UnixStream;

/// An open stream, whatever carries it.
#[derive(Debug)]
pub struct Stream(pub(crate) Kind);

#[derive(Debug)]
pub(crate) enum Kind {
    Tcp(TcpStream),
    Unix(UnixStream),
}

macro_rules! each {
    ($stream:expr, $inner:ident => $call:expr) => {
        match &$stream.0 {
            Kind::Tcp($inner) => $call,
            Kind::Unix($inner) => $call,
        }
    };
}

impl Stream {
    /// Whether the partner is on this host: a Unix socket, or an address of our own.
    pub fn same_host(&self) -> bool {
        match &self.0 {
            Kind::Tcp(stream) => match (stream.local_addr(), stream.peer_addr()) {
                (Ok(local), Ok(peer)) => local.ip() == peer.ip() || peer.ip().is_loopback(),
                _ => false,
            },
            Kind::Unix(_) => true,
        }
    }

    pub(crate) async fn ready(&self, interest: Interest) -> io::Result<Ready> {
        each!(self, stream => stream.ready(interest).await)
    }

    pub(crate) fn try_read(&self, buffer: &mut [u8]) -> io::Result<usize> {
        each!(self, stream => stream.try_read(buffer))
    }

    pub(crate) fn try_read_buf(&self, buffer: &mut bytes::BytesMut) -> io::Result<usize> {
        each!(self, stream => stream.try_read_buf(buffer))
    }

    pub(crate) fn try_write_vectored(&self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        each!(self, stream => stream.try_write_vectored(parts))
    }
}
