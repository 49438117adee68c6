//! Letters over UDT as the C++ `fipa_services` sends them: a socket in message mode, one message a
//! letter, kept open for the next one.
//!
//! **Knows** libudt. **Never knows** what a letter says. Calls block; whoever serves many
//! connections gives each a thread of its own.
//!
//! It stands apart from the other crates: it needs a C++ compiler and the system's libudt (Debian:
//! `libudt-dev`), and it alone has `unsafe` code. A program that wants UDT plugs it in, as a
//! [`UdtTransport`]: the example `fipad-udt` is a daemon with it.
//!
//! ```
//! use std::time::Duration;
//! use fipa_udt::{Connection, Listener};
//!
//! let listener = Listener::bind("127.0.0.1:0".parse()?)?;
//! let caller = Connection::connect(listener.local_addr()?)?;
//! caller.send(b"a letter", Duration::from_secs(1))?;
//!
//! let called = listener.accept(Duration::from_secs(1))?.expect("a caller");
//! let letter = called.receive(Duration::from_secs(1))?;
//! assert_eq!(letter.as_deref(), Some(&b"a letter"[..]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod ffi;
mod transport;

use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::{Duration, Instant};

use crate::ffi::Socket;

pub use transport::UdtTransport;

/// The longest letter, in octets: the size of the buffers, as `fipa_services` has it.
pub const MAX_LETTER: usize = 10_000_000;

/// How often it is looked whether letters are confirmed; libudt confirms each 10 ms.
const LOOK: Duration = Duration::from_millis(2);

/// What libudt says went wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {text}")]
pub struct UdtError {
    what: &'static str,
    text: String,
    code: i32,
}

impl UdtError {
    /// The number that libudt gives the error; 0 if it is none of its own.
    pub fn code(&self) -> i32 {
        self.code
    }
}

/// Waits for others to call.
#[derive(Debug)]
pub struct Listener {
    socket: Socket,
    ip: Ipv4Addr,
}

impl Listener {
    /// Listens at an address; port 0 takes a free one.
    ///
    /// # Errors
    /// What libudt says, for instance that the port is in use.
    pub fn bind(address: SocketAddrV4) -> Result<Listener, UdtError> {
        Ok(Listener {
            socket: Socket::listen(address)?,
            ip: *address.ip(),
        })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// What libudt says.
    pub fn local_addr(&self) -> Result<SocketAddrV4, UdtError> {
        Ok(SocketAddrV4::new(self.ip, self.socket.local_port()?))
    }

    /// The next who calls, or `None` if nobody does for so long.
    ///
    /// # Errors
    /// What libudt says.
    pub fn accept(&self, wait: Duration) -> Result<Option<Connection>, UdtError> {
        let socket = self.socket.accept(wait)?;
        Ok(socket.map(|socket| Connection { socket }))
    }
}

/// A connection, which carries letters both ways.
#[derive(Debug)]
pub struct Connection {
    socket: Socket,
}

impl Connection {
    /// Calls somebody; gives up after about three seconds.
    ///
    /// # Errors
    /// What libudt says: nobody answers, or answers in another mode.
    pub fn connect(address: SocketAddrV4) -> Result<Connection, UdtError> {
        let socket = Socket::connect(address)?;
        Ok(Connection { socket })
    }

    /// Who is at the other end.
    ///
    /// # Errors
    /// What libudt says.
    pub fn peer_addr(&self) -> Result<SocketAddrV4, UdtError> {
        self.socket.peer()
    }

    /// Hands a letter to libudt, which sends it for as long as the connection lasts; how far it has
    /// got, [`flush`](Self::flush) tells.
    ///
    /// # Errors
    /// If the connection is broken, the letter empty or longer than [`MAX_LETTER`], or the buffer
    /// still full of earlier ones after so long.
    pub fn send(&self, letter: &[u8], wait: Duration) -> Result<(), UdtError> {
        if letter.is_empty() || letter.len() > MAX_LETTER {
            return Err(UdtError {
                what: "cannot send",
                text: format!(
                    "a letter over UDT has 1 to {MAX_LETTER} octets, not {}",
                    letter.len()
                ),
                code: 0,
            });
        }
        self.socket.send(letter, wait)
    }

    /// Waits until the libudt of the other side has confirmed that it has all letters that were sent,
    /// for so long at most; whether it has. Whether the program there has read them, nothing tells.
    ///
    /// # Errors
    /// If the connection is broken or the other end has closed it.
    pub fn flush(&self, wait: Duration) -> Result<bool, UdtError> {
        let until = Instant::now() + wait;
        loop {
            if self.socket.is_confirmed()? {
                return Ok(true);
            }
            if Instant::now() >= until {
                return Ok(false);
            }
            std::thread::sleep(LOOK);
        }
    }

    /// The next letter, or `None` if none comes for so long.
    ///
    /// # Errors
    /// If the connection is broken or the other end has closed it.
    pub fn receive(&self, wait: Duration) -> Result<Option<Vec<u8>>, UdtError> {
        self.socket.receive(wait, MAX_LETTER)
    }
}
