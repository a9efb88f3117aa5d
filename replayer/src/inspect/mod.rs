//! The inspection file: every intermediate state of a replay on one timeline, for the Rerun viewer.
//!
//! | entity | content |
//! |---|---|
//! | `/world/camera` | pose and intrinsics; the frustum is red while the track is lost |
//! | `/world/camera/color`, `depth`, `segmentation` | what the log gave |
//! | `/world/camera/unknown` | pixels that no segment claims |
//! | `/world/camera/regions`, `regions/moving`, `regions/still` | segment tracks: area by state; boxes with class, id and evidence |
//! | `/world/camera/regions/disagree` | boxes of regions whose map points move otherwise than the background |
//! | `/world/camera/keypoints` | keypoints coloured by verdict; those matched to the map are larger |
//! | `/world/camera/vouched` | halos of keypoints on regions that old map points vouch for |
//! | `/world/camera/epipolar`, `motion` | keypoints coloured by residual |
//! | `/world/map/points`, `tracked` | map points coloured by state; those seen now |
//! | `/world/keyframes`, `covisibility`, `loops` | keyframes and the graph between them |
//! | `/world/corrections` | how far each keyframe moved when a loop was closed, two maps were joined, or all was adjusted |
//! | `/world/trajectory/*` | estimated as known at each frame, final, and true |
//! | `/plots/*`, `/log`, `/about` | counts and residuals over time, events, how to read it all |

mod curves;
mod events;
mod layout;
mod picture;
mod style;
mod truth;
mod world;

use std::path::{Path, PathBuf};

use rrd::{At, RrdError, RrdWriter, TextDocument};
use slam::input::{FrameInput, Setup};
use slam::map::Map;
use slam::report::FrameReport;

pub use rrd::ImageCodec;

use crate::eval::Trajectory;

/// Why the inspection file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    /// The file, or something given to it.
    #[error(transparent)]
    Rrd(#[from] RrdError),
    /// A picture could not be packed.
    #[error("{what} of {width} x {height} pixels cannot be packed as PNG: {reason}")]
    Picture {
        /// Which picture.
        what: &'static str,
        /// Its width.
        width: usize,
        /// Its height.
        height: usize,
        /// The packer's own words.
        reason: String,
    },
}

/// A colour picture as the log holds it.
#[derive(Debug, Clone, Copy)]
pub struct ColorPicture<'a> {
    /// The whole PNG or JPEG file.
    pub bytes: &'a [u8],
    /// Which of the two.
    pub codec: ImageCodec,
}

/// Writes the inspection file of one replay, frame by frame.
pub struct Inspector {
    file: RrdWriter,
    setup: Setup,
    /// Stamps and frames logged, for the frame rate and for what is only known at the end.
    times: Vec<At>,
    world: world::World,
    events: events::Events,
}

impl Inspector {
    /// Begins the file and logs what holds for all frames. `name` tells recordings apart and is part of the bytes: the
    /// name of the log, not the time.
    ///
    /// # Errors
    /// [`InspectError::Rrd`], also when `path` exists and `force` is false.
    pub fn create(path: &Path, name: &str, setup: &Setup, force: bool) -> Result<Self, InspectError> {
        let mut file = RrdWriter::create(path, "panoptic-slam", name, force)?;
        style::log_classes(&mut file, &setup.categories)?;
        curves::log_styles(&mut file)?;
        world::log_static(&mut file)?;
        file.log("/about", At::Static, &TextDocument { markdown: layout::ABOUT })?;
        let (world, events) = Default::default();
        Ok(Self { file, setup: setup.clone(), times: Vec::new(), world, events })
    }

    /// Logs one frame. Without `color`, the grey picture is shown.
    ///
    /// # Errors
    /// [`InspectError`] when a picture has not the size it claims, or writing fails.
    pub fn frame(
        &mut self,
        input: &FrameInput,
        color: Option<ColorPicture<'_>>,
        report: &FrameReport,
        map: &Map,
    ) -> Result<(), InspectError> {
        let at = At::Frame { frame: i64::from(report.id.0), sensor_time_ns: report.stamp.0 };
        self.times.push(at);
        picture::log_inputs(&mut self.file, at, input, color)?;
        picture::log_findings(&mut self.file, at, report, &self.setup)?;
        self.world.log(&mut self.file, at, report, map, &self.setup.camera)?;
        curves::log(&mut self.file, at, report)?;
        self.events.log(&mut self.file, at, report, &self.setup)?;
        Ok(())
    }

    /// Logs what is known only at the end - the final trajectory, and with `truth` the true one and the error over
    /// time - then the layout, and gives the file its name.
    ///
    /// # Errors
    /// [`InspectError::Rrd`].
    pub fn finish(mut self, estimate: &Trajectory, truth: Option<&Trajectory>) -> Result<PathBuf, InspectError> {
        let has_error = truth::log(&mut self.file, self.setup.sensor, &self.times, estimate, truth)?;
        let size = [self.setup.camera.width, self.setup.camera.height];
        self.file.blueprint(&layout::layout(size, frame_rate(&self.times), estimate, has_error))?;
        Ok(self.file.finish()?)
    }
}

/// Mean frames a second, whole; 30 when there is nothing to tell it from.
fn frame_rate(times: &[At]) -> f64 {
    let stamp = |at: &At| if let At::Frame { sensor_time_ns, .. } = at { *sensor_time_ns } else { 0 };
    let (Some(first), Some(last)) = (times.first(), times.last()) else { return 30.0 };
    let duration_s = stamp(last).saturating_sub(stamp(first)) as f64 * 1e-9;
    if duration_s <= 0.0 { 30.0 } else { ((times.len() - 1) as f64 / duration_s).round().clamp(1.0, 120.0) }
}
