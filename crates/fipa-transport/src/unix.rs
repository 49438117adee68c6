//! Unix sockets.

use std::fs::File;
use std::io;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::Path;

use tokio::net::{UnixListener, UnixStream};

use crate::stream::{Kind, Stream};

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
    let stream = UnixStream::connect(path).await?;
    Ok(Stream(Kind::Unix(stream)))
}
