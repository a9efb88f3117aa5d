//! The measurement a depth camera gives of a point: a pixel and, where depth is known, its disparity.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, Vector3, Vector6};

/// Points nearer than this to the camera's plane, or behind it, can't be seen. Metres.
pub const MIN_DEPTH_M: f64 = 1e-3;

/// Pinhole intrinsics in undistorted pixels: `u = fx * x / z + cx`, `v = fy * y / z + cy`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, pixels.
    pub cx: f64,
    /// Principal point, pixels.
    pub cy: f64,
}

impl Pinhole {
    /// Pixel of a point in the camera's frame (metres), `None` behind the camera or when not finite.
    #[must_use]
    pub fn project(&self, point_in_camera: &Vector3<f64>) -> Option<[f64; 2]> {
        let [x, y, z] = [point_in_camera[0], point_in_camera[1], point_in_camera[2]];
        let pixel = [self.fx * x / z + self.cx, self.fy * y / z + self.cy];
        (z > MIN_DEPTH_M && pixel[0].is_finite() && pixel[1].is_finite()).then_some(pixel)
    }

    /// Normalised image coordinates `(x / z, y / z)` of a pixel.
    #[must_use]
    pub fn ray(&self, pixel: [f64; 2]) -> [f64; 2] {
        [(pixel[0] - self.cx) / self.fx, (pixel[1] - self.cy) / self.fy]
    }

    /// Point in the camera's frame (metres) of a pixel at a depth (metres along z).
    #[must_use]
    pub fn unproject(&self, pixel: [f64; 2], depth_m: f64) -> Vector3<f64> {
        let [x, y] = self.ray(pixel);
        Vector3::new(x * depth_m, y * depth_m, depth_m)
    }
}

/// One observation of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Undistorted pixel.
    pub pixel: [f64; 2],
    /// Where depth is known: `bf / depth`, pixels. Its noise is the depth sensor's alone: unlike the field's usual right
    /// image coordinate `u - bf / depth` it shares none with the pixel, so accurate depth is not spoilt by the corner's
    /// noise.
    pub disparity: Option<f64>,
    /// Information of each pixel coordinate, `1 / sigma^2` in 1/px^2: lower on coarser octaves.
    pub weight: f64,
    /// Information of the disparity, 1/px^2: follows the noise of the depth, so far points count less. Unused without depth.
    pub weight_disparity: f64,
}

impl Measurement {
    /// Every number is finite and the weights can be used.
    pub(crate) fn is_usable(&self) -> bool {
        let right = self
            .disparity
            .is_none_or(|u| u.is_finite() && self.weight_disparity.is_finite() && self.weight_disparity >= 0.0);
        right && self.pixel.iter().all(|v| v.is_finite()) && self.weight.is_finite() && self.weight > 0.0
    }
}

/// Intrinsics and virtual baseline: everything that turns a point into a measurement.
#[derive(Debug, Clone, Copy)]
pub struct DepthCamera {
    /// Intrinsics.
    pub pinhole: Pinhole,
    /// Baseline times fx, metres * pixels.
    pub bf: f64,
}

/// One observation around the current estimate, expressed in the point's coordinates in the camera's frame. The chain
/// rule then gives the pose's part through `[I, -[x]]` and the point's through the rotation, so the rows of the Jacobian
/// are never formed.
pub(crate) struct Linearized {
    /// Squared normalised residual.
    pub chi2: f64,
    /// `J^T W J`.
    pub information: Matrix3<f64>,
    /// `J^T W residual`.
    pub gradient: Vector3<f64>,
}

impl DepthCamera {
    /// Predicted minus measured: u, v and (0 without depth) the disparity, pixels. `None` when it can't be seen.
    pub fn residual(&self, x: &Vector3<f64>, m: &Measurement) -> Option<[f64; 3]> {
        let [u, v] = self.pinhole.project(x)?;
        let depth = m.disparity.map_or(0.0, |disparity| self.bf / x[2] - disparity);
        Some([u - m.pixel[0], v - m.pixel[1], depth])
    }

