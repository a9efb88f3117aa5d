//! What is known about the clocks and frames of a recording: the signals that tell it, and the record that keeps the
//! result in the log under [`crate::metadata::SYNC`].
//!
//! Stamps in a log are never rewritten. A reader that wants the camera's pose at a picture's stamp goes from camera time
//! to mocap time ([`Offset::mocap_ns`]), takes the marker body's pose there, where it was seen without a gap, and adds the
//! hand-eye transform.

mod arrivals;

pub use arrivals::{Arrivals, Piece, Window};

use crate::cdr::CdrError;
use crate::msg::{FrameMetadata, Imu, MocapFrame, NOT_TOLD};
use crate::{Message, Stamp, metadata, topics};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A pose at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseSample {
    /// Nanoseconds on the source's clock as it stands in the log.
    pub stamp_ns: i64,
    /// The same moment on the motion capture system's own clock, which has no zero anybody knows but steady steps: frame
    /// number times period, or the sending computer's time; nanoseconds.
    pub system_ns: Option<i64>,
    /// Metres in the source's world.
    pub translation_m: [f64; 3],
    /// `world_from_body` as quaternion x y z w.
    pub rotation_xyzw: [f64; 4],
}

/// Everything in a log that tells clocks and frames, without pictures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signals {
    /// By stream: unwrapped device time and host monotonic time at arrival. For `mocap`: the system's own time and the
    /// frame's stamp, which is its arrival less the latency that was told.
    pub arrivals: BTreeMap<String, Arrivals>,
    /// Gyroscope: stamp in nanoseconds and rad/s in the sensor's frame.
    pub gyro: Vec<(i64, [f64; 3])>,
    /// By `subject/segment`: where the mocap saw it; occluded and suspect frames are left out.
    pub bodies: BTreeMap<String, Vec<PoseSample>>,
    /// By body: first and last sample of each window in which it was seen without a gap, if samples were left out to save
    /// memory. Else the samples themselves tell.
    pub seen: BTreeMap<String, Vec<(PoseSample, PoseSample)>>,
    /// Camera poses in a world of their own, if something estimated them.
    pub camera: Vec<PoseSample>,
}

/// Topics that [`Signals::take`] understands, with the stream that each tells about.
pub const SIGNAL_TOPICS: [(&str, &str); 6] = [
    (topics::COLOR_METADATA, "color"),
    (topics::DEPTH_NATIVE_METADATA, "depth"),
    (topics::GYRO_METADATA, "gyro"),
    (topics::ACCEL_METADATA, "accel"),
    (topics::GYRO, "gyro"),
    (topics::MOCAP, "mocap"),
];

impl Signals {
    /// Takes a message of one of the [`SIGNAL_TOPICS`]; others are passed over.
    ///
    /// # Errors
    /// The bytes are not what the topic says.
    pub fn take(&mut self, topic: &str, bytes: &[u8]) -> Result<(), CdrError> {
        let Some((_, stream)) = SIGNAL_TOPICS.iter().find(|(known, _)| *known == topic) else { return Ok(()) };
        match topic {
            topics::GYRO => self.inertial(&Imu::decode(bytes)?),
            topics::MOCAP => self.mocap(&MocapFrame::decode(bytes)?),
            _ => self.arrival(stream, &FrameMetadata::decode(bytes)?),
        }
        Ok(())
    }

    /// Clocks of one measurement of a stream.
    pub fn arrival(&mut self, stream: &str, metadata: &FrameMetadata) {
        if metadata.device_time_ns != NOT_TOLD {
            self.arrivals_of(stream).push(metadata.device_time_ns, metadata.arrival_monotonic_ns);
        }
    }

    fn arrivals_of(&mut self, stream: &str) -> &mut Arrivals {
        self.arrivals.entry(stream.to_owned()).or_default()
    }

    /// One sample of the gyroscope.
    pub fn inertial(&mut self, imu: &Imu) {
        let v = &imu.angular_velocity;
        self.gyro.push((Stamp::from(imu.header.stamp).0, [v.x, v.y, v.z]));
    }

