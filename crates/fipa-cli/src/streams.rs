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
        .map_err(|error| unreadable(path, &error))
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

/// A file, or standard input for `-`, to be read as it comes.
pub(crate) fn open_input(path: &Path) -> Result<Box<dyn Read>, Failure> {
    if path == Path::new("-") {
        return Ok(Box::new(io::stdin().lock()));
    }
    match std::fs::File::open(path) {
        Ok(file) => Ok(Box::new(file)),
        Err(error) => Err(unreadable(path, &error)),
    }
}

/// Hands on what comes, as it comes, and nothing at the end.
pub(crate) fn read_as_it_comes(
    mut input: impl Read,
    mut take: impl FnMut(&[u8]) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut chunk = [0; 4096];
    loop {
        let count = match input.read(&mut chunk) {
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => {
                let line = format_args!("the input breaks off: {error}");
                return Err(Failure::environment(line));
            }
        };
        take(&chunk[..count])?;
        if count == 0 {
            return Ok(());
        }
    }
}

fn unreadable(path: &Path, error: &io::Error) -> Failure {
    Failure::environment(format_args!("{}: {error}", path.display()))
}
