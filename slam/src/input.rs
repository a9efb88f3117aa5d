//! What the world gave for one frame. Everything here is immutable; the slam never sees a file, a topic or a codec.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{FrameId, Stamp};
use slam_vision::{Camera, GrayImage};

/// Depth image registered to the colour camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DepthImage {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major depth along the optical axis in sensor units; 0 = no measurement.
    pub units: Vec<u16>,
    /// Metres per sensor unit.
    pub metres_per_unit: f64,
}

impl DepthImage {
    /// Depth in metres at a pixel; `None` outside the picture and where nothing was measured.
    #[must_use]
    pub fn metres(&self, x: i64, y: i64) -> Option<f64> {
        if x < 0 || y < 0 || x >= self.width as i64 || y >= self.height as i64 {
            return None;
        }
        let units = self.units[y as usize * self.width + x as usize];
        (units > 0).then(|| f64::from(units) * self.metres_per_unit)
    }
}

/// One segment of a panoptic mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Value in [`PanopticMask::ids`], 1..65535.
    pub id: u16,
    /// Category, see [`Category::id`].
    pub category: u16,
    /// Confidence 0..1 as the network gave it; 1 when it gave none.
    pub score: f32,
}

/// Panoptic segmentation of one picture, as logged.
#[derive(Debug, Clone, PartialEq)]
pub struct PanopticMask {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major segment id per pixel; 0 = unknown (no segment claims it).
    pub ids: Vec<u16>,
    /// The segments, sorted by id.
    pub segments: Vec<Segment>,
}

impl PanopticMask {
    /// Segment id at a pixel, 0 outside the picture.
    #[must_use]
    pub fn at(&self, x: i64, y: i64) -> u16 {
        if x < 0 || y < 0 || x >= self.width as i64 || y >= self.height as i64 {
            return 0;
        }
        self.ids[y as usize * self.width + x as usize]
    }

    /// The segment with this id.
    #[must_use]
    pub fn segment(&self, id: u16) -> Option<&Segment> {
        self.segments.binary_search_by_key(&id, |s| s.id).ok().map(|i| &self.segments[i])
    }
}

/// A category of the label set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Category {
    /// Number used in the masks.
    pub id: u16,
    /// Name, such as "person".
    pub name: String,
    /// True for countable objects (Things), false for Stuff.
    pub is_thing: bool,
}

/// What the camera is made of, and with it where depth comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Sensor {
    /// A depth image registered to the picture.
    #[default]
    Rgbd,
    /// A second camera to the right; both pictures are rectified, so that a point lies on one row in both.
    Stereo {
        /// Baseline times focal length, metres x pixels.
        bf: f64,
    },
    /// The picture alone: lengths are known up to one factor, which the first map chooses.
    Monocular,
}

impl Sensor {
    /// Name for tables and records.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgbd => "rgbd",
            Self::Stereo { .. } => "stereo",
            Self::Monocular => "monocular",
        }
    }
}

/// What is known before the first frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Intrinsics of the camera; of a stereo camera those of the rectified left picture.
    pub camera: Camera,
    /// Where depth comes from.
    pub sensor: Sensor,
    /// The label set of the segmentation; empty when there is none.
    pub categories: Vec<Category>,
}

/// One frame.
#[derive(Debug, Clone)]
pub struct FrameInput {
    /// Position in the replay.
    pub id: FrameId,
    /// Sensor time.
    pub stamp: Stamp,
    /// Grey picture; of a stereo camera the left one, rectified.
    pub gray: GrayImage,
    /// The rectified right picture of a stereo camera.
    pub right: Option<GrayImage>,
    /// Depth, when the frame has one.
    pub depth: Option<Arc<DepthImage>>,
    /// Segmentation, when the frame has one.
    pub panoptic: Option<Arc<PanopticMask>>,
}
