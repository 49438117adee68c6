use crate::bit_efficient::{Newest, WriteOptions};

/// How a peer needs to be written to. Whatever it is, reading accepts what all of them write.
///
/// What is legal by the standards and read by everybody is written to everybody (texts of envelopes
/// as `#n"…`, contents with a length, dates with the padding behind the milliseconds); a dialect is
/// what remains.
///
/// # Bit-efficient messages and envelopes
///
/// | What | `Standard`, `Jade`, `JadeBridge` | `Cpp` | Why |
/// |---|---|---|---|
/// | dates | UTC with the letter `Z` | UTC without a letter, a zero in front of the milliseconds | fipa_acl reads any date as one of its own zone, which must be UTC, and ignores the letter; it writes them like this |
/// | newest overlay | in front of everything | directly in front of the base, the newest last | SC00088D section 2.2 has the first one win, fipa_acl the last one |
/// | length of an overlay | that of the overlay | as fipa_acl announces it: four octets, the parameters, and their end, without the stamp | readers tell by it who wrote the overlay, and so which one is the newest |
/// | layers over 65,535 octets | with a long length | refused | fipa_acl never reads the long length |
/// | payload-length | as given | in every layer | fipa_acl takes the length of a layer for it where it is missing |
/// | user-defined parameters of envelopes and stamps | as given | left out | fipa_acl rejects the envelope |
/// | stamp of an overlay | in its head | in its head, not repeated as a parameter | fipa_acl repeats it, and reads both |
///
/// Code tables are only for links whose both ends are known to keep one: fipa_acl rejects their
/// numbers, and JADE's add-on puts contents into its table.
///
/// # String form
///
/// | What | `Standard`, `Cpp` | `Jade`, `JadeBridge` | Why |
/// |---|---|---|---|
/// | content that is no text | `#n"` with its octets | Base64, with a parameter `X-JADE-Encoding` that says so | JADE counts characters, not octets |
/// | other texts of several octets a character | literals | literals | likewise, so `#n"` is only for what no literal can hold |
///
/// # XML
///
/// | What | `Standard` | `Cpp` | `Jade`, `JadeBridge` | Why |
/// |---|---|---|---|---|
/// | agents of one slot | in one element | in one element | each in its own | JADE takes those of one element for one agent; fipa_acl takes the last of several elements |
/// | dates of envelopes | with a trailing `Z` | without | with | fipa_acl rejects an envelope with it; JADE ignores what is behind the date |
/// | transport behaviour | as given | left out | as given | fipa_acl rejects an envelope with an element it does not know |
/// | user-defined parameters with an empty value | as given | left out | as given | fipa_acl rejects them |
///
/// `JadeBridge` is the program between JADE and fipa_services: it reads XML envelopes around
/// messages in string form, over plain connections.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Dialect {
    /// What the standards have.
    #[default]
    Standard,
    /// fipa_acl and fipa_services, the libraries in C++.
    Cpp,
    /// JADE.
    Jade,
    /// JADE behind the program that connects it with fipa_services.
    JadeBridge,
}

const CPP: WriteOptions = WriteOptions {
    zone_letter: false,
    user_defined_slots: false,
    every_payload_length: true,
    newest: Newest::Last,
};

impl Dialect {
    pub(crate) fn bit_efficient(self) -> &'static WriteOptions {
        match self {
            Dialect::Standard | Dialect::Jade | Dialect::JadeBridge => &WriteOptions::STRICT,
            Dialect::Cpp => &CPP,
        }
    }
}
