/// Where peers want something else written than the standard has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WriteOptions {
    /// Whether all agents of a slot of an envelope stand in one element, or each in its own.
    pub(crate) grouped_agents: bool,
    /// Whether all agents of a parameter of a message stand in one element, or each in its own.
    pub(crate) grouped_receivers: bool,
    /// Whether dates say that they are in UTC.
    pub(crate) zone_letter: bool,
    /// Whether `transport-behaviour` is written.
    pub(crate) transport_behaviour: bool,
    /// Whether user-defined parameters with an empty value are written.
    pub(crate) empty_user_defined: bool,
    /// Whether the user-defined parameters of a message are elements with their own names.
    pub(crate) extension_elements: bool,
    /// How contents are written.
    pub(crate) content: ContentForm,
    /// How the layers of an envelope are written.
    pub(crate) layers: Layers,
    /// Whether agents in envelopes have their resolvers.
    pub(crate) resolvers_in_envelopes: bool,
    /// Whether envelopes have neither line ends nor octets beyond ASCII.
    pub(crate) plain_envelopes: bool,
}

/// How contents are written if it can hold them; in Base64 what none can.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ContentForm {
    /// Text with references.
    Escaped,
    /// A section, of text only.
    Section,
    /// A section, of any octets but zeros.
    RawSection,
}

/// How the layers of an envelope are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layers {
    /// As there are.
    All,
    /// As there are, up to nine: their numbers must have one digit.
    OneDigit,
    /// All of them as one, with the newest stamp, the intended receivers and the length.
    Flattened,
}

impl WriteOptions {
    /// What the standards have.
    pub(crate) const STRICT: WriteOptions = WriteOptions {
        grouped_agents: true,
        grouped_receivers: false,
        zone_letter: true,
        transport_behaviour: true,
        empty_user_defined: true,
        extension_elements: false,
        content: ContentForm::Escaped,
        layers: Layers::All,
        resolvers_in_envelopes: true,
        plain_envelopes: false,
    };
}
