//! What makes a recording worth less than its owner thinks, found before or at its start.

use super::select::VideoMode;
use super::types::{DeviceDescription, FrameHeader, StreamId, StreamProfile, TimestampDomain, metadata};
use serde::Serialize;
use std::fmt;

/// Something that should be refused unless the user allows it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Finding {
    /// A USB 2 link: too slow for most profiles, and the camera hides the others.
    SlowUsb {
        /// The link.
        usb: String,
    },
    /// A profile that the camera does not offer; the nearest is chosen.
    OtherProfile {
        /// The stream.
        stream: StreamId,
        /// Asked for.
        wanted: VideoMode,
        /// Nearest.
        offered: StreamProfile,
    },
    /// No inertial stream.
    NoImu {
        /// Which.
        stream: StreamId,
    },
    /// Frames are stamped by the host at arrival.
    SystemTime {
        /// The stream.
        stream: StreamId,
    },
    /// Frames lack metadata that a good recording needs.
    MissingMetadata {
        /// The stream.
        stream: StreamId,
        /// Names of the values.
        missing: Vec<&'static str>,
    },
}

impl Finding {
    /// The USB link, if it is too slow.
    #[must_use]
    pub fn of_link(camera: &DeviceDescription) -> Option<Self> {
        let usb = camera.usb.as_deref()?;
        let slow = usb.starts_with("1.") || usb.starts_with("2.");
        slow.then(|| Self::SlowUsb { usb: usb.to_owned() })
    }

    /// What is wrong with a frame's stamps and metadata.
    #[must_use]
    pub fn of_frame(header: &FrameHeader) -> Vec<Self> {
        let stream = header.stream;
        let mut findings = Vec::new();
        if header.domain == TimestampDomain::SystemTime {
            findings.push(Self::SystemTime { stream });
        }
        let mut missing = Vec::new();
        // Inertial samples of some firmware have no counter; librealsense's own number is then all there is.
        if stream.kind.is_video() && header.metadata(metadata::FRAME_COUNTER).is_none() {
            missing.push("Frame Counter");
        }
        if header.device_us().is_none() && header.domain != TimestampDomain::HardwareClock {
            missing.push("Sensor Timestamp");
        }
        if !missing.is_empty() {
            findings.push(Self::MissingMetadata { stream, missing });
        }
        findings
    }

    /// The option of `pslam record` that allows it.
    #[must_use]
    pub fn allowed_by(&self) -> &'static str {
        match self {
            Self::SlowUsb { .. } => "--allow-usb2",
            Self::OtherProfile { .. } | Self::NoImu { .. } => "--allow-other-profile",
            Self::SystemTime { .. } | Self::MissingMetadata { .. } => "--allow-missing-metadata",
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SlowUsb { usb } => {
                write!(f, "the camera is on a USB {usb} link: use a USB 3 port and cable, and plug it in quickly")
            }
            Self::OtherProfile { stream, wanted, offered } => {
                write!(f, "the camera does not offer {stream} {wanted}; nearest is {offered}")
            }
            Self::NoImu { stream } => write!(f, "the camera has no {stream}"),
            Self::SystemTime { stream } => write!(
                f,
                "{stream} frames are stamped by this computer at arrival, not by the camera: metadata is missing \
                 (kernel without the UVC patches? docs/recording.md)"
            ),
            Self::MissingMetadata { stream, missing } => {
                write!(
                    f,
                    "{stream} frames have no {} (kernel without the UVC patches? docs/recording.md)",
                    missing.join(", ")
                )
            }
        }
    }
}
