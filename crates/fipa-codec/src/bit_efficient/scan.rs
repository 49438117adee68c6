/// Where an octet is for the first time. Texts are short: to look at eight octets at a time is
/// faster than to call what is fast for long ones.
#[inline]
pub(super) fn find_octet<const OCTET: u8>(octets: &[u8]) -> Option<usize> {
    let mut rest = octets;
    for begin in [0, 8, 16, 24] {
        let Some((word, behind)) = rest.split_first_chunk() else {
            return rest.iter().position(|o| *o == OCTET).map(|at| begin + at);
        };
        // The octet becomes zero, and of the bits that are left the lowest is that of the first
        // zero octet.
        let word = u64::from_le_bytes(*word) ^ each(OCTET);
        let zeros = word.wrapping_sub(each(1)) & !word & each(0x80);
        if zeros != 0 {
            return Some(begin + zeros.trailing_zeros() as usize / 8);
        }
        rest = behind;
    }
    memchr::memchr(OCTET, rest).map(|at| octets.len() - rest.len() + at)
}

/// Whether a string literal can hold these octets as they are.
#[inline]
pub(super) fn is_plain(octets: &[u8]) -> bool {
    let (eights, rest) = octets.as_chunks::<8>();
    let all = eights.iter().all(|eight| are_plain(*eight));
    // The last ones are looked at together with some that were looked at before.
    match octets.last_chunk::<8>() {
        Some(last) => all && are_plain(*last),
        None => rest
            .iter()
            .all(|octet| !matches!(octet, b'\0' | b'\\' | b'"')),
    }
}

#[inline]
fn are_plain(octets: [u8; 8]) -> bool {
    let word = u64::from_le_bytes(octets);
    // The highest bit of each octet that is not zero.
    let filled = |word: u64| ((word & each(0x7f)) + each(0x7f)) | word;
    let all = filled(word) & filled(word ^ each(b'\\')) & filled(word ^ each(b'"'));
    all & each(0x80) == each(0x80)
}

/// Eight times this octet.
const fn each(octet: u8) -> u64 {
    u64::from_le_bytes([octet; 8])
}
