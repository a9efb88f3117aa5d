use std::path::{Path, PathBuf};

use slam::{ConfigError, SlamError};
use slam_vision::VisionError;

use super::records::RecordError;
use crate::OutputError;
use crate::eval::EvalError;
use crate::log::{DecodeError, LogError};

/// Why a replay, a verification or a comparison came to no result.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A frame's pictures cannot be decoded.
    #[error("{}: {source}; `pslam check` lists all damage", log.display())]
    Decode {
        /// The log.
        log: PathBuf,
        /// Which frame, and what is wrong with it.
        source: DecodeError,
    },
    /// The slam refuses calibration, settings or a frame.
    #[error(transparent)]
    Slam(#[from] SlamError),
    /// A picture is not what it says.
    #[error(transparent)]
    Vision(#[from] VisionError),
    /// The recorded configuration is not one of this version.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The records cannot be read.
    #[error(transparent)]
    Records(#[from] RecordError),
    /// A result cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The run's trajectory cannot be read.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// The file system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Its answer.
        source: std::io::Error,
    },
    /// The range holds no frame of the log.
    #[error("frames {start}..{end} are none of the log's frames 0..{frames}")]
    Range {
        /// First frame asked for.
        start: usize,
        /// Frame after the last one asked for.
        end: usize,
        /// Frames in the log.
        frames: usize,
    },
    /// There is no `run.json`.
    #[error("{} is no run: name the folder that `pslam replay LOG -o FOLDER` wrote", .0.display())]
    NoRun(PathBuf),
    /// `run.json` is not what a replay writes.
    #[error("{}: {reason}", path.display())]
    Manifest {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The log is not the one that was replayed.
    #[error("{} has BLAKE3 {found}, but the run was made from {wanted}: name the right log", log.display())]
    OtherLog {
        /// The log at hand.
        log: PathBuf,
        /// Its hash.
        found: String,
        /// The hash in the records.
        wanted: String,
    },
    /// The vocabulary that the configuration names.
    #[error(transparent)]
    Vocabulary(#[from] crate::vocabulary::VocabularyFileError),
    /// A saved state that can't be taken up.
    #[error("{}: this state can't be taken up: {reason}; save it again with this program", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A state of another log, configuration or program.
    #[error("{} is the state of another run (there, here):\n{differences}", path.display())]
    OtherState {
        /// The file.
        path: PathBuf,
        /// What differs.
        differences: String,
    },
    /// A state is to be saved where no frame is.
    #[error("there is no state to save before frame {frame}: the replay has the frames {start}..{end}")]
    SaveFrame {
        /// Frame of the log.
        frame: usize,
        /// First frame of the replay.
        start: usize,
        /// Frame after its last one.
        end: usize,
    },
    /// Worker threads cannot be started.
    #[error("{0}")]
    Threads(String),
    /// A worker thread ended without an answer.
    #[error("the thread that prepares frame {0} ended without a result: this is a bug, please report it")]
    Worker(usize),
    /// An inspection file was asked for, but the program cannot write one.
    #[error("this program was built without Rerun files: build it with `--features rerun` or leave --rrd away")]
    NoInspection,
    /// The inspection file cannot be written.
    #[cfg(feature = "rerun")]
    #[error(transparent)]
    Inspect(#[from] crate::inspect::InspectError),
}

impl RunError {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::Io { path: path.to_owned(), source }
    }
}
