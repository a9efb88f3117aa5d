//! A stereo camera: two calibrated cameras, and how their pictures are turned so that a point lies on one row in both.

use crate::calibration::{CalibrationError, CameraModel, Distortion};
use crate::msg::{CameraInfo, Header};

/// A 3 x 3 matrix, rows joined.
pub type Matrix = [f64; 9];

const IDENTITY: Matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// Two cameras side by side. In ROS: `K` and `D` of each camera, `R` its rotation into the rectified frame, `P` the
/// rectified intrinsics, with `-bf` in the right camera's `P[3]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoModel {
    /// The left camera as it records.
    pub left: CameraModel,
    /// The right camera as it records.
    pub right: CameraModel,
    /// Rotation of the left camera's frame into the rectified one.
    pub rectified_from_left: Matrix,
    /// Rotation of the right camera's frame into the rectified one.
    pub rectified_from_right: Matrix,
    /// The pinhole camera that both rectified pictures show; the left one at the origin.
    pub rectified: CameraModel,
    /// Baseline times focal length of the rectified cameras, metres x pixels.
    pub bf: f64,
}

/// Why two cameras are no stereo camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StereoError {
    /// One of the cameras is none.
    #[error("{side} camera: {source}")]
    Camera {
        /// Which one.
        side: &'static str,
        /// What is wrong.
        source: CalibrationError,
    },
    /// The second camera does not stand to the right of the first.
    #[error("the second camera is at {0:?} m in the rectified frame: it must stand to the right of the first (x > 0)")]
    Side([f64; 3]),
    /// The matrices contradict each other.
    #[error("{0}")]
    Matrices(String),
}

impl StereoModel {
    /// Rectified pictures as they are: both of this pinhole camera, the right one `bf / fx` metres to the right.
    ///
    /// # Errors
    /// No positive, finite `bf`.
    pub fn of_rectified(camera: CameraModel, bf: f64) -> Result<Self, StereoError> {
        let (left, right) = (camera, camera);
        let rectified = CameraModel { distortion: Distortion::None, ..camera };
        Self { left, right, rectified_from_left: IDENTITY, rectified_from_right: IDENTITY, rectified, bf }.validated()
    }

    /// Computes the rectification of two cameras from where they are: `x_right = rotation * x_left + translation`.
    ///
    /// Each camera turns by half of the rotation between them, then both turn by the smallest angle that brings the
    /// baseline onto the x axis (Bouguet's method). The rectified camera has the widest view all of whose pixels both
    /// cameras saw, and the principal point that the mean of both optical axes falls on.
    ///
    /// # Errors
    /// An impossible camera, or a second one that does not stand to the right of the first.
    pub fn rectify(
        left: CameraModel,
        right: CameraModel,
        rotation: Matrix,
        translation: [f64; 3],
    ) -> Result<Self, StereoError> {
        let half = half_rotation(&rotation);
        let baseline = apply(&transposed(&half), translation);
        let length = dot(baseline, baseline).sqrt();
        let right_of_left = baseline.map(|v| -v / length);
        // More than 45 degrees off the x axis is no pair side by side.
        if right_of_left[0].is_nan() || right_of_left[0] < 0.7 {
            return Err(StereoError::Side(baseline.map(|v| -v)));
        }
        let level = onto_x(right_of_left);
        let (from_left, from_right) = (product(&level, &half), product(&level, &transposed(&half)));
        let rectified = widest([(&left, &from_left), (&right, &from_right)]);
        let bf = length * rectified.fx;
        Self { left, right, rectified_from_left: from_left, rectified_from_right: from_right, rectified, bf }
            .validated()
    }

    /// True when both pictures are rectified as they are recorded.
    #[must_use]
    pub fn is_rectified(&self) -> bool {
        let plain = |camera: &CameraModel, rotation: &Matrix| {
            let turned = rotation.iter().zip(IDENTITY).any(|(a, b)| *a != b);
            *camera == self.rectified && !turned
        };
        plain(&self.left, &self.rectified_from_left) && plain(&self.right, &self.rectified_from_right)
    }

    /// Distance of the cameras, metres.
    #[must_use]
    pub fn baseline_m(&self) -> f64 {
        self.bf / self.rectified.fx
    }

