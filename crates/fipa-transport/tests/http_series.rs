//! Letters that are posted before those in front are answered, to servers that allow it and to
//! others.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use fipa_transport::http::{
    HttpClient, HttpLetter, HttpLimits, HttpReceiver, HttpRefusal, HttpServer, LetterNumber,
    PostError, Posted, TakenOver,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Handle;
use tokio::sync::oneshot;

const PATIENCE: Duration = Duration::from_secs(10);

/// An answer that lets eight letters be on their way.
const EIGHT: &str = "HTTP/1.1 200 OK\r\nX-Ahead: 8\r\nContent-Length: 0\r\n\r\n";
const ALONE: &str = "HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n";

/// The client, and where it posts to.
struct Sender {
    client: HttpClient,
    port: u16,
}

impl Sender {
    fn to(port: u16) -> Sender {
        Sender {
            client: HttpClient::new(),
            port,
        }
    }

    fn letter<'a>(&self, payload: &'a str) -> HttpLetter<'a> {
        HttpLetter {
            host: "127.0.0.1",
            port: self.port,
            path: "/acc",
            envelope: b"<envelope/>",
            payload: payload.as_bytes(),
            payload_type: "application/text",
        }
    }

    fn post(&self, payload: &str) -> oneshot::Receiver<Result<TakenOver, PostError>> {
        self.post_within(payload, PATIENCE)
    }

    fn post_within(
        &self,
        payload: &str,
        timeout: Duration,
    ) -> oneshot::Receiver<Result<TakenOver, PostError>> {
        let letter = self.letter(payload);
        let (tell, told) = oneshot::channel();
        let tell = |answer| tell.send(answer).unwrap();
        self.client
            .post_in_series(letter, timeout, &Handle::current(), tell);
        told
    }
}

async fn listener() -> (TcpListener, Sender) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    (listener, Sender::to(port))
}

/// A connection of a server that reads requests one by one.
struct Connection {
    stream: TcpStream,
    octets: Vec<u8>,
}

impl Connection {
    async fn accept(listener: &TcpListener) -> Connection {
        Connection {
            stream: listener.accept().await.unwrap().0,
            octets: Vec::new(),
        }
    }

    /// The number of the next letter, and its payload.
    async fn request(&mut self) -> (LetterNumber, String) {
        loop {
            let text = String::from_utf8_lossy(&self.octets).into_owned();
            if let Some((head, body)) = text.split_once("\r\n\r\n") {
                let field = |name: &str| {
                    let value = head.split(name).nth(1).unwrap();
                    value.split("\r\n").next().unwrap().trim()
                };
                let length: usize = field("Content-Length:").parse().unwrap();
                if body.len() >= length {
                    self.octets.drain(..head.len() + 4 + length);
                    let payload = body[..length].split("application/text\r\n\r\n").nth(1);
                    let payload = payload.unwrap().split("\r\n").next().unwrap();
                    return (field("x-letter:").parse().unwrap(), payload.to_owned());
                }
            }
            assert_ne!(self.stream.read_buf(&mut self.octets).await.unwrap(), 0);
        }
    }

    async fn requests(&mut self, count: usize) -> Vec<(LetterNumber, String)> {
        let mut come = Vec::new();
        for _ in 0..count {
            come.push(self.request().await);
        }
        come
    }

    async fn answer(&mut self, answer: &str) {
        self.stream.write_all(answer.as_bytes()).await.unwrap();
    }

    /// Nothing more has come after a while.
    async fn expect_nothing(&mut self) {
        let more = self.stream.read_buf(&mut self.octets);
        let more = tokio::time::timeout(Duration::from_millis(100), more).await;
        assert!(more.is_err() && self.octets.is_empty());
    }
}

fn payloads(come: &[(LetterNumber, String)]) -> Vec<&str> {
    come.iter().map(|(_, payload)| payload.as_str()).collect()
}

#[tokio::test]
async fn the_first_letter_is_alone_until_its_answer_lets_others_follow() {
    let (listener, sender) = listener().await;
    let names: Vec<String> = (0..12).map(|n| n.to_string()).collect();
    let told: Vec<_> = names.iter().map(|name| sender.post(name)).collect();
    let mut connection = Connection::accept(&listener).await;
    let first = connection.requests(1).await;
    connection.expect_nothing().await;
    connection.answer(EIGHT).await;
    let mut come = connection.requests(8).await;
    connection.expect_nothing().await;
    connection.answer(EIGHT).await;
    connection.answer(EIGHT).await;
    come.extend(connection.requests(2).await);
    connection.expect_nothing().await;
    for _ in 0..8 {
        connection.answer(EIGHT).await;
    }
    come.extend(connection.requests(1).await);
    connection.answer(EIGHT).await;
    for result in told {
        assert_eq!(result.await.unwrap(), Ok(TakenOver { ahead: 8 }));
    }
    come.insert(0, first[0].clone());
    assert_eq!(payloads(&come), names);
    for (at, (number, _)) in come.iter().enumerate() {
        assert_eq!(
            (number.series, number.number),
            (come[0].0.series, at as u64 + 1)
        );
    }
}

