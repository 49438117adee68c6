//! The end that measures.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use fipa::{Agent, AgentId, Message, Performative, Platform};
use fipa_transport::raw::{self, RawClient};
use serde_json::Value;
use tokio::task::JoinSet;

use super::{Figures, LARGE, LARGE_WINDOW, PING, SMALL, SMALL_WINDOW, Transport};
use crate::Failure;

/// How long the other end may take to be found, and to answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// The other end.
pub(super) struct Peer {
    address: SocketAddr,
    name: String,
    tcp: u16,
    http: u16,
    quic: u16,
    /// The port of bare QUIC.
    raw_quic: u16,
}

impl Peer {
    /// Asks who serves there.
    pub(super) async fn find(endpoint: &str) -> Result<Peer, Failure> {
        let nobody = |why: &dyn std::fmt::Display| {
            Failure::environment(format_args!(
                "nobody serves at {endpoint}: {why}; run `fipa bench --serve` there"
            ))
        };
        let asked = tokio::time::timeout(PATIENCE, raw::about(endpoint));
        let (address, told) = match asked.await {
            Ok(Ok(told)) => told,
            Ok(Err(error)) if error.kind() == io::ErrorKind::InvalidInput => {
                return Err(Failure::malformed(format_args!(
                    "{endpoint:?} is not HOST:PORT"
                )));
            }
            Ok(Err(error)) => return Err(nobody(&error)),
            Err(_) => return Err(nobody(&"there is no answer")),
        };
        let told: Value =
            serde_json::from_slice(&told).map_err(|_| nobody(&"its answer is of another kind"))?;
        let port = |key: &str| told[key].as_u64().and_then(|port| u16::try_from(port).ok());
        let ports = ["tcp", "http", "quic", "raw-quic"].map(port);
        match (told["name"].as_str(), ports) {
            (Some(name), [Some(tcp), Some(http), Some(quic), Some(raw_quic)]) => Ok(Peer {
                address,
                name: name.to_owned(),
                tcp,
                http,
                quic,
                raw_quic,
            }),
            _ => Err(nobody(&"its answer is of another kind")),
        }
    }

    /// What bare sockets give.
    pub(super) async fn bare(
        &self,
        transport: Transport,
        span: Duration,
    ) -> Result<Figures, Failure> {
        let lost = |error| Failure::environment(format_args!("{}: {error}", self.address));
        let quic = SocketAddr::new(self.address.ip(), self.raw_quic);
        let (echo, sink) = match transport {
            Transport::Tcp | Transport::Http => (
                RawClient::echo(self.address).await,
                RawClient::sink(self.address).await,
            ),
            Transport::Quic => (
                RawClient::quic_echo(quic).await,
                RawClient::quic_sink(quic).await,
            ),
        };
        let (mut echo, mut sink) = (echo.map_err(lost)?, sink.map_err(lost)?);
        let frame = [b'x'; PING];
        let (mut times, begun) = (Vec::new(), Instant::now());
        while begun.elapsed() < span {
            let sent = Instant::now();
            echo.round_trip(&frame).await.map_err(lost)?;
            times.push(sent.elapsed().as_secs_f64() * 1e6);
        }
        let begun = Instant::now();
        let letters = sink.flood(&[b'x'; SMALL], SMALL_WINDOW, span).await;
        let letters = letters.map_err(lost)? as f64 / begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let large = sink.flood(&vec![b'x'; LARGE], LARGE_WINDOW, span).await;
        let large = large.map_err(lost)? as f64 / begun.elapsed().as_secs_f64();
        Ok(Figures {
            times: times.into_iter().collect(),
            letters,
            megabytes: large * LARGE as f64 / 1e6,
        })
    }

