//! What the tests share.
#![allow(dead_code)] // Each test takes what it needs.

#[cfg(feature = "tls")]
pub(crate) mod careless;

use std::collections::VecDeque;
use std::net::TcpStream;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_directory::Address;
use fipa_transport::{Buffers, Driver, End, Handle, Listener, Stream, pump};

/// A stream, and a plain socket at its other end.
pub(crate) async fn pair() -> (Stream, TcpStream) {
    let listener = Listener::bind(&Address::tcp("127.0.0.1", 0)).await.unwrap();
    let Address::Tcp { host, port } = listener.address() else {
        unreachable!("it was bound so");
    };
    let plain = TcpStream::connect((host.as_str(), *port)).unwrap();
    plain
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    plain.set_nodelay(true).unwrap();
    (listener.accept().await.unwrap(), plain)
}

/// Runs a connection as a task.
pub(crate) fn spawn(stream: Stream, buffers: &Arc<Buffers>, driver: impl Driver) -> Arc<Handle> {
    let handle = Arc::new(Handle::default());
    tokio::spawn(pump(
        stream,
        Arc::clone(&handle),
        Arc::clone(buffers),
        driver,
    ));
    handle
}

/// Takes pieces behind their lengths, whole, and hands them on.
pub(crate) struct Pieces<F>(pub(crate) Mutex<F>);

impl<F: FnMut(Bytes) + Send + 'static> Driver for Pieces<F> {
    fn received(&self, octets: &mut BytesMut) {
        while let Some(length) = octets.first_chunk() {
            let whole = 4 + u32::from_be_bytes(*length) as usize;
            if octets.len() < whole {
                return;
            }
            let piece = octets.split_to(whole).freeze().slice(4..);
            (self.0.lock().unwrap())(piece);
        }
    }

    fn transmit(&self, _parts: &mut VecDeque<Bytes>) -> bool {
        false
    }

    fn closed(&self, _end: &End, _all_written: bool) {}
}
