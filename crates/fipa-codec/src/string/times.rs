use fipa_acl::{FipaTime, InvalidToken};

use crate::{EncodeError, Fault, Output};

/// DateTimeToken of SC00070I.
pub(super) fn parse(token: &[u8]) -> Result<FipaTime, (Fault, &'static str)> {
    FipaTime::from_token(token).map_err(|error| match error {
        InvalidToken::Shape => (Fault::Malformed, "a date is like 20260102T030405678Z"),
        InvalidToken::NoSuchDate => (Fault::Violation, "no such date"),
    })
}

/// A point in time in UTC with its zone letter, or a span with its sign.
pub(super) fn write(time: &FipaTime, out: &mut Output) -> Result<(), EncodeError> {
    let token = time.to_token().map_err(|error| EncodeError {
        parameter: "reply-by",
        what: error.as_str(),
    })?;
    out.put_slice(token.as_bytes());
    Ok(())
}
