/// What an input is, judged by how it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Form {
    /// A bit-efficient message (SC00069G).
    BitEfficientMessage,
    /// A bit-efficient envelope (SC00088D).
    BitEfficientEnvelope,
    /// A message or an envelope in XML (SC00071E, SC00085J).
    Xml,
    /// A message in string form (SC00070I).
    String,
    /// None of these.
    Unknown,
}

/// Tells by its first octets what an input is; nothing else is looked at.
///
/// White space and a byte order mark may precede the forms that are text.
///
/// ```
/// use fipa_codec::{Form, detect};
///
/// assert_eq!(detect(&[0xfa, 0x10, 0x08, 0x01]), Form::BitEfficientMessage);
/// assert_eq!(detect(b" (inform)"), Form::String);
/// ```
pub fn detect(bytes: &[u8]) -> Form {
    match bytes {
        // XML in UTF-16: the first two octets are a byte order mark.
        [0xfe, 0xff, 0x00, b'<', ..] | [0xff, 0xfe, b'<', 0x00, ..] => Form::Xml,
        [0xfa..=0xfc, ..] => Form::BitEfficientMessage,
        [0xfd | 0xfe, ..] => Form::BitEfficientEnvelope,
        _ => detect_text(bytes),
    }
}

fn detect_text(bytes: &[u8]) -> Form {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match text.trim_ascii_start().first() {
        Some(b'<') => Form::Xml,
        Some(b'(') => Form::String,
        _ => Form::Unknown,
    }
}
