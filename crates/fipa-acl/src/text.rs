use std::borrow::Borrow;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;

use ascii::{AsciiChar, AsciiStr};
use bytes::Bytes;
use bytestring::ByteString;

/// UTF-8 text: a short one in ASCII is held within the value, any other shares the buffer it was
/// read from.
///
/// Cloning is cheap. A `Text` that shares a buffer keeps all of it alive; what is stored for long
/// should be [`detached`](Text::detached) first.
#[derive(Clone)]
pub struct Text(Held);

/// Where the octets are. Both kinds are text by their types, so none is checked twice.
#[derive(Clone)]
enum Held {
    Inline(Short),
    Shared(ByteString),
}

/// The octets are not UTF-8; `valid_up_to` counts the octets before the first bad one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not UTF-8 after {valid_up_to} octets")]
pub struct NotUtf8 {
    /// Octets before the first that is not UTF-8.
    pub valid_up_to: usize,
}

impl Text {
    /// Octets that a text in ASCII may have to be held within the value.
    pub const SHORT: usize = 23;

    /// Text that lives as long as the program; no allocation.
    pub const fn from_static(text: &'static str) -> Text {
        Text(Held::Shared(ByteString::from_static(text)))
    }

    /// The text in these octets; copied only if it is held within the value.
    #[inline]
    pub fn from_utf8(octets: Bytes) -> Result<Text, NotUtf8> {
        if let Some(text) = Text::short(&octets) {
            return Ok(text);
        }
        match ByteString::try_from(octets) {
            Ok(text) => Ok(Text(Held::Shared(text))),
            Err(error) => Err(NotUtf8 {
                valid_up_to: error.valid_up_to(),
            }),
        }
    }

    /// The text in these octets, with U+FFFD for what is not UTF-8.
    pub fn from_utf8_lossy(octets: Bytes) -> Text {
        match Text::from_utf8(octets.clone()) {
            Ok(text) => text,
            Err(_) => Text::from(String::from_utf8_lossy(&octets).into_owned()),
        }
    }

    /// The text in these octets if it can be held within the value: ASCII of up to
    /// [`SHORT`](Self::SHORT) octets.
    ///
    /// Who reads from a buffer tries this first, because to share the buffer costs more.
    ///
    /// ```
    /// use fipa_acl::Text;
    /// assert_eq!(Text::short(b"drive@robot1").unwrap(), "drive@robot1");
    /// assert!(Text::short(b"a name of 24 octets, yes").is_none());
    /// ```
    #[inline]
    pub fn short(octets: &[u8]) -> Option<Text> {
        Short::of(octets).map(|short| Text(Held::Inline(short)))
    }

    /// The text.
    #[inline]
    pub fn as_str(&self) -> &str {
        match &self.0 {
            Held::Inline(short) => short.as_str(),
            Held::Shared(text) => text,
        }
    }

    /// The octets; copied only if they are held within the value.
    #[inline]
    pub fn into_bytes(self) -> Bytes {
        match self.0 {
            Held::Inline(short) => Bytes::copy_from_slice(short.as_str().as_bytes()),
            Held::Shared(text) => text.into_bytes(),
        }
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
        match &self.0 {
            Held::Inline(short) => short.is_word(),
            Held::Shared(text) => is_word(text.as_bytes()),
        }
    }
}

/// Up to 23 ASCII characters with zeros behind them. The last place has their number, whose octet
/// is that of a character too.
#[derive(Clone)]
struct Short([[AsciiChar; 8]; 3]);

impl Short {
    #[inline]
    fn of(octets: &[u8]) -> Option<Short> {
        if octets.len() > Text::SHORT {
            return None;
        }
        let [first, second, third] = in_words(octets);
        if (first | second | third) & each(0x80) != 0 {
            return None;
        }
        let third = third | (octets.len() as u64) << 56;
        Some(Short([
            characters(first),
            characters(second),
            characters(third),
        ]))
    }