#[tokio::test]
async fn a_series_begins_on_a_connection_that_is_open_already() {
    let (listener, sender) = listener().await;
    let serving = tokio::spawn(async move {
        let mut connection = Connection::accept(&listener).await;
        let mut letter = [0; 1024];
        assert_ne!(connection.stream.read(&mut letter).await.unwrap(), 0);
        connection.answer(EIGHT).await;
        assert_eq!(connection.request().await.1, "b");
        connection.answer(EIGHT).await;
    });
    let first = sender.letter("a");
    let taken = sender.client.post(first, PATIENCE).await;
    assert_eq!(taken, Ok(TakenOver { ahead: 8 }));
    assert!(sender.post("b").await.unwrap().is_ok());
    serving.await.unwrap();
}

#[tokio::test]
async fn a_server_that_knows_no_numbers_gets_a_letter_when_it_has_answered_the_one_in_front() {
    let (listener, sender) = listener().await;
    let told = ["a", "b", "c"].map(|payload| sender.post(payload));
    let mut connection = Connection::accept(&listener).await;
    for payload in ["a", "b", "c"] {
        assert_eq!(connection.request().await.1, payload);
        connection.expect_nothing().await;
        connection.answer(ALONE).await;
    }
    for result in told {
        assert_eq!(result.await.unwrap(), Ok(TakenOver { ahead: 0 }));
    }
}

#[tokio::test]
async fn an_answer_that_allows_less_holds_what_follows() {
    let (listener, sender) = listener().await;
    let told = ["a", "b", "c", "d", "e"].map(|payload| sender.post(payload));
    let mut connection = Connection::accept(&listener).await;
    connection.request().await;
    let three = "HTTP/1.1 200 OK\r\nX-Ahead: 3\r\nContent-Length: 2\r\n\r\nok";
    connection.answer(three).await;
    assert_eq!(payloads(&connection.requests(3).await), ["b", "c", "d"]);
    for _ in 0..2 {
        connection.answer(ALONE).await;
        connection.expect_nothing().await;
    }
    connection.answer(ALONE).await;
    assert_eq!(connection.request().await.1, "e");
    connection.answer(ALONE).await;
    for result in told {
        assert!(result.await.unwrap().is_ok());
    }
}

#[tokio::test]
async fn what_was_not_answered_when_a_connection_ends_comes_again_in_order_with_its_numbers() {
    let (listener, sender) = listener().await;
    let told = ["a", "b", "c", "d"].map(|payload| sender.post(payload));
    let mut connection = Connection::accept(&listener).await;
    connection.request().await;
    connection.answer(EIGHT).await;
    let come = connection.requests(3).await;
    connection.answer(EIGHT).await;
    drop(connection);
    let mut connection = Connection::accept(&listener).await;
    let mut again = connection.requests(1).await;
    // Whoever answers now may be another one.
    connection.expect_nothing().await;
    connection.answer(EIGHT).await;
    again.extend(connection.requests(1).await);
    connection.answer(EIGHT).await;
    assert_eq!(again, come[1..]);
    for result in told {
        assert!(result.await.unwrap().is_ok());
    }
}

#[tokio::test]
async fn behind_a_refusal_that_ends_the_connection_letters_go_on_over_a_new_one() {
    let (listener, sender) = listener().await;
    let [a, b, c] = ["a", "b", "c"].map(|payload| sender.post(payload));
    let mut connection = Connection::accept(&listener).await;
    connection.request().await;
    connection.answer(EIGHT).await;
    connection.requests(2).await;
    let no = "HTTP/1.1 406 Not Acceptable\r\nConnection: close\r\n\r\n";
    connection.answer(no).await;
    let mut connection = Connection::accept(&listener).await;
    assert_eq!(connection.request().await.1, "c");
    connection.answer(ALONE).await;
    assert!(a.await.unwrap().is_ok() && c.await.unwrap().is_ok());
    let refused = b.await.unwrap();
    assert!(matches!(
        refused,
        Err(PostError::Refused { status: 406, .. })
    ));
}

