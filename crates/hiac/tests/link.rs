//! Packets in a stream of octets.

use hiac::edcp::{Counters, Decoder, Event, escaped};
use hiac::{Fixed, Growing};
use proptest::collection::vec;
use proptest::prelude::*;

/// An event that is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Seen {
    Packet(Vec<u8>),
    Alive,
    Unfinished(Vec<u8>),
    TooLong(Vec<u8>),
}

fn seen(event: Event<'_>) -> Seen {
    match event {
        Event::Packet(octets) => Seen::Packet(octets.to_vec()),
        Event::Alive => Seen::Alive,
        Event::Unfinished(octets) => Seen::Unfinished(octets.to_vec()),
        Event::TooLong(octets) => Seen::TooLong(octets.to_vec()),
    }
}

fn decode(octets: &[u8]) -> (Vec<Seen>, Counters) {
    let mut decoder = Decoder::new(Fixed::<8>::new());
    let mut events = Vec::new();
    for octet in octets {
        events.extend(decoder.push(*octet).map(seen));
    }
    events.extend(decoder.end().map(seen));
    (events, decoder.counters())
}

fn events(octets: &[u8]) -> Vec<Seen> {
    decode(octets).0
}

#[test]
fn codes_stand_as_exch_and_their_substitute() {
    let packet: Vec<u8> = (0xF0..=0xFF).collect();
    let link: Vec<u8> = escaped(packet.clone()).collect();
    assert_eq!(
        link[..9],
        [0xF8, 0xF0, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7]
    );
    assert_eq!(link[9..13], [0xFC, 0xC8, 0xFC, 0xC9]);
    assert_eq!(link[23..], [0xFC, 0xCF, 0xF9]);
    let mut decoder = Decoder::new(Fixed::<16>::new());
    let events: Vec<_> = link
        .iter()
        .filter_map(|o| decoder.push(*o).map(seen))
        .collect();
    assert_eq!(events, [Seen::Packet(packet)]);
}

#[test]
fn a_packet_without_octets_says_alive() {
    assert_eq!(events(&[0xF8, 0xF9]), [Seen::Alive]);
    assert_eq!(events(&[0xF8, 0xFA, 0xF9]), [Seen::Alive]);
    assert_eq!(events(&[0xF8, 0xFC, 0xF9]), [Seen::Alive]);
    assert_eq!(escaped([]).collect::<Vec<_>>(), [0xF8, 0xF9]);
}

#[test]
fn an_exch_without_substitute_is_ignored_and_the_octet_taken_as_if_alone() {
    let packet = |octets: &[u8]| Seen::Packet(octets.to_vec());
    let unfinished = |octets: &[u8]| Seen::Unfinished(octets.to_vec());
    assert_eq!(events(&[0xF8, 1, 0xFC, 2, 0xF9]), [packet(&[1, 2])]);
    assert_eq!(events(&[0xF8, 1, 0xFC, 0xF9, 0xC9]), [packet(&[1])]);
    assert_eq!(
        events(&[0xF8, 1, 0xFC, 0xFC, 0xC9, 0xF9]),
        [packet(&[1, 0xF9])]
    );
    assert_eq!(
        events(&[0xF8, 1, 0xFC, 0xFE, 0xC9, 0xF9]),
        [packet(&[1, 0xC9])]
    );
    assert_eq!(
        events(&[0xF8, 1, 0xFC, 0xF8, 2, 0xF9]),
        [unfinished(&[1]), packet(&[2])]
    );
    let (_, counters) = decode(&[0xF8, 1, 0xFC, 2, 0xFA, 0xFF, 0xF9]);
    assert_eq!(counters.ignored, 3);
}

#[test]
fn what_is_outside_of_packets_is_noise() {
    // EXCH there does nothing to the octet behind it.
    let (events, counters) = decode(&[1, 0xF9, 0xFC, 0xF8, 2, 0xF9, 0xFB, 3]);
    assert_eq!(events, [Seen::Packet(vec![2])]);
    assert_eq!(counters.noise, 5);
}

#[test]
fn an_unfinished_packet_gives_way_to_the_next() {
    let (events, counters) = decode(&[0xF8, 1, 0xF8, 0xF8, 2, 0xF9, 0xF8, 3, 0xFC]);
    assert_eq!(
        events,
        [
            Seen::Unfinished(vec![1]),
            Seen::Unfinished(vec![]),
            Seen::Packet(vec![2]),
            Seen::Unfinished(vec![3]),
        ]
    );
    assert_eq!(counters.unfinished, 3);
}

#[test]
fn a_packet_that_is_too_long_is_dropped_up_to_the_next_start() {
    let mut link = vec![0xF8];
    link.extend(0..9);
    link.extend([9, 0xF9, 0xFC, 0xF8, 7, 0xF9]);
    let (events, counters) = decode(&link);
    assert_eq!(
        events,
        [Seen::TooLong((0..8).collect()), Seen::Packet(vec![7])]
    );
    assert_eq!((counters.too_long, counters.noise), (1, 0));
}

#[test]
fn noise_is_not_heard() {
    let heard = |octets: &[u8]| {
        let mut decoder = Decoder::new(Fixed::<8>::new());
        octets.iter().for_each(|octet| {
            decoder.push(*octet);
        });
        decoder.heard()
    };
    assert_eq!(heard(&[1, 2, 0xF9, 0xFC]), 0);
    assert_eq!(heard(&[0xF8]), 1);
    assert_eq!(heard(&[0xF8, 1, 0xFC, 0xC8, 0xFA]), 3);
}

proptest! {
    #[test]
    fn every_packet_survives_whatever_stands_between(
        packets in vec((vec(any::<u8>(), 1..40), vec(0..0xF8_u8, 0..4)), 0..8),
    ) {
        let mut link = Vec::new();
        for (packet, noise) in &packets {
            link.extend(escaped(packet.iter().copied()));
            link.extend(noise);
        }
        let mut decoder = Decoder::new(Growing::new(40));
        let events: Vec<_> = link.iter().filter_map(|o| decoder.push(*o).map(seen)).collect();
        let expected: Vec<_> = packets.into_iter().map(|(p, _)| Seen::Packet(p)).collect();
        prop_assert_eq!(events, expected);
    }

    #[test]
    fn after_any_octets_the_packet_behind_the_next_is_read(
        noise in vec(prop_oneof![any::<u8>(), 0xF8..=0xFF_u8], 0..200),
        packet in vec(any::<u8>(), 1..8),
    ) {
        let mut decoder = Decoder::new(Fixed::<8>::new());
        noise.iter().for_each(|octet| { decoder.push(*octet); });
        let link: Vec<u8> = escaped(packet.clone()).collect();
        let events: Vec<_> = link.iter().filter_map(|o| decoder.push(*o).map(seen)).collect();
        prop_assert_eq!(events.last(), Some(&Seen::Packet(packet)));
    }
}
