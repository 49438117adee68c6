//! Taking letters over HTTP from clients that behave, and from others.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use fipa_transport::http::{
    HttpClient, HttpLetter, HttpLimits, HttpReceiver, HttpRefusal, HttpServer, Posted,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::AbortHandle;

/// Keeps what comes; refuses what says so.
#[derive(Clone, Default)]
struct Inbox(Arc<Mutex<Vec<Posted>>>);

impl HttpReceiver for Inbox {
    fn letter(&self, posted: Posted) -> Result<(), HttpRefusal> {
        match &posted.envelope[..] {
            b"<bad/>" => Err(HttpRefusal::Malformed("it is bad".to_owned())),
            b"<full/>" => Err(HttpRefusal::Overloaded("it is full".to_owned())),
            _ => {
                self.0.lock().unwrap().push(posted);
                Ok(())
            }
        }
    }

    fn description(&self, _: SocketAddr) -> Bytes {
        Bytes::from_static(b"(ap-description :name robot1)")
    }
}

impl Inbox {
    fn payloads(&self) -> Vec<Bytes> {
        let come = self.0.lock().unwrap();
        come.iter().map(|posted| posted.payload.clone()).collect()
    }
}

struct Server {
    address: SocketAddr,
    inbox: Inbox,
    task: AbortHandle,
}

impl Drop for Server {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn serve_at(host: &str, limits: HttpLimits) -> Server {
    let server = HttpServer::bind(host, 0, "/acc", limits).await.unwrap();
    let (address, inbox) = (server.address(), Inbox::default());
    let task = tokio::spawn(server.serve(inbox.clone())).abort_handle();
    Server {
        address,
        inbox,
        task,
    }
}

async fn serve(limits: HttpLimits) -> Server {
    serve_at("127.0.0.1", limits).await
}

/// Sends octets, ends, and tells everything that comes back.
async fn exchange(server: &Server, octets: impl AsRef<[u8]>) -> String {
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    // A server that does not want the rest may have closed by now.
    let _ = stream.write_all(octets.as_ref()).await;
    let _ = stream.shutdown().await;
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer).await;
    String::from_utf8(answer).unwrap()
}

const BODY: &str = "--B\r\n\r\n<e/>\r\n--B\r\n\r\n(inform)\r\n--B--\r\n";
const MIXED: &str = "Content-Type: multipart/mixed; boundary=\"B\"\r\n";

fn post(headers: &str, body: &str) -> String {
    let length = body.len();
    format!("POST /acc HTTP/1.1\r\nHost: h\r\n{headers}Content-Length: {length}\r\n\r\n{body}")
}

const TAKEN: &str =
    "HTTP/1.1 200 OK\r\nConnection: Keep-Alive\r\nX-Ahead: 64\r\nContent-Length: 0\r\n\r\n";

#[tokio::test]
async fn a_letter_is_answered_at_once_and_the_connection_stays() {
    let server = serve(HttpLimits::default()).await;
    assert_eq!(exchange(&server, post(MIXED, BODY)).await, TAKEN);
    // JADE ends a request with one line end that it does not count.
    let twice = [post(MIXED, BODY), post(MIXED, BODY)].join("\r\n") + "\r\n";
    assert_eq!(exchange(&server, twice).await, TAKEN.repeat(2));
    let come = server.inbox.0.lock().unwrap();
    let numbers: Vec<_> = come.iter().map(|p| (p.connection, p.earlier)).collect();
    assert_eq!(numbers, [(1, 0), (2, 0), (2, 1)]);
    assert!(come.iter().all(|posted| posted.payload == "(inform)"));
}

#[tokio::test]
async fn whoever_wants_the_connection_closed_gets_it_closed() {
    let server = serve(HttpLimits::default()).await;
    let answer = exchange(
        &server,
        post(&format!("{MIXED}Connection: close\r\n"), BODY),
    )
    .await;
    assert!(
        answer.starts_with("HTTP/1.1 200 OK\r\nConnection: close\r\n"),
        "{answer}"
    );
}

