use std::io::{self, IoSlice};
use std::pin::pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use bytes::{BufMut, BytesMut};
use socket2::SockRef;
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;

use crate::unix::UnixStream;

/// An open stream, whatever carries it.
#[derive(Debug)]
pub struct Stream(pub(crate) Kind);

#[derive(Debug)]
pub(crate) enum Kind {
    Plain(Plain),
    /// One that has streams of its own.
    #[cfg(feature = "quic")]
    Quic(Box<crate::quic::QuicLink>),
    /// What becomes one once the caller has shown who it is.
    #[cfg(feature = "quic")]
    Calling(Box<crate::quic::Calling>),
}

/// A single stream of octets.
#[derive(Debug)]
pub(crate) enum Plain {
    Tcp(TcpStream),
    #[cfg(feature = "tls")]
    Tls(Box<crate::tls::Secured>),
    Unix(UnixStream),
}

macro_rules! each {
    ($stream:expr, $inner:ident => $call:expr) => {
        match $stream {
            Plain::Tcp($inner) => $call,
            #[cfg(feature = "tls")]
            Plain::Tls($inner) => $call,
            Plain::Unix($inner) => $call,
        }
    };
}

impl Stream {
    pub(crate) fn plain(stream: Plain) -> Stream {
        Stream(Kind::Plain(stream))
    }

    /// Whether the partner is on this host: a Unix socket, or an address of our own.
    pub fn same_host(&self) -> bool {
        match &self.0 {
            Kind::Plain(stream) => stream.same_host(),
            #[cfg(feature = "quic")]
            Kind::Quic(link) => link.same_host(),
            #[cfg(feature = "quic")]
            Kind::Calling(_) => false,
        }
    }

    /// Where the other end is.
    pub fn remote(&self) -> String {
        match &self.0 {
            Kind::Plain(stream) => stream.remote(),
            #[cfg(feature = "quic")]
            Kind::Quic(link) => format!("quic://{}", link.remote()),
            #[cfg(feature = "quic")]
            Kind::Calling(calling) => format!("quic://{}", calling.remote()),
        }
    }

    /// Whose certificate the other side has shown, where the stream is secured: the name of a robot
    /// of our fleet.
    pub fn identity(&self) -> Option<&str> {
        match &self.0 {
            #[cfg(feature = "tls")]
            Kind::Plain(Plain::Tls(stream)) => Some(stream.name()),
            #[cfg(feature = "quic")]
            Kind::Quic(link) => link.name(),
            _ => None,
        }
    }

    /// The certificate that the other side has shown (DER), where the stream is secured. Without a
    /// fleet it is nobody's.
    pub fn certificate(&self) -> Option<&[u8]> {
        match &self.0 {
            #[cfg(feature = "tls")]
            Kind::Plain(Plain::Tls(stream)) => stream.certificate(),
            #[cfg(feature = "quic")]
            Kind::Quic(link) => link.certificate(),
            _ => None,
        }
    }

    /// Whether there are lanes beside the main stream.
    pub fn has_lanes(&self) -> bool {
        #[cfg(feature = "quic")]
        return matches!(self.0, Kind::Quic(_));
        #[cfg(not(feature = "quic"))]
        return false;
    }

    /// Whether it is the call of somebody who [has to show](Self::settle) who it is.
    pub fn is_calling(&self) -> bool {
        #[cfg(feature = "quic")]
        return matches!(self.0, Kind::Calling(_));
        #[cfg(not(feature = "quic"))]
        return false;
    }

    /// Lets a caller show who it is; any other stream stays what it is. An error says why the
    /// caller is not let in.
    pub async fn settle(self) -> io::Result<Stream> {
        match self.0 {
            #[cfg(feature = "quic")]
            Kind::Calling(calling) => calling.settle().await,
            other => Ok(Stream(other)),
        }
    }
}

impl Plain {
    fn same_host(&self) -> bool {
        match self.tcp() {
            Some(stream) => match (stream.local_addr(), stream.peer_addr()) {
                (Ok(local), Ok(peer)) => local.ip() == peer.ip() || peer.ip().is_loopback(),
                _ => false,
            },
            None => true,
        }
    }

    fn remote(&self) -> String {
        match self.tcp() {
            Some(stream) => match stream.peer_addr() {
                Ok(address) => format!("tcp://{address}"),
                Err(_) => "tcp://".to_owned(),
            },
            None => "a program of this host".to_owned(),
        }
    }

    fn tcp(&self) -> Option<&TcpStream> {
        match self {
            Plain::Tcp(stream) => Some(stream),
            #[cfg(feature = "tls")]
            Plain::Tls(stream) => Some(stream.stream()),
            Plain::Unix(_) => None,
        }
    }

    /// Ends what we write; an error if the connection is known to be broken by now.
    pub(crate) fn end_writing(&mut self) -> io::Result<()> {
        match self {
            Plain::Tcp(stream) => {
                SockRef::from(&*stream).shutdown(std::net::Shutdown::Write)?;
                match stream.try_read(&mut [0]) {
                    Err(error) if error.kind() != io::ErrorKind::WouldBlock => Err(error),
                    _ => Ok(()),
                }
            }
            #[cfg(feature = "tls")]
            Plain::Tls(stream) => stream.end_writing(),
            Plain::Unix(stream) => stream.end_writing(),
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
        each!(self, stream => stream.poll_read_ready(cx))
    }

    /// To be asked after a writing that was refused.
    pub(crate) fn poll_write_ready(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        each!(self, stream => stream.poll_write_ready(cx))
    }

    /// Reads once into the room that the buffer has. Whether it was filled: after a reading that
    /// left some of it the system is not asked in vain whether there is more.
    pub(crate) fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        buffer: &mut BytesMut,
    ) -> Poll<io::Result<bool>> {
        let (before, mut room) = (buffer.len(), buffer.capacity() - buffer.len());
        let octets = match self {
            Plain::Tcp(stream) => {
                let mut buffer = buffer.limit(room);
                ready!(pin!(stream.read_buf(&mut buffer)).poll(cx))?
            }
            #[cfg(feature = "tls")]
            Plain::Tls(stream) => return stream.poll_read(cx, buffer),
            Plain::Unix(stream) => {
                // Zeroed before they are read.
                room = room.min(stream.usual());
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
        each!(self, stream => stream.try_write_vectored(parts))
    }

    /// Hands to the system what was taken; whether some of it has to wait.
    pub(crate) fn flush(&mut self) -> io::Result<bool> {
        match self {
            #[cfg(feature = "tls")]
            Plain::Tls(stream) => stream.flush(),
            Plain::Tcp(_) | Plain::Unix(_) => Ok(false),
        }
    }
}
