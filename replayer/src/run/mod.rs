//! Replaying a log: the same log, configuration and program version give the same bits, for any number of threads.
//!
//! [`replay`] writes a folder, [`verify`] recomputes it, [`diff`] finds where two of them part, [`bench()`] measures.
//!
//! | file of a run | content |
//! |---|---|
//! | `trajectory.txt` | TUM text: the camera's path as the map says at the end |
//! | `trajectory_online.txt` | the same as it was known at each frame |
//! | `records.bin` | digest and value of every field of every stage, see [`records`] |
//! | `run.json` | [`RunSummary`] |
//! | `config.toml` | the whole configuration |
//! | `replay.rrd` | with `rrd`: the inspection file |
//!
//! ```no_run
//! use replayer::run::{ReplayOptions, replay, verify};
//! use std::path::Path;
//!
//! let run = Path::new("run");
//! println!("{}", replay(Path::new("log.mcap"), run, &ReplayOptions::default(), &mut |_, _| {})?);
//! assert!(verify(run, None, 4, &mut |_, _| {})?.passed());
//! # Ok::<(), replayer::run::RunError>(())
//! ```
//!
//! Lost frames and frames of other maps than the largest stand in `run.json`, never in a trajectory.

mod bench;
mod diff;
mod drive;
mod error;
mod folder;
mod inspection;
pub mod records;
mod rig;
mod source;
mod summary;
mod timing;
mod verify;
mod workers;

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::ops::Range;
use std::path::Path;

use slam::Config;

pub use bench::{BenchReport, Size, bench, bench_looped, trajectory};
pub use diff::{DiffReport, Difference, diff};
pub use error::RunError;
pub use inspection::INSPECTION_RRD;
pub use summary::{MapFrames, RunEvent, RunResult, RunSummary};
pub use timing::{StageTime, Timing};
pub use verify::{VerifyReport, verify};
pub use workers::Unrest;

use crate::log::Log;
use crate::write_file;
use drive::drive;
use folder::RunFolder;
use inspection::Inspection;
use records::{Block, RecordWriter};
use source::Source;

/// Name and version of the program, part of the fingerprint.
pub const PROGRAM: &str = concat!("pslam ", env!("CARGO_PKG_VERSION"));
/// The final trajectory's file in a run.
pub const TRAJECTORY_TXT: &str = "trajectory.txt";
/// The online trajectory's file in a run.
pub const TRAJECTORY_ONLINE_TXT: &str = "trajectory_online.txt";
/// The records' file in a run.
pub const RECORDS_BIN: &str = "records.bin";
/// The summary's file in a run.
pub const RUN_JSON: &str = "run.json";
/// The configuration's file in a run.
pub const CONFIG_TOML: &str = "config.toml";

/// Is told how many frames are done, and of how many.
pub type Progress<'a> = &'a mut dyn FnMut(usize, usize);

/// How to replay.
#[derive(Debug, Clone)]
pub struct ReplayOptions {
    /// All constants of the slam.
    pub config: Config,
    /// How the user called the configuration: a preset's name or a file.
    pub config_name: String,
    /// Frames of the log's timeline; all of them by default. An end beyond the log's is clipped, with a warning unless
    /// it is `usize::MAX`.
    pub frames: Option<Range<usize>>,
    /// Threads to use, at least 1; the result does not depend on it.
    pub threads: usize,
    /// Segmentation layer; the log's default by default.
    pub layer: Option<String>,
    /// Replace an existing run.
    pub force: bool,
    /// Write the inspection file too.
    pub rrd: bool,
    /// For tests.
    pub unrest: Option<Unrest>,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        Self {
            config: Config::default(),
            config_name: "full".to_owned(),
            frames: None,
            threads: 1,
            layer: None,
            force: false,
            rrd: false,
            unrest: None,
        }
    }
}

/// Replays a log into a new folder. `progress` is told how many frames are done, and of how many.
///
/// # Errors
/// An unreadable log or frame, an empty range, or a folder that cannot be written. The folder appears only when all is
/// well.
pub fn replay(
    log: &Path,
    out_dir: &Path,
    options: &ReplayOptions,
    progress: Progress<'_>,
) -> Result<RunSummary, RunError> {
    let folder = RunFolder::create(out_dir, options.force)?;
    let source = Source::new(Log::open(log)?, &options.config, options.layer.as_deref(), options.frames.clone())?;
    let mut inspection = Inspection::create(options.rrd, &folder, &source)?;

    let records_path = folder.file(RECORDS_BIN);
    let mut file = BufWriter::new(File::create(&records_path).map_err(RunError::io(&records_path))?);
    let mut writer = RecordWriter::default();
    let mut write = |bytes: &[u8]| file.write_all(bytes).map_err(RunError::io(&records_path));
    let header = source.header();
    write(&RecordWriter::preamble())?;
    write(&writer.block(&Block::Header(header.clone())))?;
    let outcome = drive(&source, options.threads, options.unrest.as_ref(), progress, &mut |stepped| {
        inspection.frame(stepped)?;
        write(&writer.block(&Block::Frame(stepped.entry.clone())))?;
        Ok(true)
    })?;
    let outcome = outcome.expect("the replay is never ended early");
    write(&writer.block(&Block::End(outcome.end())))?;
    file.into_inner()
        .map_err(|error| error.into_error())
        .and_then(|file| file.sync_all())
        .map_err(RunError::io(&records_path))?;
    inspection.finish(&outcome.trajectory, source.log.ground_truth())?;

    let summary = RunSummary {
        fingerprint: writer.fingerprint().to_string(),
        header,
        result: outcome.result,
        log: std::path::absolute(log).map_err(RunError::io(log))?,
        config_name: options.config_name.clone(),
        timing: outcome.timing,
    };
    let text = |name: &str, text: &str| write_file(&folder.file(name), text.as_bytes(), false);
    text(TRAJECTORY_TXT, &outcome.trajectory.to_tum())?;
    text(TRAJECTORY_ONLINE_TXT, &outcome.online.to_tum())?;
    text(CONFIG_TOML, &summary.header.config)?;
    text(RUN_JSON, &serde_json::to_string_pretty(&summary).expect("plain numbers and texts"))?;
    folder.finish()?;
    Ok(summary)
}