    /// The ROS messages of the left and of the right camera.
    #[must_use]
    pub fn to_camera_infos(&self, left: Header, right: Header) -> [CameraInfo; 2] {
        let CameraModel { fx, fy, cx, cy, .. } = self.rectified;
        let projection = |tx| [fx, 0.0, cx, tx, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
        [
            CameraInfo { r: self.rectified_from_left, p: projection(0.0), ..self.left.to_camera_info(left) },
            CameraInfo { r: self.rectified_from_right, p: projection(-self.bf), ..self.right.to_camera_info(right) },
        ]
    }

    /// The stereo camera that two ROS messages tell.
    ///
    /// # Errors
    /// An impossible camera, matrices that are no rotations, or projections that are not those of one camera twice.
    pub fn from_camera_infos(left: &CameraInfo, right: &CameraInfo) -> Result<Self, StereoError> {
        let camera =
            |side, info| CameraModel::from_camera_info(info).map_err(|source| StereoError::Camera { side, source });
        let (a, b) = (&left.p, &right.p);
        let same = (0..12).all(|i| i == 3 || a[i] == b[i]) && a[3] == 0.0 && a[7] == 0.0;
        if !same {
            let what = format!("P of the cameras differ in more than the baseline P[3]: {a:?} and {b:?}");
            return Err(StereoError::Matrices(what));
        }
        let rectified = CameraModel {
            width: left.width,
            height: left.height,
            fx: a[0],
            fy: a[5],
            cx: a[2],
            cy: a[6],
            distortion: Distortion::None,
        };
        Self {
            left: camera("left", left)?,
            right: camera("right", right)?,
            rectified_from_left: left.r,
            rectified_from_right: right.r,
            rectified,
            bf: -b[3],
        }
        .validated()
    }

    fn validated(self) -> Result<Self, StereoError> {
        for (side, camera) in [("left", self.left), ("right", self.right), ("rectified", self.rectified)] {
            camera.validated().map_err(|source| StereoError::Camera { side, source })?;
        }
        let size = |camera: &CameraModel| (camera.width, camera.height);
        if size(&self.left) != size(&self.right) {
            let (left, right) = (size(&self.left), size(&self.right));
            return Err(StereoError::Matrices(format!("pictures of {left:?} and {right:?} pixels: wanted one size")));
        }
        if !(self.bf.is_finite() && self.bf > 0.0) {
            let bf = self.bf;
            return Err(StereoError::Matrices(format!("baseline x focal length is {bf}, wanted more than 0")));
        }
        for (side, r) in [("left", &self.rectified_from_left), ("right", &self.rectified_from_right)] {
            let gram = product(r, &transposed(r));
            let off =
                gram.iter().zip(IDENTITY).map(|(g, i)| (g - i).abs()).fold(0.0, |a: f64, b| if b > a { b } else { a });
            if !r.iter().all(|v| v.is_finite()) || off > 1e-6 {
                return Err(StereoError::Matrices(format!("R of the {side} camera is no rotation: {r:?}")));
            }
        }
        Ok(self)
    }
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| (0..3).map(|k| a[i / 3 * 3 + k] * b[k * 3 + i % 3]).sum())
}

fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| a[i % 3 * 3 + i / 3])
}

fn apply(a: &Matrix, x: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|r| (0..3).map(|c| a[r * 3 + c] * x[c]).sum())
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The rotation about the same axis by half the angle (below half a turn): the matrix of the quaternion half-way to 1.
fn half_rotation(r: &Matrix) -> Matrix {
    // Twice w and twice the imaginary part, over 2 w: enough to see the direction of `q + 1`.
    let w = (1.0 + r[0] + r[4] + r[8]).sqrt() / 2.0;
    let v = [r[7] - r[5], r[2] - r[6], r[3] - r[1]].map(|d| d / (4.0 * w));
    let q = [w + 1.0, v[0], v[1], v[2]];
    let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|c| c / norm);
    [
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    ]
}

