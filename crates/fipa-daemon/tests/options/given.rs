use std::ffi::OsString;
use std::path::PathBuf;

use fipa_daemon::options::{Invocation, Options, OptionsError, parse};
use tempfile::TempDir;

/// A command line with an environment and a configuration file.
#[derive(Default)]
pub(crate) struct Given<'a> {
    pub(crate) line: &'a [&'a str],
    pub(crate) env: &'a [(&'a str, &'a str)],
    pub(crate) file: Option<&'a str>,
}

impl Given<'_> {
    pub(crate) fn parse(&self) -> Result<Invocation, OptionsError> {
        let dir = TempDir::new().unwrap();
        let mut args: Vec<OsString> = vec!["fipad".into()];
        if let Some(text) = self.file {
            args.extend(["--config".into(), write(&dir, text).into()]);
        }
        args.extend(self.line.iter().map(OsString::from));
        let find = |name: &str| self.env.iter().find(|(variable, _)| *variable == name);
        parse(args.into_iter(), |name| {
            find(name).map(|(_, value)| value.to_string())
        })
    }

    pub(crate) fn options(&self) -> Options {
        match self.parse() {
            Ok(Invocation::Run(options)) => *options,
            other => panic!("{other:?}"),
        }
    }

    /// The exit code, and the message without the folder of the file.
    pub(crate) fn error(&self) -> (u8, String) {
        let error = self.parse().unwrap_err();
        let message = error.to_string();
        assert_eq!(message.lines().count(), 1, "{message}");
        let from = message.find("fipad.toml:").unwrap_or(0);
        (error.exit_code(), message[from..].to_owned())
    }
}

pub(crate) fn write(dir: &TempDir, text: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.path().join("fipad.toml");
    std::fs::write(&path, text).unwrap();
    path
}

pub(crate) fn line<'a>(line: &'a [&'a str]) -> Given<'a> {
    Given {
        line,
        ..Given::default()
    }
}

pub(crate) fn file(text: &str) -> Given<'_> {
    Given {
        file: Some(text),
        ..Given::default()
    }
}

pub(crate) fn env<'a>(env: &'a [(&'a str, &'a str)]) -> Given<'a> {
    Given {
        env,
        ..Given::default()
    }
}
