use std::env;
use std::ffi::OsString;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Where a daemon offers its control socket and programs look for it, unless they are told.
///
/// `$XDG_RUNTIME_DIR/fipad.sock`, else `fipad-<uid>.sock` in the temporary directory.
pub fn default_control_path() -> PathBuf {
    match runtime_dir(env::var_os("XDG_RUNTIME_DIR")) {
        Some(dir) => dir.join("fipad.sock"),
        None => env::temp_dir().join(temporary_name(user())),
    }
}

/// A relative path does not count: it would name another socket in every working directory.
fn runtime_dir(variable: Option<OsString>) -> Option<PathBuf> {
    variable.map(PathBuf::from).filter(|dir| dir.is_absolute())
}

/// The temporary directory is shared, hence the number of the user.
fn temporary_name(user: Option<u32>) -> String {
    match user {
        Some(uid) => format!("fipad-{uid}.sock"),
        None => "fipad.sock".to_owned(),
    }
}

/// The user this process runs as. The standard library does not tell, but this process owns its
/// own entry in `/proc`; where there is none, the home directory has to do.
fn user() -> Option<u32> {
    let owner = |path: &Path| fs::metadata(path).ok().map(|metadata| metadata.uid());
    owner(Path::new("/proc/self")).or_else(|| owner(&env::home_dir()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_runtime_directory_must_be_absolute() {
        let dir = |variable: &str| runtime_dir(Some(variable.into()));
        assert_eq!(dir("/run/user/7"), Some(PathBuf::from("/run/user/7")));
        assert_eq!(dir("run"), None);
        assert_eq!(dir(""), None);
        assert_eq!(runtime_dir(None), None);
    }

    #[test]
    fn in_the_temporary_directory_the_name_tells_the_user() {
        assert_eq!(temporary_name(Some(1000)), "fipad-1000.sock");
        assert_eq!(temporary_name(None), "fipad.sock");
    }

    #[test]
    fn the_user_is_the_one_whose_files_are_created() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(user(), Some(file.as_file().metadata().unwrap().uid()));
    }

    #[test]
    fn the_path_is_absolute_and_names_a_socket() {
        let path = default_control_path();
        assert!(path.is_absolute(), "{path:?}");
        assert!(path.extension().is_some_and(|ending| ending == "sock"));
    }
}