/// The smallest rotation that brings a unit vector (x > 0) onto the x axis: `I + [v] + [v]^2 / (1 + cos)` (Rodrigues) with
/// `v = a x (1, 0, 0)`.
fn onto_x(a: [f64; 3]) -> Matrix {
    let (y, z, k) = (a[2], -a[1], 1.0 / (1.0 + a[0]));
    [1.0 - k * (y * y + z * z), -z, y, z, 1.0 - k * z * z, k * y * z, -y, k * y * z, 1.0 - k * y * y]
}

/// Step of the search for the widest view.
const ZOOM: f64 = 1.002;

/// The widest pinhole view (square pixels, size of the left camera) all of whose border both cameras saw.
fn widest(cameras: [(&CameraModel, &Matrix); 2]) -> CameraModel {
    let left = cameras[0].0;
    let view = |f: f64| {
        // Where the optical axes fall, and what brings them back to where they were: the mean over both cameras.
        let [cx, cy] = cameras.iter().fold([0.0; 2], |sum, (camera, rotation)| {
            let axis = apply(rotation, [0.0, 0.0, 1.0]);
            let shift = [camera.cx - f * axis[0] / axis[2], camera.cy - f * axis[1] / axis[2]];
            [sum[0] + shift[0] / 2.0, sum[1] + shift[1] / 2.0]
        });
        CameraModel { fx: f, fy: f, cx, cy, distortion: Distortion::None, ..*left }
    };
    let seen = |f: f64| cameras.iter().all(|(camera, rotation)| covers(camera, rotation, &view(f)));
    let start = (left.fx + left.fy) / 2.0;
    let mut f = start;
    // Lenses are far from needing a factor of four.
    while !seen(f) && f < start * 4.0 {
        f *= ZOOM;
    }
    while seen(f / ZOOM) && f > start / 4.0 {
        f /= ZOOM;
    }
    view(f)
}

