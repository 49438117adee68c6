use std::collections::VecDeque;
use std::fmt;
use std::future::poll_fn;
use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use bytes::{Buf, Bytes, BytesMut};
use tokio::time::Sleep;

use crate::buffers::ROOM;
use crate::handle::Wish;
use crate::stream::{Kind, Plain};
use crate::{Buffers, Handle, Stream};

/// What moves through a connection, and what becomes of it.
pub trait Driver: Send + Sync + 'static {
    /// Octets were read; what cannot be used yet is left in the buffer.
    fn received(&self, octets: &mut BytesMut);
    /// Whether somebody in this process was woken by what was received last, who may have more to
    /// say: that goes out together with what waits.
    fn gives_way(&self) -> bool {
        false
    }
    /// The next octets to write, and whether there may be more after these.
    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool;
    /// The connection has ended; nothing follows. `all_written`: the system took everything that
    /// waited to be written.
    fn closed(&self, end: &End, all_written: bool);
    /// Octets were read on a lane, where the connection has any; what cannot be used yet is left
    /// in the buffer. Whether more is wanted on it: otherwise nothing is read of it until it was
    /// offered again, after something else has come.
    fn received_on(&self, lane: usize, octets: &mut BytesMut) -> bool {
        let _ = lane;
        octets.clear();
        true
    }
    /// The next octets to write on a lane, and whether there may be more after these.
    fn transmit_on(&self, lane: usize, parts: &mut VecDeque<Bytes>) -> bool {
        let _ = (lane, parts);
        false
    }
}

/// Streams that a connection may have beside its main one, the last the most urgent.
pub const LANES: usize = 3;

/// How a connection ended.
#[derive(Debug)]
pub enum End {
    /// We closed it.
    Ours,
    /// The other side had written everything that it had to say.
    Theirs,
    /// It broke.
    Broken(io::Error),
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            End::Ours => f.write_str("closed"),
            End::Theirs => f.write_str("the other side closed the connection"),
            End::Broken(error) => error.fmt(f),
        }
    }
}

/// How long a partner that takes nothing is waited for once the connection is to close.
pub(crate) const LINGER: Duration = Duration::from_secs(1);

/// Octets that wait for the rest of what they belong to, from which on it counts as large. Fewer
/// are copied to where the rest is read, and leave room there.
pub(crate) const LARGE: usize = ROOM / 2;

/// Parts that are written at once.
const PARTS: usize = 256;

/// Parts for which an idle connection keeps room.
const IDLE_PARTS: usize = 32;

/// Turns that who was woken has before what waits goes out without more.
const TURNS: usize = 2;

/// Moves octets between a stream and its driver until one of them ends it.
///
/// In one turn a connection reads once, at most a buffer full, and writes what its driver gives at
/// once; then the others have theirs. Where the runtime ends before that, what the socket takes at
/// once is still written.
pub async fn pump(stream: Stream, handle: Arc<Handle>, buffers: Arc<Buffers>, driver: impl Driver) {
    match stream.0 {
        Kind::Plain(stream) => pump_plain(stream, handle, buffers, driver).await,
        #[cfg(feature = "quic")]
        Kind::Quic(link) => crate::quic::pump(*link, handle, buffers, driver).await,
        #[cfg(feature = "quic")]
        Kind::Calling(_) => {
            let error = io::Error::other("the caller has not shown who it is");
            driver.closed(&End::Broken(error), false);
        }
    }
}

async fn pump_plain(
    stream: Plain,
    handle: Arc<Handle>,
    buffers: Arc<Buffers>,
    driver: impl Driver,
) {
    let mut pumped = Pumped {
        stream,
        driver,
        output: Outgoing::default(),
        over: false,
    };
    let result = pumped.run(&handle, &buffers).await;
    pumped.over = true;
    finish(result, pumped.output.all_written, &pumped.driver);
}

/// Tells how a connection ended.
pub(crate) fn finish(result: io::Result<()>, all_written: bool, driver: &impl Driver) {
    let end = match result {
        Ok(()) => End::Ours,
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => End::Theirs,
        Err(error) => End::Broken(error),
    };
    driver.closed(&end, all_written);
}

/// A connection that is being run.
struct Pumped<D: Driver> {
    stream: Plain,
    driver: D,
    output: Outgoing,
    over: bool,
}

impl<D: Driver> Drop for Pumped<D> {
    fn drop(&mut self) {
        if !self.over {
            // Nobody is left to be told of an error.
            let _ = self.output.send(&mut self.stream, &self.driver);
        }
    }
}

impl<D: Driver> Pumped<D> {
    async fn run(&mut self, handle: &Handle, buffers: &Buffers) -> io::Result<()> {
        let Pumped {
            stream,
            driver,
            output,
            ..
        } = self;
        let mut rest = BytesMut::new();
        let mut linger = None;
        loop {
            if handle.wish() == Wish::Abort {
                return stream.abort();
            }
            let blocked = match output.send(stream, driver)? {
                Sent::All => false,
                Sent::Blocked => true,
                Sent::Some => {
                    // Nobody wakes us for what the driver still has.
                    tokio::task::yield_now().await;
                    continue;
                }
            };
            let wish = handle.wish();
            if wish != Wish::None && !blocked {
                return stream.end_writing();
            }
            if wish == Wish::Close {
                linger.get_or_insert_with(|| Box::pin(tokio::time::sleep(LINGER)));
            }
            match poll_fn(|cx| poll_turn(cx, stream, handle, blocked, &mut linger)).await? {
                Turn::Write => {}
                Turn::Over => return Ok(()),
                Turn::Read => {
                    let mut reading =
                        |cx: &mut Context<'_>| read(cx, stream, buffers, &mut rest, driver);
                    let full = poll_fn(|cx| Poll::Ready(reading(cx))).await?;
                    if full {
                        // Receipts go out first: whoever has the letter now may end the program.
                        output.send(stream, driver)?;
                        tokio::task::yield_now().await;
                    } else if driver.gives_way() {
                        give_way(handle).await;
                    }
                }
            }
        }
    }
}

