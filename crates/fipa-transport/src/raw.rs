//! Bare TCP sockets, and connections of QUIC with one stream: what a network gives with nothing of
//! ours in between, to measure beside it.
//!
//! ```text
//!   e  [length][octets] ─▶   ◀─ the same         a round trip
//!   s  [length][octets] ─▶   ◀─ one octet        what is taken, counted
//!   ?                        ◀─ what the server tells about itself, to the end
//! ```
//!
//! The first octet of a connection chooses. Lengths are four octets, the greatest first.

#[cfg(feature = "quic")]
mod quic;

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use bytes::Bytes;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader, BufWriter};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::Instant;

#[cfg(feature = "quic")]
pub use self::quic::RawQuicServer;

/// Octets of the largest frame.
const MAX_FRAME: u32 = 4 << 20;

/// Octets of what a server tells about itself, at most.
const MAX_ABOUT: u64 = 64 << 10;

/// Connections that are served at once.
const AT_ONCE: usize = 16;

/// Octets that are gathered before they are written.
const BUFFER: usize = 64 << 10;

const ABOUT: u8 = b'?';
const ECHO: u8 = b'e';
const SINK: u8 = b's';

/// The other end of measurements.
#[derive(Debug)]
pub struct RawServer {
    listener: TcpListener,
    address: SocketAddr,
}

impl RawServer {
    /// Binds; port 0 takes a free port.
    pub async fn bind(endpoint: &str) -> io::Result<RawServer> {
        let listener = crate::tcp::bind(resolve(endpoint).await?)?;
        let address = listener.local_addr()?;
        Ok(RawServer { listener, address })
    }

    /// Where it is bound, with the port that it got.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until the future is dropped. `about` is told whoever asks.
    pub async fn serve(self, about: Bytes) {
        let mut served = JoinSet::new();
        loop {
            tokio::select! {
                accepted = self.listener.accept(), if served.len() < AT_ONCE => match accepted {
                    // How a connection ends is the affair of whoever measures.
                    Ok((stream, _)) => drop(served.spawn(serve_tcp(stream, about.clone()))),
                    // Out of file descriptors, as a rule.
                    Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
                },
                Some(_) = served.join_next() => {}
            }
        }
    }
}

async fn serve_tcp(stream: TcpStream, about: Bytes) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let (reader, writer) = stream.into_split();
    serve(reader, writer, about).await
}

async fn serve(
    reader: impl AsyncRead + Unpin,
    writer: impl AsyncWrite + Unpin,
    about: Bytes,
) -> io::Result<()> {
    let mut reader = BufReader::with_capacity(BUFFER, reader);
    let mut writer = BufWriter::with_capacity(BUFFER, writer);
    let wanted = reader.read_u8().await?;
    if wanted == ABOUT {
        writer.write_all(&about).await?;
        return writer.shutdown().await;
    }
    let mut frame = Vec::new();
    loop {
        let length = reader.read_u32().await?;
        if length > MAX_FRAME {
            return Err(io::Error::other("the frame is too large"));
        }
        frame.clear();
        (&mut reader)
            .take(length.into())
            .read_to_end(&mut frame)
            .await?;
        if frame.len() < length as usize {
            return Ok(());
        }
        match wanted {
            ECHO => {
                writer.write_u32(length).await?;
                writer.write_all(&frame).await?;
            }
            SINK => writer.write_u8(0).await?,
            _ => return Ok(()),
        }
        if reader.buffer().is_empty() {
            writer.flush().await?;
        }
    }
}

/// What the server at an endpoint `HOST:PORT` tells about itself, and its address.
pub async fn about(endpoint: &str) -> io::Result<(SocketAddr, Bytes)> {
    let address = resolve(endpoint).await?;
    let mut stream = TcpStream::connect(address).await?;
    stream.write_all(&[ABOUT]).await?;
    let mut told = Vec::new();
    stream.take(MAX_ABOUT).read_to_end(&mut told).await?;
    Ok((address, Bytes::from(told)))
}

/// A connection over which is measured.
pub struct RawClient {
    reader: BufReader<Box<dyn AsyncRead + Send + Unpin>>,
    writer: BufWriter<Box<dyn AsyncWrite + Send + Unpin>>,
    local: SocketAddr,
}

