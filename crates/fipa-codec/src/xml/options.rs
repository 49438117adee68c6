/// Where peers want something else written than the standard has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WriteOptions {
    /// Whether all agents of `to` and `intended-receiver` stand in one element, or each in its
    /// own.
    pub(crate) grouped_agents: bool,
    /// Whether `fipa-message` has the conversation id as an attribute besides the element.
    pub(crate) conversation_id_attribute: bool,
    /// Whether the dates of an envelope say that they are in UTC.
    pub(crate) envelope_zone_letter: bool,
    /// Whether `transport-behaviour` is written.
    pub(crate) transport_behaviour: bool,
    /// Whether user-defined parameters with an empty value are written.
    pub(crate) empty_user_defined: bool,
}

impl WriteOptions {
    /// What the standards have.
    pub(crate) const STRICT: WriteOptions = WriteOptions {
        grouped_agents: true,
        conversation_id_attribute: true,
        envelope_zone_letter: true,
        transport_behaviour: true,
        empty_user_defined: true,
    };
}
