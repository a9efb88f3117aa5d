//! How much room there is.

use rustix::fs::statvfs;
use rustix::process::{Resource, getrlimit};
use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// Bytes that a file in this folder may still grow by: free space for users, and the process's own limit of a file's size.
///
/// # Errors
/// The file system does not tell.
pub fn room_bytes(folder: &Path, file_bytes: u64) -> io::Result<u64> {
    let told = statvfs(folder)?;
    let free = told.f_bavail.saturating_mul(told.f_frsize);
    let limit = getrlimit(Resource::Fsize).current.map_or(u64::MAX, |limit| limit.saturating_sub(file_bytes));
    Ok(free.min(limit))
}

/// The folder that a file stands in.
#[must_use]
pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether `path` names this open file: `false` once it, or a folder above it, was moved or removed.
#[must_use]
pub fn is_named(file: &File, path: &Path) -> bool {
    let identity = |told: fs::Metadata| (told.dev(), told.ino());
    match (file.metadata(), fs::metadata(path)) {
        (Ok(open), Ok(named)) => identity(open) == identity(named),
        // What the system does not tell is no reason to end a recording.
        (_, Err(error)) => error.kind() != io::ErrorKind::NotFound,
        (Err(_), Ok(_)) => true,
    }
}

/// Where an open file stands now; `None` once it has no name left, and so is lost when it is closed.
#[must_use]
pub fn place_of(file: &File) -> Option<PathBuf> {
    let link = fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd())).ok()?;
    (file.metadata().ok()?.nlink() > 0).then_some(link)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_file_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        let file = File::create(&one).unwrap();
        assert!(is_named(&file, &one));
        assert_eq!(place_of(&file).unwrap(), one.canonicalize().unwrap());
        fs::rename(&one, &other).unwrap();
        assert!(!is_named(&file, &one) && is_named(&file, &other));
        assert_eq!(place_of(&file).unwrap(), other.canonicalize().unwrap());
        File::create(&one).unwrap();
        assert!(!is_named(&file, &one), "another file of that name");
        fs::remove_file(&other).unwrap();
        assert!(!is_named(&file, &other) && place_of(&file).is_none());
    }
}
