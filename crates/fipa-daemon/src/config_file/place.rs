/// Where something stands in a text, as people count: from 1, and characters rather than octets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) line: usize,
    pub(super) column: usize,
}

impl Place {
    /// The place of an octet, which may be the end of the text.
    pub(super) fn of(text: &[u8], offset: usize) -> Place {
        let before = text.get(..offset).unwrap_or(text);
        let mut lines = before.split(|octet| *octet == b'\n');
        let last = lines.next_back().unwrap_or_default();
        Place {
            line: lines.count() + 1,
            column: String::from_utf8_lossy(last).chars().count() + 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_characters_are_counted_from_one() {
        let text = "ä = 1\r\nbc\n";
        for (offset, line, column) in [(0, 1, 1), (2, 1, 2), (8, 2, 1), (9, 2, 2), (11, 3, 1)] {
            assert_eq!(Place::of(text.as_bytes(), offset), Place { line, column });
        }
        assert_eq!(Place::of(b"", 0), Place { line: 1, column: 1 });
        assert_eq!(Place::of(b"a", 7), Place { line: 1, column: 2 });
    }
}
