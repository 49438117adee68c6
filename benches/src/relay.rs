//! A plain relay of length-prefixed pieces, as a process: what a hop costs that knows nothing.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use bytes::{Buf, BytesMut};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

/// Holds where to, in processes that are relays.
const MARK: &str = "FIPA_BENCH_RELAY";

/// Octets that are read at once.
const CHUNK: usize = 64 << 10;

/// A relay of the bench; it ends with this value.
#[derive(Debug)]
pub struct Relay {
    process: Child,
    address: String,
}

impl Relay {
    /// Starts a relay to this address. It takes one caller after the other.
    pub fn start(to: &str) -> Relay {
        let mut process = Command::new(std::env::current_exe().expect("this program"))
            .env(MARK, to)
            .stdout(Stdio::piped())
            .spawn()
            .expect("a relay");
        let mut address = String::new();
        let output = process.stdout.take().expect("piped");
        BufReader::new(output)
            .read_line(&mut address)
            .expect("ready");
        Relay {
            process,
            address: address.trim().to_owned(),
        }
    }

    /// Its process.
    pub fn process(&self) -> u32 {
        self.process.id()
    }

    /// Where it is called.
    pub fn address(&self) -> &str {
        &self.address
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Where to, if this process is to be a relay: then its `main` calls [`run`].
pub fn is_relay() -> Option<String> {
    std::env::var(MARK).ok()
}

/// Relays until the process is ended.
pub fn run(to: &str) {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .expect("a runtime");
    runtime.block_on(async {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        println!("{}", listener.local_addr().expect("bound"));
        loop {
            let (caller, _) = listener.accept().await.expect("a caller");
            let partner = TcpStream::connect(to).await.expect("the next one");
            let ((caller_read, caller_write), (partner_read, partner_write)) =
                (split(caller), split(partner));
            tokio::spawn(pass_on(caller_read, partner_write));
            tokio::spawn(pass_on(partner_read, caller_write));
        }
    });
}

fn split(
    stream: TcpStream,
) -> (
    tokio::net::tcp::OwnedReadHalf,
    tokio::net::tcp::OwnedWriteHalf,
) {
    stream.set_nodelay(true).expect("a socket");
    stream.into_split()
}

/// Passes on whole pieces, all that were read in one go.
async fn pass_on(mut from: impl AsyncRead + Unpin, mut to: impl AsyncWrite + Unpin) {
    let mut read = BytesMut::with_capacity(CHUNK);
    while from
        .read_buf(&mut read)
        .await
        .is_ok_and(|octets| octets > 0)
    {
        let whole = whole_pieces(&read);
        let mut pieces = read.split_to(whole);
        while pieces.has_remaining() {
            if to.write_buf(&mut pieces).await.is_err() {
                return;
            }
        }
        drop(pieces);
        let next = match read.first_chunk() {
            Some(length) => 4 + u32::from_be_bytes(*length) as usize,
            None => 0,
        };
        read.reserve(next.saturating_sub(read.len()).max(CHUNK));
    }
}

/// Octets of the pieces that are there as a whole.
fn whole_pieces(read: &[u8]) -> usize {
    let mut at = 0;
    while let Some(length) = read.get(at..).and_then(|rest| rest.first_chunk()) {
        let next = at + 4 + u32::from_be_bytes(*length) as usize;
        if next > read.len() {
            break;
        }
        at = next;
    }
    at
}
