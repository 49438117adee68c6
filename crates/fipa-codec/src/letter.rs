//! Letters and their payloads: where these end, how they are represented, and in which charset.

use std::ops::Range;

use bytes::Bytes;
use fipa_acl::{Envelope, Letter, Message, Representation, Text};

use crate::charset::{Charset, Extent, Foreign, Named};
use crate::{DecodeError, Fault, Form, Limits, decode_message_prefix, detect, xml};

/// The letter of an envelope that was read, and of the payload that stands there.
pub(crate) fn around(
    envelope: Envelope,
    bytes: &Bytes,
    payload: Range<usize>,
    limits: &Limits,
) -> Result<Letter, DecodeError> {
    if payload.end > limits.max_octets {
        return Err(DecodeError {
            offset: limits.max_octets,
            fault: Fault::Limit,
            what: "too long",
        });
    }
    let payload = bytes.slice(payload);
    Ok(Letter { envelope, payload })
}

/// The letter of an envelope that was read, and of the payload that begins there; tells where it
/// ends: at its announced length if there is one and the input is that long, else with the input.
pub(crate) fn prefix(
    envelope: Envelope,
    bytes: &Bytes,
    begin: usize,
    limits: &Limits,
) -> Result<(Letter, usize), DecodeError> {
    let announced = envelope
        .payload_length()
        .and_then(|length| begin.checked_add(usize::try_from(length).ok()?));
    let end = announced
        .filter(|end| *end <= bytes.len())
        .unwrap_or(bytes.len());
    Ok((around(envelope, bytes, begin..end, limits)?, end))
}

/// Reads the message in the payload of a letter, as its envelope says that it is represented and
/// encoded; what stands behind the message is ignored.
///
/// ```
/// use bytes::Bytes;
/// use fipa_acl::{Envelope, Representation, Slots};
/// use fipa_codec::{Limits, decode_payload};
///
/// let envelope = Envelope::new(Slots {
///     acl_representation: Some(Representation::String),
///     payload_encoding: Some("ISO-8859-1".into()),
///     ..Slots::default()
/// });
/// let payload = Bytes::from_static(b"(inform :content \"gr\xfc\xdf\")");
/// let message = decode_payload(&envelope, &payload, &Limits::default()).unwrap();
/// assert_eq!(message.content_str(), Some("grüß"));
/// ```
pub fn decode_payload(
    envelope: &Envelope,
    payload: &Bytes,
    limits: &Limits,
) -> Result<Message, DecodeError> {
    let representation = payload_representation(envelope, payload).ok_or(DecodeError {
        offset: 0,
        fault: Fault::Malformed,
        what: "no message begins like this",
    })?;
    let (message, _) = decode_payload_as(&representation, envelope, payload, limits)?;
    Ok(message)
}

/// How the payload of a letter is represented: what its envelope says, else what it looks like.
pub fn payload_representation(envelope: &Envelope, payload: &[u8]) -> Option<Representation> {
    if let Some(named) = envelope.acl_representation() {
        return Some(named.clone());
    }
    let head = payload.get(..HEAD).unwrap_or(payload);
    let form = match charset_of(envelope, head) {
        Some(charset) if !charset.extends_ascii() => detect(&charset.transcoded(head)),
        _ => detect(payload),
    };
    match form {
        Form::BitEfficientMessage => Some(Representation::BitEfficient),
        Form::String => Some(Representation::String),
        Form::Xml => Some(Representation::Xml),
        Form::BitEfficientEnvelope | Form::Unknown => None,
    }
}

/// Octets within which a message begins.
const HEAD: usize = 256;

