//! A plain TCP echo, and a plain stream of length-prefixed pieces: what the sockets alone cost.

use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use crate::table::Times;

/// Where an echo answers, on a thread of its own, one connection after the other.
pub fn echo_server() -> std::net::SocketAddr {
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async move {
            let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
            sender
                .send(listener.local_addr().expect("bound"))
                .expect("heard");
            loop {
                let (stream, _) = listener.accept().await.expect("a caller");
                echo(stream).await;
            }
        });
    });
    receiver.recv().expect("a server")
}

/// Where an echo answers, as a task of this runtime, one connection after the other.
pub async fn echo_here() -> std::net::SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("bound");
    tokio::spawn(async move {
        loop {
            let (stream, _) = listener.accept().await.expect("a caller");
            echo(stream).await;
        }
    });
    address
}

/// Each piece comes behind its length, and goes back the same way.
async fn echo(mut stream: TcpStream) {
    stream.set_nodelay(true).expect("a socket");
    let mut piece = Vec::new();
    while let Ok(length) = stream.read_u32().await {
        piece.resize(4 + length as usize, 0);
        piece[..4].copy_from_slice(&length.to_be_bytes());
        if stream.read_exact(&mut piece[4..]).await.is_err() {
            return;
        }
        if stream.write_all(&piece).await.is_err() {
            return;
        }
    }
}

/// Times one piece after the other.
pub async fn round_trips(server: std::net::SocketAddr, octets: usize, count: usize) -> Times {
    let mut stream = TcpStream::connect(server).await.expect("the echo");
    stream.set_nodelay(true).expect("a socket");
    let mut piece = vec![0; 4 + octets];
    let length = u32::try_from(octets).expect("small");
    piece[..4].copy_from_slice(&length.to_be_bytes());
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let start = Instant::now();
        stream.write_all(&piece).await.expect("written");
        stream.read_exact(&mut piece).await.expect("answered");
        times.push(start.elapsed());
    }
    Times::new(times)
}

/// Pieces a second with so many under way, answers counted.
pub async fn rate(
    server: std::net::SocketAddr,
    octets: usize,
    window: usize,
    span: Duration,
) -> f64 {
    let stream = TcpStream::connect(server).await.expect("the echo");
    stream.set_nodelay(true).expect("a socket");
    let (mut read, mut write) = stream.into_split();
    let mut piece = vec![0; 4 + octets];
    let length = u32::try_from(octets).expect("small");
    piece[..4].copy_from_slice(&length.to_be_bytes());
    let mut answer = piece.clone();
    let (mut sent, mut answered) = (0_usize, 0_usize);
    let start = Instant::now();
    while start.elapsed() < span {
        while sent - answered < window {
            write.write_all(&piece).await.expect("written");
            sent += 1;
        }
        read.read_exact(&mut answer).await.expect("answered");
        answered += 1;
    }
    answered as f64 / start.elapsed().as_secs_f64()
}
