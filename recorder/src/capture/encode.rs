//! From what the sources hand over to messages, ready for the log.

use super::clock::HostTimeline;
use super::effort::Encoding;
use super::stamps::DeviceTime;
use super::stream::Stream;
use crate::mocap::{self, MocapFrame};
use crate::picture::{Packing, PictureError, pack_rgb8};
use crate::realsense::{
    Calibration, Format, Frame, FrameHeader, Motion, StreamId, StreamKind, TimestampDomain, metadata,
};
use crate::{Arrival, ChannelId, LogWriter, WriteError};
use schemas::alignment::{Intrinsics, LensModel};
use schemas::msg::{
    CameraInfo, CompressedImage, FrameMetadata, Header, Image, Imu, RegionOfInterest, TFMessage, Vector3, domain,
    encoding, format,
};
use schemas::{Message, Stamp, StampError, topics};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;

/// One message in the log's bytes.
pub struct Encoded {
    pub topic: Cow<'static, str>,
    pub log_time: Stamp,
    pub publish_time: Stamp,
    pub bytes: Vec<u8>,
    /// Opens the topic for this type of message.
    pub open: fn(&mut LogWriter, &str) -> Result<ChannelId, WriteError>,
}

impl Encoded {
    pub fn new<'a, M: Message<'a>>(
        topic: impl Into<Cow<'static, str>>,
        log_time: Stamp,
        publish_time: Stamp,
        message: &M,
    ) -> Self {
        let open = |log: &mut LogWriter, topic: &str| log.open_topic::<M>(topic, BTreeMap::new());
        Self { topic: topic.into(), log_time, publish_time, bytes: message.encode(), open }
    }
}

/// A measurement on its way to the log.
pub struct Measurement {
    pub stream: Stream,
    /// For the ledger.
    pub counter: u64,
    pub arrival: Arrival,
    pub payload: Payload,
}

impl Measurement {
    /// Log time of a picture.
    pub fn picture_stamp(&self) -> Option<Stamp> {
        match &self.payload {
            Payload::Picture { time, .. } => Some(time.stamp),
            Payload::Motion { .. } | Payload::Mocap { .. } => None,
        }
    }
}

/// What was measured.
pub enum Payload {
    Picture { frame: Arc<Frame>, time: DeviceTime, calibration: Arc<Calibration> },
    Motion { motion: Motion, time: DeviceTime },
    Mocap { frame: Box<MocapFrame>, source: Arc<str> },
}

impl Payload {
    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Picture { frame, .. } => frame.bytes.len(),
            Self::Motion { .. } | Self::Mocap { .. } => 256,
        }
    }
}