#[tokio::test]
async fn requests_of_every_shape_are_taken() {
    let server = serve(HttpLimits::default()).await;
    let chunks = format!(
        "POST http://h:1/x HTTP/1.1\r\nHost: h\r\ncontent-type: multipart-mixed ;boundary=B\r\n\
         Transfer-Encoding: chunked\r\n\r\n5\r\n--B\r\n\r\n{:x}\r\n{}\r\n0\r\n\r\n",
        BODY.len() - 5,
        &BODY[5..]
    );
    let old = post(MIXED, BODY)
        .replace("HTTP/1.1", "HTTP/1.0")
        .replace("Host: h\r\n", "");
    let folded = post(
        "Content-Type: multipart/mixed ; charset=x; boundary=\"B\"\r\n",
        BODY,
    );
    for request in [chunks, old, folded] {
        let answer = exchange(&server, &request).await;
        assert!(answer.contains(" 200 OK\r\n"), "{request}\n{answer}");
    }
    assert_eq!(server.inbox.payloads().len(), 3);
}

#[tokio::test]
async fn payloads_keep_every_octet() {
    let server = serve(HttpLimits::default()).await;
    let client = HttpClient::new();
    let payloads = ["(inform)\r", "(inform)\r\n", "", "\r\n--", "(inform)\n"].map(Bytes::from);
    for payload in &payloads {
        let letter = letter_to(server.address, payload);
        client.post(letter, Duration::from_secs(5)).await.unwrap();
    }
    assert_eq!(server.inbox.payloads(), payloads);
}

fn letter_to(address: SocketAddr, payload: &[u8]) -> HttpLetter<'_> {
    HttpLetter {
        host: if address.is_ipv6() {
            "::1"
        } else {
            "127.0.0.1"
        },
        port: address.port(),
        path: "/acc",
        envelope: b"<e/>",
        payload,
        payload_type: "application/text",
    }
}

#[tokio::test]
async fn letters_go_over_ipv6() {
    if tokio::net::TcpListener::bind("[::1]:0").await.is_err() {
        println!("skipped: needs IPv6");
        return;
    }
    let server = serve_at("::1", HttpLimits::default()).await;
    let letter = letter_to(server.address, b"(inform)");
    HttpClient::new()
        .post(letter, Duration::from_secs(5))
        .await
        .unwrap();
    assert_eq!(server.inbox.payloads(), ["(inform)"]);
}

#[tokio::test]
async fn the_description_is_got_where_tools_look_for_it() {
    let server = serve(HttpLimits::default()).await;
    for path in ["/", "/acc", "/APDescription.txt", "http://h:1/acc"] {
        let answer = exchange(&server, format!("GET {path} HTTP/1.1\r\nHost: h\r\n\r\n")).await;
        assert!(answer.starts_with("HTTP/1.1 200 OK\r\n"), "{answer}");
        assert!(
            answer.ends_with("\r\n\r\n(ap-description :name robot1)"),
            "{answer}"
        );
    }
}

#[tokio::test]
async fn bad_requests_get_the_status_of_their_fault() {
    let server = serve(HttpLimits {
        max_body: 1000,
        body: Duration::from_millis(200),
        ..HttpLimits::default()
    })
    .await;
    let short = format!("POST / HTTP/1.1\r\nHost: h\r\n{MIXED}Content-Length: 20\r\n\r\n{BODY}");
    let long = format!("POST / HTTP/1.1\r\nHost: h\r\n{MIXED}Content-Length: 900\r\n\r\n{BODY}");
    let none = format!("POST / HTTP/1.1\r\nHost: h\r\n{MIXED}\r\n{BODY}");
    let bad = BODY.replace("<e/>", "<bad/>");
    let full = BODY.replace("<e/>", "<full/>");
    for (request, status) in [
        (post("Content-Type: multipart/mixed\r\n", BODY), 400),
        (post("Content-Type: text/plain\r\n", BODY), 400),
        (post("", BODY), 400),
        (post(MIXED, &BODY[..30]), 400),
        (post(MIXED, &bad), 400),
        (post(MIXED, &full), 503),
        (post(MIXED, &"x".repeat(1001)), 413),
        (short, 400),
        (none, 411),
        (
            "PUT /acc HTTP/1.1\r\nHost: h\r\nContent-Length: 0\r\n\r\n".to_owned(),
            405,
        ),
        ("DELETE / HTTP/1.1\r\nHost: h\r\n\r\n".to_owned(), 405),
        ("GET /other HTTP/1.1\r\nHost: h\r\n\r\n".to_owned(), 404),
        ("no request\r\n\r\n".to_owned(), 400),
    ] {
        let answer = exchange(&server, &request).await;
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {status} ")),
            "{request}\n{answer}"
        );
        assert!(!answer.contains("Keep-Alive"), "{answer}");
    }
    // What is announced and does not come is not waited for for ever.
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    stream.write_all(long.as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 408 "), "{answer}");
    assert_eq!(server.inbox.payloads().len(), 0);
}