/// Lets those who were woken have their turn, and the tasks that they start.
async fn give_way(handle: &Handle) {
    for _ in 0..TURNS {
        tokio::task::yield_now().await;
        if handle.is_asked() {
            return;
        }
    }
}

/// What a connection does next.
enum Turn {
    Read,
    Write,
    Over,
}

fn poll_turn(
    cx: &mut Context<'_>,
    stream: &mut Plain,
    handle: &Handle,
    blocked: bool,
    linger: &mut Option<Pin<Box<Sleep>>>,
) -> Poll<io::Result<Turn>> {
    if let Poll::Ready(ready) = stream.poll_read_ready(cx) {
        return Poll::Ready(ready.map(|()| Turn::Read));
    }
    if blocked && let Poll::Ready(ready) = stream.poll_write_ready(cx) {
        return Poll::Ready(ready.map(|()| Turn::Write));
    }
    if handle.poll_asked(cx).is_ready() {
        return Poll::Ready(Ok(Turn::Write));
    }
    match linger {
        Some(linger) => linger.as_mut().poll(cx).map(|()| Ok(Turn::Over)),
        None => Poll::Pending,
    }
}

/// Reads once. Whether there may be more to read at once.
fn read(
    cx: &mut Context<'_>,
    stream: &mut Plain,
    buffers: &Buffers,
    rest: &mut BytesMut,
    driver: &impl Driver,
) -> io::Result<bool> {
    if rest.len() >= LARGE {
        return read_on(cx, stream, rest, driver);
    }
    let mut taken = buffers.take();
    let buffer = &mut taken.octets;
    buffer.extend_from_slice(rest);
    let read = stream.poll_read(cx, buffer);
    if let Poll::Ready(Ok(_)) = read {
        driver.received(buffer);
        keep(rest, buffer);
    }
    buffers.give(taken);
    filled(read)
}

/// Reads on where something large is: its buffer grows with what arrived.
fn read_on(
    cx: &mut Context<'_>,
    stream: &mut Plain,
    rest: &mut BytesMut,
    driver: &impl Driver,
) -> io::Result<bool> {
    rest.reserve(rest.len());
    let read = stream.poll_read(cx, rest);
    if let Poll::Ready(Ok(_)) = read {
        driver.received(rest);
    }
    if rest.is_empty() {
        *rest = BytesMut::new();
    }
    filled(read)
}

/// Whether the room was filled; nothing was when nothing is there to be read after all.
fn filled(read: Poll<io::Result<bool>>) -> io::Result<bool> {
    match read {
        Poll::Ready(read) => read,
        Poll::Pending => Ok(false),
    }
}

/// Copies what is left over: a connection that waits holds no more than what arrived.
pub(crate) fn keep(rest: &mut BytesMut, left: &[u8]) {
    if left.is_empty() {
        *rest = BytesMut::new();
    } else {
        rest.clear();
        rest.extend_from_slice(left);
    }
}

/// What waits to be written.
#[derive(Default)]
struct Outgoing {
    parts: VecDeque<Bytes>,
    /// The system has taken everything that there was.
    all_written: bool,
}

/// How much of what waits was written.
enum Sent {
    /// Everything that the driver has.
    All,
    /// Everything that was at hand; the driver has more.
    Some,
    /// As much as the socket takes.
    Blocked,
}

impl Outgoing {
    /// Writes as much as the socket takes of what the driver gives at once.
    fn send(&mut self, stream: &mut Plain, driver: &impl Driver) -> io::Result<Sent> {
        let more = driver.transmit(&mut self.parts);
        self.all_written = false;
        let blocked = write(stream, &mut self.parts)?;
        self.all_written = !blocked && !more;
        Ok(match (blocked, more) {
            (true, _) => Sent::Blocked,
            (false, true) => Sent::Some,
            (false, false) => Sent::All,
        })
    }
}

/// Whether the socket takes no more for now.
fn write(stream: &mut Plain, output: &mut VecDeque<Bytes>) -> io::Result<bool> {
    while !output.is_empty() {
        let mut parts = [IoSlice::new(&[]); PARTS];
        let mut count = 0;
        for (slice, part) in parts.iter_mut().zip(output.iter()) {
            *slice = IoSlice::new(part);
            count += 1;
        }
        match stream.try_write_vectored(&parts[..count]) {
            Ok(written) => advance(output, written),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(true),
            Err(error) => return Err(error),
        }
    }
    if output.capacity() > IDLE_PARTS {
        *output = VecDeque::new();
    }
    stream.flush()
}

fn advance(output: &mut VecDeque<Bytes>, mut written: usize) {
    while let Some(part) = output.front_mut() {
        if written < part.len() {
            part.advance(written);
            return;
        }
        written -= part.len();
        output.pop_front();
    }
}
