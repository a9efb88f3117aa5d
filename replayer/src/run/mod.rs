//! Replaying a log: the same log, configuration and program version give the same bits, for any number of threads.
//!
//! [`replay`] writes a folder, [`verify`] recomputes it, [`diff`] finds where two of them part, [`bench()`] measures.
//!
//! | file of a run | content |
//! |---|---|
//! | `trajectory.txt` | TUM text: the camera's path as well as it is known at the end, see `slam::Slam::final_path` |
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
mod estimate;
mod inspection;
mod memory;
pub mod records;
mod retrace;
mod rig;
mod source;
mod state;
mod summary;
mod timing;
mod verify;
mod workers;

use std::ops::Range;
use std::path::{Path, PathBuf};

use slam::Config;

pub use bench::{BenchReport, Size, bench, bench_looped, trajectory};
pub(crate) use diff::config_differences;
pub use diff::{DiffReport, Difference, diff};
pub use error::RunError;
pub use estimate::Estimate;
pub use inspection::INSPECTION_RRD;
pub(crate) use memory::{frames_of, replay_frames};
pub use retrace::{Retrace, Retraced};
pub use summary::{MapFrames, RunEvent, RunResult, RunSummary};
pub use timing::{StageTime, Timing};
pub use verify::{VerifyReport, verify};
pub use workers::Unrest;

use crate::{OutputError, OutputFolder, write_file};
use drive::{Stops, drive};
use inspection::Inspection;
use records::{Block, RecordFile};
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
    /// Save the state before a frame of the log into a file; the replay goes on.
    pub save_state: Option<(usize, PathBuf)>,
    /// Take up a saved state instead of starting at the first frame. The run becomes the same as without; only the inspection
    /// file begins there.
    pub resume: Option<PathBuf>,
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
            save_state: None,
            resume: None,
            unrest: None,
        }
    }
}

/// Replays a log into a new folder. `progress` is told how many frames are done, and of how many.
///
/// # Errors
/// An unreadable log or frame, an empty range, a state that is not of this run, or a folder that cannot be written. The
/// folder appears only when all is well.
pub fn replay(
    log: &Path,
    out_dir: &Path,
    options: &ReplayOptions,
    progress: Progress<'_>,
) -> Result<RunSummary, RunError> {
    let folder = OutputFolder::create(out_dir, RUN_JSON, options.force)?;
    let source = Source::open(log, options)?;
    let save_before = save_before(options, &source.range)?;
    let mut inspection = Inspection::create(options.rrd, &folder, &source)?;
    let header = source.header();
    let mut records = RecordFile::create(folder.path(RECORDS_BIN), &header)?;
    let mut load = |path: &PathBuf| -> Result<_, RunError> {
        let saved = state::load(path, &header, &mut |entry| records.block(&Block::Frame(entry)))?;
        Ok((path.clone(), saved))
    };
    let from = options.resume.as_ref().map(&mut load).transpose()?;
    let resumed_at = from.as_ref().map(|(_, saved)| source.range.start + saved.slam.frames());
    let stops = Stops { from, save_before };
    let outcome = drive(&source, options.threads, options.unrest.as_ref(), stops, progress, &mut |stepped| {
        inspection.frame(stepped)?;
        records.block(&Block::Frame(stepped.entry.clone()))?;
        if let (Some(state), Some((_, path))) = (&stepped.state, &options.save_state) {
            let records = records.flushed()?;
            state::save(path, options.force, records, stepped.slam.frame_count(), state)?;
        }
        Ok(true)
    })?;
    let outcome = outcome.expect("the replay is never ended early");
    records.block(&Block::End(outcome.end()))?;
    let fingerprint = records.finish()?;
    inspection.finish(&outcome.trajectory, source.log.ground_truth())?;

    let summary = RunSummary {
        fingerprint,
        header,
        result: outcome.result,
        log: std::path::absolute(log).map_err(RunError::io(log))?,
        vocabulary: source.vocabulary.map(|file| file.path),
        resumed_at,
        config_name: options.config_name.clone(),
        timing: outcome.timing,
    };
    let text = |name: &str, text: &str| write_file(&folder.path(name), text.as_bytes(), false);
    text(TRAJECTORY_TXT, &outcome.trajectory.to_tum())?;
    text(TRAJECTORY_ONLINE_TXT, &outcome.online.to_tum())?;
    text(CONFIG_TOML, &summary.header.config)?;
    text(RUN_JSON, &serde_json::to_string_pretty(&summary).expect("plain numbers and texts"))?;
    folder.finish()?;
    Ok(summary)
}

/// The frame of the run before which a state is wanted. What can be refused is refused before the long work begins.
fn save_before(options: &ReplayOptions, range: &Range<usize>) -> Result<Option<usize>, RunError> {
    let Some((frame, path)) = &options.save_state else { return Ok(None) };
    let (frame, start, end) = (*frame, range.start, range.end);
    if frame <= start || frame > end {
        return Err(RunError::SaveFrame { frame, start, end });
    }
    if !options.force && path.exists() {
        return Err(OutputError::Exists { path: path.clone() }.into());
    }
    Ok(Some(frame - start))
}
