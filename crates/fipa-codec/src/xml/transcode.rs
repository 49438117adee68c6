use bytes::Bytes;

/// A document in UTF-16 as UTF-8.
pub(super) struct Transcoded {
    pub(super) text: Bytes,
    /// Octets of the byte order mark in the input.
    mark: usize,
    /// Octets of the input that were looked at.
    end: usize,
}

/// The input as UTF-8 if it is in UTF-16, which its first octets tell.
#[inline]
pub(super) fn from_utf16(bytes: &[u8], max_octets: usize) -> Option<Transcoded> {
    match bytes {
        [0xfe, 0xff, ..] => Some(transcoded(bytes, 2, max_octets, u16::from_be_bytes)),
        [0xff, 0xfe, ..] => Some(transcoded(bytes, 2, max_octets, u16::from_le_bytes)),
        [0, b'<', ..] => Some(transcoded(bytes, 0, max_octets, u16::from_be_bytes)),
        [b'<', 0, ..] => Some(transcoded(bytes, 0, max_octets, u16::from_le_bytes)),
        _ => None,
    }
}

#[cold]
fn transcoded(
    bytes: &[u8],
    mark: usize,
    max_octets: usize,
    unit: fn([u8; 2]) -> u16,
) -> Transcoded {
    let end = bytes.len().min(max_octets);
    let (pairs, _) = bytes.get(mark..end).unwrap_or_default().as_chunks::<2>();
    let units = pairs.iter().map(|pair| unit(*pair));
    let text: String = char::decode_utf16(units)
        .map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER))
        .collect();
    Transcoded {
        text: Bytes::from(text),
        mark,
        end,
    }
}

impl Transcoded {
    /// Where in the input that stands which stands here in the text.
    pub(super) fn position(&self, at: usize) -> usize {
        if at >= self.text.len() {
            return self.end;
        }
        let text = self.text.get(..at).unwrap_or_default();
        // What could not be transcoded was one unit and became a character of one unit.
        let units: usize = text
            .utf8_chunks()
            .flat_map(|chunk| chunk.valid().chars())
            .map(char::len_utf16)
            .sum();
        self.mark + units * 2
    }
}