#[tokio::test]
async fn an_endless_body_in_chunks_is_cut_off() {
    let server = serve(HttpLimits {
        max_body: 100_000,
        ..HttpLimits::default()
    })
    .await;
    let mut stream = TcpStream::connect(server.address).await.unwrap();
    let head = format!("POST / HTTP/1.1\r\nHost: h\r\n{MIXED}Transfer-Encoding: chunked\r\n\r\n");
    stream.write_all(head.as_bytes()).await.unwrap();
    let chunk = format!("1000\r\n{}\r\n", "x".repeat(4096));
    let mut written = 0;
    while stream.write_all(chunk.as_bytes()).await.is_ok() {
        written += chunk.len();
        assert!(written < 64 << 20, "nobody stops it");
    }
}

#[tokio::test]
async fn one_octet_at_a_time_is_too_slow() {
    let server = serve(HttpLimits {
        head: Duration::from_millis(200),
        body: Duration::from_millis(200),
        ..HttpLimits::default()
    })
    .await;
    for (begun, status) in [
        (post(MIXED, BODY), "HTTP/1.1 408 "),
        ("POST / H".to_owned(), ""),
    ] {
        let begun = &begun[..begun.len().min(120)];
        let mut stream = TcpStream::connect(server.address).await.unwrap();
        stream.write_all(begun.as_bytes()).await.unwrap();
        let mut octets = 0;
        let mut answer = Vec::new();
        while answer.is_empty() && octets < 1000 {
            octets += 1;
            if stream.write_all(b"x").await.is_err() {
                break;
            }
            let read = stream.read_buf(&mut answer);
            if let Ok(Ok(0)) = tokio::time::timeout(Duration::from_millis(20), read).await {
                break;
            }
        }
        assert!(octets < 1000, "{begun}");
        let answer = String::from_utf8(answer).unwrap();
        assert!(answer.starts_with(status), "{answer}");
    }
}

#[tokio::test]
async fn all_bodies_together_are_bounded_and_what_ended_is_given_back() {
    let server = serve(HttpLimits {
        max_bodies: 3000,
        ..HttpLimits::default()
    })
    .await;
    let begun = format!("POST / HTTP/1.1\r\nHost: h\r\n{MIXED}Content-Length: 2600\r\n\r\n");
    let mut waiting = TcpStream::connect(server.address).await.unwrap();
    waiting
        .write_all((begun.clone() + &"x".repeat(2500)).as_bytes())
        .await
        .unwrap();
    let padded = BODY.to_owned() + &"x".repeat(600);
    loop {
        let answer = exchange(&server, post(MIXED, &padded)).await;
        // The close of a connection whose letter is not read may overtake the answer.
        if answer.starts_with("HTTP/1.1 503 ") || answer.is_empty() {
            break;
        }
        assert_eq!(answer, TAKEN);
    }
    drop(waiting);
    while exchange(&server, post(MIXED, &padded)).await != TAKEN {}
}

#[tokio::test]
async fn connections_are_bounded() {
    let server = serve(HttpLimits {
        max_connections: 2,
        ..HttpLimits::default()
    })
    .await;
    let mut first = TcpStream::connect(server.address).await.unwrap();
    let second = TcpStream::connect(server.address).await.unwrap();
    let mut third = TcpStream::connect(server.address).await.unwrap();
    let mut answer = Vec::new();
    // Closed with nothing said, or reset.
    let _ = third.read_to_end(&mut answer).await;
    assert!(answer.is_empty());
    first.write_all(post(MIXED, BODY).as_bytes()).await.unwrap();
    let mut taken = [0; TAKEN.len()];
    first.read_exact(&mut taken).await.unwrap();
    drop(second);
    while exchange(&server, post(MIXED, BODY)).await != TAKEN {}
}
