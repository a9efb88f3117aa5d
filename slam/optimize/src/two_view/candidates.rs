//! The motions that a homography or a fundamental matrix allows, translations of length one.

use nalgebra::{Matrix3, Vector3};
use slam_math::Se3;

use crate::camera::Pinhole;
use crate::fundamental::Match;

/// Sweeps after which the singular value iteration gives up; it needs a few.
const MAX_SWEEPS: usize = 100;
/// Squared singular values of a normalised homography that differ by less are a turn on the spot: no translation.
const NO_TRANSLATION: f64 = 1e-6;

/// The four motions of `E = K^T F K` (Hartley and Zisserman 2004, section 9.6.2).
pub(super) fn of_fundamental(f: &Matrix3<f64>, camera: &Pinhole) -> Vec<Se3> {
    let k = calibration(camera);
    let Some((mut u, _, mut v)) = sorted_svd(&(k.transpose() * f * k)) else { return Vec::new() };
    // Signs of the last columns are free: they belong to the singular value zero.
    for m in [&mut u, &mut v] {
        if m.determinant() < 0.0 {
            m.set_column(2, &-m.column(2));
        }
    }
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let along: Vector3<f64> = u.column(2).into_owned();
    let turns = [u * w * v.transpose(), u * w.transpose() * v.transpose()];
    turns.iter().flat_map(|rotation| [along, -along].map(|t| unit(*rotation, t))).flatten().collect()
}

/// The up to four motions of a homography of a plane (Ma, Soatto, Kosecka and Sastry 2004, "An Invitation to 3-D Vision",
/// section 5.3.3, algorithm 5.2).
pub(super) fn of_homography(h: &Matrix3<f64>, camera: &Pinhole, matches: &[Match]) -> Vec<Se3> {
    let k = calibration(camera);
    let Some(inverse) = k.try_inverse() else { return Vec::new() };
    let h = inverse * h * k;
    let Some((_, singular, _)) = sorted_svd(&h) else { return Vec::new() };
    // Of the two signs, the one with which points in front stay in front.
    let depth = |m: &Match| ray(camera, m.current).dot(&(h * ray(camera, m.last)));
    let in_front = matches.iter().filter(|m| depth(m) > 0.0).count();
    let sign = if in_front * 2 < matches.len() { -1.0 } else { 1.0 };
    let h = h * (sign / singular[1]);
    let Some((_, singular, v)) = sorted_svd(&h) else { return Vec::new() };
    let (largest, smallest) = (singular[0] * singular[0], singular[2] * singular[2]);
    if largest - smallest <= NO_TRANSLATION {
        return Vec::new();
    }
    let v = if v.determinant() < 0.0 { -v } else { v };
    let (v1, v2, v3): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
        (v.column(0).into_owned(), v.column(1).into_owned(), v.column(2).into_owned());
    let root = |x: f64| if x > 0.0 { x.sqrt() } else { 0.0 };
    let (a, b, c) = (root(1.0 - smallest), root(largest - 1.0), root(largest - smallest));
    // Two directions that the homography keeps at their length, with v2 they span the plane's two possible attitudes.
    let in_plane = [(v1 * a + v3 * b) / c, (v1 * a - v3 * b) / c];
    let motions = in_plane.iter().flat_map(|u| {
        let normal = v2.cross(u);
        let before = Matrix3::from_columns(&[v2, *u, normal]);
        let (h_v2, h_u) = (h * v2, h * u);
        let after = Matrix3::from_columns(&[h_v2, h_u, h_v2.cross(&h_u)]);
        let rotation = after * before.transpose();
        let translation = (h - rotation) * normal;
        [translation, -translation].map(|t| unit(rotation, t))
    });
    motions.flatten().collect()
}

fn unit(rotation: Matrix3<f64>, translation: Vector3<f64>) -> Option<Se3> {
    let motion = Se3 { rotation, translation: translation / translation.norm() };
    motion.is_finite().then(|| motion.normalized())
}

fn ray(camera: &Pinhole, pixel: [f64; 2]) -> Vector3<f64> {
    let [x, y] = camera.ray(pixel);
    Vector3::new(x, y, 1.0)
}

fn calibration(camera: &Pinhole) -> Matrix3<f64> {
    Matrix3::new(camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)
}

/// `U`, the singular values and `V`, by falling singular value.
fn sorted_svd(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, Vector3<f64>, Matrix3<f64>)> {
    let svd = m.try_svd(true, true, f64::EPSILON, MAX_SWEEPS)?;
    let (u, v) = (svd.u?, svd.v_t?.transpose());
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    let sorted = |m: &Matrix3<f64>| Matrix3::from_columns(&order.map(|i| m.column(i)));
    let values = Vector3::from(order.map(|i| svd.singular_values[i]));
    values.iter().all(|v| v.is_finite()).then(|| (sorted(&u), values, sorted(&v)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;
    use slam_math::Rng;
    use slam_math::se3::skew;

    const CAMERA: Pinhole = Pinhole { fx: 535.4, fy: 539.2, cx: 320.1, cy: 247.6 };

    fn contains(candidates: &[Se3], truth: &Se3) -> bool {
        let wanted = Se3 { translation: truth.translation.normalize(), ..*truth };
        candidates
            .iter()
            .any(|c| (c.rotation - wanted.rotation).norm() + (c.translation - wanted.translation).norm() < 1e-6)
    }

    #[test]
    fn the_true_motion_is_among_the_candidates() {
        let mut rng = Rng::at(1, 0, 0, 0);
        let k = calibration(&CAMERA);
        let back = k.try_inverse().unwrap();
        for _ in 0..100 {
            let truth = Se3::exp(&Vector6::from_fn(|_, _| 0.3 * rng.normal()));
            let f = back.transpose() * skew(&truth.translation) * truth.rotation * back;
            assert!(contains(&of_fundamental(&f, &CAMERA), &truth));
            // A plane in front of the camera: H = R + t n^T / d.
            let normal = Vector3::new(0.3 * rng.normal(), 0.3 * rng.normal(), 1.0).normalize();
            let plane = (truth.rotation + truth.translation * normal.transpose() / 3.0) * (1.0 + rng.uniform());
            let h = k * plane * back;
            let pixels = (0..20).map(|_| [640.0 * rng.uniform(), 480.0 * rng.uniform()]);
            let matches: Vec<Match> = pixels
                .map(|last| {
                    let moved = h * Vector3::new(last[0], last[1], 1.0);
                    Match { last, current: [moved[0] / moved[2], moved[1] / moved[2]] }
                })
                .collect();
            for sign in [1.0, -1.0] {
                let found = of_homography(&(h * sign), &CAMERA, &matches);
                assert!(found.len() == 4 && contains(&found, &truth), "{found:?} {truth:?}");
            }
        }
    }

    #[test]
    fn turning_on_the_spot_has_no_motion() {
        let turn = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.1, 0.2, 0.0)).rotation;
        let k = calibration(&CAMERA);
        assert!(of_homography(&(k * turn * k.try_inverse().unwrap()), &CAMERA, &[]).is_empty());
    }
}
