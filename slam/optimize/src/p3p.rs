//! Where is the camera? Its pose from points of the map and their pixels alone.
//!
//! Three points leave up to four poses. The distances to them satisfy three quadratic equations; two homogeneous ones
//! remain without the scale, and the singular members of their pencil are pairs of lines (the route of Persson and Nordberg
//! 2018, "Lambda Twist: An Accurate Fast Robust Perspective Three Point (P3P) Solver": a cubic instead of a quartic).

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use slam_math::{Buffers, Rng, Se3};

use crate::absolute::AbsoluteOptions;
use crate::camera::{DepthCamera, Pinhole};
use crate::cubic::{pencil_determinant, real_roots};
use crate::pose::{PoseObservation, PoseOptions, PoseResult, optimize_pose};
use crate::ransac::samples_needed;

/// Sweeps after which the eigenvalue iteration gives up; it needs a few.
const MAX_SWEEPS: usize = 100;
/// Newton steps on the three distances: each doubles the digits.
const POLISH: u32 = 3;

/// Up to four poses `camera_from_world` that see three points (world, metres) along three rays (unit length, in the
/// camera's frame), all in front of the camera. None when the points lie on a line.
pub fn p3p(points: &[Vector3<f64>; 3], rays: &[Vector3<f64>; 3]) -> impl Iterator<Item = Se3> + use<> {
    let (points, rays) = (*points, *rays);
    let poses = distances(&points, &rays)
        .map(move |found| found.and_then(|d| pose_of(&points, &[rays[0] * d[0], rays[1] * d[1], rays[2] * d[2]])));
    poses.into_iter().flatten()
}

/// One of the three equations: `d^T M d = squared` for the distances `d`.
fn equation(points: &[Vector3<f64>; 3], rays: &[Vector3<f64>; 3], i: usize, j: usize) -> (Matrix3<f64>, f64) {
    let mut m = Matrix3::zeros();
    (m[(i, i)], m[(j, j)]) = (1.0, 1.0);
    let cos = rays[i].dot(&rays[j]);
    (m[(i, j)], m[(j, i)]) = (-cos, -cos);
    (m, (points[i] - points[j]).norm_squared())
}

/// Distances of the three points from the camera's centre.
fn distances(points: &[Vector3<f64>; 3], rays: &[Vector3<f64>; 3]) -> [Option<Vector3<f64>>; 4] {
    let equations = [(0, 1), (0, 2), (1, 2)].map(|(i, j)| equation(points, rays, i, j));
    let [(m01, a01), (m02, a02), (m12, a12)] = equations;
    // Without the right sides: two conics in the ratios of the distances.
    let conics = [m01 * a12 - m12 * a01, m02 * a12 - m12 * a02].map(|conic| conic / conic.norm());
    let Some((lines, other)) = line_pair(&conics) else { return [None; 4] };
    let directions = lines.map(|line| intersections(&line, &other));
    let all = [directions[0][0], directions[0][1], directions[1][0], directions[1][1]];
    all.map(|direction| {
        let direction = direction? * direction?.sum().signum();
        let squared = (a01 + a02 + a12) / direction.dot(&((m01 + m02 + m12) * direction));
        polish(direction * squared.sqrt(), &equations).filter(|d| d.iter().all(|v| v.is_finite() && *v > 0.0))
    })
}

/// A line of the projective plane by two of its points.
type Line = [Vector3<f64>; 2];