    #[inline]
    fn is_word(&self) -> bool {
        let [first, second, third] = &self.0;
        let [begin, ..] = first.map(AsciiChar::as_byte);
        let outside = |eight: &[AsciiChar; 8]| outside_words(eight.map(AsciiChar::as_byte));
        // The zeros and the number behind the text are outside, so there is a first one that is.
        let bits = match (outside(first), outside(second)) {
            (0, 0) => 128 + outside(third).trailing_zeros(),
            (0, second) => 64 + second.trailing_zeros(),
            (first, _) => first.trailing_zeros(),
        };
        let len = u32::from(self.len());
        len > 0 && begins_word(begin) && bits / 8 == len
    }

    /// How many characters there are.
    #[inline]
    fn len(&self) -> u8 {
        let [.., [.., len]] = self.0;
        len.as_byte()
    }

    #[inline]
    fn as_str(&self) -> &str {
        let characters = self.0.as_flattened().get(..usize::from(self.len()));
        <&AsciiStr>::from(characters.unwrap_or_default()).as_str()
    }
}

/// The characters of eight octets in ASCII: nothing is done at all once it is compiled.
#[inline]
fn characters(word: u64) -> [AsciiChar; 8] {
    let character = |octet| AsciiChar::from_ascii(octet & 0x7f).unwrap_or(AsciiChar::Null);
    word.to_le_bytes().map(character)
}

/// Up to 23 octets with zeros behind them, from pieces that overlap: what copies any number of
/// octets takes longer.
#[inline]
fn in_words(octets: &[u8]) -> [u64; 3] {
    let word = |octets: &[u8; 8]| u64::from_le_bytes(*octets);
    let len = octets.len();
    let (Some(first), Some(last)) = (octets.first_chunk(), octets.last_chunk()) else {
        return [in_word(octets), 0, 0];
    };
    let moved = |end: usize| word(last).checked_shr(8 * (end - len) as u32);
    match octets.get(8..).and_then(|octets| octets.first_chunk()) {
        None => [word(first), moved(16).unwrap_or(0), 0],
        Some(second) => [word(first), word(second), moved(24).unwrap_or(0)],
    }
}

/// Up to seven octets with zeros behind them.
#[inline]
fn in_word(octets: &[u8]) -> u64 {
    let half = |octets: &[u8; 4]| u64::from(u32::from_le_bytes(*octets));
    match (octets.first_chunk(), octets.last_chunk()) {
        (Some(first), Some(last)) => half(first) | half(last) << (8 * (octets.len() - 4)),
        _ => octets
            .iter()
            .rev()
            .fold(0, |word, octet| word << 8 | u64::from(*octet)),
    }
}

/// Eight times this octet.
const fn each(octet: u8) -> u64 {
    u64::from_le_bytes([octet; 8])
}

#[inline]
pub(crate) fn is_word(octets: &[u8]) -> bool {
    let Some(first) = octets.first() else {
        return false;
    };
    begins_word(*first) && all_in_words(octets)
}

/// Whether a word may begin with an octet that it may hold.
#[inline]
fn begins_word(octet: u8) -> bool {
    !matches!(octet, b'#' | b'0'..=b'9' | b'-' | b'@' | b'"')
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
    outside_words(octets) == 0
}

/// The highest bits of those octets that are not 21 to 7F, or a parenthesis.
#[inline]
fn outside_words(octets: [u8; 8]) -> u64 {
    let word = u64::from_le_bytes(octets);
    let from_21 = (word | each(0x80)) - each(0x21);
    // The parentheses differ in the lowest bit only, and become zero.
    let parentheses = (word & each(0xfe)) ^ each(b'(');
    let no_parenthesis = ((parentheses & each(0x7f)) + each(0x7f)) | parentheses;
    (word | !from_21 | !no_parenthesis) & each(0x80)
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

impl Default for Text {
    fn default() -> Text {
        Text::from_static("")
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Text {
        match Short::of(text.as_bytes()) {
            Some(short) => Text(Held::Inline(short)),
            None => Text(Held::Shared(ByteString::from(text))),
        }
    }
}

impl From<String> for Text {
    fn from(text: String) -> Text {
        match Short::of(text.as_bytes()) {
            Some(short) => Text(Held::Inline(short)),
            None => Text(Held::Shared(ByteString::from(text))),
        }
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
