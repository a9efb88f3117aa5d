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

/// Why depth cannot be registered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AlignmentError {
    /// A lens that neither D400 nor L500 cameras have.
    #[error("depth cannot be registered with the lens model {0:?}: only none and the Brown-Conrady models are known")]
    Lens(LensModel),
    /// A camera without pixels or with impossible numbers.
    #[error("{0} camera is impossible: {1:?}")]
    Camera(&'static str, Intrinsics),
    /// Extrinsics or depth units that are not numbers.
    #[error("extrinsics or depth units are not finite, or the units are not positive")]
    Rig,
    /// A picture of another size.
    #[error("the depth picture has {found} pixels, its camera {width}x{height}")]
    Pixels {
        /// Pixels.
        found: usize,
        /// Columns of the camera.
        width: u32,
        /// Rows of the camera.
        height: u32,
    },
}

/// Which pixel a place in the other picture belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rounding {
    /// The pixel that the middle of the depth pixel falls on, as in librealsense 2.56.
    #[default]
    Middle,
    /// The pixel that its upper left corner falls on, as in librealsense 2.59: half a depth pixel to the upper left.
    Corner,
}

/// Registers depth to another camera, as librealsense's `rs2_create_align` does it: every depth pixel gives its value to
/// one pixel of the other picture, or to a rectangle where the other picture is finer; the nearest value wins. Not
/// measured is 0. The value stays the distance along the depth camera's axis, as librealsense leaves it.
///
/// Equal to librealsense in every pixel (2.56.5 and 2.59.1 on x86-64, see [`Rounding`]) as long as the other camera's lens
/// does not bend, as that of a D435. Where it bends, this follows the lens; librealsense takes every lens for a pinhole
/// but that of [`LensModel::ModifiedBrownConrady`], whose radial part is equal again.
///
/// Arithmetic in f32 with `+ - * /` only, in librealsense's order: the same bits everywhere.
#[derive(Debug, Clone)]
pub struct Aligner {
    depth: Intrinsics,
    target: Intrinsics,
    target_from_depth: Extrinsics,
    depth_units_m: f32,
    /// Directions (x / z, y / z) of pixel corners: rows of `width + 1`, `height + 1` of them.
    corners: Vec<[f32; 2]>,
    /// Whether a depth pixel covers more than one pixel of the other picture.
    spreads: bool,
    rounding: Rounding,
}

impl Aligner {
    /// Prepares a rig.
    ///
    /// # Errors
    /// Impossible numbers or an unknown lens.
    pub fn new(
        depth: &Intrinsics,
        target: &Intrinsics,
        target_from_depth: &Extrinsics,
        depth_units_m: f32,
    ) -> Result<Self, AlignmentError> {
        for (name, camera) in [("depth", depth), ("target", target)] {
            let numbers = [camera.fx, camera.fy, camera.cx, camera.cy];
            let finite = numbers.iter().chain(&camera.coefficients).all(|value| value.is_finite());
            if camera.width == 0 || camera.height == 0 || !finite || camera.fx <= 0.0 || camera.fy <= 0.0 {
                return Err(AlignmentError::Camera(name, *camera));
            }
            if matches!(camera.model, LensModel::FTheta | LensModel::KannalaBrandt) && camera.bends() {
                return Err(AlignmentError::Lens(camera.model));
            }
        }
        let Extrinsics { rotation, translation } = target_from_depth;
        let finite = rotation.iter().chain(translation).all(|value| value.is_finite());
        if !finite || !depth_units_m.is_finite() || depth_units_m <= 0.0 {
            return Err(AlignmentError::Rig);
        }
        let corner = |row: u32, column: u32| depth.direction([column as f32 - 0.5, row as f32 - 0.5]);
        let corners = (0..=depth.height).flat_map(|row| (0..=depth.width).map(move |column| corner(row, column)));
        let corners = corners.collect();
        let (depth, target, target_from_depth) = (*depth, *target, *target_from_depth);
        let spreads = spreads(&depth, &target);
        Ok(Self { depth, target, target_from_depth, depth_units_m, corners, spreads, rounding: Rounding::default() })
    }

