//! The shim, with Rust's types around it. All `unsafe` code of the project is here.

use std::ffi::{CStr, c_char, c_int};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use crate::{MAX_LETTER, UdtError};

#[repr(C)]
struct RawError {
    code: c_int,
    text: [c_char; 200],
}

unsafe extern "C" {
    fn fipa_udt_listen(ip: u32, port: u16, buffer: c_int, error: *mut RawError) -> c_int;
    fn fipa_udt_local_port(socket: c_int, error: *mut RawError) -> c_int;
    fn fipa_udt_peer(socket: c_int, ip: *mut u32, port: *mut u16, error: *mut RawError) -> c_int;
    fn fipa_udt_accept(listener: c_int, milliseconds: c_int, error: *mut RawError) -> c_int;
    fn fipa_udt_connect(ip: u32, port: u16, buffer: c_int, error: *mut RawError) -> c_int;
    fn fipa_udt_send(
        socket: c_int,
        octets: *const c_char,
        count: c_int,
        milliseconds: c_int,
        error: *mut RawError,
    ) -> c_int;
    fn fipa_udt_unconfirmed(socket: c_int, error: *mut RawError) -> c_int;
    fn fipa_udt_receive(
        socket: c_int,
        octets: *mut c_char,
        capacity: c_int,
        milliseconds: c_int,
        error: *mut RawError,
    ) -> c_int;
    fn fipa_udt_close(socket: c_int);
}

/// A socket of libudt, closed when it is dropped. libudt allows calls from several threads.
#[derive(Debug)]
pub(crate) struct Socket(c_int);

impl Socket {
    pub(crate) fn listen(address: SocketAddrV4) -> Result<Socket, UdtError> {
        let (ip, port) = (address.ip().to_bits(), address.port());
        // SAFETY: only plain numbers and the error, which `call` keeps alive, are handed over.
        let socket = call("cannot listen", |error| unsafe {
            fipa_udt_listen(ip, port, octets(MAX_LETTER), error)
        })?;
        Ok(Socket(socket))
    }

    pub(crate) fn connect(address: SocketAddrV4) -> Result<Socket, UdtError> {
        let (ip, port) = (address.ip().to_bits(), address.port());
        // SAFETY: as for `listen`.
        let socket = call("cannot connect", |error| unsafe {
            fipa_udt_connect(ip, port, octets(MAX_LETTER), error)
        })?;
        Ok(Socket(socket))
    }

    pub(crate) fn local_port(&self) -> Result<u16, UdtError> {
        // SAFETY: as for `listen`; the socket is open as long as `self` lives.
        let port = call("no local port", |error| unsafe {
            fipa_udt_local_port(self.0, error)
        })?;
        Ok(u16::try_from(port).unwrap_or_default())
    }

    pub(crate) fn peer(&self) -> Result<SocketAddrV4, UdtError> {
        let (mut ip, mut port) = (0, 0);
        // SAFETY: `ip` and `port` outlive the call, which writes to nothing else.
        call("no peer", |error| unsafe {
            fipa_udt_peer(self.0, &mut ip, &mut port, error)
        })?;
        Ok(SocketAddrV4::new(Ipv4Addr::from_bits(ip), port))
    }

    pub(crate) fn accept(&self, wait: Duration) -> Result<Option<Socket>, UdtError> {
        // SAFETY: as for `local_port`.
        let socket = call("cannot accept", |error| unsafe {
            fipa_udt_accept(self.0, milliseconds(wait), error)
        })?;
        Ok((socket != 0).then_some(Socket(socket)))
    }

    pub(crate) fn send(&self, letter: &[u8], wait: Duration) -> Result<(), UdtError> {
        let count = octets(letter.len());
        // SAFETY: the letter has `count` octets and is only read, during the call.
        call("cannot send", |error| unsafe {
            fipa_udt_send(
                self.0,
                letter.as_ptr().cast(),
                count,
                milliseconds(wait),
                error,
            )
        })?;
        Ok(())
    }

    /// Whether the other side has confirmed all that was sent.
    pub(crate) fn is_confirmed(&self) -> Result<bool, UdtError> {
        // SAFETY: as for `local_port`.
        let packets = call("cannot send", |error| unsafe {
            fipa_udt_unconfirmed(self.0, error)
        })?;
        Ok(packets == 0)
    }

    pub(crate) fn receive(
        &self,
        wait: Duration,
        capacity: usize,
    ) -> Result<Option<Vec<u8>>, UdtError> {
        // Untouched pages of a fresh allocation cost nothing; the letter keeps what it needs.
        let mut letter = vec![0; capacity];
        // SAFETY: `letter` has `capacity` octets, to which the call writes at most.
        let count = call("cannot receive", |error| unsafe {
            let place = letter.as_mut_ptr().cast();
            fipa_udt_receive(self.0, place, octets(capacity), milliseconds(wait), error)
        })?;
        letter.truncate(usize::try_from(count).unwrap_or_default());
        letter.shrink_to_fit();
        Ok((count != 0).then_some(letter))
    }
}

impl Drop for Socket {
    fn drop(&mut self) {
        // SAFETY: the socket is open, and nobody has its number any more.
        unsafe { fipa_udt_close(self.0) }
    }
}

/// Calls the shim; -1 is an error.
fn call(what: &'static str, call: impl FnOnce(*mut RawError) -> c_int) -> Result<c_int, UdtError> {
    let mut error = RawError {
        code: 0,
        text: [0; 200],
    };
    match call(&mut error) {
        -1 => {
            // SAFETY: the shim ends the text with a zero, as it was before.
            let text = unsafe { CStr::from_ptr(error.text.as_ptr()) };
            Err(UdtError {
                what,
                text: text.to_string_lossy().trim_end_matches('.').to_owned(),
                code: error.code,
            })
        }
        result => Ok(result),
    }
}

fn milliseconds(wait: Duration) -> c_int {
    c_int::try_from(wait.as_millis()).unwrap_or(c_int::MAX)
}

fn octets(count: usize) -> c_int {
    c_int::try_from(count).unwrap_or(c_int::MAX)
}