/// Why a measurement cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    #[error(transparent)]
    Stamp(#[from] StampError),
    #[error(transparent)]
    Picture(#[from] PictureError),
    #[error("{stream} pixels {format:?} of {width}x{height} in {bytes} bytes are not recorded")]
    Pixels { stream: &'static str, format: Format, width: u32, height: u32, bytes: usize },
}

/// How measurements become messages.
#[derive(Debug, Clone, Copy)]
pub struct Encoder {
    host: HostTimeline,
    encoding: Encoding,
}

impl Encoder {
    pub fn new(host: HostTimeline, encoding: Encoding) -> Self {
        Self { host, encoding }
    }

    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// The messages of a measurement; `packing` is for colour.
    pub fn encode(&self, measurement: &Measurement, packing: Packing) -> Result<Vec<Encoded>, EncodeError> {
        let stream = measurement.stream;
        match &measurement.payload {
            Payload::Picture { frame, time, calibration } => self.picture(stream, frame, time, calibration, packing),
            Payload::Motion { motion, time } => motion_messages(stream, motion, time),
            Payload::Mocap { frame, source } => self.mocap(frame, source),
        }
    }

    fn picture(
        &self,
        stream: Stream,
        frame: &Frame,
        time: &DeviceTime,
        calibration: &Calibration,
        packing: Packing,
    ) -> Result<Vec<Encoded>, EncodeError> {
        let Frame { header: told, width, height, format, bytes } = frame;
        let (width, height, format) = (*width, *height, *format);
        let unfit = || EncodeError::Pixels { stream: stream.name(), format, width, height, bytes: bytes.len() };
        let pixel_bytes = format.bytes_per_pixel().ok_or_else(unfit)?;
        if bytes.len() != width as usize * height as usize * pixel_bytes {
            return Err(unfit());
        }
        let publish = Stamp(told.arrival.realtime_ns);
        let header = Header::new(time.stamp, stream.frame())?;
        let intrinsics = calibration.stream(told.stream).and_then(|stream| stream.intrinsics);
        let info_topic = if stream == Stream::Color { topics::COLOR_INFO } else { topics::DEPTH_NATIVE_INFO };
        let info = intrinsics.map(|lens| camera_info(header.clone(), &lens));
        let mut out: Vec<Encoded> =
            info.map(|info| Encoded::new(info_topic, time.stamp, publish, &info)).into_iter().collect();
        out.push(match (stream, format) {
            (Stream::Depth, Format::Z16) => {
                let (encoding, step, data) = (encoding::DEPTH.to_owned(), width * 2, Cow::Borrowed(bytes.as_slice()));
                let image = Image { header, height, width, encoding, is_bigendian: 0, step, data };
                Encoded::new(topics::DEPTH_NATIVE, time.stamp, publish, &image)
            }
            (Stream::Color, Format::Rgb8 | Format::Bgr8) => {
                let rgb =
                    if format == Format::Rgb8 { Cow::Borrowed(bytes.as_slice()) } else { Cow::Owned(swapped(bytes)) };
                if self.encoding != Encoding::Raw {
                    let data = Cow::Owned(pack_rgb8(width, height, &rgb, packing)?);
                    let picture = CompressedImage { header, format: format::PNG.to_owned(), data };
                    Encoded::new(topics::COLOR, time.stamp, publish, &picture)
                } else {
                    let (encoding, step) = (encoding::RGB8.to_owned(), width * 3);
                    let image = Image { header, height, width, encoding, is_bigendian: 0, step, data: rgb };
                    Encoded::new(topics::COLOR_RAW, time.stamp, publish, &image)
                }
            }
            _ => return Err(unfit()),
        });
        out.extend(metadata_message(stream, told, time, bytes.len())?);
        Ok(out)
    }

    fn mocap(&self, frame: &MocapFrame, source: &str) -> Result<Vec<Encoded>, EncodeError> {
        let publish = Stamp(frame.arrival.realtime_ns);
        let stamp = self.host.captured(frame);
        let messages = mocap::messages(frame, source, stamp)?;
        let mut out = vec![Encoded::new(topics::MOCAP, stamp, publish, &messages.frame)];
        out.extend(messages.tf.map(|tf: TFMessage| Encoded::new(topics::TF, stamp, publish, &tf)));
        out.extend(messages.poses.into_iter().map(|(topic, pose)| Encoded::new(topic, stamp, publish, &pose)));
        Ok(out)
    }
}

fn motion_messages(stream: Stream, motion: &Motion, time: &DeviceTime) -> Result<Vec<Encoded>, EncodeError> {
    /// ROS: the message has no such measurement.
    const ABSENT: [f64; 9] = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let publish = Stamp(motion.header.arrival.realtime_ns);
    let [x, y, z] = motion.xyz.map(f64::from);
    let measured = Vector3 { x, y, z };
    let header = Header::new(time.stamp, stream.frame())?;
    let imu = Imu { header, orientation_covariance: ABSENT, ..Imu::default() };
    let (topic, imu) = if stream == Stream::Gyro {
        (topics::GYRO, Imu { angular_velocity: measured, linear_acceleration_covariance: ABSENT, ..imu })
    } else {
        (topics::ACCEL, Imu { linear_acceleration: measured, angular_velocity_covariance: ABSENT, ..imu })
    };
    let mut out = vec![Encoded::new(topic, time.stamp, publish, &imu)];
    out.extend(metadata_message(stream, &motion.header, time, size_of_val(&motion.xyz))?);
    Ok(out)
}

/// Clocks and metadata of a measurement.
fn metadata_message(
    stream: Stream,
    told: &FrameHeader,
    time: &DeviceTime,
    payload_bytes: usize,
) -> Result<Option<Encoded>, EncodeError> {
    let Some(topic) = stream.metadata_topic() else { return Ok(None) };
    let message = FrameMetadata {
        header: Header::new(time.stamp, stream.frame())?,
        counter: counter(told),
        frame_number: told.number,
        timestamp_ms: told.timestamp_ms,
        domain: match told.domain {
            TimestampDomain::HardwareClock => domain::HARDWARE_CLOCK,
            TimestampDomain::SystemTime => domain::SYSTEM_TIME,
            TimestampDomain::GlobalTime => domain::GLOBAL_TIME,
            TimestampDomain::Other(raw) => u8::try_from(raw).unwrap_or(u8::MAX),
        },
        device_clock: time.clock,
        device_time_us: time.raw_us,
        device_time_ns: time.time_ns,
        arrival_monotonic_ns: told.arrival.monotonic_ns,
        arrival_realtime_ns: told.arrival.realtime_ns,
        payload_bytes: payload_bytes as u64,
        attribute_ids: told.metadata.iter().map(|(number, _)| *number as u16).collect(),
        attribute_values: told.metadata.iter().map(|(_, value)| *value).collect(),
    };
    Ok(Some(Encoded::new(topic, time.stamp, Stamp(told.arrival.realtime_ns), &message)))
}

/// The counter that tells lost frames.
pub fn counter(told: &FrameHeader) -> u64 {
    told.metadata(metadata::FRAME_COUNTER).and_then(|value| u64::try_from(value).ok()).unwrap_or(told.number)
}

fn swapped(bgr: &[u8]) -> Vec<u8> {
    bgr.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0]]).collect()
}

/// A camera's calibration as ROS tells it. A lens that ROS has no name for keeps its own, and readers refuse it rather
/// than take it for another.
pub fn camera_info(header: Header, lens: &Intrinsics) -> CameraInfo {
    let [fx, fy, cx, cy] = [lens.fx, lens.fy, lens.cx, lens.cy].map(f64::from);
    let bent = lens.coefficients.iter().any(|value| *value != 0.0);
    let distortion_model = match lens.model {
        LensModel::ModifiedBrownConrady if bent => "modified_brown_conrady",
        LensModel::InverseBrownConrady if bent => "inverse_brown_conrady",
        LensModel::FTheta if bent => "f_theta",
        LensModel::KannalaBrandt if bent => "equidistant",
        _ => "plumb_bob",
    };
    CameraInfo {
        header,
        height: lens.height,
        width: lens.width,
        distortion_model: distortion_model.to_owned(),
        d: lens.coefficients.map(f64::from).to_vec(),
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        binning_x: 0,
        binning_y: 0,
        roi: RegionOfInterest::default(),
    }
}

/// The camera's identifier of a stream.
pub fn stream_id(stream: Stream) -> Option<StreamId> {
    let kind = match stream {
        Stream::Color => StreamKind::Color,
        Stream::Depth => StreamKind::Depth,
        Stream::Gyro => StreamKind::Gyro,
        Stream::Accel => StreamKind::Accel,
        Stream::Mocap => return None,
    };
    Some(StreamId::only(kind))
}
