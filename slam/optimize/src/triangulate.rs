//! A point from two rays.

use nalgebra::{Cholesky, Matrix3, Vector3};
use slam_math::{Se3, float};

use crate::camera::MIN_DEPTH_M;

/// The world point (metres) seen along `first_ray` and `second_ray`, normalised image coordinates `(x / z, y / z)` of two
/// cameras with known poses: linear least squares on both projections. `None` when the angle between the rays is below
/// `min_parallax_rad`, when the point lies behind a camera, or when a number is not finite.
#[must_use]
pub fn triangulate(
    first_from_world: &Se3,
    second_from_world: &Se3,
    first_ray: [f64; 2],
    second_ray: [f64; 2],
    min_parallax_rad: f64,
) -> Option<Vector3<f64>> {
    // In the first camera's frame, so that the conditioning does not depend on where the world's origin is.
    let second_from_first = *second_from_world * first_from_world.inverse();
    let (first, second) = (direction(first_ray), direction(second_ray));
    let turned = second_from_first.rotation.tr_mul(&second);
    let angle = float::atan2(first.cross(&turned).norm(), first.dot(&turned));
    if angle.is_nan() || angle < min_parallax_rad {
        return None;
    }
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (camera, ray) in [(Se3::identity(), first_ray), (second_from_first, second_ray)] {
        for (axis, coordinate) in ray.into_iter().enumerate() {
            let row = (camera.rotation.row(2) * coordinate - camera.rotation.row(axis)).transpose();
            normal += row * row.transpose();
            right += row * (camera.translation[axis] - coordinate * camera.translation[2]);
        }
    }
    let point = Cholesky::new(normal)?.solve(&right);
    let in_front = point[2] > MIN_DEPTH_M && second_from_first.transform(&point)[2] > MIN_DEPTH_M;
    let world = first_from_world.inverse().transform(&point);
    (in_front && world.iter().all(|v| v.is_finite())).then_some(world)
}

fn direction(ray: [f64; 2]) -> Vector3<f64> {
    Vector3::new(ray[0], ray[1], 1.0)
}
