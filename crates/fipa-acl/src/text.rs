use std::borrow::Borrow;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;

use bytes::Bytes;
use bytestring::ByteString;

/// UTF-8 text that shares the buffer it was read from.
///
/// Cloning is cheap. A `Text` keeps its whole buffer alive; what is stored for long should be
/// [`detached`](Text::detached) first.
#[derive(Clone, Default)]
pub struct Text(ByteString);

/// The octets are not UTF-8; `valid_up_to` counts the octets before the first bad one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not UTF-8 after {valid_up_to} octets")]
pub struct NotUtf8 {
    /// Octets before the first that is not UTF-8.
    pub valid_up_to: usize,
}

impl Text {
    /// Text that lives as long as the program; no allocation.
    pub const fn from_static(text: &'static str) -> Text {
        Text(ByteString::from_static(text))
    }

    /// The text in these octets, shared, not copied.
    #[inline]
    pub fn from_utf8(octets: Bytes) -> Result<Text, NotUtf8> {
        match ByteString::try_from(octets) {
            Ok(text) => Ok(Text(text)),
            Err(error) => Err(NotUtf8 {
                valid_up_to: error.valid_up_to(),
            }),
        }
    }

    /// The text in these octets, with U+FFFD for what is not UTF-8 (only then is it copied).
    pub fn from_utf8_lossy(octets: Bytes) -> Text {
        match ByteString::try_from(octets.clone()) {
            Ok(text) => Text(text),
            Err(_) => Text::from(String::from_utf8_lossy(&octets).into_owned()),
        }
    }

    /// The text.
    #[inline]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The octets, shared.
    #[inline]
    pub fn into_bytes(self) -> Bytes {
        self.0.into_bytes()
    }

    /// A copy that does not keep the buffer alive that this text was read from.
    pub fn detached(&self) -> Text {
        Text::from(self.as_str())
    }

    /// Whether this is a Word of FIPA SC00070I in ASCII: the only form in which names, addresses
    /// and protocols can be written.
    ///
    /// ```
    /// use fipa_acl::Text;
    /// assert!(Text::from("drive@robot1").is_word());
    /// assert!(!Text::from("9lives@robot1").is_word());
    /// assert!(!Text::from("two words").is_word());
    /// ```
    #[inline]
    pub fn is_word(&self) -> bool {
        is_word(self.as_str().as_bytes())
    }
}

#[inline]
pub(crate) fn is_word(octets: &[u8]) -> bool {
    let Some(first) = octets.first() else {
        return false;
    };
    !matches!(first, b'#' | b'0'..=b'9' | b'-' | b'@' | b'"') && all_in_words(octets)
}

/// Whether all octets are 21 to 7F without parentheses, found out for eight of them at a time.
#[inline]
fn all_in_words(octets: &[u8]) -> bool {
    let (eights, rest) = octets.as_chunks::<8>();
    let all = eights.iter().all(|eight| are_in_words(*eight));
    // The last ones are looked at together with some that were looked at before.
    match (octets.last_chunk::<8>(), octets) {
        (Some(last), _) => all && are_in_words(*last),
        (None, [a, b, c, d, ..]) => {
            let [.., w, x, y, z] = octets else {
                return false;
            };
            are_in_words([*a, *b, *c, *d, *w, *x, *y, *z])
        }
        _ => rest
            .iter()
            .all(|octet| matches!(octet, 0x21..=0x7f) && !matches!(octet, b'(' | b')')),
    }
}

#[inline]
fn are_in_words(octets: [u8; 8]) -> bool {
    const fn each(octet: u8) -> u64 {
        u64::from_le_bytes([octet; 8])
    }
    let word = u64::from_le_bytes(octets);
    let from_21 = (word | each(0x80)) - each(0x21);
    // The parentheses differ in the lowest bit only, and become zero.
    let parentheses = (word & each(0xfe)) ^ each(b'(');
    let no_parenthesis = ((parentheses & each(0x7f)) + each(0x7f)) | parentheses;
    !word & from_21 & no_parenthesis & each(0x80) == each(0x80)
}

impl Deref for Text {
    type Target = str;
    #[inline]
    fn deref(&self) -> &str {
        self.as_str()
    }
}

impl AsRef<str> for Text {
    fn as_ref(&self) -> &str {
        self.as_str()
    }
}

impl Borrow<str> for Text {
    fn borrow(&self) -> &str {
        self.as_str()
    }
}

impl PartialEq for Text {
    fn eq(&self, other: &Text) -> bool {
        self.as_str() == other.as_str()
    }
}

impl Eq for Text {}

impl Hash for Text {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.as_str().hash(state);
    }
}

impl PartialOrd for Text {
    fn partial_cmp(&self, other: &Text) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Text {
    fn cmp(&self, other: &Text) -> std::cmp::Ordering {
        self.as_str().cmp(other.as_str())
    }
}

impl PartialEq<str> for Text {
    fn eq(&self, other: &str) -> bool {
        self.as_str() == other
    }
}

impl PartialEq<&str> for Text {
    fn eq(&self, other: &&str) -> bool {
        self.as_str() == *other
    }
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Text {
        Text(ByteString::from(text))
    }
}

impl From<String> for Text {
    fn from(text: String) -> Text {
        Text(ByteString::from(text))
    }
}

impl From<&String> for Text {
    fn from(text: &String) -> Text {
        Text::from(text.as_str())
    }
}

impl From<&Text> for Text {
    fn from(text: &Text) -> Text {
        text.clone()
    }
}
