use std::io::{self, IoSlice};
use std::time::Duration;

use socket2::SockRef;
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

    /// Where the other end is.
    pub fn remote(&self) -> String {
        match &self.0 {
            Kind::Tcp(stream) => match stream.peer_addr() {
                Ok(address) => format!("tcp://{address}"),
                Err(_) => "tcp://".to_owned(),
            },
            Kind::Unix(_) => "a program of this host".to_owned(),
        }
    }

    /// Ends what we write; an error if the connection is known to be broken by now.
    pub(crate) fn end_writing(&self) -> io::Result<()> {
        each!(self, stream => SockRef::from(stream).shutdown(std::net::Shutdown::Write))?;
        match self.try_read(&mut [0]) {
            Err(error) if error.kind() != io::ErrorKind::WouldBlock => Err(error),
            _ => Ok(()),
        }
    }

    /// Has the other side see an error instead of an end, once the stream is dropped.
    pub(crate) fn abort(&self) -> io::Result<()> {
        each!(self, stream => SockRef::from(stream).set_linger(Some(Duration::ZERO)))
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