    /// Squared normalised residual, `None` when the point can't be seen or the value is not finite.
    pub fn chi2(&self, x: &Vector3<f64>, m: &Measurement) -> Option<f64> {
        let e = self.residual(x, m)?;
        let chi2 = chi2_of(&e, m);
        chi2.is_finite().then_some(chi2)
    }

    /// Residual and derivatives by the point in the camera's frame.
    pub(crate) fn linearize(&self, x: &Vector3<f64>, m: &Measurement) -> Option<Linearized> {
        let e = self.residual(x, m)?;
        let chi2 = chi2_of(&e, m);
        if !chi2.is_finite() {
            return None;
        }
        let inverse_z = 1.0 / x[2];
        // Rows of the Jacobian: (au, 0, cu), (0, av, cv), (0, 0, cd).
        let (au, av) = (self.pinhole.fx * inverse_z, self.pinhole.fy * inverse_z);
        let (cu, cv) = (-au * x[0] * inverse_z, -av * x[1] * inverse_z);
        let cd = -self.bf * inverse_z * inverse_z;
        let (w, wd) = (m.weight, disparity_weight(m));
        let xx = w * au * au;
        let xz = w * au * cu;
        let yz = w * av * cv;
        let zz = w * (cu * cu + cv * cv) + wd * cd * cd;
        let information = Matrix3::new(xx, 0.0, xz, 0.0, w * av * av, yz, xz, yz, zz);
        let [eu, ev, ed] = [w * e[0], w * e[1], wd * e[2]];
        let gradient = Vector3::new(au * eu, av * ev, cu * eu + cv * ev + cd * ed);
        Some(Linearized { chi2, information, gradient })
    }
}

fn disparity_weight(m: &Measurement) -> f64 {
    if m.disparity.is_some() { m.weight_disparity } else { 0.0 }
}

fn chi2_of(e: &[f64; 3], m: &Measurement) -> f64 {
    m.weight * (e[0] * e[0] + e[1] * e[1]) + disparity_weight(m) * e[2] * e[2]
}

/// `A^T M A` for the pose's derivative `A = [I, -[x]]` and a symmetric `M`.
pub(crate) fn pose_information(m: &Matrix3<f64>, x: &Vector3<f64>) -> Matrix6<f64> {
    // Rows of -M [x] are x cross the rows of M.
    let b: [[f64; 3]; 3] = std::array::from_fn(|r| cross(x, [m[(r, 0)], m[(r, 1)], m[(r, 2)]]));
    let d: [[f64; 3]; 3] = std::array::from_fn(|c| cross(x, [b[0][c], b[1][c], b[2][c]]));
    let mut out = Matrix6::zeros();
    for r in 0..3 {
        for c in 0..3 {
            out[(r, c)] = m[(r, c)];
            out[(r, c + 3)] = b[r][c];
            out[(c + 3, r)] = b[r][c];
            out[(r + 3, c + 3)] = d[c][r];
        }
    }
    out
}

/// `A^T g`.
pub(crate) fn pose_gradient(g: &Vector3<f64>, x: &Vector3<f64>) -> Vector6<f64> {
    let turned = cross(x, [g[0], g[1], g[2]]);
    Vector6::new(g[0], g[1], g[2], turned[0], turned[1], turned[2])
}

/// `A^T N`: the block between a pose and a point, for `N = M * rotation`.
pub(crate) fn pose_point(n: &Matrix3<f64>, x: &Vector3<f64>) -> Matrix6x3<f64> {
    let mut out = Matrix6x3::zeros();
    for c in 0..3 {
        let column = [n[(0, c)], n[(1, c)], n[(2, c)]];
        let turned = cross(x, column);
        for r in 0..3 {
            out[(r, c)] = column[r];
            out[(r + 3, c)] = turned[r];
        }
    }
    out
}

