/// What a file may hold at most. The default is generous for protocols that people write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Octets of the file.
    pub max_octets: usize,
    /// Elements within elements.
    pub max_depth: usize,
    /// Elements and attributes together.
    pub max_items: usize,
    /// States.
    pub max_states: usize,
    /// Transitions, those that nested states inherit counted for each of them.
    pub max_transitions: usize,
    /// Octets of one compiled regular expression.
    pub max_pattern: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_octets: 1 << 20,
            max_depth: 32,
            max_items: 20_000,
            max_states: 1_000,
            max_transitions: 2_000,
            max_pattern: 1 << 16,
        }
    }
}