    /// One frame of the mocap.
    pub fn mocap(&mut self, frame: &MocapFrame) {
        let stamp_ns = Stamp::from(frame.header.stamp).0;
        let system_ns = system_ns(frame);
        if let Some(system_ns) = system_ns {
            self.arrivals_of("mocap").push(system_ns, stamp_ns);
        }
        for body in frame.bodies.iter().filter(|body| !body.occluded && !body.suspect) {
            let (p, q) = (&body.pose.position, &body.pose.orientation);
            let (translation_m, rotation_xyzw) = ([p.x, p.y, p.z], [q.x, q.y, q.z, q.w]);
            let sample = PoseSample { stamp_ns, system_ns, translation_m, rotation_xyzw };
            self.bodies.entry(format!("{}/{}", body.subject, body.segment)).or_default().push(sample);
        }
    }
}

/// The time of a frame on the system's own clock.
fn system_ns(frame: &MocapFrame) -> Option<i64> {
    if frame.source_stamp_ns != NOT_TOLD {
        return Some(frame.source_stamp_ns);
    }
    let counts = frame.frame_number != NOT_TOLD && frame.rate > 0.0;
    counts.then(|| (frame.frame_number as f64 / frame.rate * 1e9).round() as i64)
}

impl PoseSample {
    /// When it was taken: by the system's own clock where `clock` tells how that one runs, else as it was stamped. The
    /// stamp has all the jitter of the way to the recorder.
    #[must_use]
    pub fn moment_ns(&self, clock: Option<&ClockFit>) -> i64 {
        let covered = clock.zip(self.system_ns).filter(|(clock, system_ns)| clock.covers(*system_ns));
        covered.map_or(self.stamp_ns, |(clock, system_ns)| clock.host_ns(system_ns))
    }
}

/// How a device clock runs against the host's monotonic clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ClockFit {
    /// A moment of the device clock, nanoseconds.
    pub origin_ns: i64,
    /// The host's clock at that moment plus the shortest transport there was, nanoseconds.
    pub host_at_origin_ns: i64,
    /// By how much a second of the device is longer on the host, parts per million.
    pub drift_ppm: f64,
    /// Spread of the earliest arrivals of each second about the line (1.4826 x median absolute deviation), nanoseconds.
    pub residual_ns: f64,
    /// Median of each second's median delay above the line, nanoseconds.
    pub delay_p50_ns: f64,
    /// The longest delay above the line, nanoseconds.
    pub delay_max_ns: f64,
    /// Samples that were used.
    pub samples: usize,
    /// Seconds between the first and the last of them.
    pub span_s: f64,
}

impl ClockFit {
    /// Whether a moment of the device clock lies among the samples; a clock that was set anew is another one.
    #[must_use]
    pub fn covers(&self, device_ns: i64) -> bool {
        (0.0..=self.span_s).contains(&((device_ns - self.origin_ns) as f64 * 1e-9))
    }

    /// The host's clock when the device's showed `device_ns`, nanoseconds.
    #[must_use]
    pub fn host_ns(&self, device_ns: i64) -> i64 {
        let since = device_ns - self.origin_ns;
        self.host_at_origin_ns + since + (since as f64 * self.drift_ppm * 1e-6).round() as i64
    }
}

