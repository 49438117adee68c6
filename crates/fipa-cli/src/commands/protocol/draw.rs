use std::path::PathBuf;

use clap::ValueEnum;
use fipa_protocol::draw::{dot, mermaid, svg};

use crate::{Failure, streams};

/// The options of `fipa protocol draw`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// An SCXML file; - is standard input
    file: PathBuf,
    /// What to write
    #[arg(long, value_name = "FORMAT", default_value = "svg")]
    format: Format,
}

/// A form of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A picture for browsers
    Svg,
    /// Graphviz
    Dot,
    /// A diagram for Markdown
    Mermaid,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let protocol = super::protocol(&args.file)?;
    let drawn = match args.format {
        Format::Svg => svg(&protocol),
        Format::Dot => dot(&protocol),
        Format::Mermaid => mermaid(&protocol),
    };
    streams::write_output(|output| Ok(output.write_all(drawn.as_bytes())?))
}
