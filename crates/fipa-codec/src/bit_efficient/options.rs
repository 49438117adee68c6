/// Where a peer wants something else written than the standards have.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WriteOptions {
    /// Whether dates say that they are in UTC.
    pub(crate) zone_letter: bool,
    /// Whether user-defined parameters of envelopes and stamps are written.
    pub(crate) user_defined_slots: bool,
    /// Whether every layer of an envelope has a payload-length.
    pub(crate) every_payload_length: bool,
    /// Where the newest overlay stands.
    pub(crate) newest: Newest,
}

/// Where the newest overlay of an envelope stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Newest {
    /// In front of everything (SC00088D section 2.2), with its length.
    First,
    /// Directly in front of the base, with the length that fipa_acl announces: without the stamp.
    /// By that length readers know the order.
    Last,
}

impl WriteOptions {
    /// What the standards have.
    pub(crate) const STRICT: WriteOptions = WriteOptions {
        zone_letter: true,
        user_defined_slots: true,
        every_payload_length: false,
        newest: Newest::First,
    };
}
