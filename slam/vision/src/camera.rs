//! Pinhole camera with radial-tangential lens distortion.
//!
//! Camera frame: x right, y down, z forward, metres. Pixel (0, 0) is the centre of the upper left pixel.

use nalgebra::Vector3;

use crate::VisionError;

/// Newton steps of [`Camera::undistort`]; it converges quadratically, so real lenses need four or five.
const UNDISTORT_STEPS: usize = 20;

/// Lens distortion model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Distortion {
    /// An ideal or already rectified image.
    #[default]
    None,
    /// The Brown-Conrady model ("radtan", ROS `plumb_bob`) with its usual five coefficients, without unit.
    Radtan {
        /// Radial, r^2.
        k1: f64,
        /// Radial, r^4.
        k2: f64,
        /// Tangential, along y.
        p1: f64,
        /// Tangential, along x.
        p2: f64,
        /// Radial, r^6.
        k3: f64,
    },
    /// The same with the tangential part taken from the radially bent point, as librealsense has it.
    ModifiedRadtan {
        /// Radial, r^2.
        k1: f64,
        /// Radial, r^4.
        k2: f64,
        /// Tangential, along y.
        p1: f64,
        /// Tangential, along x.
        p2: f64,
        /// Radial, r^6.
        k3: f64,
    },
}

/// Intrinsic calibration. Lengths in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal length along x.
    pub fx: f64,
    /// Focal length along y.
    pub fy: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
    /// Image width.
    pub width: u32,
    /// Image height.
    pub height: u32,
    /// Lens distortion.
    pub distortion: Distortion,
}

/// An axis-aligned rectangle in pixels, borders included.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// Smallest x and y.
    pub min: [f64; 2],
    /// Largest x and y.
    pub max: [f64; 2],
}

impl Bounds {
    /// Whether the pixel lies inside or on the border; never for NaN.
    #[must_use]
    pub fn contains(&self, pixel: [f64; 2]) -> bool {
        (0..2).all(|axis| self.min[axis] <= pixel[axis] && pixel[axis] <= self.max[axis])
    }
}

