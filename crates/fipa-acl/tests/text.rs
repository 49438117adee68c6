//! A text behaves as its characters, wherever it is held.

use std::hash::{BuildHasher, RandomState};

use bytes::Bytes;
use fipa_acl::Text;
use proptest::prelude::*;

/// The octets of a value itself.
fn within(text: &Text) -> bool {
    let value = std::slice::from_ref(text).as_ptr_range();
    (value.start.cast()..value.end.cast()).contains(&text.as_ptr())
}

/// The same text in both ways, if there are two.
fn both(text: &str) -> [Text; 2] {
    let shared = Text::from_static(text.to_owned().leak());
    [Text::from(text), shared]
}

proptest! {
    #[test]
    fn a_text_is_its_characters(text in "[ -~]{0,30}|[\\x00-\\x7f]{0,30}|\\PC{0,12}|[a-z@]{20,26}") {
        let hasher = RandomState::new();
        for held in both(&text) {
            prop_assert_eq!(held.as_str(), text.as_str());
            prop_assert_eq!(held.clone().into_bytes(), text.as_bytes());
            prop_assert_eq!(held.detached(), text.as_str());
            prop_assert_eq!(hasher.hash_one(&held), hasher.hash_one(text.as_str()));
        }
        let [one, other] = both(&text);
        prop_assert_eq!(one.is_word(), other.is_word());
        prop_assert_eq!(one, other);
    }

    #[test]
    fn texts_are_ordered_as_their_characters(a in "[a-c]{0,4}|\\PC{0,30}", b in "[a-c]{0,4}|\\PC{0,30}") {
        for (one, other) in both(&a).iter().zip(both(&b).iter().rev()) {
            prop_assert_eq!(one.cmp(other), a.cmp(&b));
            prop_assert_eq!(one == other, a == b);
        }
    }

    #[test]
    fn octets_are_text_if_they_are_utf_8(octets in prop::collection::vec(any::<u8>(), 0..30)) {
        let text = Text::from_utf8(octets.clone().into());
        let expected = std::str::from_utf8(&octets).map_err(|error| error.valid_up_to());
        prop_assert_eq!(text.as_deref().map_err(|error| error.valid_up_to), expected);
    }
}

#[test]
fn short_texts_in_ascii_are_held_within_the_value_and_others_share_their_buffer() {
    assert_eq!(size_of::<Text>(), 32);
    let buffer = Bytes::from("a".repeat(Text::SHORT + 1));
    for len in 0..=Text::SHORT {
        let text = Text::from_utf8(buffer.slice(..len)).unwrap();
        assert!(within(&text) && within(&text.clone()), "{len}");
        assert_eq!(Text::short(&buffer[..len]), Some(text));
    }
    for long in [buffer, Bytes::from("\u{e9}")] {
        assert_eq!(Text::short(&long), None);
        let text = Text::from_utf8(long.clone()).unwrap();
        assert_eq!(text.as_ptr(), long.as_ptr());
        assert_eq!(text.clone().into_bytes().as_ptr(), long.as_ptr());
        assert_ne!(text.detached().as_ptr(), long.as_ptr());
    }
}
