//! Unix sockets.

use std::fs::File;
use std::io::{self, IoSlice, Read, Write};
use std::net::Shutdown;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::Path;
use std::task::{Context, Poll, ready};

use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::net::UnixListener;

use crate::stream::{Plain, Stream};

/// Binds a socket that only this user may open. A file there that nobody answers at is replaced;
/// one that somebody answers at is [`io::ErrorKind::AddrInUse`].
pub(crate) fn bind(path: &Path) -> io::Result<UnixListener> {
    let _turn = take_turns(path);
    match std::os::unix::net::UnixStream::connect(path) {
        Ok(_) => return Err(io::ErrorKind::AddrInUse.into()),
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            if !std::fs::symlink_metadata(path)?.file_type().is_socket() {
                return Err(io::Error::other("the file there is no socket"));
            }
            std::fs::remove_file(path)?;
        }
        Err(_) => {}
    }
    // Bound under another name and moved, so that it is never there with other rights.
    let hidden = path.with_extension(format!("{}.new", std::process::id()));
    let listener = UnixListener::bind(&hidden)?;
    std::fs::set_permissions(&hidden, std::fs::Permissions::from_mode(0o600))?;
    std::fs::rename(&hidden, path)?;
    Ok(listener)
}

/// Of several that bind in one folder each waits for the others, so that none replaces what
/// another has bound after it looked. Where there are no locks, it is left to chance.
fn take_turns(path: &Path) -> Option<File> {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let folder = File::open(folder.unwrap_or(Path::new("."))).ok()?;
    folder.lock().ok()?;
    Some(folder)
}

pub(crate) async fn connect(path: &str) -> io::Result<Stream> {
    stream(tokio::net::UnixStream::connect(path).await?)
}

pub(crate) fn stream(stream: tokio::net::UnixStream) -> io::Result<Stream> {
    let stream = stream.into_std()?;
    Ok(Stream::plain(Plain::Unix(UnixStream {
        stream: watched(stream, Interest::READABLE)?,
        refused: None,
        usual: FEW,
    })))
}

/// Octets that are read at once, at least and at most.
const FEW: usize = 4 << 10;
const MANY: usize = 32 << 10;

/// A Unix socket that is asked whether it can be written to only after it refused.
///
/// The kernel wakes whoever waits for that with everything that the partner reads: each letter
/// would cost its sender another turn.
#[derive(Debug)]
pub(crate) struct UnixStream {
    stream: AsyncFd<Socket>,
    /// Another descriptor of the same socket, as long as nothing can be written.
    refused: Option<AsyncFd<Socket>>,
    /// Octets that it is worth while to have room for.
    usual: usize,
}

type Socket = std::os::unix::net::UnixStream;

/// What is deprecated is that this takes values whose descriptor may change; that of a socket which
/// is owned here never does.
#[allow(deprecated)]
fn watched(socket: Socket, interest: Interest) -> io::Result<AsyncFd<Socket>> {
    AsyncFd::with_interest(socket, interest)
}

impl UnixStream {
    pub(crate) fn poll_read_ready(&self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.stream.poll_read_ready(cx).map_ok(|_| ())
    }

    pub(crate) fn poll_write_ready(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let refused = match self.refused.take() {
            Some(refused) => refused,
            None => {
                let socket = self.stream.get_ref().try_clone()?;
                watched(socket, Interest::WRITABLE)?
            }
        };
        let ready = refused.poll_write_ready(cx).map_ok(|_| ());
        if ready.is_pending() {
            self.refused = Some(refused);
        }
        ready
    }

    /// Octets for which there is to be room at the next reading: more if the last one filled what
    /// there was, fewer if it left most of it.
    pub(crate) fn usual(&self) -> usize {
        self.usual
    }

    pub(crate) fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        room: &mut [u8],
    ) -> Poll<io::Result<usize>> {
        loop {
            let mut ready = ready!(self.stream.poll_read_ready(cx))?;
            let Ok(octets) = ready.try_io(|socket| socket.get_ref().read(room)) else {
                continue;
            };
            if let Ok(octets) = octets {
                self.usual = match octets {
                    _ if octets == room.len() => (self.usual * 2).min(MANY),
                    _ if octets < self.usual / 4 => (self.usual - self.usual / 8).max(FEW),
                    _ => self.usual,
                };
                if octets < room.len() {
                    ready.clear_ready();
                }
            }
            return Poll::Ready(octets);
        }
    }

    pub(crate) fn end_writing(&self) -> io::Result<()> {
        self.stream.get_ref().shutdown(Shutdown::Write)
    }

    pub(crate) fn try_write_vectored(&self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        self.stream.get_ref().write_vectored(parts)
    }
}
