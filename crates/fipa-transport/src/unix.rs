//! Unix sockets.

use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use tokio::net::{UnixListener, UnixStream};

use crate::stream::{Kind, Stream};

/// Binds a socket that only this user may open. A file there that nobody answers at is replaced;
/// one that somebody answers at is [`io::ErrorKind::AddrInUse`].
pub(crate) fn bind(path: &Path) -> io::Result<UnixListener> {
    match std::os::unix::net::UnixStream::connect(path) {
        Ok(_) => return Err(io::ErrorKind::AddrInUse.into()),
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
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

pub(crate) async fn connect(path: &str) -> io::Result<Stream> {
    let stream = UnixStream::connect(path).await?;
    Ok(Stream(Kind::Unix(stream)))
}
