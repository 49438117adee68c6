/// What a decoder accepts at most. The default is generous for honest peers and bounds hostile ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Octets of one input: a message, or a letter with its payload.
    pub max_octets: usize,
    /// Resolvers within resolvers, lists within lists.
    pub max_depth: usize,
    /// Entries of all lists of one input together: receivers, addresses, parameters, items.
    pub max_items: usize,
    /// Layers of one envelope, its base included.
    pub max_layers: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_octets: 256 << 20,
            max_depth: 32,
            max_items: 65_536,
            max_layers: 64,
        }
    }
}
