/// Where the zero octet is, or a backslash in front of it.
#[inline]
pub(super) fn find_zero_or_backslash(octets: &[u8]) -> Option<usize> {
    find(
        octets,
        |word| zeros(word) | zeros(word ^ each(b'\\')),
        |rest| memchr::memchr2(0, b'\\', rest),
    )
}

/// Where the zero octet is.
#[inline]
pub(super) fn find_zero(octets: &[u8]) -> Option<usize> {
    find(octets, zeros, |rest| memchr::memchr(0, rest))
}

/// Where octets are for the first time. Texts are short: to look at eight octets at a time is
/// faster than to call what is fast for long ones.
///
/// The lowest bit that `hits` finds in a word is the highest one of the first such octet.
#[inline(always)]
fn find(
    octets: &[u8],
    hits: impl Fn(u64) -> u64,
    search: impl Fn(&[u8]) -> Option<usize>,
) -> Option<usize> {
    let mut rest = octets;
    for begin in [0, 8, 16, 24] {
        let Some((word, behind)) = rest.split_first_chunk() else {
            break;
        };
        let hits = hits(u64::from_le_bytes(*word));
        if hits != 0 {
            return Some(begin + hits.trailing_zeros() as usize / 8);
        }
        rest = behind;
    }
    search(rest).map(|at| octets.len() - rest.len() + at)
}

/// The highest bits of octets that are zero, and perhaps of others behind the first one.
#[inline]
fn zeros(word: u64) -> u64 {
    word.wrapping_sub(each(1)) & !word & each(0x80)
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