fn cross(x: &Vector3<f64>, v: [f64; 3]) -> [f64; 3] {
    [x[1] * v[2] - x[2] * v[1], x[2] * v[0] - x[0] * v[2], x[0] * v[1] - x[1] * v[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x6, SMatrix};
    use proptest::prelude::*;
    use slam_math::Se3;

    const CAMERA: DepthCamera =
        DepthCamera { pinhole: Pinhole { fx: 535.4, fy: 539.2, cx: 320.1, cy: 247.6 }, bf: 40.0 };

    /// Jacobian of the residual by central differences of `moved`, a point in the camera's frame after a small change.
    fn numeric<const N: usize>(
        m: &Measurement,
        moved: impl Fn(&SMatrix<f64, N, 1>) -> Vector3<f64>,
    ) -> SMatrix<f64, 3, N> {
        let step = 1e-6;
        SMatrix::from_fn(|r, c| {
            let mut delta = SMatrix::<f64, N, 1>::zeros();
            delta[c] = step;
            let (plus, minus) = (CAMERA.residual(&moved(&delta), m), CAMERA.residual(&moved(&-delta), m));
            (plus.unwrap()[r] - minus.unwrap()[r]) / (2.0 * step)
        })
    }

    fn close<const R: usize, const C: usize>(a: &SMatrix<f64, R, C>, b: &SMatrix<f64, R, C>) -> bool {
        (a - b).norm() <= 1e-6 * (1.0 + b.norm())
    }

    proptest! {
        #[test]
        fn every_block_equals_finite_differences(
            point in [-2.0..2.0f64, -1.5..1.5, 0.5..6.0],
            twist in proptest::array::uniform6(-0.1..0.1f64),
            offset in proptest::array::uniform3(-20.0..20.0f64),
            weights in [0.1..2.0f64, 0.1..2.0],
            stereo: bool,
        ) {
            let (point, pose) = (Vector3::from(point), Se3::exp(&Vector6::from(twist)));
            let x = pose.transform(&point);
            let [u, v] = CAMERA.pinhole.project(&x).unwrap();
            let m = Measurement {
                pixel: [u + offset[0], v + offset[1]],
                disparity: stereo.then_some(CAMERA.bf / x[2] + offset[2]),
                weight: weights[0],
                weight_disparity: weights[1],
            };
            let w = Matrix3::from_diagonal(&Vector3::new(m.weight, m.weight, disparity_weight(&m)));
            let e = Vector3::from(CAMERA.residual(&x, &m).unwrap());
            let by_pose: Matrix3x6<f64> = numeric(&m, |d| (Se3::exp(d) * pose).transform(&point));
            let by_point: Matrix3<f64> = numeric(&m, |d| pose.transform(&(point + d)));

            let l = CAMERA.linearize(&x, &m).unwrap();
            let turned = l.information * pose.rotation;
            prop_assert!((l.chi2 - (e.transpose() * w * e)[0]).abs() < 1e-9 * (1.0 + l.chi2));
            prop_assert!(close(&pose_information(&l.information, &x), &(by_pose.transpose() * w * by_pose)));
            prop_assert!(close(&pose_gradient(&l.gradient, &x), &(by_pose.transpose() * w * e)));
            prop_assert!(close(&pose_point(&turned, &x), &(by_pose.transpose() * w * by_point)));
            prop_assert!(close(&pose.rotation.tr_mul(&turned), &(by_point.transpose() * w * by_point)));
            prop_assert!(close(&pose.rotation.tr_mul(&l.gradient), &(by_point.transpose() * w * e)));
        }
    }

    #[test]
    fn what_cannot_be_seen_has_no_residual() {
        let m = Measurement { pixel: [320.0, 240.0], disparity: None, weight: 1.0, weight_disparity: 0.0 };
        for z in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY] {
            assert!(CAMERA.chi2(&Vector3::new(0.0, 0.0, z), &m).is_none());
        }
        assert!(CAMERA.chi2(&Vector3::new(1e200, 0.0, 1.0), &m).is_none());
        assert!(CAMERA.linearize(&Vector3::new(1e200, 0.0, 1.0), &m).is_none());
        assert!(!Measurement { weight: 0.0, ..m }.is_usable());
        assert!(!Measurement { disparity: Some(f64::NAN), ..m }.is_usable());
        assert!(!Measurement { pixel: [f64::INFINITY, 0.0], ..m }.is_usable());
    }
}
