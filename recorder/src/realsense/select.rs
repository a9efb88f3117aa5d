//! From a wish to stream profiles.

use super::context::CameraError;
use super::finding::Finding;
use super::types::{DeviceDescription, Format, StreamId, StreamKind, StreamProfile};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Size and rate of a picture stream, as `640x480@30`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct VideoMode {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pictures a second.
    pub rate_hz: u32,
}

impl fmt::Display for VideoMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}@{}", self.width, self.height, self.rate_hz)
    }
}

impl FromStr for VideoMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = || {
            let (size, rate) = text.split_once('@')?;
            let (width, height) = size.split_once('x')?;
            Some(Self { width: width.parse().ok()?, height: height.parse().ok()?, rate_hz: rate.parse().ok()? })
        };
        numbers().ok_or_else(|| format!("`{text}` is not a size and a rate like 640x480@30"))
    }
}

/// What to record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Wish {
    /// Colour.
    pub color: Option<VideoMode>,
    /// Depth.
    pub depth: Option<VideoMode>,
    /// Gyroscope and accelerometer, where the camera has them.
    pub imu: bool,
}

/// Profiles for a wish.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// One a stream.
    pub profiles: Vec<StreamProfile>,
    /// What should be refused unless allowed: a slow USB link, a profile other than the one asked for, no IMU.
    pub findings: Vec<Finding>,
}

/// Inertial streams: the highest rate up to this one. Above it a D435i repeats itself more than it tells about a robot.
const MAX_IMU_RATE_HZ: u32 = 250;

/// Chooses profiles. What the camera cannot do exactly is replaced by the nearest and told.
pub(super) fn select(camera: &DeviceDescription, wish: &Wish) -> Result<Selection, CameraError> {
    let mut profiles = Vec::new();
    let mut findings: Vec<Finding> = Finding::of_link(camera).into_iter().collect();
    let videos = [
        (StreamKind::Depth, &[Format::Z16][..], wish.depth),
        (StreamKind::Color, &[Format::Rgb8, Format::Bgr8][..], wish.color),
    ];
    for (kind, formats, mode) in videos {
        let Some(mode) = mode else { continue };
        let stream = StreamId::only(kind);
        let chosen = nearest(camera, kind, formats, mode).ok_or_else(|| no_stream(camera, stream))?;
        if (chosen.width, chosen.height, chosen.rate_hz) != (mode.width, mode.height, mode.rate_hz) {
            findings.push(Finding::OtherProfile { stream: chosen.stream, wanted: mode, offered: chosen });
        }
        profiles.push(chosen);
    }
    for kind in [StreamKind::Gyro, StreamKind::Accel].into_iter().filter(|_| wish.imu) {
        let slow_enough = |p: &&StreamProfile| p.rate_hz <= MAX_IMU_RATE_HZ;
        let all = || offered(camera).filter(|p| p.stream.kind == kind && p.format == Format::MotionXyz32f);
        let best = all().filter(slow_enough).max_by_key(|p| p.rate_hz);
        match best.or_else(|| all().min_by_key(|p| p.rate_hz)) {
            Some(profile) => profiles.push(*profile),
            None => findings.push(Finding::NoImu { stream: StreamId::only(kind) }),
        }
    }
    Ok(Selection { profiles, findings })
}

fn offered(camera: &DeviceDescription) -> impl Iterator<Item = &StreamProfile> {
    camera.sensors.iter().flat_map(|sensor| &sensor.profiles)
}

/// The profile that is nearest in pixels, then in rate, then in the order of the formats.
fn nearest(camera: &DeviceDescription, kind: StreamKind, formats: &[Format], mode: VideoMode) -> Option<StreamProfile> {
    let VideoMode { width, height, rate_hz } = mode;
    let distance = |p: &&StreamProfile| {
        let size = u64::from(p.width.abs_diff(width)) + u64::from(p.height.abs_diff(height));
        (size, p.rate_hz.abs_diff(rate_hz), formats.iter().position(|format| *format == p.format))
    };
    offered(camera).filter(|p| p.stream.kind == kind && formats.contains(&p.format)).min_by_key(distance).copied()
}

fn no_stream(camera: &DeviceDescription, stream: StreamId) -> CameraError {
    let mut offered: Vec<String> = offered(camera).map(|profile| profile.stream.to_string()).collect();
    offered.sort();
    offered.dedup();
    let (name, serial) = (camera.name.clone(), camera.serial.clone());
    CameraError::Stream { name, serial, stream: stream.to_string(), offered }
}
