//! The output folder: it appears whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use super::{RUN_JSON, RunError};
use crate::OutputError;

/// A folder in the making, beside its final place. Dropped before [`RunFolder::finish`], it vanishes.
pub(super) struct RunFolder {
    target: PathBuf,
    partial: PathBuf,
    finished: bool,
}

impl RunFolder {
    pub fn create(target: &Path, force: bool) -> Result<Self, RunError> {
        if target.exists() {
            if !force {
                return Err(OutputError::Exists { path: target.to_owned() }.into());
            }
            check_is_run(target)?;
        }
        let partial = beside(target, ".partial");
        if partial.exists() {
            if !force {
                return Err(RunError::Unfinished(partial));
            }
            fs::remove_dir_all(&partial).map_err(RunError::io(&partial))?;
        }
        fs::create_dir_all(&partial).map_err(RunError::io(&partial))?;
        Ok(Self { target: target.to_owned(), partial, finished: false })
    }

    /// Where a file of the run is written.
    pub fn file(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Gives the folder its name. An old run is moved away first and removed last.
    pub fn finish(mut self) -> Result<(), RunError> {
        let old = beside(&self.target, ".old");
        let replaces = self.target.exists();
        if replaces {
            fs::rename(&self.target, &old).map_err(RunError::io(&self.target))?;
        }
        fs::rename(&self.partial, &self.target).map_err(RunError::io(&self.target))?;
        self.finished = true;
        if replaces {
            fs::remove_dir_all(&old).map_err(RunError::io(&old))?;
        }
        Ok(())
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        if !self.finished {
            // What made the replay fail is the error to report, not this.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}

fn beside(target: &Path, suffix: &str) -> PathBuf {
    let mut name = target.file_name().unwrap_or_default().to_owned();
    name.push(suffix);
    target.with_file_name(name)
}

/// Replacing removes the whole folder: only an empty one or one that a replay made.
fn check_is_run(target: &Path) -> Result<(), RunError> {
    let mut entries = fs::read_dir(target).map_err(RunError::io(target))?;
    if target.join(RUN_JSON).is_file() || entries.next().is_none() {
        return Ok(());
    }
    Err(RunError::NotARun(target.to_owned()))
}