    /// The same with another rounding.
    #[must_use]
    pub fn with_rounding(self, rounding: Rounding) -> Self {
        Self { rounding, ..self }
    }

    /// The depth picture as the other camera would see it: rows of its size, the same units.
    ///
    /// # Errors
    /// A picture of another size.
    pub fn align(&self, pixels: &[u16]) -> Result<Vec<u16>, AlignmentError> {
        let (width, height) = (self.depth.width as usize, self.depth.height as usize);
        if pixels.len() != width * height {
            let Intrinsics { width, height, .. } = self.depth;
            return Err(AlignmentError::Pixels { found: pixels.len(), width, height });
        }
        let (columns, rows) = (self.target.width as usize, self.target.height as usize);
        let mut aligned = vec![0_u16; columns * rows];
        for (index, value) in pixels.iter().copied().enumerate().filter(|(_, value)| *value > 0) {
            let corner = index / width * (width + 1) + index % width;
            let depth_m = f32::from(value) * self.depth_units_m;
            let Some(first) = self.target_pixel(self.corners[corner], depth_m) else { continue };
            let last =
                if self.spreads { self.target_pixel(self.corners[corner + width + 2], depth_m) } else { Some(first) };
            let Some(last) = last else { continue };
            for row in inside(first[1], last[1], rows) {
                for column in inside(first[0], last[0], columns) {
                    let seen = &mut aligned[row * columns + column];
                    if *seen == 0 || value < *seen {
                        *seen = value;
                    }
                }
            }
        }
        Ok(aligned)
    }

    /// The pixel of the other picture for a corner. `None` behind the other camera.
    fn target_pixel(&self, [x, y]: [f32; 2], depth_m: f32) -> Option<[i32; 2]> {
        let point = self.target_from_depth.transform([depth_m * x, depth_m * y, depth_m]);
        let place = self.target.project(point);
        let seen = point[2] > 0.0 && place.iter().all(|value| value.is_finite());
        seen.then(|| {
            place.map(|value| match self.rounding {
                // Half a pixel more: the upper left corner then stands for the middle.
                Rounding::Middle => (value + 0.5).round_ties_even() as i32,
                Rounding::Corner => (value + 0.5) as i32,
            })
        })
    }
}

/// Indices from `first` to `last` that are below `end`.
fn inside(first: i32, last: i32, end: usize) -> std::ops::Range<usize> {
    let index = |value: i32| usize::try_from(value).unwrap_or(0);
    index(first)..index(last.saturating_add(1)).min(end)
}

/// librealsense's rule for when a depth pixel covers a rectangle: the other picture has more pixels a degree, or the
/// sizes are one of two exceptions.
fn spreads(depth: &Intrinsics, target: &Intrinsics) -> bool {
    let [depth_x, depth_y] = pixels_per_degree(depth);
    let [target_x, target_y] = pixels_per_degree(target);
    let sizes = [depth.width, depth.height, target.width, target.height];
    depth_x < target_x || depth_y < target_y || [[640, 240, 320, 180], [640, 480, 640, 360]].contains(&sizes)
}

fn pixels_per_degree(camera: &Intrinsics) -> [f32; 2] {
    let (width, height) = (camera.width as f32, camera.height as f32);
    [(width, camera.cx, camera.fx), (height, camera.cy, camera.fy)].map(|(size, centre, focal)| {
        let angle = libm::atan2f(centre + 0.5, focal) + libm::atan2f(size - (centre + 0.5), focal);
        size / angle.to_degrees()
    })
}

