//! `fipa hiac`: what passes on a HIAC link to and from JSON, a device, and those of the daemon.

mod device;
mod devices;

use std::io::{Read, Write};
use std::path::PathBuf;

use fipa_json::{HiacForm, hiac_from_json, hiac_to_json};
use hiac::edcp::{self, Decoder, Event};
use hiac::{Address, Growing, Mask, Packet};

use crate::json_values::JsonValues;
use crate::{Failure, streams};

/// The longest packet, in octets from PV to CHK.
const MAX_PACKET: usize = 65_536;

/// The options of `fipa hiac`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// The commands of `fipa hiac`.
#[derive(Clone, Debug, clap::Subcommand)]
pub enum Action {
    /// Show the packets of an octet stream as JSON, one a line, as they come
    Decode(Translation),
    /// Write packets given as JSON as an octet stream
    Encode(Translation),
    /// Be a device: wait for an employer, answer each question with its own octets
    Device(device::Args),
    /// List the devices behind the daemon
    Devices(devices::Args),
}

/// The options of a translation.
#[derive(Clone, Debug, clap::Args)]
pub struct Translation {
    /// The mask of the link, such as 00:00:00:FF, needed for level addresses
    #[arg(long, value_parser = mask)]
    pub mask: Option<Mask>,
    /// What to translate; - is standard input
    #[arg(default_value = "-")]
    pub file: PathBuf,
}

fn mask(text: &str) -> Result<Mask, String> {
    let bits: Address = text
        .parse()
        .map_err(|_| "a mask is four octets in hexadecimal, such as 00:00:00:FF".to_owned())?;
    Mask::new(bits.0).map_err(|error| error.to_string())
}

/// Does what the options say, with standard output.
///
/// # Errors
/// Exit code 3 for a file that cannot be read, else see [`decode`] and [`encode`]; for what talks
/// to others 3 if it cannot bind or there is no daemon, and 1 if there is no device.
pub fn run(args: &Args) -> Result<(), Failure> {
    match &args.action {
        Action::Decode(Translation { mask, file }) => {
            let input = streams::open_input(file)?;
            streams::write_output(|output| decode(input, *mask, output))
        }
        Action::Encode(Translation { mask, file }) => {
            let input = streams::read_input(file)?;
            streams::write_output(|output| encode(&input, *mask, output))
        }
        Action::Device(args) => device::run(args),
        Action::Devices(args) => devices::run(args),
    }
}

/// Writes one JSON line for each packet of the input, as soon as it is whole.
///
/// # Errors
/// Exit code 1 if a packet could not be read, which stands as an error in its place; exit code 3
/// when the input breaks off.
pub fn decode(input: impl Read, mask: Option<Mask>, output: &mut dyn Write) -> Result<(), Failure> {
    let mut decoder = Decoder::new(Growing::new(MAX_PACKET));
    let mut unreadable = 0_u64;
    let mut show = |event: Event<'_>, output: &mut dyn Write| {
        let (json, readable) = hiac_to_json(event, mask);
        unreadable += u64::from(!readable);
        writeln!(output, "{json}")
    };
    streams::read_as_it_comes(input, |octets| {
        for octet in octets {
            if let Some(event) = decoder.push(*octet) {
                show(event, output)?;
            }
        }
        if octets.is_empty()
            && let Some(event) = decoder.end()
        {
            show(event, output)?;
        }
        Ok(output.flush()?)
    })?;
    match unreadable {
        0 => Ok(()),
        1 => Err(Failure::no("a packet could not be read")),
        count => Err(Failure::no(format_args!(
            "{count} packets could not be read"
        ))),
    }
}

/// Writes the octets of each packet of the input as they stand on a link.
///
/// # Errors
/// Exit code 2 with `line:column` for the first value that is not JSON, not of the form or not
/// writable. What was encoded before it is written.
pub fn encode(input: &[u8], mask: Option<Mask>, output: &mut dyn Write) -> Result<(), Failure> {
    for value in JsonValues::new(input) {
        let (position, value) = value?;
        let octets = hiac_from_json(&value)
            .map_err(|error| error.to_string())
            .and_then(|form| octets(&form, mask))
            .map_err(|error| Failure::malformed(format_args!("{position}: {error}")))?;
        output.write_all(&octets)?;
    }
    Ok(())
}

fn octets(form: &HiacForm, mask: Option<Mask>) -> Result<Vec<u8>, String> {
    let HiacForm::Packet(packet, data) = form else {
        return Ok(edcp::ALIVE.to_vec());
    };
    let packet = Packet { data, ..*packet };
    let encoded = packet.encode(mask).map_err(|error| error.to_string())?;
    match encoded.count() {
        ..=MAX_PACKET => Ok(edcp::escaped(encoded.octets()).collect()),
        count => Err(format!(
            "the packet has {count} octets, more than {MAX_PACKET}"
        )),
    }
}
