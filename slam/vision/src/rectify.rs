//! A picture as another camera at the same place would have taken it: without lens distortion, turned.

use nalgebra::{Matrix3, Vector3};

use crate::{Camera, GrayImage, VisionError};

/// Fractions of a pixel are whole numbers of this size: interpolation is exact integer arithmetic.
const FRACTION: i64 = 256;
/// Source of a target pixel that the camera did not see.
const OUTSIDE: u32 = u32::MAX;

/// Where a target pixel comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Tap {
    /// Index of the upper left of four source pixels, or [`OUTSIDE`].
    index: u32,
    /// How far towards the right and the lower neighbour, in 256ths.
    weight: [u8; 2],
}

/// A table from target to source pixels, made once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rectifier {
    source: [usize; 2],
    target: [usize; 2],
    taps: Vec<Tap>,
}

impl Rectifier {
    /// The table from pictures of `source` to those of `target`, a camera without distortion; `target_from_source` is the
    /// rotation between their frames.
    ///
    /// # Errors
    /// An impossible camera.
    pub fn new(source: &Camera, target: &Camera, target_from_source: &Matrix3<f64>) -> Result<Self, VisionError> {
        source.validate()?;
        target.validate()?;
        let source_from_target = target_from_source.transpose();
        let mut taps = Vec::with_capacity(target.width as usize * target.height as usize);
        for y in 0..target.height {
            for x in 0..target.width {
                let ray: Vector3<f64> = source_from_target * target.unproject([f64::from(x), f64::from(y)], 1.0);
                let seen = source.project(ray).map(|pixel| source.distort(pixel));
                taps.push(seen.map_or(Tap::NONE, |pixel| Tap::at(source, pixel)));
            }
        }
        let size = |camera: &Camera| [camera.width as usize, camera.height as usize];
        Ok(Self { source: size(source), target: size(target), taps })
    }

    /// The picture by bilinear interpolation; black where the camera saw nothing.
    ///
    /// Panics when the picture has not the source camera's size.
    #[must_use]
    pub fn picture(&self, source: &GrayImage) -> GrayImage {
        assert_eq!([source.width, source.height], self.source, "the picture has the calibration's size");
        let [width, height] = self.source;
        let mut target = GrayImage::new(self.target[0], self.target[1], 0);
        for (out, tap) in target.data.iter_mut().zip(&self.taps).filter(|(_, tap)| tap.index != OUTSIDE) {
            let at = tap.index as usize;
            let right = usize::from(at % width + 1 < width);
            let below = if at / width + 1 < height { width } else { 0 };
            let [wx, wy] = tap.weight.map(u32::from);
            let value = |i: usize| u32::from(source.data[i]);
            let above = value(at) * (256 - wx) + value(at + right) * wx;
            let under = value(at + below) * (256 - wx) + value(at + below + right) * wx;
            *out = ((above * (256 - wy) + under * wy + (1 << 15)) >> 16) as u8;
        }
        target
    }

    /// Labels by the nearest source pixel; 0 where the camera saw nothing.
    ///
    /// Panics when there are not as many labels as source pixels.
    #[must_use]
    pub fn labels(&self, source: &[u16]) -> Vec<u16> {
        let [width, height] = self.source;
        assert_eq!(source.len(), width * height, "a label a source pixel");
        let nearest = |tap: &Tap| {
            if tap.index == OUTSIDE {
                return 0;
            }
            let at = tap.index as usize;
            let right = usize::from(tap.weight[0] >= 128 && at % width + 1 < width);
            let below = usize::from(tap.weight[1] >= 128 && at / width + 1 < height);
            source[at + right + below * width]
        };
        self.taps.iter().map(nearest).collect()
    }

    /// Source position of a target pixel, rounded to a 256th of a pixel; `None` where the camera saw nothing.
    #[must_use]
    pub fn source_of(&self, x: usize, y: usize) -> Option<[f64; 2]> {
        let tap = self.taps.get(y * self.target[0] + x).filter(|tap| x < self.target[0] && tap.index != OUTSIDE)?;
        let at = tap.index as usize;
        let part = tap.weight.map(|w| f64::from(w) / FRACTION as f64);
        Some([(at % self.source[0]) as f64 + part[0], (at / self.source[0]) as f64 + part[1]])
    }
}

impl Tap {
    const NONE: Self = Self { index: OUTSIDE, weight: [0; 2] };

