use bytes::{Bytes, BytesMut};
use fipa_acl::Message;

use super::code_table::{CodeTable, Coding, NO_ENTRY};
use super::message_writer::{expected_len, write_content, write_parameters};
use super::options::WriteOptions;
use super::reader::Reader;
use super::writer::write_length;
use crate::{DecodeError, EncodeError, Limits, Output};

/// The first octet of a message whose texts enter the code table.
const LEARNS: u8 = 0xfb;
/// The first octet of a message that only looks into the code table.
const LOOKS_UP: u8 = 0xfc;

/// Reads a message (SC00069G section 2) that fills the whole input, with the code table of its
/// link; line ends behind it are ignored.
///
/// The table learns the texts of a message that begins with `FB`, and is looked into by one that
/// begins with `FC`; one that begins with `FA` leaves it alone. After an error in one of the first
/// two the table must be reset, and every further message errs the same way until it is.
pub fn decode_message_with(
    bytes: &Bytes,
    limits: &Limits,
    table: &mut CodeTable,
) -> Result<Message, DecodeError> {
    let whole = |reader: &mut Reader<'_>| reader.message(|reader| reader.finish());
    read(bytes, limits, table, whole)
}

/// Reads the message (SC00069G section 2) at the beginning of the input, with the code table of
/// its link, and tells how many octets it has; see [`decode_message_with`].
pub fn decode_message_prefix_with(
    bytes: &Bytes,
    limits: &Limits,
    table: &mut CodeTable,
) -> Result<(Message, usize), DecodeError> {
    let prefix = |reader: &mut Reader<'_>| {
        let message = reader.message(|_| Ok(()))?;
        Ok((message, reader.position()))
    };
    read(bytes, limits, table, prefix)
}

fn read<T>(
    bytes: &Bytes,
    limits: &Limits,
    table: &mut CodeTable,
    read: impl FnOnce(&mut Reader<'_>) -> Result<T, DecodeError>,
) -> Result<T, DecodeError> {
    if let Some(error) = table.broken() {
        return Err(error.clone());
    }
    let mut reader = Reader::new(bytes, limits);
    let learns = match bytes.first() {
        Some(&LEARNS) => true,
        Some(&LOOKS_UP) => false,
        _ => return read(&mut reader),
    };
    reader.table = Some(Coding {
        table: &mut *table,
        learns,
    });
    let done = read(&mut reader);
    done.map_err(|error| table.break_with(reset_after(error)))
}

/// The other side's table has the changes of the whole message, ours those of its beginning.
fn reset_after(error: DecodeError) -> DecodeError {
    let what = if error.what == NO_ENTRY {
        "the code table must be reset: nothing has this number in it"
    } else {
        "the code table must be reset: a message that uses it cannot be read from here on"
    };
    DecodeError { what, ..error }
}

/// Appends a message (SC00069G section 2) with the code table of its link. On an error `out` and
/// the table are as before.
///
/// The message begins with `FB` if texts of it were added to the table, else with `FC`. Texts are
/// added unless that could make all of them together longer than a table may hold.
pub fn encode_message_with(
    message: &Message,
    table: &mut CodeTable,
    out: &mut Output,
) -> Result<(), EncodeError> {
    if table.broken().is_some() {
        return Err(EncodeError {
            parameter: "code table",
            what: "it must be reset",
        });
    }
    // Whatever cannot be written is found out without the table.
    let options = &WriteOptions::STRICT;
    let mut plain = BytesMut::with_capacity(expected_len(message));
    write_parameters(message, options, None, &mut plain)?;
    let learns = table.has_room_for(plain.len());
    if let Some(content) = &message.content {
        write_length(content.len(), &mut plain).map_err(|why| why.within("content"))?;
    }
    out.reserve(expected_len(message));
    out.all_or_nothing(|out| {
        let added = table.added();
        let start = out.buffer().len();
        out.put_slice(&[LOOKS_UP, 0x10]);
        let coding = Coding {
            table: &mut *table,
            learns,
        };
        write_parameters(message, options, Some(coding), out.buffer())?;
        if table.added() > added
            && let Some(first) = out.buffer().get_mut(start)
        {
            *first = LEARNS;
        }
        write_content(message, out)
    })
}
