/// The name of a user-defined parameter without the `X-` that marks it where it is written.
///
/// A name is kept without its prefix, but its field can be set by anybody.
pub(crate) fn without_prefix(mut name: &str) -> &str {
    while let Some(shorter) = name.strip_prefix("X-").or_else(|| name.strip_prefix("x-")) {
        name = shorter;
    }
    name
}
