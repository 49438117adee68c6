//! UDT as a transport that a platform has plugged in.

use std::collections::HashMap;
use std::io;
use std::net::{SocketAddr, SocketAddrV4, ToSocketAddrs};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use fipa::{LetterInbox, LetterListener, LetterTransport, PostFailure};

use crate::{Connection, Listener, MAX_LETTER};

/// How long is waited at once; then it is seen whether there is still something to wait for.
const SLICE: Duration = Duration::from_millis(200);

/// Connections to others that are kept open, at most; they take a socket and two threads each.
const MAX_OPEN: usize = 64;

/// Connections of others at once, at most.
const MAX_CALLERS: usize = 256;

/// Letters over UDT, as a [`LetterTransport`] for addresses `udt://HOST:PORT`.
///
/// A connection is kept open for the next letter, and is made anew when it has broken. A letter is
/// handed over once the libudt of the other side has confirmed that it has all of it; whether the
/// program there has read it, nobody says. UDT is for IPv4, and a letter has
/// [`MAX_LETTER`] octets at most.
#[derive(Debug, Default)]
pub struct UdtTransport {
    open: Mutex<HashMap<SocketAddrV4, Arc<Connection>>>,
}

impl UdtTransport {
    /// A transport without any connection.
    pub fn new() -> UdtTransport {
        UdtTransport::default()
    }

    fn open(&self) -> MutexGuard<'_, HashMap<SocketAddrV4, Arc<Connection>>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a letter to the connection that is there, or to a new one.
    fn write(
        &self,
        address: SocketAddrV4,
        letter: &[u8],
        until: Instant,
    ) -> Result<Arc<Connection>, PostFailure> {
        let kept = self.open().get(&address).map(Arc::clone);
        if let Some(kept) = kept {
            if kept.send(letter, left(until)).is_ok() {
                return Ok(kept);
            }
            self.forget(address, &kept);
        }
        let connection = Connection::connect(address).map_err(unreached)?;
        connection.send(letter, left(until)).map_err(unreached)?;
        let connection = Arc::new(connection);
        let mut open = self.open();
        if open.len() < MAX_OPEN {
            open.insert(address, Arc::clone(&connection));
        }
        Ok(connection)
    }

    /// A connection is of no use any more.
    fn forget(&self, address: SocketAddrV4, broken: &Arc<Connection>) {
        let mut open = self.open();
        // Somebody else may have made a new one.
        let same = |kept: &Arc<Connection>| Arc::ptr_eq(kept, broken);
        if open.get(&address).is_some_and(same) {
            open.remove(&address);
        }
    }
}

impl LetterTransport for UdtTransport {
    fn scheme(&self) -> &'static str {
        "udt"
    }

    fn bind(&self, host: &str, port: u16) -> io::Result<Box<dyn LetterListener>> {
        let listener = Listener::bind(resolve(host, port)?).map_err(io::Error::other)?;
        let port = listener.local_addr().map_err(io::Error::other)?.port();
        Ok(Box::new(Endpoint { listener, port }))
    }

    fn send(
        &self,
        host: &str,
        port: u16,
        letter: &[u8],
        timeout: Duration,
    ) -> Result<(), PostFailure> {
        let until = Instant::now() + timeout;
        if letter.len() > MAX_LETTER {
            return Err(PostFailure::Refused(format!(
                "a letter over UDT has at most {MAX_LETTER} octets, not {}",
                letter.len()
            )));
        }
        let address = resolve(host, port).map_err(unreached)?;
        let connection = self.write(address, letter, until)?;
        let reason = match connection.flush(left(until)) {
            Ok(true) => return Ok(()),
            Ok(false) => "the other side did not confirm the letter in time".to_owned(),
            Err(error) => error.to_string(),
        };
        self.forget(address, &connection);
        Err(PostFailure::Unanswered(format!(
            "{reason}, and nobody knows whether it arrived"
        )))
    }
}

fn unreached(error: impl ToString) -> PostFailure {
    PostFailure::Unreached(error.to_string())
}

fn left(until: Instant) -> Duration {
    until.saturating_duration_since(Instant::now())
}

fn resolve(host: &str, port: u16) -> io::Result<SocketAddrV4> {
    let mut found = (host, port).to_socket_addrs()?;
    let v4 = found.find_map(|address| match address {
        SocketAddr::V4(address) => Some(address),
        SocketAddr::V6(_) => None,
    });
    v4.ok_or_else(|| io::Error::other("the host has no IPv4 address, and UDT has no other"))
}

struct Endpoint {
    listener: Listener,
    port: u16,
}

impl LetterListener for Endpoint {
    fn port(&self) -> u16 {
        self.port
    }

    fn serve(self: Box<Self>, inbox: LetterInbox) {
        let callers = Arc::new(AtomicUsize::new(0));
        while inbox.is_open() {
            match self.listener.accept(SLICE) {
                Ok(Some(caller)) => admit(caller, &inbox, &callers),
                Ok(None) => {}
                // Out of memory or threads: neither gets better by trying again at once.
                Err(_) => std::thread::sleep(SLICE),
            }
        }
    }
}

/// Reads what somebody sends in a thread of its own; one caller too many is hung up on.
fn admit(caller: Connection, inbox: &LetterInbox, callers: &Arc<AtomicUsize>) {
    if callers.load(Ordering::Relaxed) >= MAX_CALLERS {
        return;
    }
    callers.fetch_add(1, Ordering::Relaxed);
    let (inbox, count) = (inbox.clone(), Arc::clone(callers));
    let read = move || {
        read(&caller, &inbox);
        count.fetch_sub(1, Ordering::Relaxed);
    };
    let thread = std::thread::Builder::new().name("udt caller".to_owned());
    if thread.spawn(read).is_err() {
        callers.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Takes letters until the connection ends.
fn read(caller: &Connection, inbox: &LetterInbox) {
    let Ok(from) = caller.peer_addr() else {
        return;
    };
    while inbox.is_open() {
        match caller.receive(SLICE) {
            Ok(Some(letter)) => inbox.put(SocketAddr::V4(from), letter.into()),
            Ok(None) => {}
            Err(_) => return,
        }
    }
}