impl Camera {
    /// Checks that every number is finite, focal lengths are positive and the image is not empty.
    pub fn validate(&self) -> Result<(), VisionError> {
        let (finite, positive) = ("finite", "finite and greater than 0");
        let refuse = |name, value, allowed| Err(VisionError::Camera { name, value, allowed });
        for (name, value) in [("fx", self.fx), ("fy", self.fy)] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(name, value, positive);
            }
        }
        for (name, value) in [("width", self.width), ("height", self.height)] {
            if value == 0 {
                return refuse(name, 0.0, positive);
            }
        }
        let [k1, k2, p1, p2, k3] = self.distortion.coefficients();
        let rest = [("cx", self.cx), ("cy", self.cy), ("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)];
        match rest.into_iter().find(|(_, value)| !value.is_finite()) {
            Some((name, value)) => refuse(name, value, finite),
            None => Ok(()),
        }
    }

    /// Undistorted pixel of a point in the camera frame, in or out of the image; `None` when the point is not in front
    /// of the camera or not finite.
    #[must_use]
    pub fn project(&self, point: Vector3<f64>) -> Option<[f64; 2]> {
        let pixel = [self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy];
        (point.z > 0.0 && pixel.iter().all(|v| v.is_finite())).then_some(pixel)
    }

    /// Point in the camera frame at an undistorted pixel and a depth along z in metres.
    #[must_use]
    pub fn unproject(&self, pixel: [f64; 2], depth_m: f64) -> Vector3<f64> {
        let [x, y] = self.normalized(pixel);
        Vector3::new(x * depth_m, y * depth_m, depth_m)
    }

    /// Where the lens shows an undistorted pixel in the recorded image.
    #[must_use]
    pub fn distort(&self, pixel: [f64; 2]) -> [f64; 2] {
        match self.distortion {
            Distortion::None => pixel,
            lens => self.pixel(lens.apply(self.normalized(pixel)).0),
        }
    }

    /// Inverse of [`Camera::distort`], by Newton's method with a counted number of steps.
    ///
    /// Beyond the radius where the lens model folds back no inverse exists; the iterate that met the fold is
    /// returned then. A pixel that is not finite comes back unchanged.
    #[must_use]
    pub fn undistort(&self, pixel: [f64; 2]) -> [f64; 2] {
        if self.distortion == Distortion::None || !pixel.iter().all(|v| v.is_finite()) {
            return pixel;
        }
        let target = self.normalized(pixel);
        let mut guess = target;
        for _ in 0..UNDISTORT_STEPS {
            let (value, [[xx, xy], [yx, yy]]) = self.distortion.apply(guess);
            let residual = [value[0] - target[0], value[1] - target[1]];
            let determinant = xx * yy - xy * yx;
            // A model that turns inside out (or is about to) has no unique inverse here.
            if determinant.is_nan() || determinant <= 1e-6 {
                break;
            }
            let step = [
                (yy * residual[0] - xy * residual[1]) / determinant,
                (xx * residual[1] - yx * residual[0]) / determinant,
            ];
            guess = [guess[0] - step[0], guess[1] - step[1]];
            if step[0].abs() + step[1].abs() < 1e-15 {
                break;
            }
        }
        if guess.iter().all(|v| v.is_finite()) { self.pixel(guess) } else { pixel }
    }

    /// Smallest rectangle that holds every undistorted pixel of the image.
    #[must_use]
    pub fn undistorted_bounds(&self) -> Bounds {
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let mut bounds = Bounds { min: [0.0, 0.0], max: [width, height] };
        if self.distortion == Distortion::None {
            return bounds;
        }
        let columns = (0..=self.width).flat_map(|x| [[f64::from(x), 0.0], [f64::from(x), height]]);
        let rows = (0..=self.height).flat_map(|y| [[0.0, f64::from(y)], [width, f64::from(y)]]);
        (bounds.min, bounds.max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for pixel in columns.chain(rows).map(|pixel| self.undistort(pixel)) {
            for ((min, max), value) in bounds.min.iter_mut().zip(&mut bounds.max).zip(pixel) {
                *min = slam_math::float::min(*min, value);
                *max = slam_math::float::max(*max, value);
            }
        }
        bounds
    }

    fn normalized(&self, pixel: [f64; 2]) -> [f64; 2] {
        [(pixel[0] - self.cx) / self.fx, (pixel[1] - self.cy) / self.fy]
    }

    fn pixel(&self, normalized: [f64; 2]) -> [f64; 2] {
        [normalized[0] * self.fx + self.cx, normalized[1] * self.fy + self.cy]
    }
}

impl Distortion {
    /// Coefficients `[k1, k2, p1, p2, k3]`, all 0 without distortion.
    #[must_use]
    pub fn coefficients(&self) -> [f64; 5] {
        match *self {
            Self::None => [0.0; 5],
            Self::Radtan { k1, k2, p1, p2, k3 } | Self::ModifiedRadtan { k1, k2, p1, p2, k3 } => [k1, k2, p1, p2, k3],
        }
    }

    /// Distorted normalised point and its derivative `[[dx/dx, dx/dy], [dy/dx, dy/dy]]`.
    fn apply(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let [k1, k2, p1, p2, k3] = self.coefficients();
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let radial_by_r2 = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        if let Self::ModifiedRadtan { .. } = self {
            return tangential_after([x, y], r2, radial, radial_by_r2, [p1, p2]);
        }
        let value = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        let mixed = 2.0 * x * y * radial_by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
        let xx = radial + 2.0 * x * x * radial_by_r2 + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = radial + 2.0 * y * y * radial_by_r2 + 6.0 * p1 * y + 2.0 * p2 * x;
        (value, [[xx, mixed], [mixed, yy]])
    }
}

/// [`Distortion::ModifiedRadtan`] from its radial part and that one's derivative by r^2.
fn tangential_after(
    [x, y]: [f64; 2],
    r2: f64,
    radial: f64,
    radial_by_r2: f64,
    [p1, p2]: [f64; 2],
) -> ([f64; 2], [[f64; 2]; 2]) {
    let [bx, by] = [x * radial, y * radial];
    let cross = 2.0 * x * y * radial_by_r2;
    // Derivatives of the radially bent point by x and by y.
    let [bx_x, bx_y] = [radial + 2.0 * x * x * radial_by_r2, cross];
    let [by_x, by_y] = [cross, radial + 2.0 * y * y * radial_by_r2];
    let value =
        [bx + 2.0 * p1 * bx * by + p2 * (r2 + 2.0 * bx * bx), by + p1 * (r2 + 2.0 * by * by) + 2.0 * p2 * bx * by];
    let product = [bx_x * by + bx * by_x, bx_y * by + bx * by_y];
    let along_x = [
        bx_x + 2.0 * p1 * product[0] + p2 * (2.0 * x + 4.0 * bx * bx_x),
        bx_y + 2.0 * p1 * product[1] + p2 * (2.0 * y + 4.0 * bx * bx_y),
    ];
    let along_y = [
        by_x + 2.0 * p2 * product[0] + p1 * (2.0 * x + 4.0 * by * by_x),
        by_y + 2.0 * p2 * product[1] + p1 * (2.0 * y + 4.0 * by * by_y),
    ];
    (value, [along_x, along_y])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_the_lens() {
        let (k1, k2, p1, p2, k3) = (-0.055, 0.065, 0.006, -0.004, -0.021);
        for lens in [Distortion::Radtan { k1, k2, p1, p2, k3 }, Distortion::ModifiedRadtan { k1, k2, p1, p2, k3 }] {
            for point in [[0.0, 0.0], [0.7, -0.4], [-0.9, 0.6]] {
                let (_, jacobian) = lens.apply(point);
                for axis in 0..2 {
                    let step = 1e-6;
                    let at = |sign: f64| {
                        let mut moved = point;
                        moved[axis] += sign * step;
                        lens.apply(moved).0
                    };
                    let (after, before) = (at(1.0), at(-1.0));
                    for row in 0..2 {
                        let numeric = (after[row] - before[row]) / (2.0 * step);
                        assert!((numeric - jacobian[row][axis]).abs() < 1e-8, "{lens:?} {point:?} {row} {axis}");
                    }
                }
            }
            let camera =
                Camera { fx: 380.0, fy: 381.0, cx: 320.0, cy: 240.0, width: 640, height: 480, distortion: lens };
            for pixel in [[0.0, 0.0], [639.0, 100.0], [300.0, 479.0]] {
                let there_and_back = camera.distort(camera.undistort(pixel));
                assert!((0..2).all(|axis| (there_and_back[axis] - pixel[axis]).abs() < 1e-9), "{lens:?} {pixel:?}");
            }
        }
    }
}
