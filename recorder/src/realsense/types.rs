//! What a camera says, as plain values.

use crate::Arrival;
use schemas::alignment::{Extrinsics, Intrinsics};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Kind of a stream. The numbers are librealsense's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StreamKind {
    /// Depth along z.
    Depth,
    /// Colour.
    Color,
    /// One of the two infrared cameras.
    Infrared,
    /// Angular velocity.
    Gyro,
    /// Acceleration, gravity included.
    Accel,
    /// A kind that is not recorded.
    Other(i32),
}

impl StreamKind {
    pub(super) fn from_raw(raw: i32) -> Self {
        let known = [Self::Depth, Self::Color, Self::Infrared, Self::Gyro, Self::Accel];
        known.into_iter().find(|kind| kind.raw() == raw).unwrap_or(Self::Other(raw))
    }

    pub(super) fn raw(self) -> i32 {
        match self {
            Self::Depth => 1,
            Self::Color => 2,
            Self::Infrared => 3,
            Self::Gyro => 5,
            Self::Accel => 6,
            Self::Other(raw) => raw,
        }
    }

    /// Whether it gives pictures.
    #[must_use]
    pub fn is_video(self) -> bool {
        matches!(self, Self::Depth | Self::Color | Self::Infrared)
    }

    /// Whether it gives [`Motion`].
    #[must_use]
    pub fn is_motion(self) -> bool {
        matches!(self, Self::Gyro | Self::Accel)
    }
}

/// A stream of a camera: `depth`, `color`, `infrared1`, `gyro`, ...
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct StreamId {
    /// Its kind.
    pub kind: StreamKind,
    /// 0 where there is one of the kind; the infrared cameras are 1 (left) and 2 (right).
    pub index: i32,
}

impl StreamId {
    /// The only stream of its kind.
    #[must_use]
    pub const fn only(kind: StreamKind) -> Self {
        Self { kind, index: 0 }
    }
}

impl fmt::Display for StreamId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.kind {
            StreamKind::Depth => "depth",
            StreamKind::Color => "color",
            StreamKind::Infrared => "infrared",
            StreamKind::Gyro => "gyro",
            StreamKind::Accel => "accel",
            StreamKind::Other(raw) => return write!(f, "stream{raw}.{}", self.index),
        };
        f.write_str(name)?;
        if self.index > 0 { write!(f, "{}", self.index) } else { Ok(()) }
    }
}

/// How pixels stand in a frame. The numbers are librealsense's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Depth, u16 little endian, 0 = none.
    Z16,
    /// Y0 U Y1 V, two bytes a pixel.
    Yuyv,
    /// Red, green, blue.
    Rgb8,
    /// Blue, green, red.
    Bgr8,
    /// Grey.
    Y8,
    /// Three f32.
    MotionXyz32f,
    /// A format that is not recorded.
    Other(i32),
}

impl Format {
    pub(super) fn from_raw(raw: i32) -> Self {
        let known = [Self::Z16, Self::Yuyv, Self::Rgb8, Self::Bgr8, Self::Y8, Self::MotionXyz32f];
        known.into_iter().find(|format| format.raw() == raw).unwrap_or(Self::Other(raw))
    }

    pub(super) fn raw(self) -> i32 {
        match self {
            Self::Z16 => 1,
            Self::Yuyv => 4,
            Self::Rgb8 => 5,
            Self::Bgr8 => 6,
            Self::Y8 => 9,
            Self::MotionXyz32f => 16,
            Self::Other(raw) => raw,
        }
    }

    /// Bytes of a pixel (of a sample, for motion); `None` for formats that are not recorded.
    #[must_use]
    pub fn bytes_per_pixel(self) -> Option<usize> {
        match self {
            Self::Z16 | Self::Yuyv => Some(2),
            Self::Rgb8 | Self::Bgr8 => Some(3),
            Self::Y8 => Some(1),
            Self::MotionXyz32f => Some(12),
            Self::Other(_) => None,
        }
    }
}

/// One way in which a stream can run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StreamProfile {
    /// The stream.
    pub stream: StreamId,
    /// Pixels.
    pub format: Format,
    /// Columns; 0 for motion.
    pub width: u32,
    /// Rows; 0 for motion.
    pub height: u32,
    /// Frames or samples a second.
    pub rate_hz: u32,
}

impl fmt::Display for StreamProfile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stream, format, width, height, rate_hz } = self;
        if stream.kind.is_motion() {
            return write!(f, "{stream} @{rate_hz}");
        }
        write!(f, "{stream} {width}x{height}@{rate_hz} {format:?}")
    }
}

/// The value of one option of a sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OptionValue {
    /// Name, as `Emitter Enabled`.
    pub name: String,
    /// Value.
    pub value: f32,
    /// What the library calls this value, as `High Accuracy`, where it has a word.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub meaning: Option<String>,
    /// Least, greatest, default, step; where the library tells them.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub range: Option<[f32; 4]>,
    /// Whether it only tells.
    pub read_only: bool,
}

/// One part of a camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SensorDescription {
    /// `Stereo Module`, `RGB Camera`, `Motion Module`.
    pub name: String,
    /// All options with their values.
    pub options: Vec<OptionValue>,
    /// All profiles.
    pub profiles: Vec<StreamProfile>,
}

