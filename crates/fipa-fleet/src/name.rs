/// How a certificate says whose it is: this, and the name.
pub(crate) const SCHEME: &str = "fipa:";

/// Octets of a name, at most: it stands in file names too.
const LONGEST: usize = 128;

/// The name cannot be that of a robot of a fleet.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is no name for a robot of a fleet: a letter, then letters, digits, and . _ - @ +, at most \
     128, not ending in .fleet or .pem"
)]
pub struct NameError(String);

/// Whether a name can be that of a robot of a fleet: it stands in certificates, file names and rules.
pub fn check_name(name: &str) -> Result<(), NameError> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "._-@+".contains(c);
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
    let is_file = [".fleet", ".pem"].iter().any(|end| name.ends_with(end));
    match begins && name.len() <= LONGEST && name.chars().all(allowed) && !is_file {
        true => Ok(()),
        false => Err(NameError(name.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_words_that_no_file_system_minds() {
        for good in ["robot1", "mts@host.example", "R-2_x+y"] {
            assert_eq!(check_name(good), Ok(()));
        }
        let long = "r".repeat(129);
        for bad in [
            "",
            "1robot",
            "../x",
            "a/b",
            "a b",
            "robot1.fleet",
            "x.pem",
            "é",
            &long,
        ] {
            assert!(check_name(bad).is_err(), "{bad}");
        }
    }
}
