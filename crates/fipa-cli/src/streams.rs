//! Where the commands read and write.

use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

use bytes::Bytes;

use crate::Failure;

/// All octets of a file, or of standard input for `-`.
pub(crate) fn read_input(path: &Path) -> Result<Bytes, Failure> {
    let read = if path == Path::new("-") {
        let mut octets = Vec::new();
        io::stdin().read_to_end(&mut octets).map(|_| octets)
    } else {
        std::fs::read(path)
    };
    read.map(Bytes::from)
        .map_err(|error| Failure::environment(format_args!("{}: {error}", path.display())))
}

/// Lets `write` write to standard output. What it wrote before it failed is written.
pub(crate) fn write_output(
    write: impl FnOnce(&mut dyn Write) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut output = BufWriter::new(io::stdout().lock());
    let result = write(&mut output);
    let flushed = output.flush().map_err(Failure::from);
    result.and(flushed)
}