/// The best conditioned pair of real lines in the pencil of two conics, and a conic to intersect them with.
fn line_pair(conics: &[Matrix3<f64>; 2]) -> Option<([Line; 2], Matrix3<f64>)> {
    let mut best: Option<(f64, [Line; 2], Matrix3<f64>)> = None;
    for root in real_roots(pencil_determinant(&conics[0], &conics[1])).into_iter().flatten() {
        let singular = conics[0] + conics[1] * root;
        let singular = singular / singular.norm();
        if !singular.iter().all(|v| v.is_finite()) {
            continue;
        }
        let Some(eigen) = SymmetricEigen::try_new(singular, f64::EPSILON, MAX_SWEEPS) else { continue };
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [low, vertex, high] = order.map(|i| (eigen.eigenvalues[i], eigen.eigenvectors.column(i).into_owned()));
        let quality = slam_math::float::min(high.0, -low.0);
        if quality <= 0.0 || best.as_ref().is_some_and(|(most, ..)| quality <= *most) {
            continue;
        }
        // high (e_h . x)^2 = -low (e_l . x)^2: two lines through the vertex.
        let (h, l) = (high.1 * high.0.sqrt(), low.1 * (-low.0).sqrt());
        let lines = [h - l, h + l].map(|normal| [vertex.1, normal.cross(&vertex.1).normalize()]);
        // On the lines both conics vanish together; the one that weighs less in the singular member says more.
        best = Some((quality, lines, conics[usize::from(root.abs() <= 1.0)]));
    }
    best.map(|(_, lines, conic)| (lines, conic))
}

fn intersections([u, v]: &Line, conic: &Matrix3<f64>) -> [Option<Vector3<f64>>; 2] {
    let (a, b, c) = (u.dot(&(conic * u)), u.dot(&(conic * v)), v.dot(&(conic * v)));
    let discriminant = b * b - a * c;
    // Touching conics may miss each other by rounding.
    if discriminant < -1e-12 {
        return [None; 2];
    }
    let q = -(b + b.signum() * slam_math::float::max(discriminant, 0.0).sqrt());
    [u * q + v * a, u * c + v * q].map(Some)
}

fn polish(mut d: Vector3<f64>, equations: &[(Matrix3<f64>, f64); 3]) -> Option<Vector3<f64>> {
    for _ in 0..POLISH {
        let rows = [0, 1, 2].map(|k| (equations[k].0 * d).transpose() * 2.0);
        let error = Vector3::from_fn(|k, _| d.dot(&(equations[k].0 * d)) - equations[k].1);
        // A double solution has no slope; what is reached then is as good as it gets.
        let Some(step) = Matrix3::from_rows(&rows).lu().solve(&error).filter(|s| s.norm() < d.norm()) else { break };
        d -= step;
    }
    // What does not satisfy the equations is no solution: the pair of lines was complex, or the points degenerate.
    let fits = |(m, squared): &(Matrix3<f64>, f64)| (d.dot(&(m * d)) - squared).abs() <= 1e-6 * squared;
    equations.iter().all(fits).then_some(d)
}

/// The rigid transform of a triangle to a congruent one; `None` for points on a line.
fn pose_of(world: &[Vector3<f64>; 3], camera: &[Vector3<f64>; 3]) -> Option<Se3> {
    let frame = |p: &[Vector3<f64>; 3]| {
        let x = (p[1] - p[0]).normalize();
        let z = x.cross(&(p[2] - p[0])).normalize();
        Matrix3::from_columns(&[x, z.cross(&x), z])
    };
    let rotation = frame(camera) * frame(world).transpose();
    let pose = Se3 { rotation, translation: camera[0] - rotation * world[0] };
    pose.is_finite().then_some(pose)
}

