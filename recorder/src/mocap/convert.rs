//! Numbers of motion capture systems as rigid transforms in metres.

use nalgebra::{Matrix3, Vector3, Vector6};
use slam_math::{Se3, float};

/// Millimetres a metre.
pub const MM_PER_M: f64 = 1000.0;

/// How far a matrix may be from a rotation: well above what is lost in 32 bits, well below what a wrong matrix has.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Which axis of the system's world points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Ours: z is up.
    ZUp,
    /// y is up.
    YUp,
}

impl Axis {
    /// `z_up_from_native`: a quarter turn about x, which both have in common.
    fn z_up_from_native(self) -> Matrix3<f64> {
        match self {
            Self::ZUp => Matrix3::identity(),
            Self::YUp => Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0),
        }
    }

    /// A pose of the native world in ours. World and body axes turn alike, so that the body at rest stays at rest.
    #[must_use]
    pub fn pose_to_z_up(self, pose: &Se3) -> Se3 {
        let turn = self.z_up_from_native();
        Se3 { rotation: turn * pose.rotation * turn.transpose(), translation: turn * pose.translation }
    }

    /// The other way round.
    #[must_use]
    pub fn pose_from_z_up(self, pose: &Se3) -> Se3 {
        let turn = self.z_up_from_native();
        Se3 { rotation: turn.transpose() * pose.rotation * turn, translation: turn.transpose() * pose.translation }
    }

    /// A point of the native world in ours.
    #[must_use]
    pub fn point_to_z_up(self, point: [f64; 3]) -> [f64; 3] {
        (self.z_up_from_native() * Vector3::from(point)).into()
    }

    /// The other way round.
    #[must_use]
    pub fn point_from_z_up(self, point: [f64; 3]) -> [f64; 3] {
        (self.z_up_from_native().transpose() * Vector3::from(point)).into()
    }
}

/// From a rotation matrix row by row and millimetres; `None` if that is no rigid transform.
#[must_use]
pub fn from_matrix(rows: [f64; 9], translation_mm: [f64; 3]) -> Option<Se3> {
    let rotation = Matrix3::from_row_slice(&rows);
    let translation = Vector3::from(translation_mm) / MM_PER_M;
    let error = (rotation * rotation.transpose() - Matrix3::identity()).abs().max();
    // A NaN is no small error.
    let is_rotation = error < ROTATION_TOLERANCE && rotation.determinant() > 0.0;
    let pose = Se3 { rotation, translation };
    (is_rotation && pose.is_finite()).then(|| pose.normalized())
}

/// From a rotation vector in radians and millimetres; `None` if a number is not finite.
#[must_use]
pub fn from_rotation_vector(vector: [f64; 3], translation_mm: [f64; 3]) -> Option<Se3> {
    let rotation = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, vector[0], vector[1], vector[2])).rotation;
    let pose = Se3 { rotation, translation: Vector3::from(translation_mm) / MM_PER_M };
    pose.is_finite().then_some(pose)
}

/// From angles about the moving x, then y, then z axis, radians, and millimetres; `None` if a number is not finite.
#[must_use]
pub fn from_euler_xyz(angles: [f64; 3], translation_mm: [f64; 3]) -> Option<Se3> {
    let about = |axis: usize| {
        let (s, c) = (float::sin(angles[axis]), float::cos(angles[axis]));
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut turn = Matrix3::identity();
        (turn[(a, a)], turn[(a, b)], turn[(b, a)], turn[(b, b)]) = (c, -s, s, c);
        turn
    };
    let pose = Se3 { rotation: about(0) * about(1) * about(2), translation: Vector3::from(translation_mm) / MM_PER_M };
    pose.is_finite().then_some(pose)
}