/// Reads the message at the beginning of a payload, whatever the envelope says about its
/// representation, and tells how many octets it has.
///
/// The envelope's `payload-encoding` is heeded as far as the octets bear it out: there are peers
/// whose encoders do not heed it. In UTF-16 and UTF-32 a message is transcoded as a whole, in
/// another charset its words and literals are, but never what stands behind `#n"` or another
/// count. What is UTF-8 in XML or in bit-efficient form stays what it is. Names of charsets that
/// nobody knows are ignored.
pub fn decode_payload_as(
    representation: &Representation,
    envelope: &Envelope,
    payload: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    let Some(foreign) = foreign(representation, envelope, payload) else {
        return decode_leading(representation, payload, limits);
    };
    if payload.len() > limits.max_octets {
        return Err(DecodeError {
            offset: limits.max_octets,
            fault: Fault::Limit,
            what: "too long",
        });
    }
    match decode_foreign(representation, &foreign.to_utf8(), limits) {
        Ok((message, used)) => Ok((message, foreign.position(used))),
        Err(error) => Err(DecodeError {
            offset: foreign.position(error.offset),
            ..error
        }),
    }
}

/// The payload, if it must be transcoded.
fn foreign<'a>(
    representation: &Representation,
    envelope: &Envelope,
    payload: &'a [u8],
) -> Option<Foreign<'a>> {
    let charset = charset_of(envelope, payload)?;
    let extent = match representation {
        Representation::Other(_) => return None,
        Representation::BitEfficient if charset.extends_ascii() => Extent::Texts,
        Representation::BitEfficient => return None,
        _ if !charset.extends_ascii() => Extent::Whole,
        Representation::String => Extent::Uncounted,
        Representation::Xml if std::str::from_utf8(payload).is_ok() => return None,
        Representation::Xml => Extent::Whole,
    };
    Some(Foreign {
        octets: payload,
        charset,
        extent,
    })
}

fn charset_of(envelope: &Envelope, payload: &[u8]) -> Option<Charset> {
    match Named::of(envelope.payload_encoding()?) {
        Named::Unknown | Named::Utf8 => None,
        Named::Wide => Charset::of_wide(payload),
        Named::Charset(charset) => Some(charset),
    }
}

/// Reads what was transcoded: what a declaration says about it is no longer true.
fn decode_foreign(
    representation: &Representation,
    payload: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    if *representation != Representation::Xml {
        return decode_message_prefix(representation, payload, limits);
    }
    match xml::decode_utf8_message(payload, limits) {
        Ok(message) => Ok((message, payload.len())),
        Err(_) => xml::decode_utf8_message_prefix(payload, limits),
    }
}

fn decode_leading(
    representation: &Representation,
    payload: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    if *representation == Representation::Xml
        // Where text was not escaped, only the end of the payload tells where the message ends.
        && let Ok(message) = xml::decode_message(payload, limits)
    {
        return Ok((message, payload.len()));
    }
    decode_message_prefix(representation, payload, limits)
}

/// What an envelope should say as the `payload-encoding` of a payload in UTF-8; `given` is what
/// it says so far.
///
/// In string form, what is not ASCII is read only if it says UTF-8; but nothing is said about a
/// payload that has other octets behind `#n"`. In XML, UTF-8 goes without saying. A name that
/// nobody knows is left alone.
pub fn payload_encoding(
    representation: &Representation,
    payload: &[u8],
    given: Option<&Text>,
) -> Option<Text> {
    const UTF_8: Text = Text::from_static("UTF-8");
    let is_string = match representation {
        Representation::String => true,
        Representation::Xml => false,
        Representation::BitEfficient | Representation::Other(_) => return given.cloned(),
    };
    let is_utf8 = std::str::from_utf8(payload).is_ok();
    let fits = match given.map(|name| Named::of(name)) {
        None => payload.is_ascii() || !is_string,
        Some(Named::Unknown) => true,
        Some(Named::Utf8) => payload.is_ascii() || given == Some(&UTF_8) && is_utf8,
        Some(Named::Wide) => false,
        Some(Named::Charset(charset)) => charset.extends_ascii() && payload.is_ascii(),
    };
    if fits {
        return given.cloned();
    }
    is_utf8.then_some(UTF_8)
}
