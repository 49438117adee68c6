//! Hostile inputs are refused, and cost no more memory than honest ones.

mod support;

use bytes::Bytes;
use fipa_codec::bit_efficient::{decode_letter, decode_letter_prefix, decode_message};
use fipa_codec::{Fault, Limits};
use support::hex;

const INFORM: &[u8] = b"\xfa\x10\x08";
const BASE: &[u8] = b"\xfe\x00\x0f\x10\x20\x31\x25\x16\x18\x24\x56\x1a\x12\x34";
const MANY: usize = 1 << 20;

fn message_fault(octets: Vec<u8>) -> Fault {
    let octets = Bytes::from(octets);
    decode_message(&octets, &Limits::default())
        .unwrap_err()
        .fault
}

fn letter_fault(octets: Vec<u8>) -> Fault {
    let octets = Bytes::from(octets);
    decode_letter(&octets, &Limits::default())
        .unwrap_err()
        .fault
}

/// The most address space that this process ever had, in octets, where the system tells.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmPeak:"));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    number.map_or(0, |number| number.parse::<u64>().unwrap() * 1024)
}

/// One test, so that nothing else allocates meanwhile.
#[test]
fn hostile_inputs_are_refused_without_much_memory() {
    let before = peak();
    announced_lengths();
    depth_bombs();
    long_lists();
    many_layers();
    long_inputs();
    assert!(
        peak() - before < 256 << 20,
        "{} MiB",
        (peak() - before) >> 20
    );
}

fn announced_lengths() {
    for announced in [&b"\x19\xff\xff\xff\xff"[..], b"\x17\xff\xff", b"\x16\xff"] {
        for prefix in [&b"\x04"[..], b"\x04\xff", b"\x09"] {
            let octets = [INFORM, prefix, announced, b"hello\x01"].concat();
            assert_eq!(message_fault(octets), Fault::Malformed);
        }
    }
    let fused = [INFORM, b"\x09\x78\xff\xff\xff\xff"].concat();
    assert_eq!(message_fault(fused), Fault::Malformed);
    assert_eq!(
        message_fault([INFORM, b"\x04\x14#4294967295\"hello"].concat()),
        Fault::Malformed
    );
    let length = hex("fe 00 00 ff ff ff ff 10 20 31 25 16 18 24 56 1a 12 34 08");
    assert_eq!(letter_fault(length.to_vec()), Fault::Malformed);
    let payload = [BASE, b"\x06\x12\xaa\xaa\xaa\xaa\xaa\xaa\xaa\xaa\xa0\x01PAY"].concat();
    let (letter, _) = decode_letter_prefix(&payload.into(), &Limits::default()).unwrap();
    assert_eq!(letter.payload, "PAY");
}

fn depth_bombs() {
    for open in [&b"\x60"[..], b"\x70a\0"] {
        let octets = [INFORM, b"\x09", &open.repeat(MANY)].concat();
        assert_eq!(message_fault(octets), Fault::Limit);
    }
    let resolvers = b"\x02\x10a\0\x03".repeat(MANY);
    assert_eq!(
        message_fault([INFORM, b"\x02", &resolvers].concat()),
        Fault::Limit
    );
    let resolvers = b"\x02a\0\x03".repeat(MANY);
    assert_eq!(
        letter_fault([BASE, b"\x03", &resolvers].concat()),
        Fault::Limit
    );
    let just = Limits {
        max_depth: 2,
        ..Limits::default()
    };
    let nested = |depth: usize| -> Bytes {
        let lists = [b"\x60".repeat(depth), b"\x40".repeat(depth)].concat();
        [INFORM, b"\x09", &lists, b"\x01"].concat().into()
    };
    assert!(decode_message(&nested(2), &just).is_ok());
    assert_eq!(
        decode_message(&nested(3), &just).unwrap_err().fault,
        Fault::Limit
    );
}

fn long_lists() {
    for entry in [&b"\x60\x40"[..], b"\x10\0", b"\x12\x10", b"\x16\0"] {
        let octets = [INFORM, b"\x09\x60", &entry.repeat(MANY), b"\x40\x01"].concat();
        assert_eq!(message_fault(octets), Fault::Limit);
    }
    // Many short lists are no way around it.
    let lists = b"\x60\x10a\0\x40".repeat(MANY);
    let octets = [INFORM, b"\x09\x60", &lists, b"\x40\x01"].concat();
    assert_eq!(message_fault(octets), Fault::Limit);
    for entry in [&b"\x00\x10a\0\x10b\0"[..], b"\x03\x02\x10a\0\x01\x01"] {
        let octets = [INFORM, &entry.repeat(MANY), b"\x01"].concat();
        assert_eq!(message_fault(octets), Fault::Limit);
    }
    let receivers = b"\x02a\0\x01".repeat(MANY);
    assert_eq!(
        letter_fault([BASE, b"\x02", &receivers].concat()),
        Fault::Limit
    );
    assert_eq!(
        letter_fault([BASE, &b"\x00a\0b\0".repeat(MANY)].concat()),
        Fault::Limit
    );
}

fn many_layers() {
    let overlay = b"\xfd\x00\x0fa\0\x20\x31\x25\x16\x18\x24\x56\x1a\x12\x34\x01\x01";
    let layers = |overlays: usize| -> Bytes {
        [&overlay.repeat(overlays)[..], BASE, b"\x01"]
            .concat()
            .into()
    };
    let limits = Limits {
        max_layers: 3,
        ..Limits::default()
    };
    assert!(decode_letter(&layers(2), &limits).is_ok());
    assert_eq!(
        decode_letter(&layers(3), &limits).unwrap_err().fault,
        Fault::Limit
    );
    assert_eq!(letter_fault(layers(MANY).to_vec()), Fault::Limit);
}

fn long_inputs() {
    let limits = Limits {
        max_octets: 20,
        ..Limits::default()
    };
    let message: Bytes = [INFORM, b"\x04\x16\x14", &[b'x'; 20], b"\x01"]
        .concat()
        .into();
    assert_eq!(
        decode_message(&message, &limits).unwrap_err().fault,
        Fault::Limit
    );
    let letter: Bytes = [BASE, b"\x01PAYLOAD"].concat().into();
    assert_eq!(
        decode_letter(&letter, &limits).unwrap_err().fault,
        Fault::Limit
    );
    let digits = [INFORM, b"\x09\x12", &[0x22; MANY], b"\x20\x01"].concat();
    assert!(decode_message(&digits.into(), &Limits::default()).is_ok());
    let count = [BASE, b"\x06\x12", &[0x22; MANY], b"\x20\x01"].concat();
    assert_eq!(letter_fault(count), Fault::Malformed);
}