/// A camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DeviceDescription {
    /// `Intel RealSense D435I`.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// Firmware version.
    pub firmware: Option<String>,
    /// USB type descriptor: `3.2`, `2.1`.
    pub usb: Option<String>,
    /// USB product id, four hexadecimal digits.
    pub product_id: Option<String>,
    /// Everything else that it says about itself: (name, text).
    pub more: Vec<(String, String)>,
    /// The file that is played, if it is no real camera.
    pub recording: Option<String>,
    /// Its parts.
    pub sensors: Vec<SensorDescription>,
}

/// Scale, cross-axis and bias matrix and noise of an inertial sensor.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MotionIntrinsics {
    /// Rows of scale and cross-axis sensitivity; the fourth column is the bias (rad/s, m/s^2).
    pub matrix: [[f32; 4]; 3],
    /// Variance of the noise, per axis.
    pub noise_variances: [f32; 3],
    /// Variance of the bias, per axis.
    pub bias_variances: [f32; 3],
}

/// What calibrates one stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StreamCalibration {
    /// The profile that is streamed.
    pub profile: StreamProfile,
    /// Of a picture.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub intrinsics: Option<Intrinsics>,
    /// Of an inertial sensor.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub motion: Option<MotionIntrinsics>,
}

/// Where one stream stands to another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StreamExtrinsics {
    /// Source frame.
    pub from: StreamId,
    /// Target frame.
    pub to: StreamId,
    /// `to_from_from`.
    #[serde(flatten)]
    pub transform: Extrinsics,
}

/// Calibration of all streams that are streamed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Calibration {
    /// The streams.
    pub streams: Vec<StreamCalibration>,
    /// Between every two different ones that the library relates.
    pub extrinsics: Vec<StreamExtrinsics>,
    /// Metres of a depth value of one.
    pub depth_units_m: Option<f32>,
}

impl Calibration {
    /// The calibration of a stream.
    #[must_use]
    pub fn stream(&self, stream: StreamId) -> Option<&StreamCalibration> {
        self.streams.iter().find(|calibration| calibration.profile.stream == stream)
    }

    /// `to_from_from`.
    #[must_use]
    pub fn extrinsics(&self, from: StreamId, to: StreamId) -> Option<Extrinsics> {
        self.extrinsics.iter().find(|pair| pair.from == from && pair.to == to).map(|pair| pair.transform)
    }
}

/// Which clock a frame's stamp is of. The numbers are librealsense's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimestampDomain {
    /// The device's microsecond counter.
    HardwareClock,
    /// Arrival at the host: metadata is missing.
    SystemTime,
    /// The device's time mapped to the host's realtime clock by librealsense.
    GlobalTime,
    /// A later invention.
    Other(i32),
}

impl TimestampDomain {
    pub(super) fn from_raw(raw: i32) -> Self {
        match raw {
            0 => Self::HardwareClock,
            1 => Self::SystemTime,
            2 => Self::GlobalTime,
            _ => Self::Other(raw),
        }
    }

    pub(super) fn raw(self) -> i32 {
        match self {
            Self::HardwareClock => 0,
            Self::SystemTime => 1,
            Self::GlobalTime => 2,
            Self::Other(raw) => raw,
        }
    }
}

/// Numbers of the metadata values that the recorder itself reads; all others are kept too.
pub mod metadata {
    /// Hardware frame counter.
    pub const FRAME_COUNTER: u32 = 0;
    /// Readout, microseconds of the device (wraps at 2^32).
    pub const FRAME_TIMESTAMP: u32 = 1;
    /// Middle of the exposure, microseconds of the device (wraps at 2^32).
    pub const SENSOR_TIMESTAMP: u32 = 2;
    /// Exposure, microseconds.
    pub const ACTUAL_EXPOSURE: u32 = 3;
    /// Arrival by librealsense's clock, milliseconds.
    pub const TIME_OF_ARRIVAL: u32 = 7;
}

/// What every picture and every inertial sample carries.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameHeader {
    /// The stream.
    pub stream: StreamId,
    /// librealsense's frame number; for a camera the hardware's counter.
    pub number: u64,
    /// Stamp in `domain`, milliseconds.
    pub timestamp_ms: f64,
    /// Its clock.
    pub domain: TimestampDomain,
    /// All supported metadata values by their number, ascending; names by [`crate::realsense::Library::metadata_name`].
    pub metadata: Vec<(u32, i64)>,
    /// The host's clocks when librealsense handed it over.
    pub arrival: Arrival,
}

impl FrameHeader {
    /// A metadata value.
    #[must_use]
    pub fn metadata(&self, number: u32) -> Option<i64> {
        self.metadata.iter().find(|(known, _)| *known == number).map(|(_, value)| *value)
    }

    /// The device's microsecond counter: middle of the exposure, else readout.
    #[must_use]
    pub fn device_us(&self) -> Option<i64> {
        self.metadata(metadata::SENSOR_TIMESTAMP).or_else(|| self.metadata(metadata::FRAME_TIMESTAMP))
    }
}

/// A picture, copied out of the library.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number, clocks, metadata.
    pub header: FrameHeader,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pixels.
    pub format: Format,
    /// Rows without padding, top first.
    pub bytes: Vec<u8>,
}

/// An inertial sample: rad/s or m/s^2 in the sensor's axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Number, clocks, metadata.
    pub header: FrameHeader,
    /// x, y, z.
    pub xyz: [f32; 3],
}

/// What a stream hands over.
#[derive(Debug, Clone, PartialEq)]
pub enum Sample {
    /// A picture.
    Frame(Frame),
    /// An inertial sample.
    Motion(Motion),
    /// Something came that could not be read: a sentence.
    Unreadable {
        /// When.
        arrival: Arrival,
        /// Why.
        reason: String,
    },
}
