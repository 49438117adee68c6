use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use http_body_util::{BodyExt, Full};
use hyper::body::Incoming;
use hyper::header::{
    ALLOW, CONNECTION, CONTENT_LENGTH, CONTENT_TYPE, HeaderMap, HeaderName, HeaderValue,
};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;
use tokio::time::{Instant, timeout_at};

use super::multipart;
use super::request::{AHEAD, LetterNumber, NUMBER};
use super::series::MAX_AHEAD;

const NUMBER_FIELD: HeaderName = HeaderName::from_static(NUMBER);
const AHEAD_FIELD: HeaderName = HeaderName::from_static(AHEAD);

/// Where JADE's tools look for the description of a platform.
const DESCRIPTION: &str = "/APDescription.txt";

/// What a server takes.
#[derive(Clone, Copy, Debug)]
pub struct HttpLimits {
    /// Octets of the body of one request.
    pub max_body: usize,
    /// Octets of the bodies of all requests together.
    pub max_bodies: usize,
    /// Connections at once; what comes beyond is closed.
    pub max_connections: usize,
    /// How long a request may take to begin, and its head to end.
    pub head: Duration,
    /// How long a body may take beside what its octets are worth.
    pub body: Duration,
    /// Octets of a body that are worth a second each.
    pub slowest: usize,
}

impl Default for HttpLimits {
    fn default() -> HttpLimits {
        HttpLimits {
            max_body: 256 << 20,
            max_bodies: 512 << 20,
            max_connections: 1000,
            head: Duration::from_secs(65),
            body: Duration::from_secs(30),
            slowest: 1000,
        }
    }
}

/// A letter as it was posted.
#[derive(Clone, Debug)]
pub struct Posted {
    /// The octets of the envelope.
    pub envelope: Bytes,
    /// The octets of the payload.
    pub payload: Bytes,
    /// Where it came from.
    pub remote: SocketAddr,
    /// The connection; no other of the same server has this number.
    pub connection: u64,
    /// How many requests came over the connection before.
    pub earlier: u64,
    /// Its number, if others were posted behind it before it is answered.
    pub number: Option<LetterNumber>,
}

/// Why a letter is not taken over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HttpRefusal {
    /// It cannot be read (400).
    Malformed(String),
    /// There is no room for it now (503).
    Overloaded(String),
}

/// Takes what is posted. Its answer is waited for, so it must not take long.
pub trait HttpReceiver: Send + Sync + 'static {
    /// Takes a letter over, or says why not.
    fn letter(&self, posted: Posted) -> Result<(), HttpRefusal>;
    /// The description of the platform for somebody there, as text.
    fn description(&self, remote: SocketAddr) -> Bytes;
}

/// Takes letters over HTTP.
#[derive(Debug)]
pub struct HttpServer {
    listener: TcpListener,
    address: SocketAddr,
    path: String,
    limits: HttpLimits,
}

impl HttpServer {
    /// Binds; port 0 takes a free port. Letters are taken at every path; `path` is that under
    /// which the description can be read as well.
    pub async fn bind(
        host: &str,
        port: u16,
        path: &str,
        limits: HttpLimits,
    ) -> io::Result<HttpServer> {
        let mut found = tokio::net::lookup_host((host, port)).await?;
        let wanted = found
            .next()
            .ok_or_else(|| io::Error::other("the host name has no address"))?;
        let listener = crate::tcp::bind(wanted)?;
        let address = listener.local_addr()?;
        Ok(HttpServer {
            listener,
            address,
            path: path.to_owned(),
            limits,
        })
    }

    /// Where it is bound, with the port that it got.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until the future is dropped; the connections end with it.
    pub async fn serve(self, receiver: impl HttpReceiver) {
        let places = Arc::new(Semaphore::new(self.limits.max_connections));
        let serving = Arc::new(Serving {
            receiver,
            path: self.path,
            limits: self.limits,
            octets: AtomicUsize::new(0),
        });
        let mut connections = JoinSet::new();
        let mut number = 0;
        loop {
            tokio::select! {
                accepted = self.listener.accept() => match accepted {
                    Ok((stream, remote)) => {
                        let Ok(place) = Arc::clone(&places).try_acquire_owned() else {
                            continue;
                        };
                        number += 1;
                        let connection = Connection { number, remote, requests: AtomicUsize::new(0) };
                        let serving = Arc::clone(&serving);
                        connections.spawn(async move {
                            serving.connection(stream, connection).await;
                            drop(place);
                        });
                    }
                    // Out of file descriptors, as a rule.
                    Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
                },
                Some(_) = connections.join_next() => {}
            }
        }
    }
}

