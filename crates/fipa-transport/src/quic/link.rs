//! A connection of QUIC with its streams, and what moves octets through them.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll};

use bytes::{Buf, Bytes, BytesMut};
use quinn::{Connection, ConnectionError, ReadError, RecvStream, SendStream, StoppedError};
use tokio::time::Sleep;

use super::{BROKEN_OFF, DONE, words};
use crate::handle::Wish;
use crate::pump::{LARGE, LINGER, finish, keep};
use crate::{Buffers, Driver, Handle, LANES};

/// Parts that are handed over at once.
const PARTS: usize = 64;

/// Parts that are read at once: packets, as a rule.
const CHUNKS: usize = 32;

/// Turns after which the other connections have theirs.
const TURNS: u32 = 8;

/// Streams of a connection: the main one, and the lanes.
const STREAMS: usize = 1 + LANES;

/// A connection with its streams.
#[derive(Debug)]
pub(crate) struct QuicLink {
    connection: Connection,
    remote: SocketAddr,
    name: Option<String>,
    certificate: Option<Vec<u8>>,
    /// The main one first.
    streams: [Both; STREAMS],
}

/// Both directions of what is one stream for us.
#[derive(Debug)]
struct Both {
    lane: Option<usize>,
    send: SendStream,
    /// What waits to be written.
    parts: VecDeque<Bytes>,
    /// The stream takes no more for now.
    blocked: bool,
    /// The stream takes no more.
    deaf: bool,
    recv: RecvStream,
    /// What was read, and not taken by the driver.
    rest: BytesMut,
    /// Nothing is read until the driver wants more.
    held: bool,
    ended: bool,
}

impl QuicLink {
    /// Opens our streams, and waits for those of the other side.
    pub(super) async fn open(
        connection: Connection,
        dialled: bool,
        name: Option<String>,
        certificate: Option<Vec<u8>>,
    ) -> io::Result<QuicLink> {
        let lost = |error| words::of_connection(&error);
        let main = match dialled {
            true => Some(connection.open_bi().await.map_err(lost)?),
            false => None,
        };
        let mut ours = Vec::with_capacity(LANES);
        for lane in 0..LANES {
            let mut send = connection.open_uni().await.map_err(lost)?;
            send.write_all(&[lane as u8]).await?;
            ours.push(send);
        }
        // It comes with what the caller says first.
        let main = match main {
            Some(main) => main,
            None => connection.accept_bi().await.map_err(lost)?,
        };
        let mut theirs: [Option<RecvStream>; LANES] = Default::default();
        for _ in 0..LANES {
            let mut recv = connection.accept_uni().await.map_err(lost)?;
            let mut lane = [0];
            let read = recv.read_exact(&mut lane).await;
            read.map_err(|error| io::Error::other(error.to_string()))?;
            match theirs.get_mut(usize::from(lane[0])) {
                Some(free @ None) => *free = Some(recv),
                _ => return Err(io::Error::other("a stream is none of a link")),
            }
        }
        let lanes = ours.into_iter().zip(theirs.into_iter().flatten());
        let streams = std::iter::once(main).chain(lanes).enumerate();
        let streams: Vec<Both> = streams
            .map(|(number, (send, recv))| Both::new(number.checked_sub(1), send, recv))
            .collect();
        let streams = streams
            .try_into()
            .map_err(|_| io::Error::other("a stream is missing"))?;
        Ok(QuicLink {
            remote: connection.remote_address(),
            connection,
            name,
            certificate,
            streams,
        })
    }

    pub(crate) fn remote(&self) -> SocketAddr {
        self.remote
    }

    pub(crate) fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    pub(crate) fn certificate(&self) -> Option<&[u8]> {
        self.certificate.as_deref()
    }

    /// Whether the partner is on this host: what goes there leaves from its own address.
    pub(crate) fn same_host(&self) -> bool {
        let any = match self.remote {
            SocketAddr::V4(_) => "0.0.0.0:0",
            SocketAddr::V6(_) => "[::]:0",
        };
        let leaves_from = || {
            let socket = UdpSocket::bind(any)?;
            socket.connect(self.remote)?;
            socket.local_addr()
        };
        let remote = self.remote.ip();
        remote.is_loopback() || leaves_from().is_ok_and(|own| own.ip() == remote)
    }
}

#[cfg(test)]
impl QuicLink {
    pub(super) async fn say(&mut self, octets: &[u8]) {
        self.streams[0].send.write_all(octets).await.unwrap();
    }