impl Extrinsics {
    /// As a log tells them, in the device's own precision.
    #[must_use]
    pub fn from_message(rig: &crate::msg::Extrinsics) -> Self {
        let [a, b, c, d, e, f, g, h, i] = rig.rotation.map(|value| value as f32);
        // Columns.
        let rotation = [a, d, g, b, e, h, c, f, i];
        Self { rotation, translation: rig.translation.map(|value| value as f32) }
    }

    /// The point in the target frame, metres.
    #[must_use]
    pub fn transform(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        [0, 1, 2].map(|row| r[row] * x + (r[row + 3] * y + (r[row + 6] * z + t[row])))
    }
}

impl Intrinsics {
    /// A camera without a lens that bends: size, and `fx, fy, cx, cy` in pixels.
    #[must_use]
    pub fn pinhole(width: u32, height: u32, k: [f64; 4]) -> Self {
        let [fx, fy, cx, cy] = k.map(|value| value as f32);
        Self { width, height, fx, fy, cx, cy, ..Self::default() }
    }

    /// As a log tells them: what was written as 64 bits was 32 bits on the device. None for a lens that is not known.
    #[must_use]
    pub fn from_camera_info(info: &crate::msg::CameraInfo) -> Option<Self> {
        let [fx, _, cx, _, fy, cy, ..] = info.k.map(|value| value as f32);
        let mut coefficients = [0.0; 5];
        coefficients.iter_mut().zip(&info.d).for_each(|(to, from)| *to = *from as f32);
        let model = match info.distortion_model.as_str() {
            "" | "none" => LensModel::None,
            "plumb_bob" => LensModel::BrownConrady,
            "modified_brown_conrady" => LensModel::ModifiedBrownConrady,
            "inverse_brown_conrady" => LensModel::InverseBrownConrady,
            _ => return None,
        };
        Some(Self { width: info.width, height: info.height, fx, fy, cx, cy, model, coefficients })
    }

    /// Whether any coefficient does something.
    fn bends(&self) -> bool {
        self.model != LensModel::None && self.coefficients.iter().any(|coefficient| *coefficient != 0.0)
    }

    /// Where a point stands in the picture, pixels. `InverseBrownConrady` is bent as `ModifiedBrownConrady`: librealsense
    /// projects so too, whatever the name says.
    #[must_use]
    pub fn project(&self, [x, y, z]: [f32; 3]) -> [f32; 2] {
        let [x, y] = self.bent([x / z, y / z]);
        [x * self.fx + self.cx, y * self.fy + self.cy]
    }

    /// The direction (x / z, y / z) that a place in the picture looks in.
    #[must_use]
    pub fn direction(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let seen = [(u - self.cx) / self.fx, (v - self.cy) / self.fy];
        if !self.bends() {
            return seen;
        }
        // Fixed-point iteration; ten steps as librealsense takes.
        let mut straight = seen;
        for _ in 0..10 {
            let bent = self.bent(straight);
            straight = [0, 1].map(|axis| straight[axis] + seen[axis] - bent[axis]);
        }
        straight
    }

