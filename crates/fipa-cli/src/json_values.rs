//! JSON values one after another, with the places where they stand.

use serde_json::de::SliceRead;
use serde_json::{Deserializer, StreamDeserializer, Value};

use crate::Failure;

/// The JSON values of an input, one a line or just one after the other.
pub(crate) struct JsonValues<'a> {
    input: &'a [u8],
    values: StreamDeserializer<'a, SliceRead<'a>, Value>,
}

impl<'a> JsonValues<'a> {
    pub(crate) fn new(input: &'a [u8]) -> JsonValues<'a> {
        JsonValues {
            input,
            values: Deserializer::from_slice(input).into_iter(),
        }
    }
}

impl Iterator for JsonValues<'_> {
    /// A value and where it begins, as `line:column`, or exit code 2 for what is not JSON.
    type Item = Result<(String, Value), Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        let start = self.values.byte_offset();
        let value = self.values.next()?;
        Some(match value {
            Ok(value) => Ok((position(self.input, start), value)),
            Err(error) => Err(syntax(&error)),
        })
    }
}

fn syntax(error: &serde_json::Error) -> Failure {
    let (line, column) = (error.line(), error.column());
    let said = error.to_string();
    let what = said
        .strip_suffix(&format!(" at line {line} column {column}"))
        .unwrap_or(&said);
    Failure::malformed(format_args!("{line}:{column}: {what}"))
}

/// Where the value behind `start` begins, as `line:column`, both from 1 on; columns are octets, as
/// they are in errors of syntax.
fn position(input: &[u8], start: usize) -> String {
    let rest = &input[start..];
    let blanks = rest.len() - rest.trim_ascii_start().len();
    let before = &input[..start + blanks];
    let line_start = before
        .iter()
        .rposition(|b| *b == b'\n')
        .map_or(0, |at| at + 1);
    let line = before.iter().filter(|b| **b == b'\n').count() + 1;
    format!("{line}:{}", before.len() - line_start + 1)
}