    pub(super) async fn hear(&mut self, octets: usize) {
        let mut heard = vec![0; octets];
        self.streams[0].recv.read_exact(&mut heard).await.unwrap();
    }
}

impl Drop for QuicLink {
    /// Streams that are dropped end as if all were said; a connection that was not closed in order
    /// is cut off instead.
    fn drop(&mut self) {
        self.connection.close(BROKEN_OFF, b"");
    }
}

/// Moves octets between a connection and its driver until one of them ends it.
pub(crate) async fn pump(
    mut link: QuicLink,
    handle: Arc<Handle>,
    buffers: Arc<Buffers>,
    driver: impl Driver,
) {
    let mut all_written = false;
    let result = run(&mut link, &handle, &buffers, &driver, &mut all_written).await;
    link.connection.close(DONE, b"");
    finish(result, all_written, &driver);
}

async fn run(
    link: &mut QuicLink,
    handle: &Handle,
    buffers: &Buffers,
    driver: &impl Driver,
    all_written: &mut bool,
) -> io::Result<()> {
    let mut linger = None;
    let mut turns = 0_u32;
    loop {
        let wish = handle.wish();
        if wish == Wish::Abort {
            link.connection.close(BROKEN_OFF, b"");
            return Ok(());
        }
        if wish == Wish::Close {
            linger.get_or_insert_with(|| Box::pin(tokio::time::sleep(LINGER)));
        }
        let mut turn = Turn {
            handle,
            buffers,
            driver,
            wish,
            begins: true,
        };
        match poll_fn(|cx| turn.poll(cx, &mut link.streams, &mut linger)).await? {
            Next::Again => {
                turns += 1;
                if turns.is_multiple_of(TURNS) {
                    tokio::task::yield_now().await;
                }
            }
            Next::Over => return Ok(()),
            Next::Written => {
                *all_written = acknowledged(&link.streams, linger).await?;
                return Ok(());
            }
        }
    }
}

/// Waits until the other side has all that was written.
async fn acknowledged(
    streams: &[Both; STREAMS],
    linger: Option<Pin<Box<Sleep>>>,
) -> io::Result<bool> {
    let all = async {
        for stream in streams {
            match stream.send.stopped().await {
                Ok(_) => {}
                // The other side has closed it as well, and may have everything.
                Err(StoppedError::ConnectionLost(ConnectionError::ApplicationClosed(_))) => {
                    return Ok(false);
                }
                Err(StoppedError::ConnectionLost(lost)) => return Err(words::of_connection(&lost)),
                Err(other) => return Err(io::Error::other(other.to_string())),
            }
        }
        Ok(true)
    };
    match linger {
        None => all.await,
        Some(linger) => tokio::select! {
            all = all => all,
            () = linger => Ok(false),
        },
    }
}

enum Next {
    Again,
    /// Everything was handed over, and the streams are ended.
    Written,
    /// The partner took too long.
    Over,
}

struct Turn<'a, D> {
    handle: &'a Handle,
    buffers: &'a Buffers,
    driver: &'a D,
    /// How the connection was wished to end when the turn began.
    wish: Wish,
    /// Nothing was done in it yet.
    begins: bool,
}

impl<D: Driver> Turn<'_, D> {
    /// Writes what there is, then reads what there is, a buffer of each stream at most.
    fn poll(
        &mut self,
        cx: &mut Context<'_>,
        streams: &mut [Both; STREAMS],
        linger: &mut Option<Pin<Box<Sleep>>>,
    ) -> Poll<io::Result<Next>> {
        let mut all = std::mem::take(&mut self.begins);
        // Whoever asks next wakes us.
        while self.handle.poll_asked(cx).is_ready() {
            all = true;
        }
        let mut again = self.handle.wish() != self.wish;
        for stream in streams.iter_mut().filter(|s| all || s.blocked) {
            again |= stream.write(cx, self.driver);
        }
        if self.wish != Wish::None && !again && streams.iter().all(|stream| !stream.blocked) {
            for stream in streams.iter_mut() {
                // It was not ended before.
                let _ = stream.send.finish();
            }
            return Poll::Ready(Ok(Next::Written));
        }
        for stream in streams.iter_mut().rev() {
            again |= stream.read(cx, self.buffers, self.driver)?;
        }
        // What came on one stream may be what another has waited for.
        if again {
            for stream in streams.iter_mut().filter(|s| !s.rest.is_empty()) {
                stream.hand_over(self.driver);
            }
            return Poll::Ready(Ok(Next::Again));
        }
        if streams.iter().all(|stream| stream.ended) {
            return Poll::Ready(Err(io::ErrorKind::UnexpectedEof.into()));
        }
        match linger {
            Some(linger) => linger.as_mut().poll(cx).map(|()| Ok(Next::Over)),
            None => Poll::Pending,
        }
    }
}

