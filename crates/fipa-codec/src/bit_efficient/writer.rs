use bytes::{BufMut, BytesMut};
use fipa_acl::Text;

use crate::EncodeError;
use crate::decimal::Decimal;
pub(super) use crate::user_names::without_prefix;

/// The name of a user-defined parameter as it follows `X-` in a BinWord.
pub(super) fn user_name(name: &str) -> Option<&str> {
    let name = without_prefix(name);
    let fits = |octet| matches!(octet, 0x21..=0x7f) && !matches!(octet, b'(' | b')');
    (!name.is_empty() && name.bytes().all(fits)).then_some(name)
}

/// More than a length in 32 bits can tell.
pub(super) struct TooLong;

impl TooLong {
    pub(super) const WHAT: &str = "more than 4 GiB";

    pub(super) fn within(self, parameter: &'static str) -> EncodeError {
        let what = TooLong::WHAT;
        EncodeError { parameter, what }
    }
}

/// BinString of SC00069G with a length in as few octets as will do.
pub(super) fn write_counted(octets: &[u8], out: &mut BytesMut) -> Result<(), TooLong> {
    write_length(octets.len(), out)?;
    out.put_slice(octets);
    Ok(())
}

/// The part of a BinString that precedes its octets.
pub(super) fn write_length(octets: usize, out: &mut BytesMut) -> Result<(), TooLong> {
    if let Ok(len) = u8::try_from(octets) {
        out.put_slice(&[0x16, len]);
    } else if let Ok(len) = u16::try_from(octets) {
        let [high, low] = len.to_be_bytes();
        out.put_slice(&[0x17, high, low]);
    } else if let Ok(len) = u32::try_from(octets) {
        out.put_u8(0x19);
        out.put_u32(len);
    } else {
        return Err(TooLong);
    }
    Ok(())
}

/// NullTerminatedString of SC00088D in the form `#n"…`, the only one that all peers read.
pub(super) fn write_null_terminated(
    text: &[u8],
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    write_prefixed("", text, parameter, out)
}

/// A user-defined parameter of an envelope: its name with the `X-` that marks it, and its value.
pub(super) fn write_user_text(
    name: &str,
    value: &Text,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    const PARAMETER: &str = "user-defined";
    out.put_u8(0);
    write_prefixed("X-", without_prefix(name).as_bytes(), PARAMETER, out)?;
    write_null_terminated(value.as_bytes(), PARAMETER, out)
}

pub(super) fn write_prefixed(
    prefix: &str,
    text: &[u8],
    parameter: &'static str,
    out: &mut BytesMut,
) -> Result<(), EncodeError> {
    if text.contains(&0) {
        return Err(EncodeError {
            parameter,
            what: "a zero octet cannot stand in a null terminated string",
        });
    }
    out.put_u8(b'#');
    out.put_slice(Decimal::of(prefix.len() + text.len()).as_bytes());
    out.put_u8(b'"');
    out.put_slice(prefix.as_bytes());
    out.put_slice(text);
    out.put_u8(0);
    Ok(())
}
