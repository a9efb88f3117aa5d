//! Similarity transforms: rotation, translation and scale.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3, Vector6};

use crate::se3::{Se3, skew};
use crate::{LieGroup, float};

/// Tangent of [`Sim3`]: `[translation part, rotation part, logarithm of the scale]`.
pub type Vector7 = SVector<f64, 7>;

/// A similarity `target_from_source`: `x_target = scale * rotation * x_source + translation`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Sim3 {
    /// Length in the target frame of one unit of the source frame, > 0.
    pub scale: f64,
    /// Rotation and translation.
    pub se3: Se3,
}

impl Default for Sim3 {
    fn default() -> Self {
        Self::identity()
    }
}

impl From<Se3> for Sim3 {
    /// Scale 1.
    fn from(se3: Se3) -> Self {
        Self { scale: 1.0, se3 }
    }
}

impl std::ops::Mul for Sim3 {
    type Output = Self;
    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, other: Self) -> Self {
        let rotation = self.se3.rotation * other.se3.rotation;
        let translation = self.transform(&other.se3.translation);
        Self { scale: self.scale * other.scale, se3: Se3 { rotation, translation } }
    }
}

impl Sim3 {
    /// The transform that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Se3::identity().into()
    }

    /// A point of the source frame in the target frame.
    #[must_use]
    pub fn transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.se3.rotation * point * self.scale + self.se3.translation
    }

    /// `source_from_target`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.se3.rotation.transpose();
        let scale = 1.0 / self.scale;
        Self { scale, se3: Se3 { rotation, translation: -(rotation * self.se3.translation) * scale } }
    }

    /// The rigid transform of a camera whose world this similarity scales: for `camera_from_world`, the camera with the
    /// same centre and rotation that sees a world of the target's unit, `translation / scale`.
    #[must_use]
    pub fn to_se3(&self) -> Se3 {
        Se3 { rotation: self.se3.rotation, translation: self.se3.translation / self.scale }
    }

    /// Exponential of `[upsilon, omega, sigma]`: scale `e^sigma`, rotation `exp(omega)`, translation `W upsilon` (Strasdat
    /// 2012, "Local Accuracy and Global Consistency for Efficient Visual SLAM", section 2.4).
    #[must_use]
    pub fn exp(tangent: &Vector7) -> Self {
        let omega = Vector3::new(tangent[3], tangent[4], tangent[5]);
        let turn = Vector6::new(0.0, 0.0, 0.0, omega[0], omega[1], omega[2]);
        let rotation = Se3::exp(&turn).rotation;
        let translation = translation_factor(&omega, tangent[6]) * tangent.fixed_rows::<3>(0);
        Self { scale: float::exp(tangent[6]), se3: Se3 { rotation, translation } }
    }

    /// Inverse of [`exp`](Self::exp). Not a number where the scale is not above zero.
    #[must_use]
    pub fn log(&self) -> Vector7 {
        let turn = Se3 { rotation: self.se3.rotation, translation: Vector3::zeros() }.log();
        let omega = Vector3::new(turn[3], turn[4], turn[5]);
        let sigma = float::ln(self.scale);
        let unsolvable = || Vector3::repeat(f64::NAN);
        let factor = translation_factor(&omega, sigma).lu();
        let u = factor.solve(&self.se3.translation).unwrap_or_else(unsolvable);
        Vector7::from([u[0], u[1], u[2], omega[0], omega[1], omega[2], sigma])
    }

    /// True when every number is finite and the scale is above zero.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.se3.is_finite() && self.scale.is_finite() && self.scale > 0.0
    }
}

/// `W = integral over u in 0..1 of exp(u (sigma I + [omega]))`, the matrix that takes the tangent's translation part to
/// the translation.
fn translation_factor(omega: &Vector3<f64>, sigma: f64) -> Matrix3<f64> {
    let k = skew(omega);
    let theta2 = omega.dot(omega);
    let (one, sum) = (Matrix3::identity(), theta2 + sigma * sigma);
    if sum < 0.25 {
        // The closed form cancels here. The series sum M^n / (n + 1)! in Horner's form: with |M| <= 1/2 its 15th term is
        // below 2^-60.
        let m = k + one * sigma;
        return (2..=15).rev().fold(one, |tail, n| one + m * tail / f64::from(n));
    }
    let theta = theta2.sqrt();
    let (scale, cos) = (float::exp(sigma), float::cos(theta));
    let sinc = if theta < 1e-8 { 1.0 } else { float::sin(theta) / theta };
    let along = if sigma.abs() < 1e-8 { 1.0 + sigma / 2.0 } else { float::exp_m1(sigma) / sigma };
    let by_k = (scale * (sigma * sinc - cos) + 1.0) / sum;
    // Integral of e^(sigma u) cos(theta u); the difference below loses digits for a small angle, where [omega]^2 is small.
    let turned = (scale * (sigma * cos + theta2 * sinc) - sigma) / sum;
    let by_k2 = if theta < 1e-8 { 0.0 } else { (along - turned) / theta2 };
    one * along + k * by_k + k * k * by_k2
}