    fn at(source: &Camera, pixel: [f64; 2]) -> Self {
        // The cast saturates, so what is far outside stays outside; NaN becomes 0 and is caught before.
        let fixed = pixel.map(|v| (v * FRACTION as f64 + 0.5).floor() as i64);
        let last = [source.width, source.height].map(|n| (i64::from(n) - 1) * FRACTION);
        let inside = (0..2).all(|i| pixel[i].is_finite() && (0..=last[i]).contains(&fixed[i]));
        if !inside {
            return Self::NONE;
        }
        let [x, y] = fixed.map(|v| v / FRACTION);
        let weight = fixed.map(|v| (v % FRACTION) as u8);
        Self { index: (y * i64::from(source.width) + x) as u32, weight }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Distortion;

    /// Left camera of the EuRoC MAV dataset, its rectification by OpenCV 5.0 (`stereoRectify`, alpha 0).
    fn euroc() -> (Camera, Camera, Matrix3<f64>) {
        let distortion =
            Distortion::Radtan { k1: -0.28340811, k2: 0.07395907, p1: 0.00019359, p2: 1.76187114e-05, k3: 0.0 };
        let raw = Camera { fx: 458.654, fy: 457.296, cx: 367.215, cy: 248.375, width: 752, height: 480, distortion };
        let f = 436.24429564709504;
        let (cx, cy) = (364.44123458862305, 256.95167541503906);
        let straight = Camera { fx: f, fy: f, cx, cy, distortion: Distortion::None, ..raw };
        let rotation = Matrix3::new(
            0.9999663475300331,
            -0.00142273913872113,
            0.00807958048341901,
            0.0013657418346425,
            0.9999741760894848,
            0.00705562919925044,
            -0.00808941015686568,
            -0.00704435713882815,
            0.9999424675829178,
        );
        (raw, straight, rotation)
    }

    /// Target pixel and where OpenCV 5.0's `initUndistortRectifyMap` takes it from.
    const OPENCV_MAP: [([usize; 2], [f64; 2]); 8] = [
        ([3, 3], [63.908485, 36.123318]),
        ([364, 257], [363.040833, 245.204895]),
        ([751, 0], [678.190369, 37.355251]),
        ([100, 400], [118.679298, 378.302490]),
        ([640, 300], [623.246765, 285.546539]),
        ([745, 475], [679.320312, 425.300812]),
        ([10, 470], [64.152306, 426.273163]),
        ([500, 20], [491.912689, 21.652260]),
    ];

    #[test]
    fn the_table_is_that_of_opencv() {
        let (raw, straight, rotation) = euroc();
        let table = Rectifier::new(&raw, &straight, &rotation).unwrap();
        for (pixel, expected) in OPENCV_MAP {
            let [x, y] = table.source_of(pixel[0], pixel[1]).unwrap();
            let off = [(x - expected[0]).abs(), (y - expected[1]).abs()];
            assert!(off.iter().all(|v| *v <= 0.5 / 256.0 + 1e-4), "{pixel:?}: {x} {y}, OpenCV {expected:?}");
        }
        assert_eq!(table.source_of(752, 0), None);
        assert_eq!(table.source_of(0, 480), None);
    }

    #[test]
    fn a_picture_equals_interpolation_in_floating_point() {
        let (raw, straight, rotation) = euroc();
        let table = Rectifier::new(&raw, &straight, &rotation).unwrap();
        let mut rng = slam_math::Rng::at(1, 0, 0, 0);
        let data = (0..752 * 480).map(|_| rng.below(256) as u8).collect();
        let source = GrayImage::from_vec(752, 480, data).unwrap();
        let target = table.picture(&source);
        for y in (0..480).step_by(7) {
            for x in (0..752).step_by(5) {
                let Some([u, v]) = table.source_of(x, y) else {
                    assert_eq!(target.get(x, y), Some(0));
                    continue;
                };
                let (u0, v0) = (u.floor(), v.floor());
                let at = |dx: usize, dy: usize| {
                    f64::from(source.get((u0 as usize + dx).min(751), (v0 as usize + dy).min(479)).unwrap())
                };
                let line = |dy: usize| at(0, dy) * (1.0 - (u - u0)) + at(1, dy) * (u - u0);
                let value = line(0) * (1.0 - (v - v0)) + line(1) * (v - v0);
                let found = f64::from(target.get(x, y).unwrap());
                assert!((found - value).abs() <= 0.5 + 1e-9, "{x} {y}: {found}, wanted {value}");
            }
        }
    }

    #[test]
    fn the_same_camera_changes_nothing_and_what_is_not_seen_is_void() {
        let (_, straight, _) = euroc();
        let table = Rectifier::new(&straight, &straight, &Matrix3::identity()).unwrap();
        let data: Vec<u8> = (0..752 * 480).map(|i| (i * 7 % 251) as u8).collect();
        let source = GrayImage::from_vec(752, 480, data).unwrap();
        assert_eq!(table.picture(&source), source);
        let labels: Vec<u16> = (0..752 * 480).map(|i| i as u16).collect();
        assert_eq!(table.labels(&labels), labels);
        let behind = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0));
        let table = Rectifier::new(&straight, &straight, &behind).unwrap();
        assert!(table.picture(&source).data.iter().all(|v| *v == 0));
        assert!(table.labels(&labels).iter().all(|v| *v == 0));
    }
}
