//! Posting letters to servers that answer as JADE does, and worse.

use std::time::Duration;

use bytes::Bytes;
use fipa_transport::http::{HttpClient, HttpLetter, PostError, TakenOver};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

const PATIENCE: Duration = Duration::from_secs(10);

/// JADE's answer: no length, though the connection stays open.
const JADE: &str = "HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nCache-Control: no-cache\r\n\
    Connection: Keep-Alive\r\n\r\n<html><body><h1>200 OK</h1></body></html>\r\n";

async fn listener() -> (TcpListener, HttpLetter<'static>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let letter = HttpLetter {
        host: "127.0.0.1",
        port: listener.local_addr().unwrap().port(),
        path: "/acc",
        envelope: b"<envelope/>",
        payload: b"(inform)",
        payload_type: "application/text",
    };
    (listener, letter)
}

/// Reads one request as JADE does: the head, and as many octets as it says.
async fn request(stream: &mut TcpStream) -> (String, Bytes) {
    let mut octets = Vec::new();
    let end = loop {
        if let Some(at) = octets.windows(4).position(|w| w == b"\r\n\r\n") {
            break at + 4;
        }
        assert_ne!(stream.read_buf(&mut octets).await.unwrap(), 0);
    };
    let head = String::from_utf8(octets[..end].to_vec()).unwrap();
    let length = head.split("\r\nContent-Length: ").nth(1).unwrap();
    let length: usize = length.split("\r\n").next().unwrap().parse().unwrap();
    while octets.len() < end + length {
        assert_ne!(stream.read_buf(&mut octets).await.unwrap(), 0);
    }
    assert_eq!(octets.len(), end + length, "more than was announced");
    (head, octets.split_off(end).into())
}

#[tokio::test]
async fn a_request_is_what_jade_reads() {
    let (listener, letter) = listener().await;
    let port = letter.port;
    let server = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let (head, body) = request(&mut stream).await;
        stream.write_all(JADE.as_bytes()).await.unwrap();
        (head, body)
    });
    HttpClient::new().post(letter, PATIENCE).await.unwrap();
    let (head, body) = server.await.unwrap();
    let lines: Vec<&str> = head.split("\r\n").collect();
    assert_eq!(
        lines[0],
        format!("POST http://127.0.0.1:{port}/acc HTTP/1.1")
    );
    let names = lines[1..lines.len() - 2]
        .iter()
        .map(|line| line.split_once(": ").unwrap().0);
    assert_eq!(
        names.collect::<Vec<_>>(),
        [
            "Cache-Control",
            "Mime-Version",
            "Host",
            "Content-Type",
            "Content-Length",
            "Connection"
        ]
    );
    let content_type = lines[4].split_once(": ").unwrap().1;
    let boundary = content_type.split('"').nth(1).unwrap();
    assert_eq!(boundary.len(), 31);
    assert_eq!(
        content_type,
        format!("multipart/mixed ; boundary=\"{boundary}\"")
    );
    let text = format!(
        "This is not part of the MIME multipart encoded message.\r\n\
         --{boundary}\r\nContent-Type: application/xml\r\n\r\n<envelope/>\r\n\
         --{boundary}\r\nContent-Type: application/text\r\n\r\n(inform)\r\n--{boundary}--\r\n"
    );
    assert_eq!(body, text);
}

#[tokio::test]
async fn letters_go_over_one_connection_while_each_answer_has_a_body_without_length() {
    let (listener, letter) = listener().await;
    let server = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        for number in 0..20 {
            request(&mut stream).await;
            // The body comes with the head, or with the head of the next answer.
            let (head, body) = JADE.split_at(JADE.len() - 43 + number);
            stream.write_all(head.as_bytes()).await.unwrap();
            tokio::task::yield_now().await;
            stream.write_all(body.as_bytes()).await.unwrap();
        }
    });
    let client = HttpClient::new();
    for _ in 0..20 {
        client.post(letter, PATIENCE).await.unwrap();
    }
    server.await.unwrap();
}

#[tokio::test]
async fn what_a_kept_connection_did_not_answer_is_posted_again_over_a_new_one() {
    let (listener, letter) = listener().await;
    let server = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        request(&mut stream).await;
        stream.write_all(JADE.as_bytes()).await.unwrap();
        let (_, first) = request(&mut stream).await;
        drop(stream);
        let (mut stream, _) = listener.accept().await.unwrap();
        let (_, second) = request(&mut stream).await;
        stream.write_all(JADE.as_bytes()).await.unwrap();
        (first.len(), second.len())
    });
    let client = HttpClient::new();
    client.post(letter, PATIENCE).await.unwrap();
    client.post(letter, PATIENCE).await.unwrap();
    let (first, second) = server.await.unwrap();
    assert_eq!(first, second);
}

