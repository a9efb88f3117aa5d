//! The streams of a recording.

use crate::realsense::{StreamId, StreamKind};
use schemas::topics::{self, frame};
use serde::{Serialize, Serializer};

/// A stream that is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stream {
    /// Colour pictures.
    Color,
    /// Native depth.
    Depth,
    /// Angular velocity.
    Gyro,
    /// Acceleration.
    Accel,
    /// Motion capture frames.
    Mocap,
}

impl Stream {
    /// All of them; a stream's position here is its [`Stream::index`].
    pub const ALL: [Self; 5] = [Self::Color, Self::Depth, Self::Gyro, Self::Accel, Self::Mocap];

    /// Position in [`Stream::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// The recorded stream for a camera's; `None` for those that are not recorded.
    #[must_use]
    pub fn of_camera(id: StreamId) -> Option<Self> {
        match id.kind {
            StreamKind::Color => Some(Self::Color),
            StreamKind::Depth => Some(Self::Depth),
            StreamKind::Gyro => Some(Self::Gyro),
            StreamKind::Accel => Some(Self::Accel),
            StreamKind::Infrared | StreamKind::Other(_) => None,
        }
    }

    /// Name in records and on the screen.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Depth => "depth",
            Self::Gyro => "gyro",
            Self::Accel => "accel",
            Self::Mocap => "mocap",
        }
    }

    /// Its coordinate frame.
    #[must_use]
    pub fn frame(self) -> &'static str {
        match self {
            Self::Color => frame::CAMERA,
            Self::Depth => frame::DEPTH,
            Self::Gyro => frame::GYRO,
            Self::Accel => frame::ACCEL,
            Self::Mocap => frame::WORLD,
        }
    }

    /// Topic of clocks and metadata.
    #[must_use]
    pub fn metadata_topic(self) -> Option<&'static str> {
        match self {
            Self::Color => Some(topics::COLOR_METADATA),
            Self::Depth => Some(topics::DEPTH_NATIVE_METADATA),
            Self::Gyro => Some(topics::GYRO_METADATA),
            Self::Accel => Some(topics::ACCEL_METADATA),
            Self::Mocap => None,
        }
    }

    /// Whether its measurements are pictures: large, and worth a thread of their own.
    #[must_use]
    pub fn is_video(self) -> bool {
        matches!(self, Self::Color | Self::Depth)
    }
}

impl Serialize for Stream {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}