#[tokio::test]
async fn a_letter_that_is_not_answered_in_time_says_so_and_those_behind_it_go_on() {
    let (listener, sender) = listener().await;
    let a = sender.post("a");
    let b = sender.post_within("b", Duration::from_millis(200));
    let c = sender.post("c");
    let mut connection = Connection::accept(&listener).await;
    connection.request().await;
    connection.answer(EIGHT).await;
    connection.requests(2).await;
    let late = b.await.unwrap();
    assert!(matches!(late, Err(PostError::Unanswered(_))), "{late:?}");
    let mut connection = Connection::accept(&listener).await;
    assert_eq!(connection.request().await.1, "c");
    connection.answer(ALONE).await;
    assert!(a.await.unwrap().is_ok() && c.await.unwrap().is_ok());
}

#[tokio::test]
async fn what_is_lost_twice_may_have_arrived_if_it_was_written_and_has_not_if_it_was_not() {
    let (listener, sender) = listener().await;
    let [a, b] = ["a", "b"].map(|payload| sender.post(payload));
    for _ in 0..2 {
        let mut connection = Connection::accept(&listener).await;
        assert_eq!(connection.request().await.1, "a");
    }
    let a = a.await.unwrap();
    assert!(matches!(a, Err(PostError::Unanswered(_))), "{a:?}");
    let mut connection = Connection::accept(&listener).await;
    assert_eq!(connection.request().await.1, "b");
    connection.answer(ALONE).await;
    assert!(b.await.unwrap().is_ok());
    // More than the system takes, with another one behind.
    let unwritten = [&"x".repeat(64 << 20), "c"].map(|payload| sender.post(payload));
    drop(connection);
    drop(listener.accept().await.unwrap());
    for told in unwritten {
        let told = told.await.unwrap();
        assert!(matches!(told, Err(PostError::Unreached(_))), "{told:?}");
    }
    let address = listener.local_addr().unwrap();
    drop(listener);
    let nobody = sender.post("c").await.unwrap();
    assert!(matches!(nobody, Err(PostError::Unreached(_))), "{nobody:?}");
    // The next series begins.
    let listener = TcpListener::bind(address).await.unwrap();
    let d = sender.post("d");
    let mut connection = Connection::accept(&listener).await;
    assert_eq!(connection.request().await.1, "d");
    connection.answer(ALONE).await;
    assert!(d.await.unwrap().is_ok());
}

/// Keeps what comes, and refuses what says so.
#[derive(Clone, Default)]
struct Inbox(Arc<Mutex<Vec<Posted>>>);

impl HttpReceiver for Inbox {
    fn letter(&self, posted: Posted) -> Result<(), HttpRefusal> {
        if posted.payload.starts_with(b"bad") {
            return Err(HttpRefusal::Malformed("it is bad".to_owned()));
        }
        if posted.payload.starts_with(b"full") {
            return Err(HttpRefusal::Overloaded("there is no room".to_owned()));
        }
        self.0.lock().unwrap().push(posted);
        Ok(())
    }

    fn description(&self, _: SocketAddr) -> Bytes {
        Bytes::new()
    }
}

#[tokio::test]
async fn our_server_takes_a_series_in_order_over_one_connection_whatever_it_refuses() {
    let limits = HttpLimits::default();
    let server = HttpServer::bind("127.0.0.1", 0, "/acc", limits)
        .await
        .unwrap();
    let (port, inbox) = (server.address().port(), Inbox::default());
    let serving = tokio::spawn(server.serve(inbox.clone()));
    let sender = Sender::to(port);
    let payload = |n: usize| match n % 50 {
        7 => format!("bad {n}"),
        9 => format!("full {n}"),
        10 => format!("{n} {}", "x".repeat(60_000)),
        _ => n.to_string(),
    };
    let told: Vec<_> = (0..1000).map(|n| sender.post(&payload(n))).collect();
    for (n, result) in told.into_iter().enumerate() {
        let result = result.await.unwrap();
        match (n % 50, result) {
            (7, Err(PostError::Refused { status: 400, .. })) => {}
            (9, Err(PostError::Refused { status: 503, .. })) => {}
            (7 | 9, other) => panic!("{n}: {other:?}"),
            (_, result) => assert!(result.is_ok_and(|taken| taken.ahead > 1), "{n}"),
        }
    }
    serving.abort();
    let come = std::mem::take(&mut *inbox.0.lock().unwrap());
    let expected = (0..1000).filter(|n| !matches!(n % 50, 7 | 9));
    let expected: Vec<(u64, String)> = expected.map(|n| (n as u64 + 1, payload(n))).collect();
    let found = come.iter().map(|posted| {
        let payload = String::from_utf8(posted.payload.to_vec()).unwrap();
        (posted.number.unwrap().number, payload)
    });
    assert_eq!(found.collect::<Vec<_>>(), expected);
    assert!(
        come.iter()
            .all(|posted| posted.connection == come[0].connection)
    );
}