impl LieGroup<7> for Sim3 {
    fn exp(tangent: &Vector7) -> Self {
        Self::exp(tangent)
    }

    fn log(&self) -> Vector7 {
        self.log()
    }

    fn inverse(&self) -> Self {
        self.inverse()
    }

    fn adjoint(&self) -> SMatrix<f64, 7, 7> {
        let (r, t) = (&self.se3.rotation, &self.se3.translation);
        let mut out = SMatrix::<f64, 7, 7>::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&(r * self.scale));
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&(skew(t) * r));
        out.fixed_view_mut::<3, 1>(0, 6).copy_from(&-t);
        out.fixed_view_mut::<3, 3>(3, 3).copy_from(r);
        out[(6, 6)] = 1.0;
        out
    }

    fn bracket(tangent: &Vector7) -> SMatrix<f64, 7, 7> {
        let upsilon = Vector3::new(tangent[0], tangent[1], tangent[2]);
        let turn = skew(&Vector3::new(tangent[3], tangent[4], tangent[5]));
        let mut out = SMatrix::<f64, 7, 7>::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&(turn + Matrix3::identity() * tangent[6]));
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&skew(&upsilon));
        out.fixed_view_mut::<3, 1>(0, 6).copy_from(&-upsilon);
        out.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
        out
    }

    fn normalized(&self) -> Self {
        Self { scale: self.scale, se3: self.se3.normalized() }
    }

    fn is_finite(&self) -> bool {
        self.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    fn random(rng: &mut Rng, spread: f64) -> Vector7 {
        Vector7::from_fn(|_, _| (rng.uniform() - 0.5) * spread)
    }

    fn distance(a: &Sim3, b: &Sim3) -> f64 {
        (a.se3.rotation - b.se3.rotation).norm()
            + (a.se3.translation - b.se3.translation).norm()
            + (a.scale - b.scale).abs()
    }

    #[test]
    fn group_laws_hold() {
        let mut rng = Rng::at(1, 0, 0, 0);
        for _ in 0..200 {
            let [a, b, c] = std::array::from_fn(|_| Sim3::exp(&random(&mut rng, 3.0)));
            assert!(distance(&((a * b) * c), &(a * (b * c))) < 1e-11);
            assert!(distance(&(a * a.inverse()), &Sim3::identity()) < 1e-11);
            let p = Vector3::new(0.3, -2.0, 1.0);
            assert!(((a * b).transform(&p) - a.transform(&b.transform(&p))).norm() < 1e-11);
        }
    }

    /// All four combinations of small and large angle and scale, and the seams between the branches.
    #[test]
    fn log_inverts_exp_at_every_magnitude() {
        let mut rng = Rng::at(2, 0, 0, 0);
        let sizes = [0.0, 1e-12, 1e-9, 1e-7, 1e-4, 1e-2, 0.1, 0.4, 0.5, 0.6, 1.5, 2.9];
        for (angle, sigma) in sizes.iter().flat_map(|a| sizes.map(|s| (*a, s))) {
            for sign in [-1.0, 1.0] {
                let axis = Vector3::from_fn(|_, _| rng.normal()).normalize() * angle;
                let u = Vector3::from_fn(|_, _| rng.normal());
                let tangent = Vector7::from([u[0], u[1], u[2], axis[0], axis[1], axis[2], sign * sigma]);
                let back = Sim3::exp(&tangent).log();
                assert!((back - tangent).norm() < 1e-9, "angle {angle}, sigma {sigma}: {back} {tangent}");
            }
        }
    }

    /// The exponential of a sum of steps in one direction is the product of the steps: checks `W` itself, which `log`
    /// after `exp` does not.
    #[test]
    fn exp_is_a_one_parameter_group() {
        let mut rng = Rng::at(3, 0, 0, 0);
        for spread in [1e-3, 0.1, 1.0, 3.0] {
            let tangent = random(&mut rng, spread);
            let step = Sim3::exp(&(tangent / 64.0));
            let product = (0..64).fold(Sim3::identity(), |product, _| step * product);
            assert!(distance(&product, &Sim3::exp(&tangent)) < 1e-12 * (1.0 + spread) * 10.0, "{spread}");
        }
    }

    #[test]
    fn scale_one_is_the_rigid_group() {
        let mut rng = Rng::at(4, 0, 0, 0);
        let twist = Vector6::from_fn(|_, _| rng.normal());
        let tangent = Vector7::from_fn(|i, _| if i < 6 { twist[i] } else { 0.0 });
        let rigid = Se3::exp(&twist);
        assert!(distance(&Sim3::exp(&tangent), &rigid.into()) < 1e-12);
        assert!((Sim3::from(rigid).to_se3().translation - rigid.translation).norm() == 0.0);
    }

    #[test]
    fn a_scaled_camera_sees_the_same_rays() {
        let mut rng = Rng::at(5, 0, 0, 0);
        let camera_from_world = Sim3::exp(&random(&mut rng, 2.0));
        let point = Vector3::new(0.2, -0.4, 3.0);
        let (a, b) = (camera_from_world.transform(&point), camera_from_world.to_se3().transform(&point));
        assert!((a / camera_from_world.scale - b).norm() < 1e-12);
    }
}
