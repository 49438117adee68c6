use std::fmt;
use std::str::FromStr;

/// The identity of one run of a message transport service: 128 random bits, drawn at start.
///
/// Names are for people and may be given twice; links, stamps and directory ownership go by this
/// id, so that a restarted daemon is never taken for the one before it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct InstanceId([u8; 16]);

impl InstanceId {
    /// The id with these octets; the caller draws them at random.
    pub const fn from_bytes(octets: [u8; 16]) -> InstanceId {
        InstanceId(octets)
    }

    /// The octets as they stand on the wire.
    pub const fn as_bytes(&self) -> &[u8; 16] {
        &self.0
    }
}

impl fmt::Display for InstanceId {
    /// 32 lower-case hexadecimal digits.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|octet| write!(f, "{octet:02x}"))
    }
}

impl fmt::Debug for InstanceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// The text is not 32 hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("an instance id is 32 hexadecimal digits")]
pub struct ParseInstanceIdError;

impl FromStr for InstanceId {
    type Err = ParseInstanceIdError;

    fn from_str(text: &str) -> Result<InstanceId, ParseInstanceIdError> {
        if text.len() != 32 || !text.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(ParseInstanceIdError);
        }
        let mut octets = [0; 16];
        for (octet, i) in octets.iter_mut().zip((0..32).step_by(2)) {
            *octet = u8::from_str_radix(&text[i..i + 2], 16).map_err(|_| ParseInstanceIdError)?;
        }
        Ok(InstanceId(octets))
    }
}
