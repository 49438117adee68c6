//! Letters that are not taken: what they were is answered, and nothing is kept of them.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::agents::{HTTP, http_of};
use crate::support::PATIENCE;
use crate::support::daemon::{Daemon, Place};

const HEAD: &str = "POST /acc HTTP/1.1\r\nHost: h\r\n\
    Content-Type: multipart/mixed; boundary=\"B\"\r\n";

/// Octets of memory that refused letters may leave behind. Freed memory is not given back to the
/// system page by page: each thread's heap keeps what its largest small allocations took.
const SLACK: u64 = 8 << 20;

const MIB: usize = 1 << 20;

/// A daemon, and what it needs while nothing happens.
struct Idle {
    daemon: Daemon,
    authority: String,
    memory: u64,
    files: usize,
}

impl Idle {
    /// A daemon that has had a letter of every kind, so that what it keeps for all is there.
    fn start(place: &Place) -> Idle {
        let daemon = place.start_with("robot1", &HTTP);
        let url = http_of(&daemon);
        let mut idle = Idle {
            authority: url.split('/').nth(2).unwrap().to_owned(),
            daemon,
            memory: 0,
            files: 0,
        };
        idle.files = idle.files();
        (0..50).for_each(|_| post_badly(&idle.authority));
        idle.wait_until_closed();
        idle.memory = idle.memory("VmRSS:");
        idle
    }

    fn files(&self) -> usize {
        let folder = format!("/proc/{}/fd", self.daemon.id());
        std::fs::read_dir(folder).unwrap().count()
    }

    /// Octets of the daemon's memory, now or at most until now.
    fn memory(&self, which: &str) -> u64 {
        let status = format!("/proc/{}/status", self.daemon.id());
        let status = std::fs::read_to_string(status).unwrap();
        let mut lines = status.lines();
        let line = lines.find(|line| line.starts_with(which)).unwrap();
        let kib: u64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
        kib << 10
    }

    fn wait_until_closed(&self) {
        let until = Instant::now() + PATIENCE;
        while self.files() > self.files {
            assert!(Instant::now() < until, "connections are left open");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// That the daemon has what it had, within a while.
    fn is_as_before(&self) {
        self.wait_until_closed();
        let until = Instant::now() + PATIENCE;
        while self.memory("VmRSS:") > self.memory + SLACK {
            let (now, before) = (self.memory("VmRSS:"), self.memory);
            assert!(Instant::now() < until, "{now} octets, {before} before");
            std::thread::sleep(Duration::from_millis(100));
        }
        let (now, before) = (self.memory("VmRSS:"), self.memory);
        println!("{} KiB, {} before", now >> 10, before >> 10);
    }
}

fn connect(authority: &str) -> TcpStream {
    let stream = TcpStream::connect(authority).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

/// One letter of each kind that is refused, each over a connection of its own, and one whose
/// sender goes in the middle of it.
fn post_badly(authority: &str) {
    let broken = "--B\r\n\r\n<?xml version=\"1.0\"?><envelope><par\r\n--B\r\n\r\n(a)\r\n--B--";
    let length = broken.len();
    for (request, wanted) in [
        (
            format!("{HEAD}Content-Length: {length}\r\n\r\n{broken}"),
            400,
        ),
        (format!("{HEAD}Content-Length: 4\r\n\r\n--B\n"), 400),
        (format!("{HEAD}Content-Length: {}\r\n\r\n", 1 << 30), 413),
        (format!("{HEAD}\r\n"), 411),
        ("PUT /acc HTTP/1.1\r\nHost: h\r\n\r\n".to_owned(), 405),
    ] {
        let mut stream = connect(authority);
        stream.write_all(request.as_bytes()).unwrap();
        assert_eq!(status(&mut stream), wanted, "{request}");
    }
    let mut stream = connect(authority);
    let begun = format!("{HEAD}Content-Length: {MIB}\r\n\r\n");
    stream.write_all(begun.as_bytes()).unwrap();
    stream.write_all(&vec![b'x'; MIB / 2]).unwrap();
}

/// The status of the answer that comes.
fn status(stream: &mut TcpStream) -> u16 {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n") {
        let mut octet = [0];
        stream.read_exact(&mut octet).expect("no answer");
        head.push(octet[0]);
    }
    let head = String::from_utf8(head).unwrap();
    head.split(' ').nth(1).unwrap().parse().unwrap()
}

/// Writes until all is written, or the other side wants no more; how much that was.
fn write_while_taken(stream: &mut TcpStream, part: &[u8], times: usize) -> usize {
    for written in 0..times {
        match stream.write_all(part) {
            Ok(()) => {}
            Err(error) => {
                let closed = [ErrorKind::BrokenPipe, ErrorKind::ConnectionReset];
                assert!(closed.contains(&error.kind()), "{error}");
                return written;
            }
        }
    }
    times
}

#[test]
fn a_letter_of_a_gibibyte_is_refused_before_it_is_read_if_it_says_so() {
    let place = Place::new();
    let idle = Idle::start(&place);
    let mut stream = connect(&idle.authority);
    let head = format!("{HEAD}Content-Length: {}\r\n\r\n", 1 << 30);
    stream.write_all(head.as_bytes()).unwrap();
    assert_eq!(status(&mut stream), 413);
    // Whoever goes on is not listened to.
    let written = write_while_taken(&mut stream, &vec![b'x'; MIB], 1 << 10);
    assert!(written < 64, "{written} MiB were taken");
    drop(stream);
    idle.is_as_before();
    assert!(idle.memory("VmHWM:") < idle.memory + SLACK);
}

#[test]
fn a_letter_of_a_gibibyte_in_chunks_is_refused_where_it_becomes_too_large() {
    let place = Place::new();
    let idle = Idle::start(&place);
    let mut stream = connect(&idle.authority);
    let head = format!("{HEAD}Transfer-Encoding: chunked\r\n\r\n");
    stream.write_all(head.as_bytes()).unwrap();
    let chunk = [format!("{MIB:x}\r\n").as_bytes(), &vec![b'x'; MIB], b"\r\n"].concat();
    let written = write_while_taken(&mut stream, &chunk, 1 << 10);
    assert!((256..320).contains(&written), "{written} MiB were taken");
    assert_eq!(status(&mut stream), 413);
    drop(stream);
    // 256 MiB for the largest payload, and one for what is around it.
    let most = idle.memory("VmHWM:") - idle.memory;
    assert!(most < 257 * MIB as u64 + SLACK, "{most} octets");
    idle.is_as_before();
}

#[test]
fn of_many_letters_that_are_refused_nothing_is_left() {
    let place = Place::new();
    let idle = Idle::start(&place);
    for _ in 0..4 {
        let authority = &idle.authority;
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| (0..25).for_each(|_| post_badly(authority)));
            }
        });
        idle.is_as_before();
    }
}
