//! Messages in string form (FIPA SC00070I).
//!
//! Writing is strict unless a [`Dialect`] is given; reading accepts what known peers write. Contents
//! and longer texts that were read share the buffer of the input.
//!
//! An input is read by the rules of the standard first. What cannot be read so is read once more
//! as one peer writes it, without white space: there a parameter's name ends where a keyword ends,
//! and a word in front of the next keyword.

mod acts;
mod agents;
mod expressions;
mod jade;
mod keywords;
mod message_reader;
mod message_writer;
mod reader;
mod scan;
mod tokens;
mod writer;

use bytes::Bytes;
use fipa_acl::{Message, Performative};

use self::reader::{Pass, Reader};
use self::writer::Writer;
pub(crate) use self::writer::{Base64, WriteOptions};
use crate::{DecodeError, Dialect, EncodeError, Fault, Limits, Output};

/// Reads a message (SC00070I section 2) that fills the whole input; white space behind it is
/// ignored.
pub fn decode_message(bytes: &Bytes, limits: &Limits) -> Result<Message, DecodeError> {
    let (message, used) = decode_message_prefix(bytes, limits)?;
    let behind = bytes.get(used..).unwrap_or_default();
    match behind.iter().position(|octet| !scan::is_blank(*octet)) {
        None => Ok(message),
        Some(position) => Err(DecodeError {
            offset: used + position,
            fault: Fault::Malformed,
            what: "something follows the message",
        }),
    }
}

/// Reads the message (SC00070I section 2) at the beginning of the input, and tells how many octets
/// it has: it ends with its closing parenthesis.
pub fn decode_message_prefix(
    bytes: &Bytes,
    limits: &Limits,
) -> Result<(Message, usize), DecodeError> {
    let error = match read(bytes, limits, Pass::Spaced) {
        Err(error) if error.fault != Fault::Limit => error,
        done => return done,
    };
    // The reading that comes farther tells better what is wrong.
    read(bytes, limits, Pass::Glued).map_err(|glued| {
        if glued.offset > error.offset {
            glued
        } else {
            error
        }
    })
}

fn read(bytes: &Bytes, limits: &Limits, pass: Pass) -> Result<(Message, usize), DecodeError> {
    let mut reader = Reader::new(bytes, limits, pass);
    let mut message = Message::new(Performative::Inform);
    reader.message(&mut message)?;
    Ok((message, reader.position()))
}

/// Appends a message (SC00070I section 2); on an error `out` is as before.
///
/// The parameters stand in the order of the bit-efficient form, the content is last. There is one
/// blank between tokens, none directly inside parentheses. A value is a word where it is a legal
/// one, else a string literal, and `#n"` with its octets only where no literal can hold it.
///
/// The act must be one of the standard; names, addresses and the protocol must be words
/// ([`Text::is_word`](fipa_acl::Text::is_word)); the name of a user-defined parameter must be one
/// without `#`, `"` and `:`, which readers take for the beginning of a value.
///
/// ```
/// use fipa_acl::{Message, Performative};
/// use fipa_codec::{Output, string};
///
/// let message = Message::new(Performative::Inform).to("b@robot").content("(done)");
/// let mut output = Output::new();
/// string::encode_message(&message, &mut output).unwrap();
/// assert_eq!(
///     output.take_bytes(),
///     "(inform :receiver (set (agent-identifier :name b@robot)) :content \"(done)\")",
/// );
/// ```
pub fn encode_message(message: &Message, out: &mut Output) -> Result<(), EncodeError> {
    encode_message_as(Dialect::Standard, message, out)
}

/// Appends a message (SC00070I section 2) as a peer needs it; on an error `out` is as before.
pub fn encode_message_as(
    dialect: Dialect,
    message: &Message,
    out: &mut Output,
) -> Result<(), EncodeError> {
    let options = dialect.string();
    out.all_or_nothing(|out| Writer { out, options }.message(message))
}
