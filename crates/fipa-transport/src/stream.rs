use std::io::{self, IoSlice};
use std::pin::pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::{BufMut, BytesMut};
use socket2::SockRef;
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;

use crate::unix::UnixStream;

/// Octets that are read at once from a Unix socket: they are zeroed before.
const UNIX_ROOM: usize = 32 << 10;

/// An open stream, whatever carries it.
#[derive(Debug)]
pub struct Stream(pub(crate) Kind);

#[derive(Debug)]
pub(crate) enum Kind {
    Tcp(TcpStream),
    #[cfg(feature = "tls")]
    Tls(Box<crate::tls::Secured>),
    Unix(UnixStream),
}

macro_rules! each {
    ($stream:expr, $inner:ident => $call:expr) => {
        match $stream {
            Kind::Tcp($inner) => $call,
            #[cfg(feature = "tls")]
            Kind::Tls($inner) => $call,
            Kind::Unix($inner) => $call,
        }
    };
}

impl Stream {
    /// Whether the partner is on this host: a Unix socket, or an address of our own.
    pub fn same_host(&self) -> bool {
        match self.tcp() {
            Some(stream) => match (stream.local_addr(), stream.peer_addr()) {
                (Ok(local), Ok(peer)) => local.ip() == peer.ip() || peer.ip().is_loopback(),
                _ => false,
            },
            None => true,
        }
    }

    /// Where the other end is.
    pub fn remote(&self) -> String {
        match self.tcp() {
            Some(stream) => match stream.peer_addr() {
                Ok(address) => format!("tcp://{address}"),
                Err(_) => "tcp://".to_owned(),
            },
            None => "a program of this host".to_owned(),
        }
    }

    /// Whose certificate the other side has shown, where the stream is secured: the name of a robot
    /// of our fleet.
    pub fn identity(&self) -> Option<&str> {
        match &self.0 {
            #[cfg(feature = "tls")]
            Kind::Tls(stream) => Some(stream.name()),
            _ => None,
        }
    }

    /// The certificate that the other side has shown (DER), where the stream is secured.
    pub fn certificate(&self) -> Option<&[u8]> {
        match &self.0 {
            #[cfg(feature = "tls")]
            Kind::Tls(stream) => stream.certificate(),
            _ => None,
        }
    }

    fn tcp(&self) -> Option<&TcpStream> {
        match &self.0 {
            Kind::Tcp(stream) => Some(stream),
            #[cfg(feature = "tls")]
            Kind::Tls(stream) => Some(stream.stream()),
            Kind::Unix(_) => None,
        }
    }

    /// Ends what we write; an error if the connection is known to be broken by now.
    pub(crate) fn end_writing(&mut self) -> io::Result<()> {
        match &mut self.0 {
            Kind::Tcp(stream) => {
                SockRef::from(&*stream).shutdown(std::net::Shutdown::Write)?;
                match stream.try_read(&mut [0]) {
                    Err(error) if error.kind() != io::ErrorKind::WouldBlock => Err(error),
                    _ => Ok(()),
                }
            }
            #[cfg(feature = "tls")]
            Kind::Tls(stream) => stream.end_writing(),
            Kind::Unix(stream) => stream.end_writing(),
        }
    }

    /// Has the other side see an error instead of an end, once the stream is dropped.
    pub(crate) fn abort(&self) -> io::Result<()> {
        match self.tcp() {
            Some(stream) => SockRef::from(stream).set_linger(Some(Duration::ZERO)),
            None => Ok(()),
        }
    }

    pub(crate) fn poll_read_ready(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        each!(&mut self.0, stream => stream.poll_read_ready(cx))
    }

    /// To be asked after a writing that was refused.
    pub(crate) fn poll_write_ready(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        each!(&mut self.0, stream => stream.poll_write_ready(cx))
    }

    /// Reads once into the room that the buffer has. Whether it was filled: after a reading that
    /// left some of it the system is not asked in vain whether there is more.
    pub(crate) fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        buffer: &mut BytesMut,
    ) -> Poll<io::Result<bool>> {
        let (before, mut room) = (buffer.len(), buffer.capacity() - buffer.len());
        let octets = match &mut self.0 {
            Kind::Tcp(stream) => {
                let mut buffer = buffer.limit(room);
                ready!(pin!(stream.read_buf(&mut buffer)).poll(cx))?
            }
            #[cfg(feature = "tls")]
            Kind::Tls(stream) => return stream.poll_read(cx, buffer),
            Kind::Unix(stream) => {
                room = room.min(UNIX_ROOM);
                buffer.resize(before + room, 0);
                let read = stream.poll_read(cx, &mut buffer[before..]);
                let octets = match &read {
                    Poll::Ready(Ok(octets)) => *octets,
                    _ => 0,
                };
                buffer.truncate(before + octets);
                ready!(read)?
            }
        };
        Poll::Ready(match octets {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            octets => Ok(octets == room),
        })
    }

    /// Takes as much as there is room for; see [`flush`](Self::flush).
    pub(crate) fn try_write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        each!(&mut self.0, stream => stream.try_write_vectored(parts))
    }

    /// Hands to the system what was taken; whether some of it has to wait.
    pub(crate) fn flush(&mut self) -> io::Result<bool> {
        match &mut self.0 {
            #[cfg(feature = "tls")]
            Kind::Tls(stream) => stream.flush(),
            Kind::Tcp(_) | Kind::Unix(_) => Ok(false),
        }
    }
}
