use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt;
use std::io::{self, IoSlice};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use bytes::{Buf, Bytes, BytesMut};
use tokio::io::Interest;
use tokio::sync::Notify;

use crate::Stream;

/// What moves through a connection, and what becomes of it.
pub trait Driver: Send + Sync + 'static {
    /// Octets were read; what cannot be used yet is left in the buffer.
    fn received(&self, octets: &mut BytesMut);
    /// The next octets to write, and whether there may be more after these.
    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool;
    /// The connection has ended; nothing follows. `all_written`: the system took everything that
    /// waited to be written.
    fn closed(&self, end: &End, all_written: bool);
}

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

/// Wakes a connection that waits for its partner.
#[derive(Debug, Default)]
pub struct Handle {
    wake: Notify,
    wish: AtomicU8,
}

/// How a connection is wished to end; a stronger wish replaces a weaker one.
mod wish {
    pub(super) const NONE: u8 = 0;
    /// When all is written, however long that takes.
    pub(super) const FINISH: u8 = 1;
    /// When all is written, or the partner takes nothing any more.
    pub(super) const CLOSE: u8 = 2;
    /// Now.
    pub(super) const ABORT: u8 = 3;
}

impl Handle {
    /// There is something to write.
    pub fn transmit(&self) {
        self.wake.notify_one();
    }

    /// The connection closes as soon as all that waits is written, or the partner takes no more.
    pub fn close(&self) {
        self.wish(wish::CLOSE);
    }

    /// The connection closes as soon as all that waits is written, however long the partner takes
    /// for it.
    pub fn finish(&self) {
        self.wish(wish::FINISH);
    }

    /// The connection is broken off at once: the partner sees an error, not an end.
    pub fn abort(&self) {
        self.wish(wish::ABORT);
    }

    fn wish(&self, wish: u8) {
        self.wish.fetch_max(wish, Ordering::AcqRel);
        self.wake.notify_one();
    }
}

/// How long a partner that takes nothing is waited for once the connection is to close.
const LINGER: Duration = Duration::from_secs(1);

/// Octets that are read at once.
const CHUNK: usize = 64 << 10;

/// Octets that wait for the rest of what they belong to, from which on it counts as large.
const LARGE: usize = CHUNK / 2;

/// Parts that are written at once.
const PARTS: usize = 64;

thread_local! {
    /// Read into by every connection of the thread: an idle connection holds no buffer, and what
    /// is kept of a reading is no larger than what arrived.
    static SCRATCH: RefCell<Box<[u8]>> = RefCell::new(vec![0; CHUNK].into_boxed_slice());
}

/// Moves octets between a stream and its driver until one of them ends it.
pub async fn pump(stream: Stream, handle: Arc<Handle>, driver: impl Driver) {
    let mut output: VecDeque<Bytes> = VecDeque::new();
    let mut all_written = false;
    let result = run(&stream, &handle, &driver, &mut output, &mut all_written).await;
    let end = match result {
        Ok(()) => End::Ours,
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => End::Theirs,
        Err(error) => End::Broken(error),
    };
    driver.closed(&end, all_written);
}

async fn run(
    stream: &Stream,
    handle: &Handle,
    driver: &impl Driver,
    output: &mut VecDeque<Bytes>,
    all_written: &mut bool,
) -> io::Result<()> {
    let mut input = BytesMut::new();
    loop {
        if handle.wish.load(Ordering::Acquire) == wish::ABORT {
            return stream.abort();
        }
        let more = driver.transmit(output);
        *all_written = false;
        let blocked = write(stream, output)?;
        *all_written = output.is_empty() && !more;
        if more && !blocked {
            // Nobody wakes us for what the driver still has.
            tokio::task::yield_now().await;
            continue;
        }
        let wish = handle.wish.load(Ordering::Acquire);
        if output.is_empty() && wish != wish::NONE {
            return stream.end_writing();
        }
        let linger = async {
            match wish == wish::CLOSE {
                true => tokio::time::sleep(LINGER).await,
                false => std::future::pending().await,
            }
        };
        let interest = match blocked {
            true => Interest::READABLE | Interest::WRITABLE,
            false => Interest::READABLE,
        };
        tokio::select! {
            ready = stream.ready(interest) => {
                if ready?.is_readable() {
                    read(stream, &mut input, driver)?;
                }
            }
            () = handle.wake.notified() => {}
            () = linger => return Ok(()),
        }
    }
}

/// Reads once; the rest, if there is more, comes with the next turn, after what is to be written.
fn read(stream: &Stream, input: &mut BytesMut, driver: &impl Driver) -> io::Result<()> {
    let octets = if input.len() < LARGE {
        SCRATCH.with_borrow_mut(|scratch| {
            let octets = stream.try_read(scratch)?;
            input.extend_from_slice(&scratch[..octets]);
            Ok(octets)
        })
    } else {
        // Something large is under way: room for as much again saves a copy of it.
        input.reserve(input.len());
        stream.try_read_buf(input)
    };
    match octets {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(_) => {
            driver.received(input);
            if input.is_empty() {
                *input = BytesMut::new();
            }
            Ok(())
        }
        Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(()),
        Err(error) => Err(error),
    }
}

/// Writes as much as the socket takes. Whether it is to be asked when it takes more.
fn write(stream: &Stream, output: &mut VecDeque<Bytes>) -> io::Result<bool> {
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
    Ok(false)
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
