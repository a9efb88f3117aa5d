//! Stamps and identifiers. Identifiers count up in creation order and are never reused, so sorting by id is sorting by
//! age: the canonical order everywhere.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Nanoseconds on the log's one timeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Stamp(pub i64);

impl Stamp {
    /// Seconds as a float, for plots and human eyes only.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

macro_rules! id {
    ($(#[$doc:meta])* $name:ident, $letter:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
        pub struct $name(pub u32);

        impl $name {
            /// Position in an [`IdVec`](crate::IdVec).
            #[must_use]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!($letter, "{}"), self.0)
            }
        }

        impl From<usize> for $name {
            fn from(index: usize) -> Self {
                Self(u32::try_from(index).expect("more than 2^32 items in one map"))
            }
        }
    };
}

id!(/// Position of a frame in the replay, from 0.
    FrameId, "f");
id!(/// A keyframe.
    KeyFrameId, "kf");
id!(/// A map point.
    MapPointId, "mp");
id!(/// A map of the atlas: the part of the world seen since the last unrecovered loss of track.
    MapId, "map");
