//! The contents of recorded messages of JADE, and of those that were sent to it.

use std::path::PathBuf;

use bytes::Bytes;
use fipa_acl::Message;
use fipa_sl::{Content, Limits, Profile};

fn recordings(ending: &str) -> Vec<(String, Bytes)> {
    let folder = PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/vectors/jade"
    ));
    let files = std::fs::read_dir(folder).unwrap().map(Result::unwrap);
    files
        .filter_map(|file| {
            let name = file.file_name().into_string().unwrap();
            let octets = std::fs::read(file.path()).unwrap();
            name.ends_with(ending).then(|| (name, octets.into()))
        })
        .collect()
}

/// The message in a recording: the payload itself, or behind a blank line of a request over HTTP.
fn message(octets: &Bytes) -> Option<Message> {
    let limits = fipa_codec::Limits::default();
    let starts = octets.windows(5).enumerate();
    let starts = starts.filter(|(_, window)| window == b"\r\n\r\n(");
    let mut starts = std::iter::once(0).chain(starts.map(|(at, _)| at + 4));
    starts.find_map(|at| {
        let (message, _) =
            fipa_codec::string::decode_message_prefix(&octets.slice(at..), &limits).ok()?;
        Some(message)
    })
}

/// The contents that are said to be SL.
fn contents() -> Vec<(String, Bytes)> {
    let files = recordings(".acl").into_iter().chain(recordings(".http"));
    files
        .filter_map(|(name, octets)| {
            let message = message(&octets)?;
            let language = message.language?.to_string();
            Profile::from_language(&language)?;
            Some((name, message.content?))
        })
        .collect()
}

#[test]
fn every_recorded_content_is_read_and_its_print_is_stable() {
    let contents = contents();
    let mut read = 0;
    for (name, octets) in &contents {
        match Content::parse(octets, &Limits::default()) {
            Ok(content) => {
                let printed = content.to_bytes();
                let again = Content::parse(&printed, &Limits::default()).unwrap();
                assert_eq!(again, content, "{name}");
                assert_eq!(again.to_bytes(), printed, "{name}");
                read += 1;
            }
            // Wrong on purpose, or no content in SL whatever its language says.
            Err(error) => assert!(
                name.starts_with("in_df-bad-content.req")
                    || name.starts_with("in2_df-subscribe-bad.reply")
                    || !octets.starts_with(b"("),
                "{name}: {error}"
            ),
        }
    }
    assert!(read > 80, "only {read} of {}", contents.len());
}

#[test]
fn recorded_contents_are_of_the_profile_that_their_language_names() {
    for (name, octets) in contents() {
        let Ok(content) = Content::parse(&octets, &Limits::default()) else {
            continue;
        };
        if name.contains("df-subscribe-existing") || name.contains("df-query-ref") {
            assert_eq!(content.profile(), Profile::Sl2, "{name}");
        } else if name.contains("df-search") || name.contains("ams-") {
            assert_eq!(content.profile(), Profile::Sl0, "{name}");
        }
    }
}

#[test]
fn what_jade_prints_without_blanks_to_spare_is_printed_as_it_came() {
    for (name, octets) in contents() {
        let text = String::from_utf8_lossy(&octets);
        let is_tight = !text.contains("( ") && !text.contains("  ") && !text.contains(" )");
        let Ok(content) = Content::parse(&octets, &Limits::default()) else {
            continue;
        };
        if is_tight && name.contains(".reply") && !text.contains("\"127.0.0.1\"") {
            assert_eq!(content.to_string(), text.trim(), "{name}");
        }
    }
}
