use fipa_acl::Representation;

use crate::bit_efficient::Newest;
use crate::string::Base64;
use crate::xml::{ContentForm, Layers};
use crate::{EnvelopeRepresentation, bit_efficient, string, xml};

/// How a peer needs to be written to. Whatever it is, reading accepts what all of them write.
///
/// What is legal by the standards and read by everybody is written to everybody (texts of envelopes
/// as `#n"…`, dates with the padding behind the milliseconds); a dialect is what remains.
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
/// | What | `Standard` | `Cpp` | `Jade`, `JadeBridge` | Why |
/// |---|---|---|---|---|
/// | strings that are text | literals, `#n"` for what no literal can hold | `#n"` | literals, `#n"` for what no literal can hold | fipa_acl writes no literals, and a literal could lose the blanks that it begins with |
/// | n of `#n"` | octets | octets | characters, which are UTF-16 units | JADE decodes the charset before it counts; the two differ only in texts beyond ASCII, and only such a reader reads these |
/// | content that is no text | `#n"` | `#n"` | Base64, with a parameter `X-JADE-Encoding` that says so | JADE has no octets, but for these |
/// | content beyond ASCII | as it is | as it is | `Jade` as it is, `JadeBridge` Base64 | the bridge takes as many characters for the payload as its length says octets |
/// | values of user-defined parameters of messages | as they are | in parentheses | as they are | fipa_acl reads no others; all other readers take them for lists of one |
/// | user-defined parameters of agents | as given | left out | as given | fipa_acl rejects the message |
/// | resolvers of resolvers | as given | left out | as given | fipa_acl rejects the message |
/// | dates | with the letter `Z` | without | with | fipa_acl writes none, and has its own zone, which must be UTC |
///
/// # XML
///
/// | What | `Standard` | `Cpp` | `Jade`, `JadeBridge` | Why |
/// |---|---|---|---|---|
/// | agents of one slot of an envelope | in one element | in one element | each in its own | JADE takes those of one element for one agent; fipa_acl takes the last of several elements |
/// | agents of one parameter of a message | each in its own element | in one element | each in its own | likewise |
/// | dates | with the letter `Z` | without | with | fipa_acl rejects an envelope with it; JADE ignores what is behind the date |
/// | content | with references | in a section if it has neither zeros nor `]]>`, whatever its octets are | in a section if it is text without `]]>` and carriage returns | fipa_acl folds white space outside sections, and knows no Base64; JADE puts blanks around what a reference stands for |
/// | user-defined parameters of messages | `user-defined` | `user-defined` | elements with their names, if they are names in XML | JADE reads no others |
/// | user-defined parameters with an empty value | as given | left out | as given | fipa_acl rejects them |
/// | layers of an envelope | as they are | as they are, more than nine refused | one, with the newest stamp | fipa_acl compares one digit of their numbers; JADE adds the intended receivers of all layers up, and delivers to each of them |
/// | intended-receiver, payload-length | as given | as given | always: `to` and the true length where they are missing | JADE drops an envelope without the first, and the bridge waits for the second |
/// | resolvers in envelopes | as given | as given | left out | JADE takes the last name in an agent identifier for that of the agent |
/// | characters beyond ASCII and line ends in envelopes | as they are | as they are | references | JADE takes octets for characters, and removes line ends |
/// | transport behaviour | as given | left out | as given | fipa_acl rejects an envelope with an element that it does not know |
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

const CPP_BIT_EFFICIENT: bit_efficient::WriteOptions = bit_efficient::WriteOptions {
    zone_letter: false,
    user_defined_slots: false,
    every_payload_length: true,
    newest: Newest::Last,
};

const CPP_STRING: string::WriteOptions = string::WriteOptions {
    counted: true,
    user_defined_in_parentheses: true,
    user_defined_of_agents: false,
    resolver_levels: 1,
    zone_letter: false,
    ..string::WriteOptions::STRICT
};

const JADE_STRING: string::WriteOptions = string::WriteOptions {
    base64_content: Base64::NotUtf8,
    count_utf16: true,
    ..string::WriteOptions::STRICT
};

const BRIDGE_STRING: string::WriteOptions = string::WriteOptions {
    base64_content: Base64::NotAscii,
    ..JADE_STRING
};

const CPP_XML: xml::WriteOptions = xml::WriteOptions {
    grouped_receivers: true,
    zone_letter: false,
    transport_behaviour: false,
    empty_user_defined: false,
    content: ContentForm::RawSection,
    layers: Layers::OneDigit,
    ..xml::WriteOptions::STRICT
};

const JADE_XML: xml::WriteOptions = xml::WriteOptions {
    grouped_agents: false,
    extension_elements: true,
    content: ContentForm::Section,
    layers: Layers::Flattened,
    resolvers_in_envelopes: false,
    plain_envelopes: true,
    ..xml::WriteOptions::STRICT
};

impl Dialect {
    /// The representation of messages that every such peer reads.
    pub fn message_representation(self) -> Representation {
        match self {
            Dialect::Standard | Dialect::Cpp => Representation::BitEfficient,
            Dialect::Jade | Dialect::JadeBridge => Representation::String,
        }
    }

    /// The representation of envelopes that every such peer reads.
    pub fn envelope_representation(self) -> EnvelopeRepresentation {
        match self {
            Dialect::Standard | Dialect::Cpp => EnvelopeRepresentation::BitEfficient,
            Dialect::Jade | Dialect::JadeBridge => EnvelopeRepresentation::Xml,
        }
    }

    pub(crate) fn bit_efficient(self) -> &'static bit_efficient::WriteOptions {
        match self {
            Dialect::Standard | Dialect::Jade | Dialect::JadeBridge => {
                &bit_efficient::WriteOptions::STRICT
            }
            Dialect::Cpp => &CPP_BIT_EFFICIENT,
        }
    }

    pub(crate) fn string(self) -> &'static string::WriteOptions {
        match self {
            Dialect::Standard => &string::WriteOptions::STRICT,
            Dialect::Cpp => &CPP_STRING,
            Dialect::Jade => &JADE_STRING,
            Dialect::JadeBridge => &BRIDGE_STRING,
        }
    }

    pub(crate) fn xml(self) -> &'static xml::WriteOptions {
        match self {
            Dialect::Standard => &xml::WriteOptions::STRICT,
            Dialect::Cpp => &CPP_XML,
            Dialect::Jade | Dialect::JadeBridge => &JADE_XML,
        }
    }
}
