use std::io::Write;
use std::path::{Path, PathBuf};

use fipa_protocol::{Code, Diagnostic, LoadError, Position, Severity};
use serde_json::json;

use crate::{Failure, streams};

/// The options of `fipa protocol check`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Take warnings for errors
    #[arg(long)]
    strict: bool,
    /// Print one JSON object for each finding
    #[arg(long)]
    json: bool,
    /// SCXML files; - is standard input
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

/// What became of all files.
#[derive(Default)]
struct Findings {
    errors: usize,
    warnings: usize,
    /// The first file that is not XML, and why.
    not_xml: Option<String>,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let mut findings = Findings::default();
    streams::write_output(|output| {
        for file in &args.files {
            check(file, args, &mut findings, output)?;
        }
        Ok(())
    })?;
    match findings {
        Findings {
            not_xml: Some(error),
            ..
        } => Err(Failure::malformed(error)),
        Findings { errors: 0, .. } => Ok(()),
        Findings {
            errors, warnings, ..
        } => Err(Failure::no(format_args!(
            "errors: {errors}, warnings: {warnings}"
        ))),
    }
}

fn check(
    file: &Path,
    args: &Args,
    findings: &mut Findings,
    output: &mut dyn Write,
) -> Result<(), Failure> {
    let loaded = match super::read(file)? {
        Ok(loaded) => loaded,
        Err(error) => {
            let LoadError { position, what } = &error;
            let shown = file.display();
            findings.not_xml.get_or_insert(format!("{shown}:{error}"));
            return show(
                file,
                args,
                Severity::Error,
                (*position, Code::Syntax, what),
                output,
            );
        }
    };
    for diagnostic in &loaded.diagnostics {
        let Diagnostic {
            position,
            code,
            message,
            advice,
            ..
        } = diagnostic;
        let severity = match args.strict {
            true => Severity::Error,
            false => diagnostic.severity,
        };
        match severity {
            Severity::Error => findings.errors += 1,
            Severity::Warning => findings.warnings += 1,
        }
        let message = format!("{message}; {advice}");
        show(file, args, severity, (*position, *code, &message), output)?;
    }
    if let (Some(protocol), [], false) = (&loaded.protocol, &loaded.diagnostics[..], args.json) {
        writeln!(
            output,
            "{}: {} has no errors",
            file.display(),
            protocol.name()
        )?;
    }
    Ok(())
}

fn show(
    file: &Path,
    args: &Args,
    severity: Severity,
    (position, code, message): (Position, Code, &String),
    output: &mut dyn Write,
) -> Result<(), Failure> {
    let (file, severity, code) = (file.display(), severity.as_str(), code.as_str());
    if args.json {
        let line = json!({
            "file": file.to_string(),
            "line": position.line,
            "column": position.column,
            "severity": severity,
            "code": code,
            "message": message,
        });
        writeln!(output, "{line}")?;
    } else {
        writeln!(output, "{file}:{position}: {severity} [{code}]: {message}")?;
    }
    Ok(())
}
