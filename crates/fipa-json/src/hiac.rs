use hiac::edcp::Event;
use hiac::{
    Address, Addressing, Check, Fragment, Level, Mask, Numbered, Packet, PacketType, ReadError,
};
use serde_json::{Map, Value, json};

use crate::JsonError;
use crate::reader::Fields;
use crate::values::{hexadecimal, octets_of_hexadecimal, text, truth, whole_number};

const KEYS: [&str; 10] = [
    "type",
    "priority",
    "confirm",
    "check",
    "full-addressing",
    "psn",
    "fragment",
    "target",
    "source",
    "data",
];

/// The type of an empty packet.
const ALIVE: &str = "ALIVE";

/// What is sent on a HIAC link, with memory of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HiacForm {
    /// An empty packet.
    Alive,
    /// A packet without its data, and its data.
    Packet(Packet<'static>, Vec<u8>),
}

/// The JSON form of what came on a HIAC link, and whether it could be read. `mask` is that of the
/// link.
pub fn hiac_to_json(event: Event<'_>, mask: Option<Mask>) -> (Value, bool) {
    let unreadable = |word: &str, octets: &[u8]| {
        let json = json!({"error": word, "octets": hexadecimal(octets)});
        (json, false)
    };
    match event {
        Event::Alive => (json!({"type": ALIVE}), true),
        Event::Unfinished(octets) => unreadable("unfinished", octets),
        Event::TooLong(octets) => unreadable("too-long", octets),
        Event::Packet(octets) => match Packet::decode(octets, mask) {
            Ok(packet) => (packet_to_json(&packet), true),
            Err(error) => unreadable(ReadError::word(error), octets),
        },
    }
}

fn packet_to_json(packet: &Packet<'_>) -> Value {
    let mut map = Map::new();
    let mut put = |key: &str, value: Value| map.insert(key.to_owned(), value);
    let kind = packet.kind;
    put(
        "type",
        kind.name().map_or(kind.number().into(), Value::from),
    );
    put("priority", packet.priority.into());
    put("confirm", packet.confirm.into());
    put("check", check_word(packet.check).into());
    let (full, target, source) = match packet.addressing {
        Addressing::Full { target, source } => (true, target.to_string(), source.to_string()),
        Addressing::Level { target, source } => {
            (false, format!("{target:X}"), format!("{source:X}"))
        }
    };
    put("full-addressing", full.into());
    if let Some(Numbered { psn, fragment }) = packet.numbered {
        put("psn", psn.into());
        put(
            "fragment",
            json!({"index": fragment.index, "more": fragment.more}),
        );
    }
    put("target", target.into());
    put("source", source.into());
    put("data", hexadecimal(packet.data).into());
    Value::Object(map)
}

/// Reads the JSON form of what is to be sent on a HIAC link.
///
/// # Errors
/// The place of the first value that is not of the form. Whether the packet can be written is told
/// by [`Packet::encode`].
pub fn hiac_from_json(value: &Value) -> Result<HiacForm, JsonError> {
    let fields = Fields::new(value, &KEYS)?;
    let Some(kind) = fields.required("type", kind)? else {
        // An empty packet says nothing else.
        Fields::new(value, &["type"])?;
        return Ok(HiacForm::Alive);
    };
    let full = fields.optional("full-addressing", truth)?.unwrap_or(true);
    let addressing = if full {
        Addressing::Full {
            target: fields.required("target", address)?,
            source: fields.required("source", address)?,
        }
    } else {
        Addressing::Level {
            target: fields.required("target", level)?,
            source: fields.required("source", level)?,
        }
    };
    let psn = fields.optional("psn", octet)?;
    let fragment = fields.optional("fragment", fragment)?;
    let numbered = match (psn, fragment) {
        (None, None) => None,
        (Some(psn), Some(fragment)) => Some(Numbered { psn, fragment }),
        _ => return Err(JsonError::new("psn and fragment go together")),
    };
    let packet = Packet {
        kind,
        priority: fields.optional("priority", octet)?.unwrap_or(4),
        confirm: fields.optional("confirm", truth)?.unwrap_or(false),
        check: fields.optional("check", check)?.unwrap_or(Check::Sum),
        numbered,
        addressing,
        data: &[],
    };
    let data = fields.optional("data", octets_of_hexadecimal)?;
    Ok(HiacForm::Packet(packet, data.unwrap_or_default()))
}

/// The type of a packet; `None` for an empty one.
fn kind(value: &Value) -> Result<Option<PacketType>, JsonError> {
    let error = || JsonError::expected("the name of a type or a number from 0 to 15");
    let kind = match value.as_str() {
        Some(ALIVE) => return Ok(None),
        Some(name) => PacketType::from_name(name),
        None => value
            .as_u64()
            .and_then(|number| PacketType::new(u8::try_from(number).ok()?)),
    };
    kind.map(Some).ok_or_else(error)
}

fn check(value: &Value) -> Result<Check, JsonError> {
    [Check::Sum, Check::Crc32]
        .into_iter()
        .find(|check| value.as_str() == Some(check_word(*check)))
        .ok_or_else(|| JsonError::expected("sum or crc32"))
}

fn check_word(check: Check) -> &'static str {
    match check {
        Check::Sum => "sum",
        Check::Crc32 => "crc32",
    }
}

fn fragment(value: &Value) -> Result<Fragment, JsonError> {
    let fields = Fields::new(value, &["index", "more"])?;
    Ok(Fragment {
        index: fields.required("index", octet)?,
        more: fields.required("more", truth)?,
    })
}

fn octet(value: &Value) -> Result<u8, JsonError> {
    u8::try_from(whole_number(value)?).map_err(|_| JsonError::expected("a number up to 255"))
}

fn address(value: &Value) -> Result<Address, JsonError> {
    let address = text(value)?.parse();
    address.map_err(|error: hiac::AddressError| JsonError::new(error.to_string()))
}

fn level(value: &Value) -> Result<Level, JsonError> {
    let digits = text(value)?;
    let hexadecimal = !digits.is_empty() && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    Level::from_str_radix(&digits, 16)
        .ok()
        .filter(|_| hexadecimal)
        .ok_or_else(|| JsonError::expected("a level address in hexadecimal, such as \"2F8\""))
}
