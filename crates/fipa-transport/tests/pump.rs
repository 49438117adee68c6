//! What a driver gives arrives, however it gives it.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_directory::Address;
use fipa_transport::{Driver, Handle, Listener, dial, pump};
use tokio::sync::mpsc;

/// Gives its parts one at a time.
struct Giving(Mutex<VecDeque<Bytes>>);

impl Driver for Giving {
    fn received(&self, octets: &mut BytesMut) {
        octets.clear();
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        let mut own = self.0.lock().unwrap();
        parts.extend(own.pop_front());
        !own.is_empty()
    }

    fn closed(&self, _reason: &str) {}
}

/// Tells how many octets have come.
struct Taking {
    octets: AtomicUsize,
    told: mpsc::UnboundedSender<usize>,
}

impl Driver for Taking {
    fn received(&self, octets: &mut BytesMut) {
        let before = self.octets.fetch_add(octets.len(), Ordering::Relaxed);
        let _ = self.told.send(before + octets.len());
        octets.clear();
    }

    fn transmit(&self, _parts: &mut VecDeque<Bytes>) -> bool {
        false
    }

    fn closed(&self, _reason: &str) {}
}

#[tokio::test]
async fn all_that_a_driver_has_is_written_without_waking_it_again() {
    let listener = Listener::bind(&Address::tcp("127.0.0.1", 0)).await.unwrap();
    let addresses = [listener.address().clone()];
    let (dialled, accepted) = tokio::join!(dial(&addresses), listener.accept());
    let (told, mut octets) = mpsc::unbounded_channel();
    let taking = Taking {
        octets: AtomicUsize::new(0),
        told,
    };
    tokio::spawn(pump(accepted.unwrap(), Arc::new(Handle::default()), taking));
    let parts = VecDeque::from(vec![Bytes::from_static(&[7; 100]); 5]);
    let giving = Giving(Mutex::new(parts));
    tokio::spawn(pump(
        dialled.unwrap().0,
        Arc::new(Handle::default()),
        giving,
    ));
    let all = async { while octets.recv().await.is_some_and(|octets| octets < 500) {} };
    let arrived = tokio::time::timeout(Duration::from_secs(10), all).await;
    assert!(arrived.is_ok());
}
