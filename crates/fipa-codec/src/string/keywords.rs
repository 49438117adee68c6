use super::scan::{byte_length, ends_word};

/// A parameter of the standard, of messages or of agent identifiers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Parameter {
    Sender,
    Receiver,
    Content,
    ReplyWith,
    ReplyBy,
    InReplyTo,
    ReplyTo,
    Language,
    Encoding,
    Ontology,
    Protocol,
    ConversationId,
    Name,
    Addresses,
    Resolvers,
}

/// Parameters by their names, none of which begins like another one of its table.
pub(super) struct Parameters {
    /// Those with the same first letter stand together.
    named: &'static [(Keyword, Parameter)],
    /// From where to where, by the five lowest bits of the letter, which its case does not change.
    by_letter: [(u8, u8); 32],
}

impl Parameters {
    const fn new(named: &'static [(Keyword, Parameter)]) -> Parameters {
        let mut by_letter = [(0, 0); 32];
        let mut at = 0;
        while at < named.len() {
            let letter = named[at].0.value.to_le_bytes()[0] & 31;
            let (from, to) = by_letter[letter as usize];
            assert!(from == to || to as usize == at, "not together");
            let from = if from == to { at as u8 } else { from };
            by_letter[letter as usize] = (from, at as u8 + 1);
            at += 1;
        }
        Parameters { named, by_letter }
    }

    /// Those that begin with this letter, and perhaps others.
    #[inline]
    fn beginning_with(&self, letter: u8) -> &'static [(Keyword, Parameter)] {
        let range = self.by_letter.get(usize::from(letter & 31));
        let range = range.map(|(from, to)| usize::from(*from)..usize::from(*to));
        self.named
            .get(range.unwrap_or_default())
            .unwrap_or_default()
    }
}

/// MessageParameter of SC00070I.
pub(super) static OF_MESSAGES: &Parameters = &Parameters::new(&[
    (Keyword::new(b"sender"), Parameter::Sender),
    (Keyword::new(b"receiver"), Parameter::Receiver),
    (Keyword::new(b"reply-with"), Parameter::ReplyWith),
    (Keyword::new(b"reply-by"), Parameter::ReplyBy),
    (Keyword::new(b"reply-to"), Parameter::ReplyTo),
    (Keyword::new(b"content"), Parameter::Content),
    (Keyword::new(b"conversation-id"), Parameter::ConversationId),
    (Keyword::new(b"language"), Parameter::Language),
    (Keyword::new(b"ontology"), Parameter::Ontology),
    (Keyword::new(b"protocol"), Parameter::Protocol),
    (Keyword::new(b"in-reply-to"), Parameter::InReplyTo),
    (Keyword::new(b"encoding"), Parameter::Encoding),
]);

/// AgentIdentifier of SC00070I.
pub(super) static OF_AGENTS: &Parameters = &Parameters::new(&[
    (Keyword::new(b"name"), Parameter::Name),
    (Keyword::new(b"addresses"), Parameter::Addresses),
    (Keyword::new(b"resolvers"), Parameter::Resolvers),
]);

const USER_DEFINED: Keyword = Keyword::new(b"x-");

/// A word of up to 16 octets that has a meaning in any case, made to be compared at once.
pub(super) struct Keyword {
    /// The word in lower case.
    value: u128,
    /// The bits by which its letters may differ.
    case: u128,
    /// The octets that are compared.
    mask: u128,
    pub(super) len: usize,
}

impl Keyword {
    pub(super) const fn new(word: &[u8]) -> Keyword {
        let (mut value, mut case, mut mask) = (0, 0, 0);
        let mut at = 0;
        while at < word.len() {
            let shift = 8 * at as u32;
            value |= (word[at] as u128) << shift;
            mask |= 0xff << shift;
            if word[at].is_ascii_lowercase() {
                case |= 0x20 << shift;
            }
            at += 1;
        }
        Keyword {
            value,
            case,
            mask,
            len: word.len(),
        }
    }

    /// Whether a text with this window begins with the keyword.
    #[inline]
    pub(super) fn begins(&self, window: u128) -> bool {
        // Nearly always the first octet decides.
        let first = |octets: u128| octets.to_le_bytes()[0];
        first(window | self.case) == first(self.value)
            && (window | self.case) & self.mask == self.value
    }
}

/// The first 16 octets of a text, and zeros for those that it does not have.
#[inline]
pub(super) fn window(text: &[u8]) -> u128 {
    let octets = text.first_chunk().copied().unwrap_or_else(|| {
        let mut octets = [0; 16];
        octets
            .iter_mut()
            .zip(text)
            .for_each(|(to, from)| *to = *from);
        octets
    });
    u128::from_le_bytes(octets)
}

/// The parameter with whose name the text begins, and how long that is.
#[inline]
pub(super) fn begins_with_name(known: &Parameters, text: &[u8]) -> Option<(Parameter, usize)> {
    let named = known.beginning_with(*text.first()?);
    let window = window(text);
    let (keyword, parameter) = named.iter().find(|(keyword, _)| keyword.begins(window))?;
    Some((*parameter, keyword.len))
}

/// Whether the text, which is what follows a colon, makes it that of a parameter, if words are not
/// set apart by white space.
pub(super) fn makes_parameter(text: &[u8]) -> bool {
    USER_DEFINED.begins(window(text))
        || begins_with_name(OF_MESSAGES, text).is_some()
        || begins_with_name(OF_AGENTS, text).is_some()
}

/// Whether a parameter's name with its colon stands somewhere in the word.
#[inline]
pub(super) fn has_parameter(word: &[u8]) -> bool {
    memchr::memchr_iter(b':', word)
        .any(|colon| makes_parameter(word.get(colon + 1..).unwrap_or_default()))
}

/// Octets of the word at the beginning of the text, which ends in front of a parameter as well.
pub(super) fn glued_word_len(text: &[u8]) -> usize {
    glued_len(text, |_| false)
}

/// Octets of the name of an unknown parameter at the beginning of the text, which ends in front of
/// a parameter or a value as well.
pub(super) fn glued_name_len(text: &[u8]) -> usize {
    glued_len(text, |rest| match rest.first() {
        Some(b'"') => true,
        Some(b'#') => byte_length(rest).is_some(),
        _ => false,
    })
}

/// Nothing behind the end is looked at: there may be many words in one piece of text.
fn glued_len(text: &[u8], ends: impl Fn(&[u8]) -> bool) -> usize {
    let end = text.iter().enumerate().position(|(at, octet)| {
        let rest = text.get(at..).unwrap_or_default();
        ends_word(*octet)
            || (*octet == b':' && makes_parameter(rest.get(1..).unwrap_or_default()))
            || ends(rest)
    });
    end.unwrap_or(text.len())
}
