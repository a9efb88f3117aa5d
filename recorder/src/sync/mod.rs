//! One clock and one frame for camera and motion capture, found after the fact from what was recorded.
//!
//! Stamps are never rewritten. What is estimated here are numbers to be applied by a reader, each with its quality:
//!
//! - [`fit_clock`]: a device clock against the host's, from arrival times;
//! - [`estimate_offset`]: offset and drift between camera time and mocap time, from angular velocities;
//! - [`hand_eye()`]: the transform between marker body and camera, from relative motions;
//! - [`solve`]: all of it from the signals of a log, as the record that [`append_record`] puts into the log.
//!
//! What the motion does not show is said to be unobservable, with what motion to add. Times are nanoseconds on the
//! clock of their source; the estimators work in seconds from the first sample, where a double resolves far below a
//! nanosecond.

mod append;
mod clock;
mod correlation;
mod gather;
mod hand_eye;
mod offset;
mod refine;
mod signal;
mod solve;

pub use append::append_record;
pub use clock::fit_clock;
pub use gather::Gathering;
pub use hand_eye::{HandEyeOptions, hand_eye};
pub use offset::{OffsetOptions, estimate_offset};
pub use refine::DriftPrior;
pub use signal::{AngularVelocity, from_gyro, from_poses};
pub use solve::{SyncOptions, is_of, solve};

/// Why nothing can be said.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SyncError {
    /// Less data than the method needs.
    #[error("{what}: {found} where at least {needed} are needed")]
    TooFew {
        /// Of what.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are needed.
        needed: usize,
    },
    /// The motion does not show the quantity.
    #[error("{what} cannot be observed: {reason}; {advice}")]
    Unobservable {
        /// Which quantity.
        what: &'static str,
        /// What is missing, with numbers.
        reason: String,
        /// Which motion to add.
        advice: &'static str,
    },
    /// The two signals do not belong together.
    #[error("{what}: {reason}")]
    NoAgreement {
        /// Which quantity.
        what: &'static str,
        /// With numbers.
        reason: String,
    },
}

/// Seconds since `origin_ns`.
fn seconds(stamp_ns: i64, origin_ns: i64) -> f64 {
    (stamp_ns - origin_ns) as f64 * 1e-9
}
