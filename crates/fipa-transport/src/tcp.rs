//! TCP streams.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::net::{TcpListener, TcpSocket, TcpStream};

use crate::stream::{Plain, Stream};

/// Connections that wait to be accepted.
const BACKLOG: u32 = 1024;

/// Binds a listening socket. The port can be bound again at once after the program ended.
pub(crate) fn bind(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => {
            let socket = TcpSocket::new_v6()?;
            // [::] and 0.0.0.0 are two endpoints; each is listed for what it is.
            SockRef::from(&socket).set_only_v6(true)?;
            socket
        }
    };
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

pub(crate) async fn connect(address: SocketAddr) -> io::Result<Stream> {
    TcpStream::connect(address).await.and_then(stream)
}

/// Letters are written whole, so nothing is gained by holding octets back; and a partner that
/// vanished without a word is noticed by the kernel even where no heartbeat runs.
pub(crate) fn stream(stream: TcpStream) -> io::Result<Stream> {
    stream.set_nodelay(true)?;
    let keepalive = TcpKeepalive::new()
        .with_time(Duration::from_secs(30))
        .with_interval(Duration::from_secs(10));
    SockRef::from(&stream).set_tcp_keepalive(&keepalive)?;
    Ok(Stream::plain(Plain::Tcp(stream)))
}
