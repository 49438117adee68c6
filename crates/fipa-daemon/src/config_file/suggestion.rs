/// The known word that somebody who wrote `word` may have meant.
pub(super) fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let word = word.to_lowercase().replace('_', "-");
    let near = known.iter().map(|known| (distance(&word, known), *known));
    // Beyond a third of the letters, it is another word rather than a slip.
    let meant = near.filter(|(distance, known)| *distance <= known.len().div_ceil(3));
    meant
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, known)| known)
}

/// How many letters have to be changed, added or taken away to make one word of the other; a
/// swap of neighbours counts as one.
fn distance(from: &str, to: &str) -> usize {
    let from: Vec<char> = from.chars().collect();
    let to: Vec<char> = to.chars().collect();
    let mut before: Vec<usize> = Vec::new();
    let mut above: Vec<usize> = (0..=to.len()).collect();
    for i in 1..=from.len() {
        let mut row = vec![i];
        for j in 1..=to.len() {
            let replaced = above[j - 1] + usize::from(from[i - 1] != to[j - 1]);
            let mut least = replaced.min(above[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && from[i - 1] == to[j - 2] && from[i - 2] == to[j - 1] {
                least = least.min(before[j - 2] + 1);
            }
            row.push(least);
        }
        before = std::mem::replace(&mut above, row);
    }
    above[to.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_counted() {
        for (from, to, count) in [
            ("listen", "listen", 0),
            ("lisen", "listen", 1),
            ("lsiten", "listen", 1),
            ("", "peer", 4),
            ("peer", "", 4),
            ("pier", "peers", 2),
        ] {
            assert_eq!(distance(from, to), count, "{from} {to}");
        }
    }

    #[test]
    fn a_near_word_is_suggested_and_a_far_one_is_not() {
        let known = ["name", "listen", "max-letter", "no-mdns"];
        assert_eq!(nearest("Max_Leter", &known), Some("max-letter"));
        assert_eq!(nearest("nmae", &known), Some("name"));
        assert_eq!(nearest("no_mdns", &known), Some("no-mdns"));
        assert_eq!(nearest("devices", &known), None);
        assert_eq!(nearest("", &known), None);
    }
}
