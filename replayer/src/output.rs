//! Files appear whole or not at all, and never replace another by accident.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Why a result could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Something stands there already.
    #[error("{} exists already: choose another name or pass --force to replace it", .path.display())]
    Exists {
        /// The file in the way.
        path: PathBuf,
    },
    /// A folder that nobody wants replaced by mistake.
    #[error("{} has no {marker}, so this command did not write it: it is not replaced, not even with --force", .path.display())]
    NotOurs {
        /// The folder in the way.
        path: PathBuf,
        /// The file that would tell.
        marker: &'static str,
    },
    /// An earlier command did not finish.
    #[error("{} is what an interrupted command left: remove it or pass --force", .path.display())]
    Unfinished {
        /// The folder in the way.
        path: PathBuf,
    },
    /// The file system said no.
    #[error("cannot write {}: {source}", .path.display())]
    Io {
        /// The file that was being written.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Writes `bytes` to a temporary name beside `path`, then renames it: a reader never sees half a file.
///
/// # Errors
/// [`OutputError::Exists`] unless `force`, [`OutputError::Io`] when the system refuses.
pub fn write_file(path: &Path, bytes: &[u8], force: bool) -> Result<(), OutputError> {
    if !force && path.exists() {
        return Err(OutputError::Exists { path: path.to_owned() });
    }
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    let partial = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&partial, path)
    };
    write().map_err(|source| OutputError::Io { path: path.to_owned(), source })
}

/// A folder in the making, beside its final place: a reader never sees half of it. Dropped before
/// [`OutputFolder::finish`], it vanishes.
#[derive(Debug)]
pub struct OutputFolder {
    target: PathBuf,
    partial: PathBuf,
    finished: bool,
}

impl OutputFolder {
    /// Starts a folder that will stand at `target`. With `force` it replaces an empty folder, or an older one that holds the
    /// file `marker`.
    ///
    /// # Errors
    /// Something stands there, or the system refuses.
    pub fn create(target: &Path, marker: &'static str, force: bool) -> Result<Self, OutputError> {
        if target.exists() {
            if !force {
                return Err(OutputError::Exists { path: target.to_owned() });
            }
            let entries = || fs::read_dir(target).map_err(|source| OutputError::Io { path: target.to_owned(), source });
            if !target.join(marker).is_file() && entries()?.next().is_some() {
                return Err(OutputError::NotOurs { path: target.to_owned(), marker });
            }
        }
        let partial = beside(target, ".partial");
        if partial.exists() {
            if !force {
                return Err(OutputError::Unfinished { path: partial });
            }
            fs::remove_dir_all(&partial).map_err(|source| OutputError::Io { path: partial.clone(), source })?;
        }
        fs::create_dir_all(&partial).map_err(|source| OutputError::Io { path: partial.clone(), source })?;
        Ok(Self { target: target.to_owned(), partial, finished: false })
    }

    /// Where a file of the folder stands until it is finished.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Writes a file, and the folders that its name tells.
    ///
    /// # Errors
    /// The system refuses.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), OutputError> {
        let path = self.path(name);
        let write = || -> std::io::Result<()> {
            if let Some(parent) = path.parent() {
                fs::create_dir_all(parent)?;
            }
            fs::write(&path, bytes)
        };
        write().map_err(|source| OutputError::Io { path: path.clone(), source })
    }

    /// Brings everything to the disk and gives the folder its name. An old one is moved away first and removed last.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(mut self) -> Result<(), OutputError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| OutputError::Io { path, source }
        };
        let handle = File::open(&self.partial).map_err(failed(&self.partial))?;
        rustix::fs::syncfs(&handle).map_err(|error| failed(&self.partial)(error.into()))?;
        let old = beside(&self.target, ".old");
        let replaces = self.target.exists();
        if replaces {
            fs::rename(&self.target, &old).map_err(failed(&self.target))?;
        }
        fs::rename(&self.partial, &self.target).map_err(failed(&self.target))?;
        self.finished = true;
        if replaces {
            fs::remove_dir_all(&old).map_err(failed(&old))?;
        }
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.finished {
            // What made the command fail is the error to report, not this.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}

fn beside(path: &Path, suffix: &str) -> PathBuf {
    // Without the separator that a shell's completion leaves behind a folder's name.
    let mut name = path.components().as_path().as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_appears_whole_and_replaces_only_its_kind() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("out/");
        let begin = |force| OutputFolder::create(&target, "mark.json", force);
        let folder = begin(false).unwrap();
        folder.write("a/b.txt", b"1").unwrap();
        assert!(!target.exists());
        drop(folder);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "given up without a trace");
        fs::create_dir(&target).unwrap();
        assert!(matches!(begin(false), Err(OutputError::Exists { .. })));
        let folder = begin(true).unwrap();
        folder.write("a/b.txt", b"1").unwrap();
        folder.finish().unwrap();
        assert!(matches!(begin(false), Err(OutputError::Exists { .. })));
        assert!(matches!(begin(true), Err(OutputError::NotOurs { .. })), "somebody's own folder");
        fs::write(target.join("mark.json"), b"{}").unwrap();
        let folder = begin(true).unwrap();
        folder.write("c.txt", b"2").unwrap();
        folder.finish().unwrap();
        assert!(target.join("c.txt").exists() && !target.join("a").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_existing_file_is_kept_without_force() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_file(&path, b"one", false).unwrap();
        assert!(matches!(write_file(&path, b"two", false), Err(OutputError::Exists { .. })));
        assert_eq!(fs::read(&path).unwrap(), b"one");
        write_file(&path, b"two", true).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }
}
