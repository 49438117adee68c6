use fipa_acl::{Envelope, Slots};
use fipa_codec::{EncodeError, EnvelopeRepresentation, Output, bit_efficient};

/// Appends layers as an envelope, in the order given: in bit-efficient form the base is last, in
/// XML first.
///
/// In bit-efficient form the newest overlay is in front or, from some peers, behind the others; it
/// is that which makes `flattened` of them, if that tells.
pub(super) fn encode_layers(
    mut layers: Vec<Slots>,
    flattened: Option<&Envelope>,
    rep: EnvelopeRepresentation,
    output: &mut Output,
) -> Result<(), EncodeError> {
    if rep == EnvelopeRepresentation::Xml {
        let base = layers.drain(..1).next().unwrap_or_default();
        let envelope = Envelope {
            base,
            overlays: layers,
        };
        return fipa_codec::encode_envelope(rep, &envelope, output);
    }
    let base = layers.pop().unwrap_or_default();
    let newest_last = Envelope {
        base,
        overlays: layers,
    };
    let mut newest_first = newest_last.clone();
    newest_first.overlays.reverse();
    let says = |envelope: &Envelope| flattened.is_some_and(|given| says_alike(given, envelope));
    if says(&newest_last) && !says(&newest_first) {
        return bit_efficient::encode_envelope_newest_last(&newest_last, output);
    }
    bit_efficient::encode_envelope(&newest_first, output)
}

/// Whether two envelopes have the same stamps and, but for user-defined parameters, the same values
/// of their slots.
fn says_alike(one: &Envelope, other: &Envelope) -> bool {
    let slots = |envelope: &Envelope| Slots {
        user_defined: Vec::new(),
        ..envelope.flattened()
    };
    one.stamps().eq(other.stamps()) && slots(one) == slots(other)
}
