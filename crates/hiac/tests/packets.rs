//! Packets and their octets.

use hiac::edcp::{Decoder, Event, escaped};
use hiac::{
    Address, Addressing, Check, Fixed, Fragment, Mask, Numbered, Packet, PacketType, ReadError,
    WriteError,
};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

const EMPLOYEES: u32 = 0xFF;

fn mask(bits: u32) -> Mask {
    Mask::new(bits).unwrap()
}

fn hexadecimal(text: &str) -> Vec<u8> {
    text.split_whitespace()
        .map(|octet| u8::from_str_radix(octet, 16).unwrap())
        .collect()
}

/// The packet that stands in these octets of the link, which are written again.
fn read(link: &str, bits: u32, check: impl FnOnce(Packet<'_>)) {
    let link = hexadecimal(link);
    let mut decoder = Decoder::new(Fixed::<64>::new());
    let (last, before) = link.split_last().unwrap();
    assert!(before.iter().all(|octet| decoder.push(*octet).is_none()));
    let Some(Event::Packet(octets)) = decoder.push(*last) else {
        panic!("no packet in {link:02X?}");
    };
    let packet = Packet::decode(octets, Some(mask(bits))).unwrap();
    let encoded = packet.encode(Some(mask(bits))).unwrap();
    assert_eq!(encoded.count(), octets.len());
    assert_eq!(escaped(encoded.octets()).collect::<Vec<_>>(), link);
    check(packet);
}

fn address(text: &str) -> Address {
    text.parse().unwrap()
}

fn numbered(psn: u8, index: u8, more: bool) -> Option<Numbered> {
    let fragment = Fragment { index, more };
    Some(Numbered { psn, fragment })
}

#[test]
fn a_signal_between_colleagues() {
    let addressing = Addressing::Level {
        target: 5,
        source: 3,
    };
    read("F8 11 00 05 03 01 01 1B F9", EMPLOYEES, |packet| {
        assert_eq!(packet, Packet::new(PacketType::SIG, 0, addressing, &[1]));
    });
    read("F8 11 00 05 03 02 01 FC C9 15 F9", EMPLOYEES, |packet| {
        assert_eq!(packet.data, [1, 0xF9]);
    });
}

#[test]
fn the_connection_of_a_drive() {
    let incon = "F8 1E 01 20 C4 D2 05 20 C4 D2 00 21 02 01 04 20 C4 D2 05 02 04 00 00 00 FC CF \
                 03 02 03 E8 04 04 00 01 00 00 05 01 03 06 02 41 3E 07 01 00 09 F9";
    read(incon, EMPLOYEES, |packet| {
        let addressing = Addressing::Full {
            target: address("20:C4:D2:05"),
            source: address("20:C4:D2:00"),
        };
        assert_eq!(
            (packet.kind, packet.addressing),
            (PacketType::SYS, addressing)
        );
        assert_eq!((packet.data.len(), packet.data[0]), (33, 2));
    });
    let accon = "F8 1E 01 20 C4 D2 00 20 C4 D2 05 28 03 01 04 20 C4 D2 05 02 04 00 00 00 FC CF \
                 03 02 03 E8 04 04 00 00 00 40 05 01 03 06 02 40 0A 07 01 02 0A 05 64 72 69 76 65 \
                 46 F9";
    read(accon, EMPLOYEES, |packet| {
        assert!(packet.data.ends_with(b"drive"))
    });
}

#[test]
fn a_command_and_its_confirmation() {
    read(
        "F8 13 4C 00 05 00 07 00 01 00 73 74 6F 70 32 F9",
        EMPLOYEES,
        |packet| {
            assert_eq!((packet.kind, packet.priority), (PacketType::MSG, 4));
            assert!(packet.confirm);
            assert_eq!(packet.numbered, numbered(0, 0, false));
            assert_eq!(packet.data, b"\x01\0stop");
        },
    );
    let confirmation = "F8 1E 41 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 00 EB F9";
    read(confirmation, EMPLOYEES, |packet| {
        assert_eq!(packet.data, [1, 8, 1, 0, 9, 1, 0]);
    });
}

#[test]
fn a_message_in_two_fragments_with_a_crc() {
    let first = "F8 13 4E 01 05 00 36 80 00 00 41 20 6D 65 73 73 61 67 65 20 6F 66 20 73 69 78 74 \
                 79 2D 74 77 6F 20 6F 63 74 65 74 73 20 67 6F 65 73 20 74 6F 20 74 68 65 20 64 72 \
                 69 76 65 20 69 6E 20 26 1F 26 47 F9";
    read(first, EMPLOYEES, |packet| {
        assert_eq!(packet.check, Check::Crc32);
        assert_eq!(packet.numbered, numbered(1, 0, true));
        assert_eq!(packet.encode(Some(mask(EMPLOYEES))).unwrap().count(), 64);
    });
    let second = "F8 13 4E 02 05 00 0A 01 74 77 6F 20 70 61 72 74 73 2B 1A 85 BC F9";
    read(second, EMPLOYEES, |packet| {
        assert_eq!(packet.numbered, numbered(2, 1, false));
        assert_eq!(packet.data, b"two parts");
    });
    for confirmation in [
        "F8 1E 43 20 C4 D2 00 20 C4 D2 05 07 01 08 01 01 09 01 00 C9 A5 90 4C F9",
        "F8 1E 43 20 C4 D2 00 20 C4 D2 05 07 01 08 01 02 09 01 00 DB 10 3F A2 F9",
    ] {
        read(confirmation, EMPLOYEES, |packet| {
            assert_eq!(packet.check, Check::Crc32)
        });
    }
}

#[test]
fn what_the_employer_forwards() {
    read(
        "F8 13 12 07 03 05 04 00 69 63 65 07 4B 41 81 F9",
        EMPLOYEES,
        |packet| {
            assert_eq!(packet.data, b"\x04\0ice");
        },
    );
    read(
        "F8 13 10 07 03 05 04 00 69 63 65 67 F9",
        EMPLOYEES,
        |packet| {
            assert_eq!(packet.check, Check::Sum);
        },
    );
    read(
        "F8 13 4C 00 09 03 05 00 00 00 68 69 41 F9",
        EMPLOYEES,
        |packet| {
            assert_eq!(packet.data, b"\0\0hi");
        },
    );
    let confirmation =
        "F8 1E 41 20 C4 D2 03 20 C4 D2 00 0D 01 01 04 20 C4 D2 09 08 01 00 09 01 05 B8 F9";
    read(confirmation, EMPLOYEES, |packet| {
        assert!(packet.data.ends_with(&[9, 1, 5]))
    });
}

#[test]
fn the_transfer_of_an_employee() {
    for (octets, bits) in [
        (
            "F8 1E 0C 00 13 12 14 00 06 01 04 20 C4 D2 05 02 04 00 00 00 FC CF 0D 04 20 C4 D3 00 F6 F9",
            0x3F00,
        ),
        (
            "F8 1E 01 20 C4 D2 00 20 C4 D3 00 07 01 08 01 00 09 01 00 A7 F9",
            0x3F00,
        ),
        (
            "F8 1E 0C 00 05 00 0E 00 06 01 04 20 C4 D2 05 0D 04 20 C4 D3 00 CB F9",
            EMPLOYEES,
        ),
        (
            "F8 1E 01 20 C4 D2 00 20 C4 D2 05 07 01 08 01 00 09 01 00 AB F9",
            EMPLOYEES,
        ),
        (
            "F8 1E 01 20 C4 D3 05 20 C4 D3 00 21 02 01 04 20 C4 D3 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 01 00 00 05 01 03 06 02 41 3E 07 01 00 0C F9",
            EMPLOYEES,
        ),
        (
            "F8 1E 01 20 C4 D3 00 20 C4 D3 05 28 03 01 04 20 C4 D3 05 02 04 00 00 00 FC CF 03 02 03 E8 04 04 00 00 00 40 05 01 03 06 02 40 0A 07 01 02 0A 05 64 72 69 76 65 49 F9",
            EMPLOYEES,
        ),
    ] {
        read(octets, bits, |packet| {
            assert_eq!(packet.kind, PacketType::SYS)
        });
    }
}

#[test]
fn a_level_address_is_what_the_mask_selects() {
    let twelve = mask(0x000F_FF00);
    assert_eq!(twelve.level(address("3C:12:F8:00")), 0x2F8);
    assert_eq!((twelve.level_octets(), twelve.broadcast()), (2, 0xFFF));
    assert_eq!(
        twelve.address(address("3C:12:00:00"), 0x2F8),
        Some(address("3C:12:F8:00"))
    );
    assert_eq!(twelve.address(address("3C:12:00:00"), 0x1000), None);
    assert!(twelve.same_subnetwork(address("3C:12:F8:00"), address("3C:1F:00:01")));
    assert!(!twelve.same_subnetwork(address("3C:12:F8:00"), address("3C:22:F8:00")));
    assert!(twelve.same_block(address("3C:12:F8:00"), address("3C:12:F8:77")));
    assert!(!twelve.same_block(address("3C:12:F8:00"), address("3C:12:F9:00")));
    let whole = mask(u32::MAX);
    assert_eq!((whole.level_octets(), whole.broadcast()), (4, u32::MAX));
    assert!(whole.same_subnetwork(Address(0), Address(u32::MAX)));
}

#[test]
fn masks_are_contiguous_and_of_two_bits_at_least() {
    for bits in [0, 1, 0x8000_0000, 5, 0xFF00_00FF] {
        assert_eq!(Mask::new(bits).map_err(|error| error.0), Err(bits));
    }
    assert!(Mask::new(3).is_ok());
}

#[test]
fn an_address_is_read_only_in_its_written_form() {
    assert_eq!("3C:12:f8:00".parse(), Ok(Address(0x3C12_F800)));
    assert_eq!(Address(0x3C12_F800).to_string(), "3C:12:F8:00");
    for text in [
        "",
        "3C:12:F8",
        "3C:12:F8:00:00",
        "3C12F800",
        "3C:12:F8:0",
        "3C:12:F8:+1",
        "3C:12:F8:é",
    ] {
        assert!(text.parse::<Address>().is_err(), "{text}");
    }
}

#[test]
fn the_first_fault_is_told() {
    let read = |octets: &str, mask: Option<Mask>| {
        Packet::decode(&hexadecimal(octets), mask)
            .map_err(ReadError::word)
            .map(drop)
    };
    let eight = Some(mask(EMPLOYEES));
    for (octets, mask, word) in [
        ("", eight, "length"),
        ("21", eight, "length"),
        ("21 80", eight, "version"),
        ("11 80 05", eight, "flags"),
        ("11 08 05", eight, "flags"),
        ("11 00", None, "mask"),
        ("11 00 05", eight, "length"),
        ("11 00 05 03 01 01", eight, "length"),
        ("11 00 05 03 01 01 1B 00", eight, "length"),
        // Not the shortest form, and too many octets of it.
        ("11 00 05 03 80 01 01 1B", eight, "length"),
        ("11 00 05 03 81 80 80 00 1B", eight, "length"),
        // Numbered, without a fragment octet.
        ("11 04 00 05 03 00 1D", eight, "length"),
        ("11 00 05 03 01 01 1C", eight, "checksum"),
        ("11 02 05 03 01 01 00 00 00 00", eight, "checksum"),
        ("11 00 05 03 01 01 1B", Some(self::mask(3)), "address"),
    ] {
        assert_eq!(read(octets, mask), Err(word), "{octets}");
    }
    assert_eq!(read("11 01 00 00 00 05 00 00 00 03 00 1A", None), Ok(()));
}

#[test]
fn what_a_packet_cannot_say_is_not_written() {
    let addressing = Addressing::Level {
        target: 0x100,
        source: 3,
    };
    let packet = Packet::new(PacketType::MSG, 4, addressing, &[]);
    let eight = Some(mask(EMPLOYEES));
    let error = |packet: Packet<'_>, mask| packet.encode(mask).map(drop).unwrap_err();
    assert_eq!(error(packet, eight), WriteError::Address);
    assert_eq!(error(packet, None), WriteError::Mask);
    assert_eq!(
        error(
            Packet {
                priority: 8,
                ..packet
            },
            eight
        ),
        WriteError::Priority
    );
    assert_eq!(
        error(
            Packet {
                confirm: true,
                ..packet
            },
            eight
        ),
        WriteError::Confirm
    );
    let wide = Some(mask(0xFFFF));
    let fragment = Packet {
        numbered: numbered(0, 128, false),
        ..packet
    };
    assert_eq!(error(fragment, wide), WriteError::Fragment);
    let data = vec![0; 1 << 21];
    assert_eq!(
        error(
            Packet {
                data: &data,
                ..packet
            },
            wide
        ),
        WriteError::Length
    );
    assert!(
        Packet {
            data: &data[1..],
            ..packet
        }
        .encode(wide)
        .is_ok()
    );
}

proptest! {
    #[test]
    fn what_is_written_is_read_as_the_same(
        kind in 0..16_u8,
        priority in 0..8_u8,
        crc in any::<bool>(),
        number in option::of((any::<u8>(), 0..128_u8, any::<bool>(), any::<bool>())),
        full in any::<bool>(),
        (shift, width) in (0..31_u32).prop_flat_map(|shift| (Just(shift), 2..=32 - shift)),
        (target, source) in any::<(u32, u32)>(),
        data in prop_oneof![vec(any::<u8>(), 0..300), vec(any::<u8>(), 16_380..16_390)],
    ) {
        let mask = mask((u32::MAX >> (32 - width)) << shift);
        let addressing = match full {
            true => Addressing::Full { target: Address(target), source: Address(source) },
            false => Addressing::Level {
                target: target & mask.broadcast(),
                source: source & mask.broadcast(),
            },
        };
        let packet = Packet {
            kind: PacketType::new(kind).unwrap(),
            priority,
            confirm: number.is_some_and(|(.., confirm)| confirm),
            check: if crc { Check::Crc32 } else { Check::Sum },
            numbered: number.and_then(|(psn, index, more, _)| numbered(psn, index, more)),
            addressing,
            data: &data,
        };
        let octets: Vec<u8> = packet.encode(Some(mask)).unwrap().octets().collect();
        prop_assert_eq!(Packet::decode(&octets, Some(mask)), Ok(packet));
        // One octet that changed never passes for the packet.
        let mut broken = octets.clone();
        let place = target as usize % broken.len();
        broken[place] ^= 1 << (source % 8);
        prop_assert_ne!(Packet::decode(&broken, Some(mask)), Ok(packet));
    }

    #[test]
    fn any_octets_are_read_or_refused(octets in vec(any::<u8>(), 0..40), bits in any::<u32>()) {
        let mask = Mask::new(bits).ok();
        if let Ok(packet) = Packet::decode(&octets, mask) {
            let again: Vec<u8> = packet.encode(mask).unwrap().octets().collect();
            prop_assert_eq!(again, octets);
        }
    }

    #[test]
    fn octets_with_a_right_check_are_read_or_refused(
        octets in vec(any::<u8>(), 0..20),
        flags in 0..128_u8,
    ) {
        let mut octets = [&[0x13, flags & !2], octets.as_slice()].concat();
        octets.push(octets.iter().fold(0, |sum: u8, octet| sum.wrapping_add(*octet)));
        let mask = Some(mask(0x0FFF));
        if let Ok(packet) = Packet::decode(&octets, mask) {
            let again: Vec<u8> = packet.encode(mask).unwrap().octets().collect();
            prop_assert_eq!(again, octets);
        }
    }
}
