//! Rigid transforms.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use crate::float;

/// A rigid transform `target_from_source`: `x_target = rotation * x_source + translation`. Metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "[f64; 12]", from = "[f64; 12]")]
pub struct Se3 {
    /// Rotation matrix, orthonormal.
    pub rotation: Matrix3<f64>,
    /// Translation in the target frame, metres.
    pub translation: Vector3<f64>,
}

impl Default for Se3 {
    fn default() -> Self {
        Self::identity()
    }
}

/// Columns of the rotation, then the translation.
impl From<Se3> for [f64; 12] {
    fn from(Se3 { rotation: r, translation: t }: Se3) -> Self {
        std::array::from_fn(|i| if i < 9 { r[i] } else { t[i - 9] })
    }
}

impl From<[f64; 12]> for Se3 {
    fn from(values: [f64; 12]) -> Self {
        let (rotation, translation) = values.split_at(9);
        Self { rotation: Matrix3::from_column_slice(rotation), translation: Vector3::from_column_slice(translation) }
    }
}

impl std::ops::Mul for Se3 {
    type Output = Self;
    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, other: Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            translation: self.rotation * other.translation + self.translation,
        }
    }
}

impl Se3 {
    /// The transform that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// From a translation and a quaternion `[x, y, z, w]` of any length but zero.
    #[must_use]
    pub fn from_quaternion(translation: [f64; 3], xyzw: [f64; 4]) -> Self {
        let q = UnitQuaternion::from_quaternion(Quaternion::new(xyzw[3], xyzw[0], xyzw[1], xyzw[2]));
        Self { rotation: q.to_rotation_matrix().into_inner(), translation: Vector3::from(translation) }
    }

    /// The rotation as a unit quaternion `[x, y, z, w]` with w >= 0 (Shepperd's method: the largest component first).
    #[must_use]
    pub fn quaternion_xyzw(&self) -> [f64; 4] {
        let m = &self.rotation;
        let trace = m[(0, 0)] + m[(1, 1)] + m[(2, 2)];
        let squares = [
            1.0 + m[(0, 0)] - m[(1, 1)] - m[(2, 2)],
            1.0 - m[(0, 0)] + m[(1, 1)] - m[(2, 2)],
            1.0 - m[(0, 0)] - m[(1, 1)] + m[(2, 2)],
            1.0 + trace,
        ];
        let best = (1..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
        let d = 2.0 * squares[best].sqrt();
        let (sum, diff) = (|i, j| (m[(i, j)] + m[(j, i)]) / d, |i, j| (m[(i, j)] - m[(j, i)]) / d);
        let q = match best {
            0 => [d / 4.0, sum(0, 1), sum(0, 2), diff(2, 1)],
            1 => [sum(0, 1), d / 4.0, sum(1, 2), diff(0, 2)],
            2 => [sum(0, 2), sum(1, 2), d / 4.0, diff(1, 0)],
            _ => [diff(2, 1), diff(0, 2), diff(1, 0), d / 4.0],
        };
        let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
        let s = if q[3] < 0.0 { -norm } else { norm };
        q.map(|c| c / s)
    }

    /// `source_from_target`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// A point of the source frame in the target frame.
    #[must_use]
    pub fn transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    /// Rotation angle in radians, 0 to pi. Exact near zero, where the arc cosine of the trace is not.
    #[must_use]
    pub fn angle(&self) -> f64 {
        let q = self.quaternion_xyzw();
        2.0 * float::atan2((q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt(), q[3])
    }

    /// Exponential of a twist `[translation part, rotation part]` (Sophus' order).
    #[must_use]
    pub fn exp(twist: &Vector6<f64>) -> Self {
        let (upsilon, omega) = (twist.fixed_rows::<3>(0).into_owned(), twist.fixed_rows::<3>(3).into_owned());
        let theta2 = omega.dot(&omega);
        let theta = theta2.sqrt();
        // Below 1e-4 rad the series is exact to the last bit; the closed forms cancel.
        let (a, b, c) = if theta < 1e-4 {
            (1.0 - theta2 / 6.0, 0.5 - theta2 / 24.0, 1.0 / 6.0 - theta2 / 120.0)
        } else {
            let (s, co) = (float::sin(theta), float::cos(theta));
            (s / theta, (1.0 - co) / theta2, (theta - s) / (theta2 * theta))
        };
        let k = skew(&omega);
        let k2 = k * k;
        let rotation = Matrix3::identity() + k * a + k2 * b;
        let v = Matrix3::identity() + k * b + k2 * c;
        Self { rotation, translation: v * upsilon }
    }

    /// Inverse of [`exp`](Self::exp): `[translation part, rotation part]`.
    #[must_use]
    pub fn log(&self) -> Vector6<f64> {
        let q = self.quaternion_xyzw();
        let axis = Vector3::new(q[0], q[1], q[2]);
        let sin_half = axis.norm();
        let omega = if sin_half < 1e-10 { axis * 2.0 } else { axis * (2.0 * float::atan2(sin_half, q[3]) / sin_half) };
        let theta2 = omega.dot(&omega);
        let theta = theta2.sqrt();
        let c = if theta < 1e-3 {
            1.0 / 12.0 + theta2 / 720.0
        } else {
            let half = theta * 0.5;
            (1.0 - half * float::cos(half) / float::sin(half)) / theta2
        };
        let k = skew(&omega);
        let v_inverse = Matrix3::identity() - k * 0.5 + k * k * c;
        let upsilon = v_inverse * self.translation;
        Vector6::new(upsilon[0], upsilon[1], upsilon[2], omega[0], omega[1], omega[2])
    }

    /// The same transform with its rotation made orthonormal again, through its quaternion.
    #[must_use]
    pub fn normalized(&self) -> Self {
        Self::from_quaternion(self.translation.into(), self.quaternion_xyzw())
    }

    /// True when every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.rotation.iter().chain(self.translation.iter()).all(|v| v.is_finite())
    }

    /// The twelve numbers `[R | t]`, row by row, for digests.
    #[must_use]
    pub fn rows(&self) -> [f64; 12] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|i| if i % 4 == 3 { t[i / 4] } else { r[(i / 4, i % 4)] })
    }
}

