//! The data of each packet type, written and read again.

use hiac::content::{BarrierOperation, ContentError, MessageKind, SemaphoreOperation};
use hiac::sys::{Checks, Parameters, ParametersError, Subtype, Types};
use hiac::{Address, Buffer, Content, Growing, Mask, Outcome, PacketType};
use proptest::collection::vec;
use proptest::option::of;
use proptest::prelude::*;

fn written(content: &Content<'_>) -> Vec<u8> {
    let mut data = Growing::new(usize::MAX);
    assert!(content.encode(&mut data));
    data.octets().to_vec()
}

fn read_again(content: &Content<'_>) {
    let data = written(content);
    assert_eq!(Content::decode(content.kind(), &data), Ok(*content));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_content_is_read_as_it_was_written(
        octets in vec(any::<u8>(), 0..40), byte: u8, number: u16, address: u32,
    ) {
        let octets = &octets;
        read_again(&Content::Signal { number: byte, arguments: octets });
        read_again(&Content::Write { address, octets });
        read_again(&Content::Read { address, length: number });
        for kind in [
            MessageKind::Information, MessageKind::Command, MessageKind::Question,
            MessageKind::Answer, MessageKind::Warning,
        ] {
            read_again(&Content::Message { kind, reference: byte, octets });
        }
        for operation in [
            SemaphoreOperation::Take, SemaphoreOperation::Give, SemaphoreOperation::Test,
            SemaphoreOperation::Granted, SemaphoreOperation::Waiting, SemaphoreOperation::Free,
            SemaphoreOperation::Taken,
        ] {
            read_again(&Content::Semaphore { operation, number });
        }
        for operation in [
            BarrierOperation::Arrive, BarrierOperation::Release, BarrierOperation::Leave,
        ] {
            read_again(&Content::Barrier { operation, number, parties: byte });
        }
    }

    #[test]
    fn parameters_are_read_as_they_were_written(
        subtype in 1_u8..10, address in of(any::<u32>()), level in of(0_u32..30),
        period in of(any::<u16>()), largest in of(any::<u32>()), byte in of(any::<u8>()),
        types in of(any::<u16>()), text in of("[a-zé]{0,20}"), members in vec(any::<u8>(), 0..15),
    ) {
        let members = &members[..members.len() / 4 * 4];
        let parameters = Parameters {
            address: address.map(Address),
            mask: level.map(|level| Mask::new(3 << level).unwrap()),
            period,
            largest,
            checks: byte.map(Checks),
            types: types.map(Types),
            role: byte,
            psn: byte,
            result: byte.map(Outcome),
            name: text.as_deref(),
            reason: text.as_deref(),
            abilities: byte,
            employer: address.map(Address),
            place: text.as_deref(),
            members: Some(members).filter(|members| !members.is_empty()),
        };
        let subtype = Subtype::new(subtype).unwrap();
        read_again(&Content::System { subtype, parameters });
    }

    #[test]
    fn any_octets_are_read_or_refused(kind in 0_u8..16, data in vec(any::<u8>(), 0..40)) {
        let kind = PacketType::new(kind).unwrap();
        if let Ok(content) = Content::decode(kind, &data)
            && !matches!(content, Content::System { .. })
        {
            prop_assert_eq!(written(&content), data);
        }
    }
}

#[test]
fn tags_come_in_any_order_the_first_of_a_kind_counts_and_unknown_ones_are_ignored() {
    let octets = [7, 1, 2, 99, 1, 0, 3, 2, 0x03, 0xE8, 7, 1, 0, 0, 0];
    let read = Parameters::decode(&octets).unwrap();
    assert_eq!((read.role, read.period), (Some(2), Some(1000)));
    for wrong in [
        &[7, 2, 0, 0][..],
        &[7],
        &[7, 1],
        &[2, 4, 0, 0, 0, 1],
        &[10, 1, 0xFF],
        &[15, 3, 0, 0, 0],
    ] {
        assert_eq!(Parameters::decode(wrong), Err(ParametersError), "{wrong:?}");
    }
}

#[test]
fn data_of_another_form_is_malformed_and_other_types_mean_nothing() {
    for (kind, data) in [
        (PacketType::SIG, &[][..]),
        (PacketType::SMPH, &[0, 0]),
        (PacketType::SMPH, &[3, 0, 0]),
        (PacketType::MSG, &[5, 0]),
        (PacketType::MSG, &[1]),
        (PacketType::SHMW, &[0, 0, 0]),
        (PacketType::SHMR, &[0, 0, 0, 0, 0]),
        (PacketType::SHMR, &[0, 0, 0, 0, 0, 0, 0]),
        (PacketType::SYNC, &[0, 0, 0]),
        (PacketType::SYS, &[]),
        (PacketType::SYS, &[10]),
    ] {
        assert_eq!(
            Content::decode(kind, data),
            Err(ContentError::Malformed),
            "{data:?}"
        );
    }
    let other = PacketType::new(9).unwrap();
    assert_eq!(Content::decode(other, &[]), Err(ContentError::Type));
}
