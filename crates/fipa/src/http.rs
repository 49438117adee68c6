//! Letters over HTTP: what comes is handed to the message transport service, and what it wants
//! posted is posted.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Weak};

use bytes::Bytes;
use fipa_acl::Text;
use fipa_directory::{Address, ParseAddressError};
use fipa_mts::{Arrived, Machine, Mts, PostFailure, PostedLetter, Refusal, TakenOver};
use fipa_transport::http::{
    self, HttpClient, HttpLetter, HttpLimits, HttpReceiver, HttpRefusal, HttpServer, PostError,
    Posted,
};
use tokio::runtime::Handle;

use crate::Error;
use crate::management;
use crate::node::Node;

/// Octets of envelopes and delimiters that a body may have beside the largest payload.
const AROUND: usize = 1 << 20;

/// Binds the server, and tells the URL of what was bound.
pub(crate) async fn bind(
    endpoint: &str,
    path: &str,
    max_letter: usize,
) -> Result<(HttpServer, Address), Error> {
    let url = format!("http://{endpoint}{path}");
    let address: Address = url.parse()?;
    let Address::Http { host, port, path } = &address else {
        return Err(ParseAddressError::Shape(url).into());
    };
    let limits = HttpLimits {
        max_body: max_letter.saturating_add(AROUND),
        ..HttpLimits::default()
    };
    let limits = HttpLimits {
        max_bodies: limits.max_bodies.max(limits.max_body),
        ..limits
    };
    let bound = HttpServer::bind(host, *port, path, limits).await;
    let failed = |source: io::Error| Error::Http {
        address: address.clone(),
        source,
    };
    let server = bound.map_err(failed)?;
    let at = server.address();
    let url = Address::http(at.ip().to_string(), at.port(), path);
    Ok((server, url))
}

/// Posts a letter.
pub(crate) async fn post(
    client: &HttpClient,
    letter: &PostedLetter,
) -> Result<TakenOver, PostFailure> {
    told(client.post(written(letter)?, letter.timeout).await)
}

/// Posts a letter behind those for which this was called before, and tells what became of it.
pub(crate) fn post_in_series(
    client: &HttpClient,
    letter: &PostedLetter,
    runtime: &Handle,
    tell: impl FnOnce(Result<TakenOver, PostFailure>) + Send + 'static,
) {
    match written(letter) {
        Ok(posted) => {
            let tell = |result| tell(told(result));
            client.post_in_series(posted, letter.timeout, runtime, tell);
        }
        // Not at once: who posts is at work.
        Err(failure) => drop(runtime.spawn(async move { tell(Err(failure)) })),
    }
}

fn written(letter: &PostedLetter) -> Result<HttpLetter<'_>, PostFailure> {
    let Address::Http { host, port, path } = &*letter.address else {
        let reason = format!("nothing is posted to {}", letter.address);
        return Err(PostFailure::Unreached(reason));
    };
    Ok(HttpLetter {
        host,
        port: *port,
        path,
        envelope: &letter.envelope,
        payload: &letter.payload,
        payload_type: &letter.payload_type,
    })
}

fn told(result: Result<http::TakenOver, PostError>) -> Result<TakenOver, PostFailure> {
    match result {
        Ok(taken) => Ok(TakenOver { ahead: taken.ahead }),
        Err(PostError::Unreached(reason)) => Err(PostFailure::Unreached(reason)),
        Err(PostError::Unanswered(reason)) => Err(PostFailure::Unanswered(reason)),
        Err(refused) => Err(PostFailure::Refused(refused.to_string())),
    }
}

/// Takes what is posted to a service, as long as that is there.
pub(crate) struct Inbox(Weak<Node<Mts>>);

impl Inbox {
    pub(crate) fn of(node: &Arc<Node<Mts>>) -> Inbox {
        Inbox(Arc::downgrade(node))
    }
}

impl HttpReceiver for Inbox {
    fn letter(&self, posted: Posted) -> Result<(), HttpRefusal> {
        let Some(node) = self.0.upgrade() else {
            return Err(HttpRefusal::Overloaded(Refusal::Closing.to_string()));
        };
        let arrived = Arrived {
            envelope: posted.envelope,
            payload: posted.payload,
            remote: Text::from(format!("http://{}", posted.remote)),
            connection: posted.connection,
            earlier: posted.earlier,
            number: posted.number.map(|number| (number.series, number.number)),
        };
        let taken = node.with(|now, mts, _| mts.letter_arrived(now, arrived));
        taken.map_err(|refusal| match refusal {
            Refusal::Closing => HttpRefusal::Overloaded(refusal.to_string()),
            refusal => HttpRefusal::Malformed(refusal.to_string()),
        })
    }

    fn description(&self, remote: SocketAddr) -> Bytes {
        let Some(node) = self.0.upgrade() else {
            return Bytes::new();
        };
        let same_host = remote.ip().to_canonical().is_loopback();
        node.with(|_, mts, _| {
            let urls = management::urls(mts, same_host);
            management::description(&mts.service_name(), urls)
        })
    }
}