impl Both {
    fn new(lane: Option<usize>, send: SendStream, recv: RecvStream) -> Both {
        // What is urgent goes first, and what keeps the link before all.
        let urgency = lane.unwrap_or(LANES);
        // It was just opened, so it is there.
        let _ = send.set_priority(i32::try_from(urgency).unwrap_or(i32::MAX));
        Both {
            lane,
            send,
            parts: VecDeque::new(),
            blocked: false,
            deaf: false,
            recv,
            rest: BytesMut::new(),
            held: false,
            ended: false,
        }
    }

    /// Hands over as much as the stream takes of what the driver gives at once. Whether there is
    /// more that it may take.
    fn write(&mut self, cx: &mut Context<'_>, driver: &impl Driver) -> bool {
        if self.deaf {
            return false;
        }
        let more = match self.lane {
            Some(lane) => driver.transmit_on(lane, &mut self.parts),
            None => driver.transmit(&mut self.parts),
        };
        while !self.parts.is_empty() {
            let mut parts = [const { Bytes::new() }; PARTS];
            let mut count = 0;
            for (slot, part) in parts.iter_mut().zip(&self.parts) {
                *slot = part.clone();
                count += 1;
            }
            let written = pin!(self.send.write_chunks(&mut parts[..count])).poll(cx);
            match written {
                Poll::Pending => {
                    self.blocked = true;
                    return false;
                }
                Poll::Ready(Err(_)) => {
                    // What has come is still read, and then why nothing follows.
                    self.deaf = true;
                    self.parts.clear();
                    return false;
                }
                Poll::Ready(Ok(written)) => {
                    drop(self.parts.drain(..written.chunks));
                    // The rest of a part of which not all was taken.
                    if let (Some(part), Some(front)) =
                        (parts[..count].get(written.chunks), self.parts.front_mut())
                        && part.len() < front.len()
                    {
                        front.advance(front.len() - part.len());
                    }
                }
            }
        }
        self.blocked = false;
        more
    }

    /// Reads once. Whether there was something.
    fn read(
        &mut self,
        cx: &mut Context<'_>,
        buffers: &Buffers,
        driver: &impl Driver,
    ) -> io::Result<bool> {
        if self.ended || self.held {
            return Ok(false);
        }
        let mut chunks = [const { Bytes::new() }; CHUNKS];
        let read = pin!(self.recv.read_chunks(&mut chunks)).poll(cx);
        let come = match read {
            Poll::Pending => return Ok(false),
            Poll::Ready(Err(error)) => return Err(of_read(&error)),
            Poll::Ready(Ok(None)) => {
                self.ended = true;
                return Ok(true);
            }
            Poll::Ready(Ok(Some(count))) => &chunks[..count],
        };
        let octets: usize = come.iter().map(Bytes::len).sum();
        if self.rest.len() >= LARGE {
            self.rest.reserve(octets.max(self.rest.len()));
            come.iter().for_each(|c| self.rest.extend_from_slice(c));
            self.hand_over(driver);
            return Ok(true);
        }
        let mut taken = buffers.take();
        let buffer = &mut taken.octets;
        buffer.reserve(self.rest.len() + octets);
        buffer.extend_from_slice(&self.rest);
        come.iter().for_each(|c| buffer.extend_from_slice(c));
        self.held = !offer(self.lane, buffer, driver);
        keep(&mut self.rest, buffer);
        buffers.give(taken);
        Ok(true)
    }

    /// Offers again what was left.
    fn hand_over(&mut self, driver: &impl Driver) {
        self.held = !offer(self.lane, &mut self.rest, driver);
        if self.rest.is_empty() {
            self.rest = BytesMut::new();
        }
    }
}

/// Hands what was read to the driver. Whether it wants more.
fn offer(lane: Option<usize>, octets: &mut BytesMut, driver: &impl Driver) -> bool {
    match lane {
        Some(lane) => driver.received_on(lane, octets),
        None => {
            driver.received(octets);
            true
        }
    }
}

fn of_read(error: &ReadError) -> io::Error {
    match error {
        ReadError::ConnectionLost(lost) => words::of_connection(lost),
        other => io::Error::other(other.to_string()),
    }
}