struct Connection {
    number: u64,
    remote: SocketAddr,
    requests: AtomicUsize,
}

struct Serving<R> {
    receiver: R,
    path: String,
    limits: HttpLimits,
    /// Octets of bodies that are held now.
    octets: AtomicUsize,
}

/// What a request is answered with.
struct Answer {
    status: StatusCode,
    text: Bytes,
    /// Whether the next request can be read.
    goes_on: bool,
}

impl Answer {
    /// A status with a line that says why. Lines end as the standard says: JADE skips lines until
    /// the next status line.
    fn because(status: StatusCode, why: impl std::fmt::Display) -> Answer {
        let text = Bytes::from(format!("{why}\r\n"));
        Answer {
            status,
            text,
            // What is left of a request that was not taken is not read.
            goes_on: false,
        }
    }

    fn fine(text: Bytes) -> Answer {
        Answer {
            status: StatusCode::OK,
            text,
            goes_on: true,
        }
    }
}

impl<R: HttpReceiver> Serving<R> {
    async fn connection(self: Arc<Self>, stream: TcpStream, connection: Connection) {
        if stream.set_nodelay(true).is_err() {
            return;
        }
        let connection = Arc::new(connection);
        let service = service_fn(|request| {
            let (serving, connection) = (Arc::clone(&self), Arc::clone(&connection));
            async move { Ok::<_, Infallible>(serving.request(request, &connection).await) }
        });
        let served = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(self.limits.head)
            .title_case_headers(true)
            .auto_date_header(false)
            .max_buf_size(64 << 10)
            .serve_connection(TokioIo::new(stream), service);
        // How a connection ends is its own affair: every letter that was whole was answered.
        let _ = served.await;
    }

    async fn request(
        &self,
        request: Request<Incoming>,
        connection: &Connection,
    ) -> Response<Full<Bytes>> {
        let earlier = connection.requests.fetch_add(1, Ordering::Relaxed) as u64;
        let closes = wants_close(request.headers());
        let is_post = request.method() == Method::POST;
        let answer = match *request.method() {
            Method::POST => match self.letter(request, connection, earlier).await {
                Ok(()) => Answer::fine(Bytes::new()),
                Err(answer) => answer,
            },
            Method::GET => self.description(request.uri().path(), connection.remote),
            _ => Answer::because(
                StatusCode::METHOD_NOT_ALLOWED,
                "letters are posted, and the description of the platform is got",
            ),
        };
        let has_text = !answer.text.is_empty();
        let mut response = Response::new(Full::new(answer.text));
        *response.status_mut() = answer.status;
        let headers = response.headers_mut();
        let goes_on = answer.goes_on && !closes;
        let connection = match goes_on {
            true => "Keep-Alive",
            false => "close",
        };
        headers.insert(CONNECTION, HeaderValue::from_static(connection));
        if is_post && goes_on {
            headers.insert(AHEAD_FIELD, HeaderValue::from(MAX_AHEAD));
        }
        if has_text {
            let text = HeaderValue::from_static("text/plain; charset=utf-8");
            response.headers_mut().insert(CONTENT_TYPE, text);
        }
        if answer.status == StatusCode::METHOD_NOT_ALLOWED {
            let allowed = HeaderValue::from_static("GET, POST");
            response.headers_mut().insert(ALLOW, allowed);
        }
        response
    }

    fn description(&self, path: &str, remote: SocketAddr) -> Answer {
        if path == "/" || path == DESCRIPTION || path == self.path {
            return Answer::fine(self.receiver.description(remote));
        }
        Answer::because(StatusCode::NOT_FOUND, "there is nothing here")
    }

