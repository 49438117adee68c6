//! What links take of the system's memory: for a letter that passes, and for one that does not end.

mod support;

use std::alloc::System;
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::{Event, Frame, Hello, LetterFrame, Link, LinkConfig, Role};
use fipa_transport::{Buffers, Driver, End, Handle};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};

use support::{pair, spawn};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The tests count what the whole process does, so they take turns.
static TURN: tokio::sync::Mutex<()> = tokio::sync::Mutex::const_new(());

/// One end of a link whose letters go out on another.
struct Forwarder {
    link: Arc<Mutex<Link>>,
    other: Arc<Mutex<Link>>,
    handle: Arc<OnceLock<Arc<Handle>>>,
}

impl Driver for Forwarder {
    fn received(&self, octets: &mut BytesMut) {
        let mut link = self.link.lock().unwrap();
        while let Some(event) = link.receive(Now::default(), octets).unwrap() {
            if let Event::Frame(letter @ Frame::Letter(_)) = event {
                self.other.lock().unwrap().send(Now::default(), letter);
            }
        }
        if let Some(handle) = self.handle.get() {
            handle.transmit();
        }
    }

    fn transmit(&self, parts: &mut VecDeque<Bytes>) -> bool {
        let mut link = self.link.lock().unwrap();
        parts.extend(std::iter::from_fn(|| link.poll_transmit()));
        false
    }

    fn closed(&self, _end: &End, _all_written: bool) {}
}

fn link() -> Link {
    let hello = Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([7; 16]),
        name: Text::from_static("one"),
        scope: Text::default(),
        endpoints: Vec::new(),
        max_letter: 256 << 20,
        unix_millis: 0,
        checks: false,
    };
    Link::new(LinkConfig::new(hello), Now::default())
}

/// What one end says before anything else.
fn greeting() -> Vec<u8> {
    let mut link = link();
    let parts: Vec<Bytes> = std::iter::from_fn(|| link.poll_transmit()).collect();
    parts.concat()
}

fn letters(octets: usize, count: usize) -> Vec<u8> {
    let mut written = BytesMut::new();
    for id in 0..count as u64 {
        let parts = Frame::Letter(LetterFrame {
            id,
            ttl_millis: 1_000,
            parts: Bytes::from(vec![id as u8; octets]).into(),
        })
        .encode(&mut written);
        parts
            .iter()
            .for_each(|part| written.extend_from_slice(part));
    }
    written.into()
}

/// A greeted link, forwarded to another, whose plain ends are returned.
async fn forwarded(buffers: &Arc<Buffers>) -> (TcpStream, TcpStream) {
    let ((from, mut source), (to, mut sink)) = (pair().await, pair().await);
    let (one, two) = (Arc::new(Mutex::new(link())), Arc::new(Mutex::new(link())));
    let handles = [Arc::new(OnceLock::new()), Arc::new(OnceLock::new())];
    let driver = |link: &Arc<Mutex<Link>>, other: &Arc<Mutex<Link>>, handle: usize| Forwarder {
        link: Arc::clone(link),
        other: Arc::clone(other),
        handle: Arc::clone(&handles[handle]),
    };
    let first = spawn(from, buffers, driver(&one, &two, 1));
    let second = spawn(to, buffers, driver(&two, &one, 0));
    handles[0].set(first).unwrap();
    handles[1].set(second).unwrap();
    let mut greeted = vec![0; greeting().len()];
    for plain in [&mut source, &mut sink] {
        plain.write_all(&greeting()).unwrap();
    }
    let greet = move || {
        source.read_exact(&mut greeted).unwrap();
        sink.read_exact(&mut greeted).unwrap();
        (source, sink)
    };
    tokio::task::spawn_blocking(greet).await.unwrap()
}

/// Sends the octets so many times, and takes as many at the other end, without any memory.
async fn pass(
    (mut source, mut sink): (TcpStream, TcpStream),
    octets: Arc<Vec<u8>>,
    times: usize,
) -> (TcpStream, TcpStream) {
    let mut left = octets.len() * times;
    let writing = std::thread::spawn(move || {
        (0..times).for_each(|_| source.write_all(&octets).unwrap());
        source
    });
    let reading = std::thread::spawn(move || {
        let mut some = [0; 16 << 10];
        while left > 0 {
            left -= sink.read(&mut some).unwrap();
        }
        sink
    });
    let joined = move || (writing.join().unwrap(), reading.join().unwrap());
    tokio::task::spawn_blocking(joined).await.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn a_letter_that_passes_takes_memory_less_than_once() {
    let _turn = TURN.lock().await;
    for (octets, at_once, times) in [(100, 50, 200), (1_000, 50, 200), (16_000, 5, 200)] {
        let buffers = Arc::new(Buffers::default());
        let letters = Arc::new(letters(octets, at_once));
        let ends = pass(forwarded(&buffers).await, Arc::clone(&letters), 20).await;
        let before = ALLOCATOR.stats();
        let _ends = pass(ends, letters, times).await;
        let after = ALLOCATOR.stats();
        let taken =
            after.allocations - before.allocations + after.reallocations - before.reallocations;
        let each = taken as f64 / (at_once * times) as f64;
        println!("{octets} octets: memory is taken {each:.3} times a letter");
        assert!(each <= 1.0, "{octets} octets: {each} times a letter");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn a_large_letter_is_never_copied_into_one_piece() {
    let _turn = TURN.lock().await;
    let buffers = Arc::new(Buffers::default());
    let letter = Arc::new(letters(1 << 20, 1));
    let ends = pass(forwarded(&buffers).await, Arc::clone(&letter), 20).await;
    let before = ALLOCATOR.stats();
    let _ends = pass(ends, letter, 50).await;
    let taken = ALLOCATOR.stats().bytes_allocated - before.bytes_allocated;
    let share = taken as f64 / (50 << 20) as f64;
    println!("{share:.3} octets of memory are taken an octet of the letters");
    assert!(share <= 0.25, "{share} octets an octet");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 1)]
async fn letters_that_do_not_end_hold_what_came_of_them() {
    let _turn = TURN.lock().await;
    const STALLED: usize = 40;
    for came in [40, 3_000, 100_000] {
        let buffers = Arc::new(Buffers::default());
        let letter = letters(8 << 20, 1);
        let mut ends = Vec::new();
        for _ in 0..STALLED {
            ends.push(forwarded(&buffers).await);
        }
        let before = held();
        for (source, _) in &mut ends {
            for piece in letter[..came].chunks(20_000) {
                source.write_all(piece).unwrap();
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
            // Others go on, and do not find room where a stalled letter lies.
            let between = forwarded(&buffers).await;
            drop(pass(between, Arc::new(letters(1_000, 100)), 1).await);
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
        let each = (held() - before) / STALLED as isize;
        println!("{came} octets came: {each} are held a letter");
        // A piece of 16 KiB may be all that is used of a buffer.
        assert!(each <= 4 * came as isize + (8 << 10), "{came}: {each}");
    }
}

/// Octets of memory in use.
fn held() -> isize {
    let stats = ALLOCATOR.stats();
    stats.bytes_allocated as isize - stats.bytes_deallocated as isize
}
