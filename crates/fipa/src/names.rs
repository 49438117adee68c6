//! The name of a platform that was given none.

use std::fs::File;
use std::path::PathBuf;

use fipa_acl::Text;
use fipa_directory::InstanceId;

/// Keeps other platforms of this machine from taking the same default name, as long as it lives.
#[derive(Debug)]
pub(crate) struct NameLock {
    _file: File,
}

impl NameLock {
    /// Takes the name on this machine; `None` if somebody has it.
    pub(crate) fn take(name: &str) -> Option<NameLock> {
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path(name))
            .ok()?;
        file.try_lock().ok()?;
        Some(NameLock { _file: file })
    }
}

fn path(name: &str) -> PathBuf {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    let name: String = name.chars().map(plain).collect();
    std::env::temp_dir().join(format!("fipa-name-{name}.lock"))
}

/// `mts@HOST`, and the name for where that is taken.
pub(crate) fn default_names(instance: InstanceId) -> (String, String) {
    let host = gethostname::gethostname();
    let host = host.to_string_lossy();
    let host = match Text::from(format!("x{host}")).is_word() {
        true => &*host,
        false => "localhost",
    };
    let hex = &instance.to_string()[..4];
    (format!("mts@{host}"), format!("mts-{hex}@{host}"))
}
