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
        let is_some = |mode: &Self| mode.width > 0 && mode.height > 0 && mode.rate_hz > 0;
        numbers().filter(is_some).ok_or_else(|| format!("`{text}` is not a size and a rate like 640x480@30"))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::realsense::SensorDescription;

    fn camera(usb: &str, motion_rates: &[u32]) -> DeviceDescription {
        let profile = |kind, format, width, height, rate_hz| StreamProfile {
            stream: StreamId::only(kind),
            format,
            width,
            height,
            rate_hz,
        };
        let mut profiles = vec![
            profile(StreamKind::Color, Format::Yuyv, 640, 480, 30),
            profile(StreamKind::Color, Format::Bgr8, 640, 480, 30),
            profile(StreamKind::Color, Format::Rgb8, 640, 480, 30),
            profile(StreamKind::Color, Format::Rgb8, 640, 480, 60),
            profile(StreamKind::Depth, Format::Z16, 848, 480, 30),
            profile(StreamKind::Depth, Format::Z16, 1280, 720, 30),
        ];
        for rate_hz in motion_rates {
            profiles.push(profile(StreamKind::Gyro, Format::MotionXyz32f, 0, 0, *rate_hz));
            profiles.push(profile(StreamKind::Accel, Format::MotionXyz32f, 0, 0, *rate_hz));
        }
        DeviceDescription {
            name: "D".to_owned(),
            serial: "1".to_owned(),
            firmware: None,
            usb: Some(usb.to_owned()),
            product_id: None,
            more: Vec::new(),
            recording: None,
            sensors: vec![SensorDescription { name: String::new(), options: Vec::new(), profiles }],
        }
    }

    fn mode(text: &str) -> Option<VideoMode> {
        Some(text.parse().unwrap())
    }

    #[test]
    fn modes_are_read_and_told() {
        assert_eq!(mode("640x480@30").unwrap().to_string(), "640x480@30");
        for bad in ["", "640x480", "640@30", "x@", "640x480@-1", "640x480@30@30", "a x b@c"] {
            assert!(bad.parse::<VideoMode>().is_err(), "{bad}");
        }
    }

    #[test]
    fn an_exact_wish_has_no_findings() {
        let wish = Wish { color: mode("640x480@30"), depth: mode("848x480@30"), imu: true };
        let Selection { profiles, findings } = select(&camera("3.2", &[63, 200, 400]), &wish).unwrap();
        let told: Vec<String> = profiles.iter().map(ToString::to_string).collect();
        assert_eq!(told, ["depth 848x480@30 Z16", "color 640x480@30 Rgb8", "gyro @200", "accel @200"]);
        assert_eq!(findings, []);
    }

    #[test]
    fn the_nearest_is_offered_and_told() {
        let wish = Wish { color: mode("640x480@90"), depth: mode("800x480@30"), imu: true };
        let Selection { profiles, findings } = select(&camera("2.1", &[]), &wish).unwrap();
        let told: Vec<String> = profiles.iter().map(ToString::to_string).collect();
        assert_eq!(told, ["depth 848x480@30 Z16", "color 640x480@60 Rgb8"]);
        let allowed: Vec<&str> = findings.iter().map(Finding::allowed_by).collect();
        let profile = "--allow-other-profile";
        assert_eq!(allowed, ["--allow-usb2", profile, profile, profile, profile]);
        assert!(findings[0].to_string().contains("USB 2.1"));
        assert!(findings[1].to_string().contains("depth 800x480@30; nearest is depth 848x480@30"), "{}", findings[1]);
    }

    #[test]
    fn a_stream_that_is_not_there_is_an_error() {
        let mut blind = camera("3.2", &[400]);
        blind.sensors[0].profiles.retain(|profile| profile.stream.kind != StreamKind::Depth);
        let error = select(&blind, &Wish { depth: mode("640x480@30"), ..Wish::default() }).unwrap_err().to_string();
        assert_eq!(error, "D (1) has no depth stream; it has accel, color, gyro");
        // A rate above what is asked for is better than none.
        let imu = select(&blind, &Wish { imu: true, ..Wish::default() }).unwrap();
        assert_eq!(imu.profiles.iter().map(|profile| profile.rate_hz).collect::<Vec<_>>(), [400, 400]);
    }
}
