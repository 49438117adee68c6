//! What a driver gives arrives, however it gives it.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_directory::Address;
use fipa_transport::{Buffers, Driver, End, Handle, Listener, dial, pump};
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

    fn closed(&self, _end: &End, _all_written: bool) {}
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

    fn closed(&self, _end: &End, _all_written: bool) {}
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
    let buffers = Arc::new(Buffers::default());
    let shared = Arc::clone(&buffers);
    tokio::spawn(pump(
        accepted.unwrap(),
        Arc::new(Handle::default()),
        shared,
        taking,
    ));
    let parts = VecDeque::from(vec![Bytes::from_static(&[7; 100]); 5]);
    let giving = Giving(Mutex::new(parts));
    tokio::spawn(pump(
        dialled.unwrap().0,
        Arc::new(Handle::default()),
        buffers,
        giving,
    ));
    let all = async { while octets.recv().await.is_some_and(|octets| octets < 500) {} };
    let arrived = tokio::time::timeout(Duration::from_secs(10), all).await;
    assert!(arrived.is_ok());
}

/// Gives its parts at once, and tells how the connection ended.
struct Writing {
    parts: Mutex<VecDeque<Bytes>>,
    told: mpsc::UnboundedSender<(String, bool)>,
}

impl Driver for Writing {
    fn received(&self, octets: &mut BytesMut) {
        octets.clear();
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        parts.append(&mut self.parts.lock().unwrap());
        false
    }

    fn closed(&self, end: &End, all_written: bool) {
        let end = match end {
            End::Broken(_) => "broken".to_owned(),
            end => end.to_string(),
        };
        let _ = self.told.send((end, all_written));
    }
}

/// Octets that no socket takes at once.
const MANY: usize = 16 << 20;

/// Writes many octets to a socket that `read` reads from, with `wish` made of the connection; what
/// `read` said, how the connection ended, and whether all was written.
async fn write_to<R: Send + 'static>(
    wish: impl FnOnce(&Handle),
    read: impl FnOnce(std::net::TcpStream) -> R + Send + 'static,
) -> (R, String, bool) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let reading = tokio::task::spawn_blocking(move || read(listener.accept().unwrap().0));
    let (stream, _) = dial(&[Address::tcp("127.0.0.1", port)]).await.unwrap();
    let (told, mut ended) = mpsc::unbounded_channel();
    let parts = VecDeque::from(vec![Bytes::from(vec![7; MANY])]);
    let writing = Writing {
        parts: Mutex::new(parts),
        told,
    };
    let handle = Arc::new(Handle::default());
    tokio::spawn(pump(stream, Arc::clone(&handle), Arc::default(), writing));
    tokio::time::sleep(Duration::from_millis(50)).await;
    wish(&handle);
    let read = reading.await.unwrap();
    let (end, all_written) = ended.recv().await.unwrap();
    (read, end, all_written)
}

#[tokio::test]
async fn what_is_to_be_finished_is_written_however_late_the_other_side_reads() {
    let (read, end, all_written) = write_to(Handle::finish, |mut stream| {
        std::thread::sleep(Duration::from_millis(1500));
        stream.read_to_end(&mut Vec::new()).unwrap()
    })
    .await;
    assert_eq!((read, end.as_str(), all_written), (MANY, "closed", true));
}

#[tokio::test]
async fn what_is_broken_off_ends_in_an_error_for_the_other_side() {
    let (read, end, all_written) = write_to(Handle::abort, |mut stream| {
        std::thread::sleep(Duration::from_millis(200));
        stream.read_to_end(&mut Vec::new()).map_err(|e| e.kind())
    })
    .await;
    assert_eq!(read, Err(ErrorKind::ConnectionReset));
    assert_eq!((end.as_str(), all_written), ("closed", false));
}

#[tokio::test]
async fn a_reader_that_goes_away_in_the_middle_is_told_as_such() {
    let (_, end, all_written) = write_to(Handle::finish, |mut stream| {
        stream.read_exact(&mut [0; 1000]).unwrap();
    })
    .await;
    assert_eq!((end.as_str(), all_written), ("broken", false));
}
#[tokio::test]
async fn what_a_socket_refuses_is_written_once_the_partner_reads() {
    const OCTETS: usize = 16 << 20;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("socket");
    let unix = Address::Unix(path.to_string_lossy().into_owned());
    for address in [Address::tcp("127.0.0.1", 0), unix] {
        let listener = Listener::bind(&address).await.unwrap();
        let addresses = [listener.address().clone()];
        let (dialled, accepted) = tokio::join!(dial(&addresses), listener.accept());
        let (told, mut octets) = mpsc::unbounded_channel();
        let taking = Taking {
            octets: AtomicUsize::new(0),
            told,
        };
        let parts = VecDeque::from(vec![Bytes::from(vec![7; OCTETS / 4]); 4]);
        let buffers = Arc::new(Buffers::default());
        let shared = Arc::clone(&buffers);
        let giving = Giving(Mutex::new(parts));
        let handle = Arc::new(Handle::default());
        tokio::spawn(pump(dialled.unwrap().0, handle, shared, giving));
        // Until the partner reads, the socket takes no more than fits into its buffers.
        tokio::time::sleep(Duration::from_millis(50)).await;
        let handle = Arc::new(Handle::default());
        tokio::spawn(pump(accepted.unwrap(), handle, buffers, taking));
        let all = async { while octets.recv().await.is_some_and(|octets| octets < OCTETS) {} };
        let arrived = tokio::time::timeout(Duration::from_secs(20), all).await;
        assert!(arrived.is_ok(), "{address}");
    }
}

/// Answers whatever comes, together with what others say to it.
struct Answering {
    heard: Arc<tokio::sync::Notify>,
    answer: Mutex<VecDeque<Bytes>>,
}

impl Driver for Answering {
    fn received(&self, octets: &mut BytesMut) {
        octets.clear();
        let answer = Bytes::from_static(b"receipt");
        self.answer.lock().unwrap().push_back(answer);
        self.heard.notify_one();
    }

    fn gives_way(&self) -> bool {
        true
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        parts.append(&mut self.answer.lock().unwrap());
        false
    }

    fn closed(&self, _end: &End, _all_written: bool) {}
}

#[test]
fn what_waits_when_the_runtime_ends_is_written() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let mut partner = runtime.block_on(async {
        let (stream, _) = dial(&[Address::tcp("127.0.0.1", port)]).await.unwrap();
        let heard = Arc::new(tokio::sync::Notify::new());
        let answering = Answering {
            heard: Arc::clone(&heard),
            answer: Mutex::default(),
        };
        tokio::spawn(pump(stream, Arc::default(), Arc::default(), answering));
        let (mut partner, _) = listener.accept().unwrap();
        partner.write_all(b"letter").unwrap();
        heard.notified().await;
        partner
    });
    drop(runtime);
    let mut answer = Vec::new();
    partner.read_to_end(&mut answer).unwrap();
    assert_eq!(answer, b"receipt");
}