/// The angles that [`from_euler_xyz`] takes, radians.
#[must_use]
pub fn to_euler_xyz(rotation: &Matrix3<f64>) -> [f64; 3] {
    let r = |row, column| rotation[(row, column)];
    let cos_y = (r(0, 0) * r(0, 0) + r(0, 1) * r(0, 1)).sqrt();
    let y = float::atan2(r(0, 2), cos_y);
    if cos_y > 1e-9 {
        [float::atan2(-r(1, 2), r(2, 2)), y, float::atan2(-r(0, 1), r(0, 0))]
    } else {
        // x and z turn about the same line: all of it is x.
        [float::atan2(r(2, 1), r(1, 1)), y, 0.0]
    }
}

/// From metres and a quaternion x, y, z, w; `None` if a number is not finite or the quaternion is far from length 1.
#[must_use]
pub fn from_quaternion(position_m: [f64; 3], xyzw: [f64; 4]) -> Option<Se3> {
    let square = xyzw.iter().fold(0.0, |sum, v| sum + v * v);
    let is_unit = (square - 1.0).abs() < ROTATION_TOLERANCE;
    let pose = is_unit.then(|| Se3::from_quaternion(position_m, xyzw))?;
    pose.is_finite().then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_pose() -> Se3 {
        Se3::exp(&Vector6::new(0.3, -0.2, 1.5, 0.4, -1.1, 0.7))
    }

    fn distance(a: &Se3, b: &Se3) -> f64 {
        (a.inverse() * *b).log().norm()
    }

    #[test]
    fn all_forms_say_the_same() {
        let pose = some_pose();
        let mm: [f64; 3] = (pose.translation * MM_PER_M).into();
        let r = &pose.rotation;
        let rows: [f64; 9] = std::array::from_fn(|i| r[(i / 3, i % 3)]);
        let twist = Se3 { translation: Vector3::zeros(), ..pose }.log();
        let euler = from_euler_xyz(to_euler_xyz(r), mm).unwrap();
        for other in [
            from_matrix(rows, mm).unwrap(),
            from_rotation_vector([twist[3], twist[4], twist[5]], mm).unwrap(),
            from_quaternion(pose.translation.into(), pose.quaternion_xyzw()).unwrap(),
            euler,
        ] {
            assert!(distance(&pose, &other) < 1e-12, "{other:?}");
        }
    }

    #[test]
    fn euler_angles_at_the_pole() {
        let pose = from_euler_xyz([0.3, std::f64::consts::FRAC_PI_2, 0.4], [0.0; 3]).unwrap();
        let again = from_euler_xyz(to_euler_xyz(&pose.rotation), [0.0; 3]).unwrap();
        assert!(distance(&pose, &again) < 1e-9);
    }

    #[test]
    fn what_is_no_pose_is_none() {
        assert_eq!(from_matrix([0.0; 9], [0.0; 3]), None);
        assert_eq!(from_matrix([f64::NAN; 9], [0.0; 3]), None);
        assert_eq!(from_matrix([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0], [0.0; 3]), None);
        assert_eq!(from_matrix([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [f64::INFINITY; 3]), None);
        assert_eq!(from_rotation_vector([f64::NAN; 3], [0.0; 3]), None);
        assert_eq!(from_euler_xyz([f64::INFINITY; 3], [0.0; 3]), None);
        assert_eq!(from_quaternion([0.0; 3], [0.0; 4]), None);
        assert_eq!(from_quaternion([f64::NAN; 3], [0.0, 0.0, 0.0, 1.0]), None);
    }

    #[test]
    fn up_is_up() {
        assert_eq!(Axis::YUp.point_to_z_up([1.0, 2.0, 3.0]), [1.0, -3.0, 2.0]);
        assert_eq!(Axis::YUp.point_from_z_up([1.0, -3.0, 2.0]), [1.0, 2.0, 3.0]);
        let pose = some_pose();
        let back = Axis::YUp.pose_to_z_up(&Axis::YUp.pose_from_z_up(&pose));
        assert!(distance(&pose, &back) < 1e-12);
    }
}
