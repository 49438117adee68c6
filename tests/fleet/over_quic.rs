//! The main stream of a link over QUIC, for somebody who minds nothing.

use std::io::{self, Read, Write};
use std::net::SocketAddr;
use std::sync::Arc;

use quinn::crypto::rustls::QuicClientConfig;
use quinn::{Connection, Endpoint, RecvStream, SendStream};
use tokio::runtime::Runtime;

use crate::support::PATIENCE;

/// Streams for letters that each side opens.
const LANES: u8 = 3;

/// A link that somebody has opened.
pub(crate) struct Called {
    runtime: Runtime,
    _endpoint: Endpoint,
    _connection: Connection,
    lanes: Vec<SendStream>,
    send: SendStream,
    recv: RecvStream,
}

impl Called {
    /// Opens a link with this certificate and key, if they are let in.
    pub(crate) fn call(to: SocketAddr, config: rustls::ClientConfig) -> Option<Called> {
        let runtime = Runtime::new().unwrap();
        let config = QuicClientConfig::try_from(config).unwrap();
        let config = quinn::ClientConfig::new(Arc::new(config));
        let called = runtime.block_on(async {
            let endpoint = Endpoint::client("127.0.0.1:0".parse().unwrap()).unwrap();
            let connecting = endpoint.connect_with(config, to, "fleet.invalid");
            let connection = connecting.unwrap().await.ok()?;
            let (send, recv) = connection.open_bi().await.ok()?;
            let mut lanes = Vec::new();
            for lane in 0..LANES {
                let mut send = connection.open_uni().await.ok()?;
                send.write_all(&[lane]).await.ok()?;
                lanes.push(send);
            }
            Some((endpoint, connection, lanes, send, recv))
        });
        let (endpoint, connection, lanes, send, recv) = called?;
        Some(Called {
            runtime,
            _endpoint: endpoint,
            _connection: connection,
            lanes,
            send,
            recv,
        })
    }
}

impl Read for Called {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        let read = async { tokio::time::timeout(PATIENCE, self.recv.read(room)).await };
        match self.runtime.block_on(read)? {
            Ok(octets) => Ok(octets.unwrap_or_default()),
            Err(error) => Err(error.into()),
        }
    }
}

impl Write for Called {
    fn write(&mut self, octets: &[u8]) -> io::Result<usize> {
        assert_eq!(self.lanes.len(), usize::from(LANES));
        Ok(self.runtime.block_on(self.send.write(octets))?)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
