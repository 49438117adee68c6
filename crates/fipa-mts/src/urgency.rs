//! How urgent a letter is.

use fipa_acl::Envelope;

/// The parameter of the envelope, `X-Priority`, that tells how urgent a letter is.
const PRIORITY: &str = "Priority";

/// How urgent a letter is: its envelope's user-defined parameter `X-Priority`, a number from 0, the
/// usual, to 2, the most urgent. Urgent letters pass others that wait for the same peer or in the
/// same mailbox; equally urgent ones keep their order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Urgency(u8);

impl Urgency {
    /// How many there are.
    pub const COUNT: usize = 3;

    /// All there are, the least urgent first.
    pub const ALL: [Urgency; Urgency::COUNT] = [Urgency(0), Urgency(1), Urgency(2)];

    /// That of an envelope. What is no number counts as 0, what is greater than 2 as 2.
    pub fn of(envelope: &Envelope) -> Urgency {
        let mut given = envelope.layers().flat_map(|slots| &slots.user_defined);
        let given = given.find(|(name, _)| name.eq_ignore_ascii_case(PRIORITY));
        let number = given.and_then(|(_, value)| value.trim().parse::<u64>().ok());
        Urgency(number.unwrap_or_default().min(2) as u8)
    }

    /// Its number, from 0 to 2.
    pub fn number(self) -> usize {
        self.0.into()
    }
}