/// The matrix of `v x .`.
#[must_use]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    fn random_twist(rng: &mut Rng, scale: f64) -> Vector6<f64> {
        Vector6::from_fn(|_, _| (rng.uniform() - 0.5) * scale)
    }

    fn distance(a: &Se3, b: &Se3) -> f64 {
        (a.rotation - b.rotation).norm() + (a.translation - b.translation).norm()
    }

    #[test]
    fn group_laws_hold() {
        let mut rng = Rng::at(1, 0, 0, 0);
        for _ in 0..200 {
            let [a, b, c] = std::array::from_fn(|_| Se3::exp(&random_twist(&mut rng, 4.0)));
            assert!(distance(&((a * b) * c), &(a * (b * c))) < 1e-12);
            assert!(distance(&(a * a.inverse()), &Se3::identity()) < 1e-12);
            let p = Vector3::new(0.3, -2.0, 1.0);
            assert!(((a * b).transform(&p) - a.transform(&b.transform(&p))).norm() < 1e-12);
        }
    }

    #[test]
    fn log_inverts_exp_at_every_magnitude() {
        let mut rng = Rng::at(2, 0, 0, 0);
        for scale in [1e-12, 1e-8, 1e-4, 1e-2, 1.0, 3.0] {
            for _ in 0..50 {
                let twist = random_twist(&mut rng, scale);
                let back = Se3::exp(&twist).log();
                assert!((back - twist).norm() < 1e-9 * (1.0 + scale), "{scale}: {twist} {back}");
            }
        }
    }

    #[test]
    fn quaternions_round_trip_also_at_half_turns() {
        let half_turns = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.6, 0.0, 0.8, 0.0]];
        for q in half_turns {
            let back = Se3::from_quaternion([1.0, 2.0, 3.0], q).quaternion_xyzw();
            let dot: f64 = q.iter().zip(back).map(|(a, b)| a * b).sum();
            assert!(dot.abs() > 1.0 - 1e-12, "{q:?} {back:?}");
        }
    }

    #[test]
    fn angle_is_exact_for_tiny_rotations() {
        let tiny = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 1e-9, 0.0, 0.0));
        assert!((tiny.angle() - 1e-9).abs() < 1e-20);
    }
}