/// The pose that most observations agree with, refined by [`optimize_pose`] with its gates and budget.
///
/// `bf` is the virtual baseline times fx (metres * pixels); disparities, where there are any, help to judge. An observation
/// agrees when its chi-square value is within the gate of `refinement`. `None` when fewer than `options.min_inliers` do.
#[must_use]
pub fn absolute_pose_ransac(
    rng: &mut Rng,
    camera: &Pinhole,
    bf: f64,
    observations: &[PoseObservation],
    options: &AbsoluteOptions,
    refinement: &PoseOptions,
) -> Option<PoseResult> {
    let finite = |o: &&PoseObservation| o.measurement.is_usable() && o.point_in_world.iter().all(|v| v.is_finite());
    let buffers = Buffers::default();
    let usable = buffers.collect(observations.iter().filter(finite).copied());
    let depth_camera = DepthCamera { pinhole: *camera, bf };
    let agreeing = |pose: &Se3| {
        let agrees = |o: &&PoseObservation| {
            let gate = if o.measurement.disparity.is_some() { refinement.chi2_stereo } else { refinement.chi2_mono };
            let x = pose.transform(&o.point_in_world);
            depth_camera.chi2(&x, &o.measurement).is_some_and(|chi2| chi2 <= gate)
        };
        buffers.collect(usable.iter().filter(agrees).copied())
    };
    let local = PoseOptions { rounds: 1, ..*refinement };
    let mut best: Option<(Se3, usize)> = None;
    let (mut needed, mut drawn) = (options.max_iterations, 0);
    while drawn < needed {
        drawn += 1;
        let sample = rng.sample::<3>(usable.len())?.map(|i| usable[i]);
        let rays = sample.map(|o| camera.unproject(o.measurement.pixel, 1.0).normalize());
        for pose in p3p(&sample.map(|o| o.point_in_world), &rays) {
            let inliers = agreeing(&pose);
            if inliers.len() <= best.as_ref().map_or(2, |(_, most)| *most) {
                continue;
            }
            // Three noisy points make a rough pose: its inliers make a better one with more of them.
            let refined = optimize_pose(camera, bf, &inliers, &pose, &local, &buffers).camera_from_world;
            let count = agreeing(&refined).len();
            let found = if count >= inliers.len() { (refined, count) } else { (pose, inliers.len()) };
            let share = found.1 as f64 / usable.len() as f64;
            needed = samples_needed(share, 3, options.confidence, options.max_iterations);
            best = Some(found);
        }
    }
    let result = optimize_pose(camera, bf, observations, &best?.0, refinement, &buffers);
    Some(result).filter(|found| found.inliers >= options.min_inliers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    #[test]
    fn the_true_pose_is_among_the_solutions() {
        let mut rng = Rng::at(1, 0, 0, 0);
        let (mut missed, mut many) = (0, 0);
        for _ in 0..2000 {
            let truth = Se3::exp(&Vector6::from_fn(|_, _| rng.normal()));
            let in_camera: [Vector3<f64>; 3] = std::array::from_fn(|_| {
                let z = 0.5 + 5.0 * rng.uniform();
                Vector3::new((rng.uniform() - 0.5) * z, (rng.uniform() - 0.5) * z, z)
            });
            let world = in_camera.map(|x| truth.inverse().transform(&x));
            let rays = in_camera.map(|x| x.normalize());
            let found: Vec<Se3> = p3p(&world, &rays).collect();
            for pose in &found {
                for (x, ray) in world.iter().zip(&rays) {
                    assert!((pose.transform(x).normalize() - ray).norm() < 1e-5, "{found:?}");
                }
            }
            let error =
                |pose: &Se3| (pose.rotation - truth.rotation).norm() + (pose.translation - truth.translation).norm();
            missed += u32::from(!found.iter().any(|pose| error(pose) < 1e-4));
            many += u32::from(found.len() > 1);
        }
        // Where two solutions fall together no digits are left to tell them.
        assert!(missed <= 2 && many > 500, "{missed} missed, {many} with more than one solution");
    }

    #[test]
    fn degenerate_triples_have_no_pose() {
        let line = [0.0, 1.0, 2.0].map(|x| Vector3::new(x, 0.0, 3.0));
        assert_eq!(p3p(&line, &line.map(|x| x.normalize())).count(), 0);
        assert_eq!(p3p(&[Vector3::zeros(); 3], &[Vector3::z(); 3]).count(), 0);
        assert_eq!(p3p(&[Vector3::repeat(f64::NAN); 3], &[Vector3::z(); 3]).count(), 0);
    }
}
