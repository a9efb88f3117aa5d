//! What the records tell about each frame.

use std::path::Path;

use schemas::Stamp;
use slam::report::Stage;

use crate::run::records::{Block, FrameEntry, RecordReader};
use crate::run::{RECORDS_BIN, RunError};

/// One frame of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub stamp: Stamp,
    /// Since the first frame, seconds.
    pub at_s: f64,
    /// Whether it has a pose.
    pub tracked: bool,
    pub keypoints: f64,
    pub static_keypoints: f64,
    pub matches: f64,
    pub inliers: f64,
    pub keyframes: f64,
    pub map_points: f64,
}

/// All frames, in order.
///
/// # Errors
/// Missing or damaged records.
pub fn read(run_dir: &Path) -> Result<Vec<Row>, RunError> {
    let mut reader = RecordReader::open(&run_dir.join(RECORDS_BIN))?;
    let mut rows: Vec<Row> = Vec::new();
    while let Some(block) = reader.next_block()? {
        if let Block::Frame(frame) = block {
            let first = rows.first().map_or(frame.stamp, |row| row.stamp);
            rows.push(row(&frame, first));
        }
    }
    Ok(rows)
}

fn row(frame: &FrameEntry, first: Stamp) -> Row {
    let text = |stage: Stage, field: &str| {
        let found = frame.fields.iter().find(|f| f.stage == stage && f.field == field);
        found.map_or("", |f| f.value.as_str())
    };
    // What another version of the program did not write is not drawn.
    let number = |stage, field| text(stage, field).parse().unwrap_or(f64::NAN);
    Row {
        stamp: frame.stamp,
        at_s: frame.stamp.abs_diff(first) as f64 / 1e9,
        tracked: text(Stage::Pose, "camera_from_world") != "none",
        keypoints: number(Stage::Features, "keypoints"),
        static_keypoints: number(Stage::Verdicts, "verdict"),
        matches: number(Stage::Matches, "local matches"),
        inliers: number(Stage::Matches, "points"),
        keyframes: number(Stage::Map, "keyframes"),
        map_points: number(Stage::Map, "map points"),
    }
}

/// Stretches without a pose: first frame, frame after the last.
pub fn lost(rows: &[Row]) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = Vec::new();
    for (frame, _) in rows.iter().enumerate().filter(|(_, row)| !row.tracked) {
        match found.last_mut() {
            Some(last) if last.1 == frame => last.1 += 1,
            _ => found.push((frame, frame + 1)),
        }
    }
    found
}
