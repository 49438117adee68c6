/// What the reader accepts at most. The default is generous for honest peers and bounds hostile
/// ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Octets of one content.
    pub max_octets: usize,
    /// Parentheses within parentheses.
    pub max_depth: usize,
    /// Terms of one content together.
    pub max_terms: usize,
}

impl Limits {
    /// Deeper than this is never followed, whatever the limit says: depth costs stack.
    pub(crate) const DEEPEST: usize = 256;
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_octets: 16 << 20,
            max_depth: 64,
            max_terms: 1 << 20,
        }
    }
}