    fn bent(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        if !self.bends() {
            return [x, y];
        }
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let r2 = x * x + y * y;
        let r4 = r2 * r2;
        let f = 1.0 + (k1 * r2 + (k2 * r4 + k3 * (r2 * r4)));
        let (xf, yf) = (x * f, y * f);
        // The tangential part is taken from the straight point by Brown and Conrady, from the radially bent one else.
        let [tx, ty] = if self.model == LensModel::BrownConrady { [x, y] } else { [xf, yf] };
        [xf + 2.0 * p1 * tx * ty + p2 * (r2 + 2.0 * tx * tx), yf + 2.0 * p2 * tx * ty + p1 * (r2 + 2.0 * ty * ty)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: Extrinsics =
        Extrinsics { rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], translation: [0.0; 3] };

    fn camera(width: u32, height: u32, f: f32) -> Intrinsics {
        let [f, cx, cy] = [f64::from(f), (f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0];
        Intrinsics::pinhole(width, height, [f, f, cx, cy])
    }

    #[test]
    fn the_same_camera_sees_the_same() {
        let camera = camera(32, 24, 30.0);
        let depth: Vec<u16> = (0..32 * 24).map(|i| if i % 7 == 0 { 0 } else { 1000 + i }).collect();
        assert_eq!(Aligner::new(&camera, &camera, &IDENTITY, 0.001).unwrap().align(&depth).unwrap(), depth);
    }

    #[test]
    fn a_point_moves_with_the_baseline_and_the_nearest_wins() {
        let camera = camera(64, 48, 50.0);
        let mut depth = vec![0_u16; 64 * 48];
        // 100 mm to the side are 5 pixels at 1 m and 2.5 at 2 m.
        let row = 24 * 64;
        (depth[row + 30], depth[row + 40], depth[row + 41], depth[row + 38]) = (1000, 2000, 2001, 1000);
        let rig = Extrinsics { translation: [0.1, 0.0, 0.0], ..IDENTITY };
        let aligned = Aligner::new(&camera, &camera, &rig, 0.001).unwrap().align(&depth).unwrap();
        let seen: Vec<(usize, u16)> = aligned.into_iter().enumerate().filter(|(_, value)| *value > 0).collect();
        assert_eq!(seen, [(row + 35, 1000), (row + 42, 2000), (row + 43, 1000)], "2001 is hidden");
    }

    #[test]
    fn a_finer_picture_has_no_holes() {
        let (coarse, fine) = (camera(32, 24, 30.0), camera(64, 48, 60.0));
        let aligned = Aligner::new(&coarse, &fine, &IDENTITY, 0.001).unwrap().align(&[1000; 32 * 24]).unwrap();
        assert!(aligned.iter().all(|value| *value == 1000));
    }

    #[test]
    fn lenses_are_undone() {
        for model in [LensModel::ModifiedBrownConrady, LensModel::InverseBrownConrady, LensModel::BrownConrady] {
            let coefficients = [-0.055, 0.065, 0.0006, -0.0004, -0.021];
            let camera = Intrinsics { model, coefficients, ..camera(640, 480, 600.0) };
            for pixel in [[0.0, 0.0], [320.0, 240.0], [639.0, 100.0]] {
                let [x, y] = camera.direction(pixel);
                let [u, v] = camera.project([2.0 * x, 2.0 * y, 2.0]);
                assert!((u - pixel[0]).abs() < 1e-3 && (v - pixel[1]).abs() < 1e-3, "{model:?} {pixel:?}: {u} {v}");
            }
        }
    }

    #[test]
    fn nonsense_is_refused() {
        let good = camera(8, 6, 5.0);
        let new = |depth: &Intrinsics, rig: &Extrinsics, units| Aligner::new(depth, &good, rig, units);
        assert!(new(&Intrinsics { fx: 0.0, ..good }, &IDENTITY, 0.001).is_err());
        assert!(new(&Intrinsics { width: 0, ..good }, &IDENTITY, 0.001).is_err());
        assert!(new(&good, &Extrinsics { translation: [f32::NAN, 0.0, 0.0], ..IDENTITY }, 0.001).is_err());
        assert!(new(&good, &IDENTITY, 0.0).is_err());
        let fish = Intrinsics { model: LensModel::KannalaBrandt, coefficients: [0.1; 5], ..good };
        assert_eq!(new(&fish, &IDENTITY, 0.001).unwrap_err(), AlignmentError::Lens(LensModel::KannalaBrandt));
        assert!(new(&good, &IDENTITY, 0.001).unwrap().align(&[1; 47]).is_err());
        // Behind the other camera, and at its centre: nothing is seen, nothing breaks.
        for z in [-1.0, -2.0] {
            let behind = Extrinsics { translation: [0.0, 0.0, z], ..IDENTITY };
            new(&good, &behind, 0.001).unwrap().align(&[1000; 48]).unwrap();
        }
    }
}
