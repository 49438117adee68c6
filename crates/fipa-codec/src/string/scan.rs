/// White space between tokens (SC00070I section 2).
pub(super) fn is_blank(octet: u8) -> bool {
    matches!(octet, b' ' | b'\t' | b'\r' | b'\n')
}

/// Whether a word ends in front of this octet.
pub(super) fn ends_word(octet: u8) -> bool {
    WORD_ENDS[usize::from(octet)]
}

/// A table: the question is asked for each octet outside literals.
const WORD_ENDS: [bool; 256] = {
    let mut ends = [false; 256];
    let mut octet = 0;
    while octet <= 0x20 {
        ends[octet] = true;
        octet += 1;
    }
    ends[b'(' as usize] = true;
    ends[b')' as usize] = true;
    ends
};

/// Octets of the word at the beginning of the text.
#[inline]
pub(super) fn word_len(text: &[u8]) -> usize {
    let (chunks, tail) = text.as_chunks();
    for (i, chunk) in chunks.iter().enumerate() {
        let ends = word_ends(u64::from_le_bytes(*chunk));
        if ends != 0 {
            return 8 * i + (ends.trailing_zeros() / 8) as usize;
        }
    }
    let end = tail.iter().position(|octet| ends_word(*octet));
    text.len() - tail.len() + end.unwrap_or(tail.len())
}

/// The lowest bit that is set is in the first octet that ends a word.
#[inline]
fn word_ends(octets: u64) -> u64 {
    const ONES: u64 = u64::MAX / 0xff;
    const HIGH: u64 = ONES << 7;
    // A subtraction borrows from an octet that is too small, whose high bit was not set before.
    let blanks = octets.wrapping_sub(0x21 * ONES) & !octets & HIGH;
    let parentheses = (octets | ONES) ^ (ONES * b')' as u64);
    let parentheses = parentheses.wrapping_sub(ONES) & !parentheses & HIGH;
    blanks | parentheses
}

/// Where the first quote is. Most literals are short: to look at eight octets at a time is faster
/// than to call what is fast for long ones.
#[inline]
pub(super) fn find_quote(text: &[u8]) -> Option<usize> {
    const EACH: u64 = u64::MAX / 0xff;
    let mut rest = text;
    for begin in [0, 8, 16, 24] {
        let Some((eight, behind)) = rest.split_first_chunk() else {
            break;
        };
        // The lowest bit that is left is in the first octet that became zero.
        let word = u64::from_le_bytes(*eight) ^ (EACH * u64::from(b'"'));
        let quotes = word.wrapping_sub(EACH) & !word & (EACH << 7);
        if quotes != 0 {
            return Some(begin + (quotes.trailing_zeros() / 8) as usize);
        }
        rest = behind;
    }
    memchr::memchr(b'"', rest).map(|at| text.len() - rest.len() + at)
}

/// The n of `#n"` at the beginning of the text, and how many octets these are.
pub(super) fn byte_length(text: &[u8]) -> Option<(usize, usize)> {
    let digits = text.strip_prefix(b"#")?;
    let mut count = 0_usize;
    for (i, octet) in digits.iter().enumerate() {
        match octet {
            b'0'..=b'9' => {
                let digit = usize::from(octet - b'0');
                count = count.saturating_mul(10).saturating_add(digit);
            }
            b'"' if i > 0 => return Some((count, i + 2)),
            _ => return None,
        }
    }
    None
}

/// Where in the text the first `#n"` begins.
pub(super) fn find_byte_length(text: &[u8]) -> Option<usize> {
    memchr::memchr_iter(b'#', text).find(|at| {
        let from_here = text.get(*at..).unwrap_or_default();
        byte_length(from_here).is_some()
    })
}

/// Number of SC00070I: a sign, digits with or without a point, an exponent.
pub(super) fn is_number(token: &[u8]) -> bool {
    if !matches!(token.first(), Some(b'0'..=b'9' | b'+' | b'-' | b'.')) {
        return false;
    }
    let exponent_at = token.iter().position(|b| matches!(b, b'e' | b'E'));
    let (mantissa, exponent) = token.split_at(exponent_at.unwrap_or(token.len()));
    is_mantissa(unsigned(mantissa))
        && match exponent {
            [] => true,
            [_, digits @ ..] => is_digits(unsigned(digits)),
        }
}

/// Digits, perhaps with a point among, before or behind them.
fn is_mantissa(text: &[u8]) -> bool {
    match text.iter().position(|octet| *octet == b'.') {
        None => is_digits(text),
        Some(point) => {
            let (whole, fraction) = text.split_at(point);
            let fraction = fraction.get(1..).unwrap_or_default();
            text.len() > 1
                && whole
                    .iter()
                    .chain(fraction)
                    .all(|octet| octet.is_ascii_digit())
        }
    }
}

fn unsigned(text: &[u8]) -> &[u8] {
    match text {
        [b'+' | b'-', rest @ ..] => rest,
        _ => text,
    }
}

fn is_digits(text: &[u8]) -> bool {
    !text.is_empty() && text.iter().all(u8::is_ascii_digit)
}

/// How octets can be written as a string (SC00070I StringLiteral, ByteLengthEncodedString).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// A literal that holds them as they are.
    Literal,
    /// A literal with `\"` for each quote.
    EscapedLiteral,
    /// Behind their count: a literal has no escape for the backslash, so it cannot end in one, nor
    /// hold one in front of a quote.
    Counted,
}

impl Form {
    /// The form for these octets, if a literal can hold their characters at all.
    #[inline]
    pub(super) fn of(octets: &[u8]) -> Form {
        if octets.last() == Some(&b'\\') {
            return Form::Counted;
        }
        if memchr::memchr(b'"', octets).is_none() {
            return Form::Literal;
        }
        let has_pair = memchr::memchr(b'\\', octets).is_some()
            && memchr::memmem::find(octets, b"\\\"").is_some();
        if has_pair {
            Form::Counted
        } else {
            Form::EscapedLiteral
        }
    }
}
