//! Letters that came in pieces.

use bytes::{Bytes, BytesMut};
use fipa_acl::Envelope;
use fipa_codec::{DecodeError, Limits, bit_efficient};
use smallvec::{SmallVec, smallvec};

/// The octets of a letter, in parts that follow each other. Most have one part, or two with our
/// stamp in front: these take no memory of their own.
pub(crate) type Pieces = SmallVec<[Bytes; 2]>;

/// Reads the envelope into one that is there, and tells where the payload begins. The envelope is in
/// the first part, unless it is very long: then the parts become one.
pub(crate) fn read_envelope(
    parts: &mut Pieces,
    limits: &Limits,
    envelope: &mut Envelope,
) -> Result<usize, DecodeError> {
    let first = parts.first().cloned().unwrap_or_default();
    match bit_efficient::decode_envelope_into(&first, limits, envelope) {
        Err(_) if parts.len() > 1 => {
            let whole = joined(parts, 0);
            *parts = smallvec![whole.clone()];
            bit_efficient::decode_envelope_into(&whole, limits, envelope)
        }
        read => read,
    }
}

/// The octets from this one on, in one piece: copied only where they are in several.
pub(crate) fn joined(mut parts: &[Bytes], mut from: usize) -> Bytes {
    while let [first, rest @ ..] = parts
        && first.len() <= from
        && !rest.is_empty()
    {
        from -= first.len();
        parts = rest;
    }
    match parts {
        [] => Bytes::new(),
        [only] => only.slice(from.min(only.len())..),
        [first, rest @ ..] => {
            let first = first.slice(from..);
            let octets = first.len() + rest.iter().map(Bytes::len).sum::<usize>();
            let mut whole = BytesMut::with_capacity(octets);
            whole.extend_from_slice(&first);
            rest.iter().for_each(|part| whole.extend_from_slice(part));
            whole.freeze()
        }
    }
}

#[cfg(test)]
mod tests {
    use fipa_acl::{AgentId, FipaTime, Representation, Slots, Text};
    use fipa_codec::Output;

    use super::*;

    #[test]
    fn parts_are_copied_only_where_the_payload_is_in_several() {
        let parts: Vec<Bytes> = ["head", "pay", "load"].map(Bytes::from).into();
        assert_eq!(joined(&parts, 4), "payload");
        assert_eq!(joined(&parts, 2), "adpayload");
        assert_eq!(joined(&parts, 7).as_ptr(), parts[2].as_ptr());
        assert_eq!(joined(&parts[..2], 4).as_ptr(), parts[1].as_ptr());
        assert_eq!(joined(&parts, 11), "");
        assert_eq!(joined(&parts, 12), "");
        assert_eq!(joined(&[], 0), "");
    }

    #[test]
    fn an_envelope_is_read_wherever_it_is_cut() {
        let name = |number| AgentId::new(Text::from(format!("agent{number}@robot")));
        let envelope = Envelope::new(Slots {
            to: (0..50).map(name).collect(),
            acl_representation: Some(Representation::BitEfficient),
            date: Some(FipaTime::from_unix_millis(0)),
            ..Slots::default()
        });
        let mut out = Output::new();
        bit_efficient::encode_envelope(&envelope, &mut out).unwrap();
        let head = out.take_bytes();
        let whole = Bytes::from([&head[..], b"payload"].concat());
        for cut in [1, 20, head.len() - 1, head.len(), head.len() + 3] {
            let mut parts = smallvec![whole.slice(..cut), whole.slice(cut..)];
            let mut read = Envelope::default();
            let begin = read_envelope(&mut parts, &Limits::default(), &mut read);
            assert_eq!(begin, Ok(head.len()), "cut after {cut}");
            assert_eq!(read, envelope);
            assert_eq!(joined(&parts, head.len()), "payload");
        }
    }
}
