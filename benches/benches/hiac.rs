//! HIAC on a link: its overhead, and how fast packets are written and found again, beside a copy of
//! the same octets.

use std::hint::black_box;
use std::time::{Duration, Instant};

use hiac::edcp::{Decoder, Event, escaped};
use hiac::{Addressing, Check, Growing, Mask, Packet, PacketType};

/// Octets of the largest packet.
const LARGEST: usize = 65_536;

/// How long each operation is repeated.
const TIME: Duration = Duration::from_millis(500);

fn main() {
    let mask = Mask::new(0xFF).ok();
    let addressing = Addressing::Level {
        target: 5,
        source: 3,
    };
    let random: Vec<u8> = std::iter::repeat_with(random())
        .take(LARGEST - 11)
        .collect();
    let long = Packet {
        check: Check::Crc32,
        ..Packet::new(PacketType::MSG, 4, addressing, &random)
    };
    let link = on_the_link(&long, mask);
    let overhead = |packet: &Packet<'_>| {
        let encoded = packet.encode(mask).expect("a packet that can be written");
        let (octets, inside) = (on_the_link(packet, mask).len(), encoded.count());
        let share = 100.0 * (octets - inside) as f64 / inside as f64;
        println!("a packet of {inside:5} octets is {octets:5} on the link: {share:.1} % more");
    };
    overhead(&long);
    for check in [Check::Sum, Check::Crc32] {
        let signal = Packet::new(PacketType::SIG, 1, addressing, &[3]);
        overhead(&Packet { check, ..signal });
    }
    let encode = speed(link.len(), || on_the_link(&long, mask).len());
    let decode = speed(link.len(), || found(&link, mask));
    let copy = speed(link.len(), || black_box(link.clone()).len());
    println!(
        "encode {encode:6.0} MB/s, {:.1} times as long as a copy",
        copy / encode
    );
    println!(
        "decode {decode:6.0} MB/s, {:.1} times as long as a copy",
        copy / decode
    );
    println!("memcpy {copy:6.0} MB/s");
}

fn on_the_link(packet: &Packet<'_>, mask: Option<Mask>) -> Vec<u8> {
    let encoded = packet.encode(mask).expect("a packet that can be written");
    escaped(encoded.octets()).collect()
}

/// Octets of the data of the packets in a stream.
fn found(link: &[u8], mask: Option<Mask>) -> usize {
    let mut decoder = Decoder::new(Growing::new(LARGEST));
    let mut octets = 0;
    for octet in link {
        if let Some(Event::Packet(packet)) = decoder.push(*octet) {
            let packet = Packet::decode(packet, mask).expect("what was written");
            octets += packet.data.len();
        }
    }
    octets
}

/// Megabytes a second of an operation on so many octets.
fn speed(octets: usize, operation: impl Fn() -> usize) -> f64 {
    let (began, mut rounds) = (Instant::now(), 0);
    while began.elapsed() < TIME {
        black_box(operation());
        rounds += 1;
    }
    (octets * rounds) as f64 / began.elapsed().as_secs_f64() / 1e6
}

/// Octets by xorshift64*, the same in every run.
fn random() -> impl FnMut() -> u8 {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 56) as u8
    }
}
