//! The measurement a depth camera gives of a point: a pixel and, where depth is known, a virtual right coordinate.

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
    /// Where depth is known: `u - bf / depth`, pixels.
    pub u_right: Option<f64>,
    /// Information of each pixel coordinate, `1 / sigma^2` in 1/px^2: lower on coarser octaves.
    pub weight: f64,
    /// Information of `u_right`, 1/px^2: follows the noise of the depth, so far points count less. Unused without depth.
    pub weight_right: f64,
}

impl Measurement {
    /// Every number is finite and the weights can be used.
    pub(crate) fn is_usable(&self) -> bool {
        let right =
            self.u_right.is_none_or(|u| u.is_finite() && self.weight_right.is_finite() && self.weight_right >= 0.0);
        right && self.pixel.iter().all(|v| v.is_finite()) && self.weight.is_finite() && self.weight > 0.0
    }
}

/// Intrinsics and virtual baseline: everything that turns a point into a measurement.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DepthCamera {
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
    /// Predicted minus measured: u, v and (0 without depth) u_right, pixels. `None` when it can't be seen.
    pub fn residual(&self, x: &Vector3<f64>, m: &Measurement) -> Option<[f64; 3]> {
        let [u, v] = self.pinhole.project(x)?;
        let right = m.u_right.map_or(0.0, |u_right| u - self.bf / x[2] - u_right);
        Some([u - m.pixel[0], v - m.pixel[1], right])
    }

    /// Squared normalised residual, `None` when the point can't be seen or the value is not finite.
    pub fn chi2(&self, x: &Vector3<f64>, m: &Measurement) -> Option<f64> {
        let e = self.residual(x, m)?;
        let chi2 = chi2_of(&e, m);
        chi2.is_finite().then_some(chi2)
    }

    /// Residual and derivatives by the point in the camera's frame.
    pub fn linearize(&self, x: &Vector3<f64>, m: &Measurement) -> Option<Linearized> {
        let e = self.residual(x, m)?;
        let chi2 = chi2_of(&e, m);
        if !chi2.is_finite() {
            return None;
        }
        let inverse_z = 1.0 / x[2];
        // Rows of the Jacobian: (au, 0, cu), (0, av, cv), (au, 0, cr).
        let (au, av) = (self.pinhole.fx * inverse_z, self.pinhole.fy * inverse_z);
        let (cu, cv) = (-au * x[0] * inverse_z, -av * x[1] * inverse_z);
        let cr = cu + self.bf * inverse_z * inverse_z;
        let (w, wr) = (m.weight, right_weight(m));
        let xx = (w + wr) * au * au;
        let xz = au * (w * cu + wr * cr);
        let yz = w * av * cv;
        let zz = w * (cu * cu + cv * cv) + wr * cr * cr;
        let information = Matrix3::new(xx, 0.0, xz, 0.0, w * av * av, yz, xz, yz, zz);
        let [eu, ev, er] = [w * e[0], w * e[1], wr * e[2]];
        let gradient = Vector3::new(au * (eu + er), av * ev, cu * eu + cv * ev + cr * er);
        Some(Linearized { chi2, information, gradient })
    }
}

fn right_weight(m: &Measurement) -> f64 {
    if m.u_right.is_some() { m.weight_right } else { 0.0 }
}

fn chi2_of(e: &[f64; 3], m: &Measurement) -> f64 {
    m.weight * (e[0] * e[0] + e[1] * e[1]) + right_weight(m) * e[2] * e[2]
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
