//! How much room there is.

use rustix::fs::statvfs;
use rustix::process::{Resource, getrlimit};
use std::io;
use std::path::Path;

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
