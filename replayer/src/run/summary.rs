//! `run.json`: what a run was made from and what it came to.

use std::collections::BTreeMap;
use std::fmt;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use slam::depth::Miscalibration;
use slam::report::FinalReport;

use super::records::RunHeader;
use super::{RunError, Timing};

/// Contents of `run.json`. All but `log`, `vocabulary`, `resumed_at`, `config_name` and `timing` is the same on every machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunSummary {
    /// Chain over header, every stage of every frame, and the trajectories; 32 hexadecimal digits.
    pub fingerprint: String,
    /// What decides the result.
    pub header: RunHeader,
    /// What came out.
    pub result: RunResult,
    /// The log's place when it was replayed; absolute.
    pub log: PathBuf,
    /// The place of the vocabulary of `looping.vocabulary`, whose digest stands in the header's configuration; absolute.
    pub vocabulary: Option<PathBuf>,
    /// The frame of the log before which the replay took up a saved state. It makes no difference to any result.
    pub resumed_at: Option<usize>,
    /// How the user called the configuration.
    pub config_name: String,
    /// What it cost; different every time.
    pub timing: Timing,
}

/// Counts of one run. Frames are ids in the run, which start at 0 with the first frame replayed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunResult {
    /// What the slam saw with: `rgbd`, `stereo` or `monocular`. Lengths of a monocular run have no unit.
    pub sensor: String,
    /// Frames replayed; none is ever skipped.
    pub frames: usize,
    /// Frames with a pose.
    pub tracked: usize,
    /// Frames without one.
    pub lost: usize,
    /// Which frames have none.
    pub lost_frames: Vec<Range<u32>>,
    /// Frames by tracking state.
    pub states: BTreeMap<String, usize>,
    /// Maps and the frames tracked in each. Maps have no common frame.
    pub maps: Vec<MapFrames>,
    /// The map with the most frames, whose trajectory is written.
    pub main_map: Option<u32>,
    /// Frames in `trajectory.txt`.
    pub in_trajectory: usize,
    /// Tracked frames that are not in `trajectory.txt`, as they belong to other maps.
    pub other_map_frames: Vec<Range<u32>>,
    /// The same for `trajectory_online.txt`.
    pub online_other_map_frames: Vec<Range<u32>>,
    /// Keyframes at the end.
    pub keyframes: usize,
    /// Map points at the end.
    pub map_points: usize,
    /// Of them, those on Things, which stood still when the points were made.
    pub map_points_on_things: usize,
    /// Of them, those on areas that no segment claimed.
    pub map_points_on_unknown: usize,
    /// What the final stage did, a map each; none when it is off.
    pub r#final: Vec<FinalReport>,
    /// What pixels found to be wrong with depth everywhere; none where they found out nothing.
    pub depth: Option<Miscalibration>,
    /// Events that are warnings.
    pub warnings: usize,
    /// What happened, the first thousand of it.
    pub events: Vec<RunEvent>,
    /// Events beyond those.
    pub events_left_out: usize,
}

/// A map and how many frames were tracked in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapFrames {
    /// Its id.
    pub map: u32,
    /// Frames.
    pub frames: usize,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunEvent {
    /// When; none for what concerns the whole run.
    pub frame: Option<u32>,
    /// True for what a user should look at.
    pub warning: bool,
    /// The message.
    pub text: String,
}

impl RunSummary {
    /// Reads `run.json` of a run.
    ///
    /// # Errors
    /// No such file, or not what a replay of this version writes.
    pub fn read(run_dir: &Path) -> Result<Self, RunError> {
        let path = run_dir.join(super::RUN_JSON);
        let text = match std::fs::read_to_string(&path) {
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Err(RunError::NoRun(run_dir.to_owned()));
            }
            text => text.map_err(RunError::io(&path))?,
        };
        serde_json::from_str(&text).map_err(|error| RunError::Manifest { path, reason: error.to_string() })
    }
}

/// Warnings shown to a reader; all of them are in the file.
const SHOWN_WARNINGS: usize = 10;

impl fmt::Display for RunSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let r = &self.result;
        let Range { start, end } = &self.header.frames;
        writeln!(f, "log          {} (frames {start}..{end})", self.log.display())?;
        writeln!(f, "config       {}", self.config_name)?;
        if let Some(path) = &self.vocabulary {
            writeln!(f, "vocabulary   {}", path.display())?;
        }
        if let Some(frame) = self.resumed_at {
            writeln!(f, "resumed      before frame {frame} of the log")?;
        }
        writeln!(f, "sensor       {}", r.sensor)?;
        writeln!(f, "layer        {}", self.header.layer.as_deref().unwrap_or("none"))?;
        let share = 100.0 * r.tracked as f64 / r.frames.max(1) as f64;
        writeln!(
            f,
            "tracked      {} of {} frames ({share:.1} %), {} lost{}",
            r.tracked,
            r.frames,
            r.lost,
            list(&r.lost_frames)
        )?;
        let others = list(&r.other_map_frames);
        writeln!(
            f,
            "trajectory   {} frames of {} maps, {} in other maps{others}",
            r.in_trajectory,
            r.maps.len(),
            r.tracked - r.in_trajectory
        )?;
        let (things, unknown) = (r.map_points_on_things, r.map_points_on_unknown);
        writeln!(
            f,
            "map          {} keyframes, {} points, {things} of them on things and {unknown} on unknown areas",
            r.keyframes, r.map_points
        )?;
        for part in &r.r#final {
            writeln!(f, "final        {}", told(part))?;
        }
        if let Some(depth) = &r.depth {
            writeln!(f, "depth        {depth}")?;
        }
        writeln!(f, "events       {}, {} of them warnings", r.events.len() + r.events_left_out, r.warnings)?;
        for event in r.events.iter().filter(|event| event.warning).take(SHOWN_WARNINGS) {
            let frame = event.frame.map_or(String::new(), |frame| format!("frame {frame}: "));
            writeln!(f, "  {frame}{}", event.text)?;
        }
        if r.warnings > SHOWN_WARNINGS {
            writeln!(f, "  ... see run.json")?;
        }
        writeln!(f, "fingerprint  {}", self.fingerprint)?;
        write!(f, "{}", self.timing)
    }
}

fn told(part: &FinalReport) -> String {
    let FinalReport {
        map,
        keyframes,
        points,
        observations,
        outliers,
        depth_weight,
        iterations,
        cost: [before, after],
        refined,
        kept,
    } = part;
    format!(
        "map{map}: depth counts {depth_weight} times, cost {before:.0} to {after:.0} in {iterations} iterations over {keyframes} keyframes and {points} points, \
         {outliers} of {observations} observations dropped; {refined} frames refined, {kept} kept"
    )
}

fn list(ranges: &[Range<u32>]) -> String {
    const SHOWN: usize = 5;
    let texts: Vec<String> = ranges.iter().take(SHOWN).map(|range| format!("{}..{}", range.start, range.end)).collect();
    match ranges.len() {
        0 => String::new(),
        n if n > SHOWN => format!(" ({}, ...)", texts.join(", ")),
        _ => format!(" ({})", texts.join(", ")),
    }
}