#[tokio::test]
async fn what_is_left_of_the_answer_before_is_no_answer() {
    let (listener, letter) = listener().await;
    let server = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        request(&mut stream).await;
        let (head, body) = JADE.split_at(JADE.len() - 43);
        stream.write_all(head.as_bytes()).await.unwrap();
        // The rest comes when the next letter is on its way already, and the end with it.
        request(&mut stream).await;
        stream.write_all(body.as_bytes()).await.unwrap();
        drop(stream);
        let (mut stream, _) = listener.accept().await.unwrap();
        request(&mut stream).await;
        stream.write_all(JADE.as_bytes()).await.unwrap();
    });
    let client = HttpClient::new();
    client.post(letter, PATIENCE).await.unwrap();
    client.post(letter, PATIENCE).await.unwrap();
    server.await.unwrap();
}

#[tokio::test]
async fn a_connection_that_ended_while_it_was_idle_is_not_used() {
    let (listener, letter) = listener().await;
    let server = tokio::spawn(async move {
        for _ in 0..2 {
            let (mut stream, _) = listener.accept().await.unwrap();
            request(&mut stream).await;
            stream.write_all(JADE.as_bytes()).await.unwrap();
        }
    });
    let client = HttpClient::new();
    client.post(letter, PATIENCE).await.unwrap();
    client.post(letter, PATIENCE).await.unwrap();
    server.await.unwrap();
}

async fn answered_with(answer: &'static str) -> Result<TakenOver, PostError> {
    let (listener, letter) = listener().await;
    let server = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        request(&mut stream).await;
        stream.write_all(answer.as_bytes()).await.unwrap();
        // The letter is posted once, whatever the answer is.
        let again = tokio::time::timeout(Duration::from_millis(50), listener.accept());
        assert!(again.await.is_err());
    });
    let result = HttpClient::new().post(letter, PATIENCE).await;
    server.await.unwrap();
    result
}

#[tokio::test]
async fn only_200_says_that_the_letter_was_taken_over() {
    for answer in [
        JADE,
        "HTTP/1.1 200 OK\r\nContent-Length: 0\r\nConnection: Keep-Alive\r\n\r\n",
        "HTTP/1.0 200 OK\r\n\r\n",
        "HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 200 OK\r\nConnection: close\r\n\r\n",
        "\r\njunk\r\nHTTP/1.1 200 OK\r\n\r\n",
    ] {
        assert_eq!(
            answered_with(answer).await,
            Ok(TakenOver::default()),
            "{answer}"
        );
    }
    for (answer, status) in [
        (
            "HTTP/1.1 406 Not Acceptable\r\nConnection: close\r\n\r\n",
            406,
        ),
        ("HTTP/1.1 202 Accepted\r\nContent-Length: 0\r\n\r\n", 202),
        (
            "HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:1/\r\n\r\n",
            302,
        ),
    ] {
        let result = answered_with(answer).await;
        let is_refused =
            matches!(&result, Err(PostError::Refused { status: s, .. }) if *s == status);
        assert!(is_refused, "{result:?}");
    }
    for answer in [
        "",
        "HTTP/1.1 200",
        "\x16\x03\x01",
        "HTTP/1.x 200 OK\r\n\r\n",
    ] {
        let result = answered_with(answer).await;
        assert!(
            matches!(result, Err(PostError::Unanswered(_))),
            "{answer}: {result:?}"
        );
    }
}

#[tokio::test]
async fn nobody_is_waited_for_longer_than_told() {
    let (listener, letter) = listener().await;
    let short = Duration::from_millis(100);
    let result = HttpClient::new().post(letter, short).await;
    assert!(
        matches!(result, Err(PostError::Unanswered(_))),
        "{result:?}"
    );
    let payload = vec![b'x'; 64 << 20];
    let large = HttpLetter {
        payload: &payload,
        ..letter
    };
    let result = HttpClient::new().post(large, short).await;
    assert!(matches!(result, Err(PostError::Unreached(_))), "{result:?}");
    drop(listener);
    let result = HttpClient::new().post(letter, PATIENCE).await;
    assert!(matches!(result, Err(PostError::Unreached(_))), "{result:?}");
}

#[tokio::test]
async fn letters_that_are_posted_at_once_each_have_a_connection() {
    let (listener, letter) = listener().await;
    let server = tokio::spawn(async move {
        let (mut one, _) = listener.accept().await.unwrap();
        let (mut two, _) = listener.accept().await.unwrap();
        request(&mut one).await;
        request(&mut two).await;
        two.write_all(JADE.as_bytes()).await.unwrap();
        one.write_all(JADE.as_bytes()).await.unwrap();
    });
    let client = HttpClient::new();
    let (one, two) = tokio::join!(client.post(letter, PATIENCE), client.post(letter, PATIENCE));
    assert!(one.is_ok() && two.is_ok());
    server.await.unwrap();
}