    async fn letter(
        &self,
        request: Request<Incoming>,
        connection: &Connection,
        earlier: u64,
    ) -> Result<(), Answer> {
        let malformed = |why: &dyn std::fmt::Display| Answer::because(StatusCode::BAD_REQUEST, why);
        let (head, incoming) = request.into_parts();
        let number = head.headers.get(NUMBER_FIELD);
        let number = number.and_then(|value| value.to_str().ok()?.parse().ok());
        let content_type = head.headers.get(CONTENT_TYPE);
        let content_type = content_type.and_then(|value| value.to_str().ok());
        let boundary =
            multipart::boundary_of(content_type.unwrap_or_default()).map_err(|e| malformed(&e))?;
        let mut held = Held {
            all: &self.octets,
            octets: 0,
        };
        let body = self.body(&head.headers, incoming, &mut held).await?;
        let (envelope, payload) =
            multipart::read(&body, &boundary).map_err(|error| malformed(&error))?;
        let posted = Posted {
            envelope,
            payload,
            remote: connection.remote,
            connection: connection.number,
            earlier,
            number,
        };
        let refused = |refusal| Answer {
            // Whoever posts others behind a letter does not lose them by its fault.
            goes_on: number.is_some(),
            ..match refusal {
                HttpRefusal::Malformed(why) => malformed(&why),
                HttpRefusal::Overloaded(why) => {
                    Answer::because(StatusCode::SERVICE_UNAVAILABLE, why)
                }
            }
        };
        self.receiver.letter(posted).map_err(refused)
    }

    /// Reads a body. What is held of it is no more than what has come.
    async fn body(
        &self,
        headers: &HeaderMap,
        mut incoming: Incoming,
        held: &mut Held<'_>,
    ) -> Result<Bytes, Answer> {
        let HttpLimits {
            max_body,
            max_bodies,
            ..
        } = self.limits;
        let too_large = || {
            let why = format!("a letter has {max_body} octets at most");
            Answer::because(StatusCode::PAYLOAD_TOO_LARGE, why)
        };
        let hint = hyper::body::Body::size_hint(&incoming);
        if hint.lower() > max_body as u64 {
            return Err(too_large());
        }
        if hint.exact() == Some(0) && !headers.contains_key(CONTENT_LENGTH) {
            let why = "the request has neither a Content-Length nor chunks";
            return Err(Answer::because(StatusCode::LENGTH_REQUIRED, why));
        }
        let begun = Instant::now();
        let mut body = BytesMut::new();
        loop {
            let worth = body.len() as f64 / self.limits.slowest.max(1) as f64;
            let until = begun + self.limits.body + Duration::from_secs_f64(worth);
            let Ok(frame) = timeout_at(until, incoming.frame()).await else {
                let why = "the body comes too slowly";
                return Err(Answer::because(StatusCode::REQUEST_TIMEOUT, why));
            };
            let data = match frame {
                None => return Ok(body.freeze()),
                Some(Err(error)) => {
                    return Err(Answer::because(StatusCode::BAD_REQUEST, error));
                }
                Some(Ok(frame)) => frame.into_data(),
            };
            let Ok(data) = data else {
                continue;
            };
            if body.len() + data.len() > max_body {
                return Err(too_large());
            }
            if held.add(data.len()) > max_bodies {
                let why = "too many letters come at once";
                return Err(Answer::because(StatusCode::SERVICE_UNAVAILABLE, why));
            }
            body.extend_from_slice(&data);
        }
    }
}

/// What one body has of the octets that all hold together.
struct Held<'a> {
    all: &'a AtomicUsize,
    octets: usize,
}

impl Held<'_> {
    /// How many all hold with these.
    fn add(&mut self, octets: usize) -> usize {
        self.octets += octets;
        self.all.fetch_add(octets, Ordering::Relaxed) + octets
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.all.fetch_sub(self.octets, Ordering::Relaxed);
    }
}

fn wants_close(headers: &HeaderMap) -> bool {
    let values = headers.get_all(CONNECTION).iter();
    let mut words = values.filter_map(|value| value.to_str().ok());
    words.any(|value| {
        let mut words = value.split(',');
        words.any(|word| word.trim().eq_ignore_ascii_case("close"))
    })
}
