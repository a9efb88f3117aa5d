//! Two cameras on one rig, and depth seen from the other one.

use serde::{Deserialize, Serialize};

/// How a lens bends. The five coefficients are k1, k2, p1, p2, k3.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// A pinhole picture.
    #[default]
    None,
    /// Brown-Conrady with the tangential part taken from the radially bent point.
    ModifiedBrownConrady,
    /// Brown-Conrady from the bent point to the straight one: what the colour camera of a RealSense is told by.
    InverseBrownConrady,
    /// Equidistant by one angle.
    FTheta,
    /// Brown-Conrady from the straight point to the bent one, ROS `plumb_bob`.
    BrownConrady,
    /// Equidistant by a polynomial of four.
    KannalaBrandt,
}

/// A camera as a RealSense tells it, in its own precision; pixel centres at whole numbers, the first at (0, 0).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f32,
    /// Focal length along y, pixels.
    pub fy: f32,
    /// Principal point, column.
    pub cx: f32,
    /// Principal point, row.
    pub cy: f32,
    /// Lens.
    pub model: LensModel,
    /// Its coefficients.
    pub coefficients: [f32; 5],
}

/// A rigid motion `target_from_source`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Extrinsics {
    /// Rotation matrix, **column after column**, as the vendor and realsense-ros have it.
    pub rotation: [f32; 9],
    /// Translation, metres.
    pub translation: [f32; 3],
}
