//! What every frame of a simulated system shows.

use super::{Fault, Path};
use slam_math::Se3;
use std::collections::BTreeSet;

/// One subject: a rigid body with markers, fixed to a camera that moves along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct SimSubject {
    /// Name of the subject and of its one segment.
    pub name: String,
    /// Where the camera goes.
    pub path: Path,
}

/// A simulated system. Its clock, its offset and the place of the markers are planted truths, for tests that look for them.
#[derive(Debug, Clone, PartialEq)]
pub struct Script {
    /// At least one.
    pub subjects: Vec<SimSubject>,
    /// Frames a second of the system's own clock.
    pub rate_hz: f64,
    /// After the end from the start again.
    pub looped: bool,
    /// Where the camera sits in the marker body; the system sees `world_from_camera * marker_from_camera^-1`.
    pub marker_from_camera: Se3,
    /// By how much the poses lag behind: a frame captured at t (all told latency taken off) shows the pose of `t - offset`.
    pub clock_offset_ns: i64,
    /// By how much the system's clock, which numbers the frames, is too fast; parts per million.
    pub drift_ppm: f64,
    /// Time from capture to sending; told to clients as a latency sample where the protocol has them. Seconds.
    pub latency_s: f64,
    /// What goes wrong.
    pub faults: BTreeSet<Fault>,
}

/// A script that makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct ScriptError(pub String);

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SimFrame {
    /// From 0; Vicon's programs would show one more.
    pub index: u32,
    /// The system's own clock at capture, nanoseconds since its start.
    pub system_ns: i64,
    /// True time of capture, nanoseconds since the start.
    pub true_ns: i64,
    /// The known subjects, in the script's order.
    pub bodies: Vec<SimBody>,
}

/// One subject in a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SimBody {
    /// Which subject of the script.
    pub subject: usize,
    /// `world_from_marker`, metres; `None` while occluded.
    pub world_from_marker: Option<Se3>,
}

const SECOND_NS: i64 = 1_000_000_000;
/// [`Fault::Drop`]: of this many frames ...
const DROP_PERIOD: u32 = 50;
/// ... these are lost: a single one and a run of three.
const DROPPED: [u32; 4] = [17, 31, 32, 33];
/// [`Fault::Occlude`]: how often it begins, when, and for how long.
const OCCLUSION: [i64; 3] = [2 * SECOND_NS, SECOND_NS, SECOND_NS / 4];

impl Script {
    /// One subject on a path: 100 Hz, 5 ms latency, markers at the camera, nothing wrong.
    #[must_use]
    pub fn new(name: &str, path: Path) -> Self {
        Self {
            subjects: vec![SimSubject { name: name.to_owned(), path }],
            rate_hz: 100.0,
            looped: false,
            marker_from_camera: Se3::identity(),
            clock_offset_ns: 0,
            drift_ppm: 0.0,
            latency_s: 0.005,
            faults: BTreeSet::new(),
        }
    }

    /// Looks for numbers out of range.
    ///
    /// # Errors
    /// Names the number.
    pub fn validated(self) -> Result<Self, ScriptError> {
        let in_range = |what: &str, value: f64, low: f64, high: f64| {
            let message = format!("{what} {value} is not between {low} and {high}");
            if (low..=high).contains(&value) { Ok(()) } else { Err(ScriptError(message)) }
        };
        in_range("rate (Hz)", self.rate_hz, 1.0, 2000.0)?;
        in_range("drift (ppm)", self.drift_ppm, -1000.0, 1000.0)?;
        in_range("latency (s)", self.latency_s, 0.0, 1.0)?;
        in_range("offset (ns)", self.clock_offset_ns as f64, -1e12, 1e12)?;
        if !self.marker_from_camera.is_finite() {
            return Err(ScriptError("the marker transform has a number that is not finite".to_owned()));
        }
        let names: BTreeSet<&str> = self.subjects.iter().map(|subject| subject.name.as_str()).collect();
        if names.len() != self.subjects.len() || names.is_empty() || names.contains("") {
            return Err(ScriptError("subjects need a name each, no two the same".to_owned()));
        }
        if let Some(empty) = self.subjects.iter().find(|subject| subject.path.length_ns() <= 0) {
            return Err(ScriptError(format!("the path of {} has fewer than two poses", empty.name)));
        }
        Ok(self)
    }

    /// Whether a fault was asked for.
    #[must_use]
    pub fn has(&self, fault: Fault) -> bool {
        self.faults.contains(&fault)
    }

    /// True time of a frame's capture, nanoseconds since the start.
    #[must_use]
    pub fn capture_ns(&self, index: u32) -> i64 {
        (self.system_ns(index) as f64 / (1.0 + self.drift_ppm * 1e-6)).round() as i64
    }

    /// True time at which a frame leaves the system, nanoseconds since the start.
    #[must_use]
    pub fn send_ns(&self, index: u32) -> i64 {
        self.capture_ns(index) + (self.latency_s * 1e9) as i64
    }

    /// The last frame that has left the system at a time, nanoseconds since the start; `None` before the first.
    #[must_use]
    pub fn newest(&self, true_ns: i64) -> Option<u32> {
        let captured_ns = true_ns - (self.latency_s * 1e9) as i64;
        let system_s = captured_ns as f64 * 1e-9 * (1.0 + self.drift_ppm * 1e-6);
        let index = (system_s * self.rate_hz).floor();
        (0.0..f64::from(u32::MAX)).contains(&index).then_some(index as u32)
    }

    /// Whether a frame is never sent.
    #[must_use]
    pub fn drops(&self, index: u32) -> bool {
        self.has(Fault::Drop) && DROPPED.contains(&(index % DROP_PERIOD))
    }

    /// A frame; `None` after the end.
    #[must_use]
    pub fn frame(&self, index: u32) -> Option<SimFrame> {
        let (system_ns, true_ns) = (self.system_ns(index), self.capture_ns(index));
        let shown_ns = true_ns - self.clock_offset_ns;
        let is_over = |subject: &SimSubject| shown_ns > subject.path.length_ns();
        if !self.looped && self.subjects.iter().all(is_over) {
            return None;
        }
        let [period_ns, begin_ns, length_ns] = OCCLUSION;
        let phase_ns = system_ns % period_ns - begin_ns;
        let hidden = self.has(Fault::Occlude) && (0..length_ns).contains(&phase_ns);
        let late = self.has(Fault::LateSubject) && system_ns < SECOND_NS;
        let known = self.subjects.len() - usize::from(late);
        let bodies = self.subjects[..known].iter().enumerate().map(|(subject, body)| SimBody {
            subject,
            world_from_marker: if hidden { None } else { self.pose(&body.path, shown_ns) },
        });
        Some(SimFrame { index, system_ns, true_ns, bodies: bodies.collect() })
    }

    fn system_ns(&self, index: u32) -> i64 {
        (f64::from(index) / self.rate_hz * 1e9).round() as i64
    }

    fn pose(&self, path: &Path, shown_ns: i64) -> Option<Se3> {
        let since_start = if self.looped { shown_ns.rem_euclid(path.length_ns()) } else { shown_ns };
        let world_from_camera = path.at(path.start_ns()?.checked_add(since_start)?)?;
        Some(world_from_camera * self.marker_from_camera.inverse())
    }
}