    /// An agent that reaches the other end by this transport.
    pub(super) async fn client(&self, transport: Transport) -> Result<Client, Failure> {
        let own = format!("bench-client-{}", std::process::id());
        let builder = Platform::builder().name(own.as_str()).mdns(false);
        let at = |port| SocketAddr::new(self.address.ip(), port);
        let link = match transport {
            Transport::Quic => format!("quic://{}", at(self.quic)),
            Transport::Tcp | Transport::Http => format!("tcp://{}", at(self.tcp)),
        };
        let (builder, url) = match transport {
            Transport::Tcp | Transport::Quic => (builder.peer(link.as_str()), None),
            Transport::Http => {
                // Answers are posted to where the other end sees us.
                let probe = RawClient::echo(self.address).await;
                let local = probe.map_err(Failure::environment)?.local().ip();
                let own = SocketAddr::new(local, 0).to_string();
                let url = format!("http://{}/acc", at(self.http));
                (builder.http(own, "/acc"), Some(url))
            }
        };
        let platform = builder.start().await.map_err(Failure::environment)?;
        let agent = platform.agent(format!("client@{own}")).await;
        let client = Client {
            agent: Arc::new(agent.map_err(Failure::environment)?),
            echo: self.agent("echo", url.as_deref()),
            sink: self.agent("sink", url.as_deref()),
            failure: None,
            _platform: platform.clone(),
        };
        if url.is_none() {
            let found = tokio::time::timeout(PATIENCE, platform.wait_for(&client.sink.name));
            if !matches!(found.await, Ok(Some(_))) {
                return Err(Failure::environment(format_args!(
                    "there is no link with {link}: a firewall may let nothing through to that port"
                )));
            }
        }
        Ok(client)
    }

    fn agent(&self, role: &str, url: Option<&str>) -> AgentId {
        let agent = AgentId::new(format!("{role}@{}", self.name));
        match url {
            Some(url) => agent.address(url.to_owned()),
            None => agent,
        }
    }
}

/// What sends letters by one transport.
pub(super) struct Client {
    agent: Arc<Agent>,
    echo: AgentId,
    sink: AgentId,
    failure: Option<String>,
    _platform: Platform,
}

impl Client {
    pub(super) async fn measure(&mut self, span: Duration) -> Figures {
        let times = self.round_trips(span).await;
        let letters = self.rate(SMALL, SMALL_WINDOW, span).await;
        let large = self.rate(LARGE, LARGE_WINDOW, span).await;
        Figures {
            times: times.into_iter().collect(),
            letters,
            megabytes: large * LARGE as f64 / 1e6,
        }
    }

    /// Why a letter or an answer did not arrive, if one did not.
    pub(super) fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    async fn round_trips(&mut self, span: Duration) -> Vec<f64> {
        let content = Bytes::from_static(&[b'x'; PING]);
        let (mut times, begun) = (Vec::new(), Instant::now());
        while begun.elapsed() < span {
            let query = Message::new(Performative::QueryRef)
                .to(self.echo.clone())
                .content(content.clone());
            let sent = Instant::now();
            match self.agent.request(query, PATIENCE).await {
                Ok(_) => times.push(sent.elapsed().as_secs_f64() * 1e6),
                Err(error) => self.failure = Some(error.to_string()),
            }
        }
        times
    }

    /// Letters a second that arrived.
    async fn rate(&mut self, size: usize, window: u64, span: Duration) -> f64 {
        let content = Bytes::from(vec![b'x'; size]);
        let mut under_way = JoinSet::new();
        let (mut arrived, begun) = (0_u64, Instant::now());
        while begun.elapsed() < span || !under_way.is_empty() {
            while (under_way.len() as u64) < window && begun.elapsed() < span {
                let letter = Message::new(Performative::Inform)
                    .to(self.sink.clone())
                    .content(content.clone());
                let agent = Arc::clone(&self.agent);
                under_way.spawn(async move { agent.send(letter).await });
            }
            let Some(Ok(outcomes)) = under_way.join_next().await else {
                continue;
            };
            match outcomes.iter().find(|told| !told.outcome.is_success()) {
                None => arrived += 1,
                Some(told) => self.failure = Some(told.reason.to_string()),
            }
        }
        arrived as f64 / begun.elapsed().as_secs_f64()
    }
}