/// Whether the camera saw the whole border of a rectified view.
fn covers(camera: &CameraModel, rotation: &Matrix, view: &CameraModel) -> bool {
    let back = transposed(rotation);
    let (w, h) = (f64::from(view.width - 1), f64::from(view.height - 1));
    let columns = (0..view.width).flat_map(|x| [[f64::from(x), 0.0], [f64::from(x), h]]);
    let rows = (0..view.height).flat_map(|y| [[0.0, f64::from(y)], [w, f64::from(y)]]);
    let (right, bottom) = (f64::from(camera.width - 1), f64::from(camera.height - 1));
    columns.chain(rows).all(|[u, v]| {
        let ray = apply(&back, [(u - view.cx) / view.fx, (v - view.cy) / view.fy, 1.0]);
        let [x, y] = camera.distorted([ray[0] / ray[2], ray[1] / ray[2]]);
        ray[2] > 0.0 && (0.0..=right).contains(&x) && (0.0..=bottom).contains(&y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn euroc(intrinsics: [f64; 4], d: [f64; 4]) -> CameraModel {
        let [fx, fy, cx, cy] = intrinsics;
        let distortion = Distortion::from_parameters([d[0], d[1], d[2], d[3], 0.0]);
        CameraModel { width: 752, height: 480, fx, fy, cx, cy, distortion }
    }

    /// The calibration of the EuRoC MAV dataset (`sensor.yaml` of both cameras) and `right_from_left` made from it.
    #[expect(clippy::excessive_precision, reason = "as another program printed it")]
    fn pair() -> (CameraModel, CameraModel, Matrix, [f64; 3]) {
        let left = euroc([458.654, 457.296, 367.215, 248.375], [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]);
        let right =
            euroc([457.587, 456.134, 379.999, 255.238], [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05]);
        let rotation = [
            9.9999725647744964e-01,
            2.3120671924201593e-03,
            3.7600810235099351e-04,
            -2.3171357232846189e-03,
            9.9989804850652764e-01,
            1.4089835846697310e-02,
            -3.4339312058882950e-04,
            -1.4090668452670355e-02,
            9.9990066263817956e-01,
        ];
        (left, right, rotation, [-1.1007380812713924e-01, 3.9912154701446032e-04, -8.5370250335131941e-04])
    }

    #[test]
    fn a_point_lies_on_one_row_in_both_rectified_pictures() {
        let (left, right, rotation, translation) = pair();
        let model = StereoModel::rectify(left, right, rotation, translation).unwrap();
        assert!((model.baseline_m() - 0.110_078).abs() < 1e-6, "{}", model.baseline_m());
        // R1 and R2 of OpenCV 5.0's stereoRectify for these numbers.
        let by_opencv: [Matrix; 2] = [
            [
                0.9999663475300331,
                -0.00142273913872113,
                0.00807958048341901,
                0.0013657418346425,
                0.9999741760894848,
                0.00705562919925044,
                -0.00808941015686568,
                -0.00704435713882815,
                0.9999424675829178,
            ],
            [
                0.9999633526194377,
                -0.00362581187155608,
                0.00775544366015998,
                0.00368039854725538,
                0.999968475277163,
                -0.00703584525121726,
                -0.00772968852070982,
                0.00706413052949893,
                0.9999451734846442,
            ],
        ];
        for (ours, opencv) in [model.rectified_from_left, model.rectified_from_right].iter().zip(&by_opencv) {
            assert!(ours.iter().zip(opencv).all(|(a, b)| (a - b).abs() < 1e-12), "{ours:?}");
        }
        let view = model.rectified;
        let pixel = |x: [f64; 3]| [view.fx * x[0] / x[2] + view.cx, view.fy * x[1] / x[2] + view.cy];
        for x in [[0.3, -0.2, 1.5], [-2.0, 1.0, 4.0], [0.0, 0.0, 30.0]] {
            let in_right = apply(&rotation, x);
            let in_right: [f64; 3] = std::array::from_fn(|i| in_right[i] + translation[i]);
            let in_left = apply(&model.rectified_from_left, x);
            let (a, b) = (pixel(in_left), pixel(apply(&model.rectified_from_right, in_right)));
            assert!((a[1] - b[1]).abs() < 1e-9, "rows {} and {}", a[1], b[1]);
            assert!((a[0] - b[0] - model.bf / in_left[2]).abs() < 1e-9);
        }
        assert!(covers(&left, &model.rectified_from_left, &view) && covers(&right, &model.rectified_from_right, &view));
        let wider = CameraModel { fx: view.fx / 1.01, fy: view.fy / 1.01, ..view };
        assert!(
            !covers(&left, &model.rectified_from_left, &wider) || !covers(&right, &model.rectified_from_right, &wider)
        );
    }

    #[test]
    fn the_ros_form_keeps_everything() {
        let (left, right, rotation, translation) = pair();
        let model = StereoModel::rectify(left, right, rotation, translation).unwrap();
        let [a, b] = model.to_camera_infos(Header::default(), Header::default());
        assert_eq!(StereoModel::from_camera_infos(&a, &b), Ok(model));
        assert!(!model.is_rectified());
        let plain = StereoModel::of_rectified(model.rectified, 40.0).unwrap();
        let [a, b] = plain.to_camera_infos(Header::default(), Header::default());
        assert!(StereoModel::from_camera_infos(&a, &b).unwrap().is_rectified());
        assert_eq!(b.p[3], -40.0);
    }

    #[test]
    fn what_is_no_stereo_camera_is_refused() {
        let (left, right, rotation, [x, y, z]) = pair();
        for swapped in [[-x, y, z], [0.0, 0.1, 0.0], [0.0; 3], [f64::NAN, 0.0, 0.0]] {
            let error = StereoModel::rectify(left, right, rotation, swapped).unwrap_err();
            assert!(matches!(error, StereoError::Side(_)), "{error}");
        }
        assert!(StereoModel::of_rectified(left, 0.0).is_err());
        let model = StereoModel::rectify(left, right, rotation, [x, y, z]).unwrap();
        let [a, b] = model.to_camera_infos(Header::default(), Header::default());
        let sheared = CameraInfo { r: [1.0; 9], ..a.clone() };
        assert!(StereoModel::from_camera_infos(&sheared, &b).unwrap_err().to_string().contains("no rotation"));
        let other = CameraInfo { p: [1.0; 12], ..b.clone() };
        assert!(StereoModel::from_camera_infos(&a, &other).unwrap_err().to_string().contains("baseline"));
        assert!(StereoModel::from_camera_infos(&b, &a).is_err(), "swapped");
    }
}