impl fmt::Debug for RawClient {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RawClient")
            .field("local", &self.local)
            .finish_non_exhaustive()
    }
}

impl RawClient {
    /// For round trips.
    pub async fn echo(server: SocketAddr) -> io::Result<RawClient> {
        RawClient::connect(server, ECHO).await
    }

    /// For what is taken.
    pub async fn sink(server: SocketAddr) -> io::Result<RawClient> {
        RawClient::connect(server, SINK).await
    }

    async fn connect(server: SocketAddr, wanted: u8) -> io::Result<RawClient> {
        let stream = TcpStream::connect(server).await?;
        stream.set_nodelay(true)?;
        let local = stream.local_addr()?;
        let (reader, writer) = stream.into_split();
        RawClient::new(Box::new(reader), Box::new(writer), local, wanted).await
    }

    async fn new(
        reader: Box<dyn AsyncRead + Send + Unpin>,
        writer: Box<dyn AsyncWrite + Send + Unpin>,
        local: SocketAddr,
        wanted: u8,
    ) -> io::Result<RawClient> {
        let mut writer = BufWriter::with_capacity(BUFFER, writer);
        writer.write_u8(wanted).await?;
        Ok(RawClient {
            reader: BufReader::with_capacity(BUFFER, reader),
            writer,
            local,
        })
    }

    /// The address of this end.
    pub fn local(&self) -> SocketAddr {
        self.local
    }

    /// Sends a frame, and waits until it is back.
    pub async fn round_trip(&mut self, frame: &[u8]) -> io::Result<()> {
        self.put(frame).await?;
        self.writer.flush().await?;
        let length = self.reader.read_u32().await?;
        if length as usize != frame.len() {
            return Err(io::Error::other("another frame came back"));
        }
        let mut back = vec![0; frame.len()];
        self.reader.read_exact(&mut back).await.map(drop)
    }

    /// Sends the frame again and again for so long, at most `window` of them not taken yet; how many
    /// were taken.
    pub async fn flood(&mut self, frame: &[u8], window: u64, span: Duration) -> io::Result<u64> {
        let until = Instant::now() + span;
        let (mut sent, mut taken) = (0, 0);
        let mut receipts = [0; 4096];
        loop {
            while sent - taken < window && Instant::now() < until {
                self.put(frame).await?;
                sent += 1;
            }
            if sent == taken {
                return Ok(taken);
            }
            self.writer.flush().await?;
            match self.reader.read(&mut receipts).await? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                more => taken += more as u64,
            }
        }
    }

    async fn put(&mut self, frame: &[u8]) -> io::Result<()> {
        let length = u32::try_from(frame.len()).map_err(io::Error::other)?;
        self.writer.write_u32(length).await?;
        self.writer.write_all(frame).await
    }
}

async fn resolve(endpoint: &str) -> io::Result<SocketAddr> {
    let mut found = tokio::net::lookup_host(endpoint).await?;
    found
        .next()
        .ok_or_else(|| io::Error::other("the host name has no address"))
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn server() -> SocketAddr {
        let server = RawServer::bind("127.0.0.1:0").await.unwrap();
        let address = server.address();
        tokio::spawn(server.serve(Bytes::from_static(b"me")));
        address
    }

    #[tokio::test]
    async fn frames_come_back_are_counted_and_the_server_tells_about_itself() {
        let server = server().await;
        let (address, told) = about(&server.to_string()).await.unwrap();
        assert_eq!((address, &told[..]), (server, &b"me"[..]));
        let mut echo = RawClient::echo(server).await.unwrap();
        for size in [0, 1, 100, 1 << 20] {
            echo.round_trip(&vec![7; size]).await.unwrap();
        }
        let mut sink = RawClient::sink(server).await.unwrap();
        let span = Duration::from_millis(20);
        assert!(sink.flood(&[7; 256], 64, span).await.unwrap() > 0);
        assert!(sink.flood(&vec![7; 1 << 20], 2, span).await.unwrap() > 0);
    }

    #[tokio::test]
    async fn a_frame_that_is_too_large_ends_the_connection() {
        let server = server().await;
        let mut echo = RawClient::echo(server).await.unwrap();
        let frame = vec![0; MAX_FRAME as usize + 1];
        assert!(echo.round_trip(&frame).await.is_err());
    }
}
