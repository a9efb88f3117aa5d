//! What a keyframe's depth image is like around its keypoints, and how the camera moved when it was taken.

use slam_math::{Buffer, Buffers, Se3};

use crate::input::DepthImage;

/// Half side of the window that a plane is fitted to, pixels, and the distance of its samples: 9 x 9 of them. The noise of
/// structured light and of stereo is the same over some pixels, so that a smaller window gives slopes that are mostly noise.
const RADIUS_PX: i64 = 8;
const STRIDE_PX: usize = 2;
/// Samples that must have depth, of 81.
const MIN_SAMPLES: u32 = 60;

/// How depth changes around a keypoint, metres a pixel to the right and down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// Metres a pixel.
    pub metres_per_px: [f64; 2],
    /// Root mean square of what the plane does not explain, metres.
    pub rms_m: f64,
}

/// Of the camera from the last frame to this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The camera of the last frame from that of this one.
    pub last_from_now: Se3,
    /// Seconds between the two.
    pub seconds: f64,
}

/// One entry a keypoint.
#[derive(Debug, Clone, Default)]
pub struct DepthView {
    /// How depth changes around it; none at the edge of a surface, and where too little is measured.
    pub slopes: Buffer<Option<Slope>>,
    /// None after a loss.
    pub motion: Option<Motion>,
}

impl DepthView {
    /// Of a depth image at pixels as recorded.
    #[must_use]
    pub fn new(depth: &DepthImage, raw_pixels: &[[f64; 2]], motion: Option<Motion>, buffers: &Buffers) -> Self {
        let slopes = buffers.collect(raw_pixels.iter().map(|pixel| slope_at(depth, *pixel)));
        Self { slopes, motion }
    }
}

/// Plane through the depths around a pixel.
fn slope_at(depth: &DepthImage, pixel: [f64; 2]) -> Option<Slope> {
    let [cx, cy] = pixel.map(crate::observation::round_to_pixel);
    // Sums of 1, x, y, xx, xy, yy, z, xz, yz, zz.
    let (mut n, mut s) = (0, [0.0; 9]);
    for y in (-RADIUS_PX..=RADIUS_PX).step_by(STRIDE_PX) {
        for x in (-RADIUS_PX..=RADIUS_PX).step_by(STRIDE_PX) {
            if let Some(z) = depth.metres(cx + x, cy + y) {
                let (x, y) = (x as f64, y as f64);
                n += 1;
                for (sum, value) in s.iter_mut().zip([x, y, x * x, x * y, y * y, z, x * z, y * z, z * z]) {
                    *sum += value;
                }
            }
        }
    }
    if n < MIN_SAMPLES {
        return None;
    }
    let count = f64::from(n);
    let [x, y, xx, xy, yy, z, xz, yz, zz] = s.map(|sum| sum / count);
    let (xx, xy, yy) = (xx - x * x, xy - x * y, yy - y * y);
    let (xz, yz, zz) = (xz - x * z, yz - y * z, zz - z * z);
    let det = xx * yy - xy * xy;
    if det < 1.0 {
        return None;
    }
    let (a, b) = ((yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det);
    let left = slam_math::float::max(0.0, zz - a * xz - b * yz);
    Some(Slope { metres_per_px: [a, b], rms_m: left.sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(depth_m: impl Fn(f64, f64) -> f64) -> DepthImage {
        let units = (0..40 * 40).map(|i| (depth_m(f64::from(i % 40), f64::from(i / 40)) * 5000.0) as u16).collect();
        DepthImage { width: 40, height: 40, units, metres_per_unit: 1.0 / 5000.0 }
    }

    #[test]
    fn a_plane_has_its_slope_and_an_edge_is_no_plane() {
        let plane = slope_at(&image(|x, y| 2.0 + 0.01 * x - 0.004 * y), [20.0, 20.0]).unwrap();
        let [gx, gy] = plane.metres_per_px;
        assert!((gx - 0.01).abs() < 1e-4 && (gy + 0.004).abs() < 1e-4 && plane.rms_m < 2e-4, "{plane:?}");
        let edge = slope_at(&image(|x, _| if x < 20.0 { 1.0 } else { 3.0 }), [20.0, 20.0]).unwrap();
        assert!(edge.rms_m > 0.3, "{edge:?}");
        assert_eq!(
            slope_at(&image(|x, _| if x < 20.0 { 0.0 } else { 3.0 }), [20.0, 20.0]),
            None,
            "half of it is a hole"
        );
        assert_eq!(slope_at(&image(|_, _| 2.0), [1.0, 20.0]), None, "beyond the border there is nothing");
    }
}
