//! Time and header.

use crate::message::cdr_struct;
use crate::stamp::{Stamp, StampError};

cdr_struct! {
    /// `builtin_interfaces/Time`.
    #[derive(Copy, Eq, Default)]
    pub struct Time: "builtin_interfaces/msg/Time" {
        /// Whole seconds.
        pub sec: i32,
        /// Nanoseconds beyond, below 1e9.
        pub nanosec: u32,
    }
}

cdr_struct! {
    /// `std_msgs/Header`: when and in which frame.
    #[derive(Eq, Default)]
    pub struct Header: "std_msgs/msg/Header" {
        /// Time of the measurement on the log's timeline.
        pub stamp: Time,
        /// Name of the coordinate frame, see [`crate::topics::frame`].
        pub frame_id: String,
    }
}

impl Header {
    /// A header for a stamp in a named frame.
    ///
    /// # Errors
    /// The stamp does not fit a ROS time.
    pub fn new(stamp: Stamp, frame_id: &str) -> Result<Self, StampError> {
        Ok(Self { stamp: Time::try_from(stamp)?, frame_id: frame_id.to_owned() })
    }
}

impl TryFrom<Stamp> for Time {
    type Error = StampError;

    fn try_from(stamp: Stamp) -> Result<Self, StampError> {
        let (sec, nanosec) = (stamp.0.div_euclid(1_000_000_000), stamp.0.rem_euclid(1_000_000_000));
        match i32::try_from(sec) {
            Ok(sec) if sec >= 0 => Ok(Self { sec, nanosec: nanosec as u32 }),
            _ => Err(StampError::NotRosTime(stamp.0)),
        }
    }
}

impl From<Time> for Stamp {
    fn from(time: Time) -> Self {
        Self(i64::from(time.sec) * 1_000_000_000 + i64::from(time.nanosec))
    }
}
