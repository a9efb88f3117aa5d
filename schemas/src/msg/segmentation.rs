//! Labels: which category a class id means, and the segments of one frame.

use super::Header;
use crate::message::cdr_struct;

/// [`Segment::score`] when the source tells none.
pub const SCORE_UNKNOWN: f32 = -1.0;

cdr_struct! {
    /// `vision_msgs/VisionClass`: a class id's name.
    #[derive(Eq, Default)]
    pub struct VisionClass: "vision_msgs/msg/VisionClass" {
        /// Value in the class image.
        pub class_id: u16,
        /// Name, as `person`.
        pub class_name: String,
    }
}

cdr_struct! {
    /// `vision_msgs/LabelInfo`: the names of a class image's values, for tools that know no more than that.
    #[derive(Default)]
    pub struct LabelInfo: "vision_msgs/msg/LabelInfo" {
        /// Stamp of the first frame that it holds for.
        pub header: Header,
        /// One entry a class, ids ascending.
        pub class_map: Vec<VisionClass>,
        /// Confidence below which a pixel was not labelled; 0 = not told.
        pub threshold: f32,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/Category`: a class with its kind.
    #[derive(Eq, Default)]
    pub struct Category: "panoptic_slam_msgs/msg/Category" {
        /// Value in the class image; never 0, which is void.
        pub id: u16,
        /// Name, as `person`.
        pub name: String,
        /// True for countable Things, false for Stuff (wall, floor).
        pub is_thing: bool,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/CategoryTable`: all categories of a layer, once in a log.
    #[derive(Eq, Default)]
    pub struct CategoryTable: "panoptic_slam_msgs/msg/CategoryTable" {
        /// Stamp of the first frame that it holds for.
        pub header: Header,
        /// Name of the segmentation layer.
        pub layer: String,
        /// Ids ascending, each once.
        pub categories: Vec<Category>,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/Segment`: one segment of one frame.
    #[derive(Copy, Default)]
    pub struct Segment: "panoptic_slam_msgs/msg/Segment" {
        /// Value in the instance image; never 0, which is void.
        pub id: u16,
        /// Value in the class image.
        pub category_id: u16,
        /// Confidence 0..=1, or [`SCORE_UNKNOWN`].
        pub score: f32,
        /// Left border of the box, pixels.
        pub x: u32,
        /// Upper border of the box, pixels.
        pub y: u32,
        /// Width of the box, pixels.
        pub width: u32,
        /// Height of the box, pixels.
        pub height: u32,
        /// Pixels of the segment.
        pub area: u32,
        /// Whether it stands for several Things that nobody told apart.
        pub is_crowd: bool,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/SegmentTable`: all segments of one frame.
    #[derive(Default)]
    pub struct SegmentTable: "panoptic_slam_msgs/msg/SegmentTable" {
        /// Stamp of the colour picture that was segmented, and its optical frame.
        pub header: Header,
        /// Name of the segmentation layer.
        pub layer: String,
        /// Ids ascending, each once.
        pub segments: Vec<Segment>,
    }
}
