//! Texts are looked at several octets at a time: every length, and every place of what is special.

use fipa_acl::{Expression, Message, Performative, Text};
use fipa_codec::bit_efficient::{decode_message, encode_message};
use fipa_codec::{Limits, Output};

/// Texts of this length with the character at each place, and without it.
fn texts(len: usize, special: char) -> impl Iterator<Item = Text> {
    (0..=len).map(move |place| {
        let character = |at| if at == place { special } else { 'a' };
        Text::from((0..len).map(character).collect::<String>())
    })
}

fn special() -> impl Iterator<Item = char> {
    (0..=0x7f_u8).map(char::from).chain(['ü', '\u{ff}', '漢'])
}

fn is_word(text: &str) -> bool {
    let allowed = |octet: u8| (0x21..=0x7f).contains(&octet) && octet != b'(' && octet != b')';
    !text.is_empty()
        && !text.starts_with(|c: char| c.is_ascii_digit() || "#-@\"".contains(c))
        && text.bytes().all(allowed)
}

#[test]
fn words_are_told_from_other_texts() {
    for special in special() {
        for text in (0..26).flat_map(|len| texts(len, special)) {
            assert_eq!(text.is_word(), is_word(&text), "{text:?}");
        }
    }
}

#[test]
fn texts_come_back_whatever_is_where() {
    let mut out = Output::new();
    for special in ['\0', '"', '\\', ' ', '#', 'a', 'ü'] {
        for text in (0..50).flat_map(|len| texts(len, special)) {
            let message = Message::new(Performative::Inform)
                .language(Expression::String(text.clone()))
                .encoding(Expression::List(vec![Expression::String(text)]));
            encode_message(&message, &mut out).unwrap();
            let octets = out.take_bytes();
            let decoded = decode_message(&octets, &Limits::default());
            assert_eq!(decoded, Ok(message));
        }
    }
}
