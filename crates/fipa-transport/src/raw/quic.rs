//! The same over one stream of a connection of QUIC, as `quinn` gives it.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use quinn::{Endpoint, Incoming};
use tokio::task::JoinSet;

use super::{AT_ONCE, ECHO, RawClient, SINK, resolve, serve};
use crate::Quic;
use crate::quic::endpoint;

/// The other end of measurements over QUIC.
#[derive(Debug)]
pub struct RawQuicServer {
    endpoint: Endpoint,
    address: SocketAddr,
}

impl RawQuicServer {
    /// Binds; port 0 takes a free port.
    pub async fn bind(at: &str) -> io::Result<RawQuicServer> {
        let quic = Quic::new(None).map_err(io::Error::other)?;
        let config = quic.server(&Arc::default()).map_err(io::Error::other)?;
        let endpoint = endpoint(resolve(at).await?, Some(config))?;
        let address = endpoint.local_addr()?;
        Ok(RawQuicServer { endpoint, address })
    }

    /// Where it is bound, with the port that it got.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until the future is dropped.
    pub async fn serve(self) {
        let mut served = JoinSet::new();
        loop {
            tokio::select! {
                incoming = self.endpoint.accept(), if served.len() < AT_ONCE => match incoming {
                    // How a connection ends is the affair of whoever measures.
                    Some(incoming) => drop(served.spawn(serve_connection(incoming))),
                    None => tokio::time::sleep(Duration::from_millis(100)).await,
                },
                Some(_) = served.join_next() => {}
            }
        }
    }
}

async fn serve_connection(incoming: Incoming) -> io::Result<()> {
    let connection = incoming.await?;
    let (send, recv) = connection.accept_bi().await?;
    serve(recv, send, Bytes::new()).await
}

impl RawClient {
    /// For round trips over QUIC.
    pub async fn quic_echo(server: SocketAddr) -> io::Result<RawClient> {
        RawClient::connect_quic(server, ECHO).await
    }

    /// For what is taken over QUIC.
    pub async fn quic_sink(server: SocketAddr) -> io::Result<RawClient> {
        RawClient::connect_quic(server, SINK).await
    }

    async fn connect_quic(server: SocketAddr, wanted: u8) -> io::Result<RawClient> {
        let quic = Quic::new(None).map_err(io::Error::other)?;
        let socket = quic.socket(server)?;
        let (send, recv) = quic.bare(server).await?.open_bi().await?;
        RawClient::new(Box::new(recv), Box::new(send), socket.local_addr()?, wanted).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn frames_come_back_and_are_counted() {
        let server = RawQuicServer::bind("127.0.0.1:0").await.unwrap();
        let address = server.address();
        tokio::spawn(server.serve());
        let mut echo = RawClient::quic_echo(address).await.unwrap();
        for size in [0, 1, 100, 1 << 20] {
            echo.round_trip(&vec![7; size]).await.unwrap();
        }
        let mut sink = RawClient::quic_sink(address).await.unwrap();
        let span = Duration::from_millis(20);
        assert!(sink.flood(&[7; 256], 64, span).await.unwrap() > 0);
    }
}