/// Offset between two clocks. `camera = mocap + offset + drift (mocap - reference)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Offset {
    /// Mocap time at which the offset holds, nanoseconds.
    pub reference_ns: i64,
    /// Camera time at that moment minus mocap time, nanoseconds.
    pub offset_ns: i64,
    /// Its standard deviation, nanoseconds.
    pub offset_sigma_ns: f64,
    /// Parts per million; 0 when the recording is too short for one.
    pub drift_ppm: f64,
    /// Its standard deviation; none when the recording is too short.
    pub drift_sigma_ppm: Option<f64>,
    /// Correlation coefficient of the angular speeds at the peak.
    pub correlation: f64,
    /// The best coefficient elsewhere.
    pub rival_correlation: f64,
    /// Root mean square of the residual angular velocity, rad/s.
    pub residual_rad_s: f64,
    /// Root mean square of the angular speed about its mean, rad/s.
    pub motion_rad_s: f64,
    /// Rotation from the camera side's sensor (gyroscope or camera) to the marker body, rows joined.
    pub marker_from_sensor: [f64; 9],
    /// Bias of that sensor, rad/s in its own frame.
    pub bias_rad_s: [f64; 3],
    /// Mocap samples that were used.
    pub samples: usize,
    /// The offset looked for anew in pieces: shows whether one line is enough.
    pub windows: Vec<WindowOffset>,
}

/// The offset in one piece of the recording.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WindowOffset {
    /// First mocap time, nanoseconds.
    pub start_ns: i64,
    /// Last mocap time, nanoseconds.
    pub end_ns: i64,
    /// Offset minus the line's, nanoseconds.
    pub deviation_ns: f64,
    /// Standard deviation, nanoseconds.
    pub sigma_ns: f64,
}

impl Offset {
    /// Camera time of a mocap time, nanoseconds.
    #[must_use]
    pub fn camera_ns(&self, mocap_ns: i64) -> i64 {
        let since = mocap_ns - self.reference_ns;
        mocap_ns + self.offset_ns + (since as f64 * self.drift_ppm * 1e-6).round() as i64
    }

    /// Mocap time of a camera time, nanoseconds.
    #[must_use]
    pub fn mocap_ns(&self, camera_ns: i64) -> i64 {
        // Each round shrinks the error by the drift, parts per million: three are exact for years.
        (0..3).fold(camera_ns - self.offset_ns, |mocap_ns, _| mocap_ns - (self.camera_ns(mocap_ns) - camera_ns))
    }
}

/// Where the camera sits on the marker body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HandEye {
    /// Rotation `marker_from_camera` as quaternion x y z w.
    pub rotation_xyzw: [f64; 4],
    /// Camera centre in the marker body's frame, metres.
    pub translation_m: [f64; 3],
    /// Standard deviation of the rotation about any axis, degrees.
    pub rotation_sigma_deg: f64,
    /// Standard deviation of the translation along the worst axis, metres.
    pub translation_sigma_m: f64,
    /// Root mean square of the rotation by which motions disagree, degrees.
    pub rotation_residual_deg: f64,
    /// Root mean square of the translation by which motions disagree, metres.
    pub translation_residual_m: f64,
    /// Ratio of the largest to the smallest singular value of the motions' equations: 1 to 2 is good, above 10 refused.
    pub condition: f64,
    /// Motions used.
    pub motions: usize,
}

/// A result, or why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimate<T> {
    /// It could be estimated.
    Found(T),
    /// It could not; the reason says what to do.
    Missing(String),
}

impl<T> Estimate<T> {
    /// The result, if there is one.
    pub fn found(&self) -> Option<&T> {
        match self {
            Self::Found(value) => Some(value),
            Self::Missing(_) => None,
        }
    }
}

/// A marker body against the camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodySync {
    /// `subject/segment`.
    pub body: String,
    /// When it was seen without a gap: first and last stamp of each window, nanoseconds of mocap time. Between two windows
    /// nothing is known.
    pub windows: Vec<(i64, i64)>,
    /// Where the camera side's turning came from: `gyroscope` or `camera poses`.
    pub camera_side: String,
    /// Clock offset and drift.
    pub offset: Estimate<Offset>,
    /// Transform between body and camera.
    pub hand_eye: Estimate<HandEye>,
}

/// The record in the log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SyncRecord {
    /// Version of the program that estimated it.
    pub program: String,
    /// The methods in words.
    pub method: String,
    /// By stream: device clock against host clock.
    pub clocks: BTreeMap<String, Estimate<ClockFit>>,
    /// Every marker body.
    pub bodies: Vec<BodySync>,
    /// The body that carries the camera: the one whose turning agrees best.
    pub camera_body: Option<String>,
}

