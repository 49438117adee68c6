//! The life of a link: greeting, heartbeat, silence, end.

use std::time::Duration;

use bytes::{BufMut, Bytes, BytesMut};
use fipa_acl::Text;
use fipa_directory::{InstanceId, Now};
use fipa_link::{Event, Frame, Hello, LetterFrame, Link, LinkConfig, LinkError, PREAMBLE, Role};

const fn secs(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

fn at(seconds: u64) -> Now {
    Now::default().plus(secs(seconds))
}

fn hello(n: u8) -> Hello {
    Hello {
        version: Hello::VERSION,
        role: Role::Daemon,
        instance: InstanceId::from_bytes([n; 16]),
        name: Text::from(format!("daemon{n}")),
        scope: Text::default(),
        endpoints: vec![Text::from("tcp://robot:4100")],
        max_letter: 1000,
        unix_millis: 0,
        checks: false,
    }
}

fn link(n: u8) -> Link {
    Link::new(LinkConfig::new(hello(n)), at(0))
}

fn written(link: &mut Link) -> BytesMut {
    let mut octets = BytesMut::new();
    while let Some(part) = link.poll_transmit() {
        octets.extend_from_slice(&part);
    }
    assert_eq!(link.queued(), 0);
    octets
}

fn read(link: &mut Link, now: Now, mut octets: BytesMut) -> Result<Vec<Event>, LinkError> {
    let mut events = Vec::new();
    while let Some(event) = link.receive(now, &mut octets)? {
        events.push(event);
    }
    Ok(events)
}

/// Two ends that have greeted each other.
fn greeted() -> (Link, Link) {
    let (mut one, mut two) = (link(1), link(2));
    let (from_one, from_two) = (written(&mut one), written(&mut two));
    let events = read(&mut one, at(0), from_two);
    assert_eq!(events, Ok(vec![Event::Opened(hello(2))]));
    let events = read(&mut two, at(0), from_one);
    assert_eq!(events, Ok(vec![Event::Opened(hello(1))]));
    (one, two)
}

fn letter(octets: usize) -> Frame {
    Frame::Letter(LetterFrame {
        id: 1,
        ttl_millis: 1000,
        parts: Bytes::from(vec![0; octets]).into(),
    })
}

#[test]
fn no_known_protocol_begins_like_a_link() {
    let first = PREAMBLE[0];
    // Bit-efficient messages and envelopes, strings, XML, TLS records.
    let others = [0xfa, 0xfb, 0xfc, 0xfd, 0xfe, b'(', b'<', 0x16];
    assert!(!others.contains(&first));
    // HTTP requests, ssh, IIOP, and whatever else begins with a letter or a blank.
    assert!(!first.is_ascii());
    // Nor is it the beginning of text in UTF-8.
    assert!(std::str::from_utf8(&[first]).is_err());
    assert!((0x80..0xc0).contains(&first));
}

#[test]
fn other_protocols_are_recognised_by_their_first_octets() {
    for other in ["GET / HTTP/1.1\r\n", "(inform)", "\x16\x03\x01", "S"] {
        let octets = BytesMut::from(other.as_bytes());
        assert_eq!(read(&mut link(1), at(0), octets), Err(LinkError::Preamble));
    }
    let almost = BytesMut::from(&b"\x8fFIPB"[..]);
    assert_eq!(read(&mut link(1), at(0), almost), Err(LinkError::Preamble));
    let newer = BytesMut::from(&b"\x8fFIPA\r\n\x02"[..]);
    assert_eq!(read(&mut link(1), at(0), newer), Err(LinkError::Version(2)));
}

#[test]
fn a_partner_that_says_nothing_is_given_up_after_five_seconds() {
    let mut link = link(1);
    assert_eq!(link.poll_timeout(), secs(5));
    assert_eq!(link.handle_timeout(at(4)), Ok(None));
    assert_eq!(link.handle_timeout(at(5)), Err(LinkError::NoHello));
}

#[test]
fn a_partner_that_dawdles_with_its_hello_is_given_up_as_well() {
    let mut link = link(1);
    let mut received = BytesMut::new();
    for (second, octet) in (0..).zip(PREAMBLE) {
        received.put_u8(octet);
        let receive = link.receive(at(second), &mut received);
        assert_eq!(receive, Ok(None));
        assert_eq!(link.poll_timeout(), secs(5));
    }
    assert_eq!(link.handle_timeout(at(8)), Err(LinkError::NoHello));
}

#[test]
fn a_second_hello_and_a_frame_before_the_first_are_out_of_order() {
    let (mut one, mut two) = greeted();
    two.send(at(0), Frame::Hello(hello(2)));
    let octets = written(&mut two);
    assert_eq!(read(&mut one, at(0), octets), Err(LinkError::Order));
    let mut early = BytesMut::from(&PREAMBLE[..]);
    early.put_slice(&[0, 0, 0, 1, 7]);
    assert_eq!(read(&mut link(1), at(0), early), Err(LinkError::Order));
}

#[test]
fn a_goodbye_may_come_instead_of_the_hello() {
    let mut octets = BytesMut::from(&PREAMBLE[..]);
    octets.put_slice(b"\0\0\0\x08\x0b\0\0\0\x03bye");
    let events = read(&mut link(1), at(0), octets);
    let goodbye = Frame::Goodbye(Text::from("bye"));
    assert_eq!(events, Ok(vec![Event::Frame(goodbye)]));
}

#[test]
fn an_idle_link_is_pinged_every_ten_seconds_and_answered() {
    let (mut one, mut two) = greeted();
    for second in (10..100).step_by(10) {
        assert_eq!(one.poll_timeout(), secs(second));
        assert_eq!(one.handle_timeout(at(second)), Ok(None));
        let ping = written(&mut one);
        assert_eq!(ping.len(), 13);
        assert_eq!(read(&mut two, at(second), ping), Ok(vec![]));
        let pong = written(&mut two);
        assert_eq!(read(&mut one, at(second), pong), Ok(vec![]));
        assert_eq!(written(&mut one), "", "a pong has no answer");
        // Who has just been heard and has answered need not ask.
        assert_eq!(two.poll_timeout(), secs(second + 10));
    }
}

#[test]
fn letters_quicken_the_heartbeat_for_a_minute() {
    let (mut one, mut two) = greeted();
    one.send(at(1), letter(10));
    assert_eq!(one.poll_timeout(), secs(2));
    let octets = written(&mut one);
    read(&mut two, at(1), octets).unwrap();
    assert_eq!(two.poll_timeout(), secs(2));
    let mut second = 1;
    while one.poll_timeout() < secs(second + 10) {
        second = one.poll_timeout().as_secs();
        one.handle_timeout(at(second)).unwrap();
        let octets = written(&mut one);
        read(&mut two, at(second), octets).unwrap();
        let octets = written(&mut two);
        read(&mut one, at(second), octets).unwrap();
    }
    assert!((60..66).contains(&second), "{second}");
}

#[test]
fn a_partner_is_silent_after_three_misses_and_dead_after_six() {
    let (mut one, _) = greeted();
    let mut told = Vec::new();
    let error = loop {
        let now = Now::default().plus(one.poll_timeout());
        match one.handle_timeout(now) {
            Ok(event) => told.extend(event.map(|event| (now.mono.as_secs(), event))),
            Err(error) => break (now.mono.as_secs(), error),
        }
    };
    assert_eq!(told, [(40, Event::Silent)]);
    assert_eq!(error, (70, LinkError::Dead));
}

#[test]
fn a_partner_that_is_heard_again_begins_anew() {
    let (mut one, mut two) = greeted();
    for second in [10, 20, 30, 40, 50, 60] {
        one.handle_timeout(at(second)).unwrap();
    }
    let octets = written(&mut one);
    read(&mut two, at(61), octets).unwrap();
    let octets = written(&mut two);
    assert_eq!(read(&mut one, at(61), octets), Ok(vec![Event::Heard]));
    assert_eq!(one.poll_timeout(), secs(70), "its last ping was at 60");
    for second in [71, 81, 91] {
        assert_eq!(one.handle_timeout(at(second)), Ok(None));
    }
    assert_eq!(one.handle_timeout(at(101)), Ok(Some(Event::Silent)));
}

#[test]
fn who_receives_a_large_letter_is_heard_meanwhile() {
    let (mut one, mut two) = greeted();
    one.send(at(0), letter(1000));
    let octets = written(&mut one);
    let mut received = BytesMut::new();
    let mut heard = 0;
    for (second, chunk) in (1..).zip(octets.chunks(50)) {
        received.extend_from_slice(chunk);
        two.receive(at(second), &mut received).unwrap();
        if two.poll_timeout() <= secs(second) {
            two.handle_timeout(at(second)).unwrap();
        }
        heard += usize::from(!written(&mut two).is_empty());
    }
    assert!(heard >= 10, "{heard} in 20 seconds");
}

#[test]
fn a_frame_of_four_gibioctets_is_refused_by_its_head_alone() {
    for kind in [2, 3, 8, 99] {
        let (mut one, _) = greeted();
        let mut received = BytesMut::new();
        received.put_u32(u32::MAX);
        received.put_u8(kind);
        let before = received.capacity();
        let refused = one.receive(at(0), &mut received);
        assert_eq!(refused, Err(LinkError::TooLarge(u32::MAX as usize)));
        assert_eq!(received.capacity(), before);
    }
}

#[test]
fn letters_are_limited_by_what_the_hello_said() {
    let (mut one, mut two) = greeted();
    two.send(at(0), letter(1000));
    let octets = written(&mut two);
    assert_eq!(read(&mut one, at(0), octets).unwrap().len(), 1);
    two.send(at(0), letter(200_000));
    let octets = written(&mut two);
    let refused = read(&mut one, at(0), octets);
    assert!(matches!(refused, Err(LinkError::TooLarge(_))));
}

#[test]
fn only_a_program_is_told_of_letters_that_are_larger_than_other_frames() {
    let head = |link: &mut Link| {
        let mut received = BytesMut::new();
        received.put_u32(5 << 20);
        received.put_u8(23);
        link.receive(at(0), &mut received)
    };
    let greet = |role| {
        let told = Hello {
            role,
            max_letter: 8 << 20,
            ..hello(1)
        };
        let mut one = Link::new(LinkConfig::new(told), at(0));
        let octets = written(&mut link(2));
        read(&mut one, at(0), octets).unwrap();
        one
    };
    assert_eq!(head(&mut greet(Role::Program)), Ok(None));
    let refused = head(&mut greet(Role::Daemon));
    assert_eq!(refused, Err(LinkError::TooLarge(5 << 20)));
}

#[test]
fn a_frame_without_a_kind_is_refused() {
    let (mut one, _) = greeted();
    let octets = BytesMut::from(&[0, 0, 0, 0, 7][..]);
    assert_eq!(read(&mut one, at(0), octets), Err(LinkError::TooLarge(0)));
}

#[test]
fn a_kind_that_is_not_known_is_passed_over() {
    let (mut one, mut two) = greeted();
    let mut octets = BytesMut::from(&b"\0\0\0\x04\x64abc"[..]);
    two.goodbye(at(0), "that was all");
    octets.extend_from_slice(&written(&mut two));
    let goodbye = Frame::Goodbye(Text::from("that was all"));
    assert_eq!(
        read(&mut one, at(0), octets),
        Ok(vec![Event::Frame(goodbye)])
    );
}
