use base64::Engine;
use base64::engine::general_purpose::STANDARD_PAD_INDIFFERENT as BASE64;
use bytes::Bytes;
use fipa_acl::{Message, UserDefined};

use super::scan::is_blank;

/// The name, without `X-`, of the parameter with which JADE says that the content is Base64.
pub(super) const ENCODING: &str = "JADE-Encoding";

/// Its only value.
pub(super) const VALUE: &str = "Base64";

/// Decodes a content that is said to be Base64 and takes the parameter out that says so. What is
/// no Base64 is left as it is.
pub(super) fn undo_base64(message: &mut Message) {
    if !message.user_defined.iter().any(says_base64) {
        return;
    }
    if let Some(content) = &mut message.content {
        match decoded(content) {
            Some(octets) => *content = octets,
            None => return,
        }
    }
    message
        .user_defined
        .retain(|parameter| !says_base64(parameter));
}

/// The octets in Base64.
pub(super) fn encoded(octets: &[u8]) -> Bytes {
    Bytes::from(BASE64.encode(octets))
}

fn says_base64(parameter: &UserDefined) -> bool {
    let value = parameter.value.as_str().unwrap_or_default();
    parameter.name.eq_ignore_ascii_case(ENCODING) && value.eq_ignore_ascii_case(VALUE)
}

/// White space may stand anywhere in Base64.
fn decoded(content: &Bytes) -> Option<Bytes> {
    let octets = if content.iter().any(|octet| is_blank(*octet)) {
        let digits: Vec<u8> = content.iter().copied().filter(|b| !is_blank(*b)).collect();
        BASE64.decode(digits)
    } else {
        BASE64.decode(content)
    };
    octets.ok().map(Bytes::from)
}