/// Key of [`metadata::SYNC`] with the whole record as JSON; the other keys repeat the main numbers for people.
const REPORT: &str = "report";

impl SyncRecord {
    /// The body that carries the camera.
    #[must_use]
    pub fn camera_body(&self) -> Option<&BodySync> {
        let name = self.camera_body.as_ref()?;
        self.bodies.iter().find(|body| body.body == *name)
    }

    /// As a metadata record.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let report = serde_json::to_string(self).expect("numbers and texts");
        let mut values = BTreeMap::from([(REPORT.to_owned(), report), ("method".to_owned(), self.method.clone())]);
        if let Some(body) = self.camera_body() {
            values.insert("camera_body".to_owned(), body.body.clone());
            if let Estimate::Found(offset) = &body.offset {
                values.insert("offset_ns".to_owned(), offset.offset_ns.to_string());
                values.insert("drift_ppm".to_owned(), offset.drift_ppm.to_string());
            }
            if let Estimate::Found(found) = &body.hand_eye {
                let texts = found.translation_m.iter().chain(&found.rotation_xyzw).map(f64::to_string);
                values.insert("marker_from_camera".to_owned(), texts.collect::<Vec<_>>().join(" "));
            }
        }
        values
    }

    /// From a metadata record named [`metadata::SYNC`].
    ///
    /// # Errors
    /// The record is not one of ours, in words.
    pub fn from_metadata(values: &BTreeMap<String, String>) -> Result<Self, String> {
        let report = values.get(REPORT).ok_or_else(|| format!("{} has no key `{REPORT}`", metadata::SYNC))?;
        serde_json::from_str(report).map_err(|error| format!("{}: {error}", metadata::SYNC))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_survives_the_log() {
        let body = BodySync {
            body: "quad/quad".to_owned(),
            windows: vec![(1, 5), (9, 20)],
            camera_side: "gyroscope".to_owned(),
            offset: Estimate::Missing("too still".to_owned()),
            hand_eye: Estimate::Found(HandEye {
                rotation_xyzw: [0.0, 0.0, 0.1, 0.995],
                translation_m: [0.1, 1.0 / 3.0, -2.0],
                rotation_sigma_deg: 0.1,
                translation_sigma_m: 0.001,
                rotation_residual_deg: 0.3,
                translation_residual_m: 0.004,
                condition: 1.5,
                motions: 200,
            }),
        };
        let record = SyncRecord {
            program: "pslam".to_owned(),
            method: "m".to_owned(),
            clocks: BTreeMap::new(),
            bodies: vec![body],
            camera_body: Some("quad/quad".to_owned()),
        };
        let values = record.to_metadata();
        assert_eq!(SyncRecord::from_metadata(&values), Ok(record));
        assert!(values["marker_from_camera"].starts_with("0.1 0.333"));
        assert!(SyncRecord::from_metadata(&BTreeMap::new()).is_err());
    }

    #[test]
    fn clocks_go_there_and_back() {
        let offset = Offset {
            reference_ns: 1_000_000_000,
            offset_ns: 37_300_000,
            offset_sigma_ns: 0.0,
            drift_ppm: 20.0,
            drift_sigma_ppm: None,
            correlation: 1.0,
            rival_correlation: 0.0,
            residual_rad_s: 0.0,
            motion_rad_s: 1.0,
            marker_from_sensor: [0.0; 9],
            bias_rad_s: [0.0; 3],
            samples: 0,
            windows: Vec::new(),
        };
        for mocap_ns in [0, 1_000_000_000, 3_600_000_000_000] {
            assert!((offset.mocap_ns(offset.camera_ns(mocap_ns)) - mocap_ns).abs() <= 1, "{mocap_ns}");
        }
        assert_eq!(offset.camera_ns(51_000_000_000), 51_037_300_000 + 1_000_000);
    }
}
