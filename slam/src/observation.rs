//! What the sensor said about one frame: keypoints with their depth and label. Never changes after it is made.

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, Buffers, DigestWriter};
use slam_vision::{Camera, Descriptor, Features, KeypointGrid};

use crate::config::SensorConfig;
use crate::input::{DepthImage, FrameInput, PanopticMask};

/// One entry a keypoint, arrays side by side.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Observation {
    /// Pixels as recorded (with lens distortion).
    pub raw_pixel: Buffer<[f64; 2]>,
    /// Pixels without lens distortion.
    pub pixel: Buffer<[f64; 2]>,
    /// Pyramid level.
    pub octave: Buffer<u8>,
    /// Orientation in radians.
    pub angle: Buffer<f32>,
    /// ORB descriptor.
    pub descriptor: Buffer<Descriptor>,
    /// Depth in metres; 0 = none.
    pub depth_m: Buffer<f64>,
    /// Panoptic segment id; 0 = unknown.
    pub label: Buffer<u16>,
    /// Look-up of keypoints by undistorted pixel.
    pub grid: KeypointGrid,
}

impl Observation {
    /// Reads depth and labels at the features of a frame.
    #[must_use]
    pub fn new(
        features: Features,
        input: &FrameInput,
        camera: &Camera,
        sensor: &SensorConfig,
        buffers: &Buffers,
    ) -> Self {
        let depth_of = |pixel: &[f32; 2]| {
            let depth = input.depth.as_deref()?;
            depth_at_corner(depth, pixel.map(f64::from), sensor)
        };
        let depth_m = buffers.collect(features.pixel.iter().map(|pixel| depth_of(pixel).unwrap_or(0.0)));
        Self::with_depth(features, depth_m, input.panoptic.as_deref(), camera, buffers)
    }

    /// The same with depth that is known already, metres, 0 = none.
    #[must_use]
    pub fn with_depth(
        features: Features,
        depth_m: Buffer<f64>,
        mask: Option<&PanopticMask>,
        camera: &Camera,
        buffers: &Buffers,
    ) -> Self {
        let raw_pixel = buffers.collect(features.pixel.iter().map(|p| p.map(f64::from)));
        let pixel = buffers.collect(raw_pixel.iter().map(|p| camera.undistort(*p)));
        let label = buffers.collect(raw_pixel.iter().map(|p| label_at(mask, *p)));
        let grid = KeypointGrid::build(&pixel, &features.octave, camera.undistorted_bounds(), buffers);
        Self {
            raw_pixel,
            pixel,
            octave: features.octave,
            angle: features.angle,
            descriptor: features.descriptor,
            depth_m,
            label,
            grid,
        }
    }

    /// Number of keypoints.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pixel.len()
    }

    /// True without keypoints.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pixel.is_empty()
    }

    /// Depth of keypoint `i`, when it was measured.
    #[must_use]
    pub fn depth(&self, i: usize) -> Option<f64> {
        (self.depth_m[i] > 0.0).then(|| self.depth_m[i])
    }

    /// Canonical bytes of pixels and descriptors.
    pub(crate) fn digest_keypoints(&self, w: &mut DigestWriter) {
        w.u64(self.len() as u64);
        for i in 0..self.len() {
            w.f64s(&self.raw_pixel[i]);
            w.u8(self.octave[i]);
            w.f32(self.angle[i]);
        }
    }
}

/// Depth at a corner, read so that a depth step under the corner does not give a point that floats between two
/// surfaces: the median of a window, and nothing where the window holds two surfaces.
fn depth_at_corner(depth: &DepthImage, pixel: [f64; 2], sensor: &SensorConfig) -> Option<f64> {
    let (cx, cy) = (round_to_pixel(pixel[0]), round_to_pixel(pixel[1]));
    let radius = i64::from(sensor.depth_window_px) / 2;
    let mut window = [0u16; MAX_WINDOW * MAX_WINDOW];
    let mut count = 0;
    for y in cy - radius..=cy + radius {
        for x in cx - radius..=cx + radius {
            if x >= 0 && y >= 0 && x < depth.width as i64 && y < depth.height as i64 {
                let units = depth.units[y as usize * depth.width + x as usize];
                if units > 0 {
                    window[count] = units;
                    count += 1;
                }
            }
        }
    }
    let area = ((2 * radius + 1) * (2 * radius + 1)) as usize;
    if count * 2 < area {
        return None;
    }
    window[..count].sort_unstable();
    let metres = |units: u16| f64::from(units) * depth.metres_per_unit;
    let (near, middle, far) = (metres(window[0]), metres(window[count / 2]), metres(window[count - 1]));
    let step = sensor.depth_step_share * middle + 4.0 * sensor.depth_sigma(middle);
    (far - near <= step && middle <= sensor.max_depth_m && middle >= sensor.min_depth_m).then_some(middle)
}

/// Largest depth window, pixels.
pub(crate) const MAX_WINDOW: usize = 9;

fn label_at(mask: Option<&PanopticMask>, pixel: [f64; 2]) -> u16 {
    mask.map_or(0, |mask| mask.at(round_to_pixel(pixel[0]), round_to_pixel(pixel[1])))
}

/// Nearest pixel, halves up.
pub(crate) fn round_to_pixel(coordinate: f64) -> i64 {
    (coordinate + 0.5).floor() as i64
}
