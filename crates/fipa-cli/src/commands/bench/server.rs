//! The other end: agents that answer and that take what comes, and a bare socket beside them.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use fipa::{Agent, Message, Performative, Platform, ReceiveError};
use fipa_transport::raw::{RawQuicServer, RawServer};
use serde_json::json;
use tokio::task::JoinSet;

use crate::Failure;

/// Answers under way at once.
const AT_ONCE: usize = 256;

pub(super) struct Server {
    raw: RawServer,
    raw_quic: RawQuicServer,
    about: String,
    echo: Agent,
    sink: Agent,
    _platform: Platform,
}

impl Server {
    /// Binds the bare socket at the endpoint, and the others at free ports beside it.
    pub(super) async fn bind(endpoint: &str) -> Result<Server, Failure> {
        let raw = RawServer::bind(endpoint).await;
        let raw = raw.map_err(|error| match error.kind() {
            io::ErrorKind::InvalidInput => {
                Failure::malformed(format_args!("{endpoint:?} is not HOST:PORT"))
            }
            _ => Failure::environment(format_args!("cannot listen at {endpoint}: {error}")),
        })?;
        let beside = SocketAddr::new(raw.address().ip(), 0).to_string();
        let raw_quic = RawQuicServer::bind(&beside).await;
        let raw_quic = raw_quic.map_err(Failure::environment)?;
        let platform = Platform::builder()
            .name(format!("bench-{}", std::process::id()))
            .mdns(false)
            .listen(beside.as_str())
            .listen(format!("quic://{beside}"))
            .http(beside.as_str(), "/acc")
            .start()
            .await
            .map_err(Failure::environment)?;
        let named = |role: &str| format!("{role}@{}", platform.name());
        let agent = |name: String| async { platform.agent(name).await };
        let echo = agent(named("echo")).await.map_err(Failure::environment)?;
        let sink = agent(named("sink")).await.map_err(Failure::environment)?;
        let (mut tcp, mut quic) = (0, 0);
        for endpoint in platform.endpoints() {
            match endpoint {
                fipa::Address::Tcp { port, .. } => tcp = port,
                fipa::Address::Quic { port, .. } => quic = port,
                _ => {}
            }
        }
        let http = platform.http_urls().first().map(|url| match url {
            fipa::Address::Http { port, .. } => *port,
            _ => 0,
        });
        let about = json!({
            "name": platform.name().as_str(),
            "tcp": tcp,
            "http": http,
            "quic": quic,
            "raw-quic": raw_quic.address().port(),
        });
        Ok(Server {
            raw,
            raw_quic,
            about: about.to_string(),
            echo,
            sink,
            _platform: platform,
        })
    }

    /// Where the other robot finds all of it.
    pub(super) fn address(&self) -> SocketAddr {
        self.raw.address()
    }

    /// Serves until the platform ends.
    pub(super) async fn run(self) -> Result<(), Failure> {
        let Server {
            raw,
            raw_quic,
            about,
            echo,
            sink,
            _platform,
        } = self;
        tokio::select! {
            () = raw_quic.serve() => Ok(()),
            () = raw.serve(about.into()) => Ok(()),
            ended = answer(echo) => Err(Failure::environment(ended)),
            ended = take(&sink) => Err(Failure::environment(ended)),
        }
    }
}

async fn answer(echo: Agent) -> ReceiveError {
    let echo = Arc::new(echo);
    let mut answers = JoinSet::new();
    loop {
        let query: Message = tokio::select! {
            query = echo.receive(), if answers.len() < AT_ONCE => match query {
                Ok(query) => query,
                Err(ReceiveError::Unreadable { .. }) => continue,
                Err(ended) => return ended,
            },
            Some(_) = answers.join_next() => continue,
        };
        let mut answer = query.reply(Performative::Inform);
        answer.content = query.content;
        let echo = Arc::clone(&echo);
        answers.spawn(async move { echo.send(answer).await });
    }
}

async fn take(sink: &Agent) -> ReceiveError {
    loop {
        match sink.receive().await {
            Ok(_) | Err(ReceiveError::Unreadable { .. }) => {}
            Err(ended) => return ended,
        }
    }
}
