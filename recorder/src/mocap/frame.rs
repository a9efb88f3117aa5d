//! One frame of a motion capture system.

use crate::Arrival;
use schemas::msg::MocapTimecode;
use slam_math::Se3;

/// Everything that a system says about one of its frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MocapFrame {
    /// The system's own number; gaps are lost frames. VRPN has none.
    pub number: Option<u64>,
    /// The cameras' own number.
    pub hardware_frame: Option<u32>,
    /// Frames a second by the system's clock.
    pub rate_hz: Option<f64>,
    /// When the last byte of the frame was read.
    pub arrival: Arrival,
    /// The sending computer's realtime clock, nanoseconds since 1970 (VRPN).
    pub source_stamp_ns: Option<i64>,
    /// Steps of processing since the picture was taken, in order.
    pub latency: Vec<LatencySample>,
    /// Round trip of the last ping, seconds. It holds the wait for the server's next packet, up to a frame, so half of it
    /// bounds the network's delay from above.
    pub ping_round_trip_s: Option<f64>,
    /// Datagrams since the last frame that were not the protocol (UDP only; elsewhere they end the connection).
    pub discarded: u32,
    /// SMPTE timecode.
    pub timecode: Option<MocapTimecode>,
    /// Every known segment, occluded ones too.
    pub bodies: Vec<MocapBody>,
    /// Labelled markers, then unlabelled ones; empty unless asked for.
    pub markers: Vec<MocapMarker>,
}

/// One step of the system's processing.
#[derive(Debug, Clone, PartialEq)]
pub struct LatencySample {
    /// Name of the step.
    pub name: String,
    /// Seconds since the step before.
    pub seconds: f64,
}

/// One segment of one subject.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MocapBody {
    /// Subject, as the system names it.
    pub subject: String,
    /// Segment; a rigid body has one, usually of the subject's name.
    pub segment: String,
    /// Parent segment; empty for the root.
    pub parent: String,
    /// Pose of the segment in the system's world, metres; `None` while occluded.
    pub world_from_segment: Option<Se3>,
    /// The pose is exactly zero or exactly the one before, in a protocol that cannot say "occluded".
    pub suspect: bool,
    /// How well the markers fit, 0..=1.
    pub quality: Option<f64>,
    /// The subject's health, 0..=1.
    pub health: Option<f64>,
    /// Marker error, metres.
    pub marker_error_m: Option<f64>,
}

/// One reconstructed marker.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MocapMarker {
    /// Subject; empty for an unlabelled marker.
    pub subject: String,
    /// Name; empty for an unlabelled marker.
    pub name: String,
    /// In the system's world, metres.
    pub position_m: [f64; 3],
    /// Metres.
    pub radius_m: f64,
    /// The same number as long as the system follows the marker.
    pub trajectory_id: u32,
}

impl MocapFrame {
    /// Time from the picture to the frame's leaving the system, seconds; `None` if the system does not tell, or tells
    /// what cannot be: a negative time, more than ten seconds, no number.
    #[must_use]
    pub fn latency_s(&self) -> Option<f64> {
        let sum = self.latency.iter().fold(0.0, |sum, sample| sum + sample.seconds);
        (!self.latency.is_empty() && (0.0..=10.0).contains(&sum)).then_some(sum)
    }
}
