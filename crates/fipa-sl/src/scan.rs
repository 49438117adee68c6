use fipa_acl::{FipaTime, InvalidToken};

/// White space between tokens.
pub(crate) fn is_blank(octet: u8) -> bool {
    matches!(octet, b' ' | b'\t' | b'\r' | b'\n')
}

/// Whether a token that is no literal ends in front of this octet.
pub(crate) fn ends_token(octet: u8) -> bool {
    octet <= b' ' || matches!(octet, b'(' | b')' | b'"')
}

/// What a token that is no literal stands for.
pub(crate) enum Token {
    Word,
    Truth(bool),
    Number,
    Time(FipaTime),
    NoSuchDate,
    /// It begins like nothing that the lexis knows.
    Illegal,
}

impl Token {
    pub(crate) fn of(token: &[u8]) -> Token {
        if is_number(token) {
            return Token::Number;
        }
        match FipaTime::from_token(token) {
            Ok(time) => return Token::Time(time),
            Err(InvalidToken::NoSuchDate) => return Token::NoSuchDate,
            Err(InvalidToken::Shape) => {}
        }
        match token {
            [] | [b'#' | b'0'..=b'9' | b':' | b'-' | b'?', ..] => Token::Illegal,
            _ if token.eq_ignore_ascii_case(b"true") => Token::Truth(true),
            _ if token.eq_ignore_ascii_case(b"false") => Token::Truth(false),
            _ => Token::Word,
        }
    }
}

/// Number of SC00008I: decimal with or without point and exponent, or hexadecimal.
pub(crate) fn is_number(token: &[u8]) -> bool {
    let unsigned = unsigned(token);
    if let [b'0', b'x' | b'X', digits @ ..] = unsigned {
        return !digits.is_empty() && digits.iter().all(u8::is_ascii_hexdigit);
    }
    let exponent_at = unsigned.iter().position(|b| matches!(b, b'e' | b'E'));
    let (mantissa, exponent) = unsigned.split_at(exponent_at.unwrap_or(unsigned.len()));
    is_mantissa(mantissa)
        && match exponent {
            [] => true,
            [_, digits @ ..] => is_digits(self::unsigned(digits)),
        }
}

fn unsigned(text: &[u8]) -> &[u8] {
    match text {
        [b'+' | b'-', rest @ ..] => rest,
        _ => text,
    }
}

fn is_mantissa(text: &[u8]) -> bool {
    match text.iter().position(|octet| *octet == b'.') {
        None => is_digits(text),
        Some(point) => {
            let (whole, fraction) = text.split_at(point);
            let mut digits = whole.iter().chain(fraction.iter().skip(1));
            text.len() > 1 && digits.all(u8::is_ascii_digit)
        }
    }
}

fn is_digits(text: &[u8]) -> bool {
    !text.is_empty() && text.iter().all(u8::is_ascii_digit)
}
