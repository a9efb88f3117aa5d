//! Evidence of motion from a keypoint without depth: where the static world could have shown it a moment ago.

use nalgebra::Vector3;

use super::Remembered;
use super::evidence::{KEYPOINT_SIGMA_PX, find_again};
use crate::context::Context;
use crate::observation::Observation;
use slam_math::Se3;

/// Nothing is taken to be nearer than this share of the scene's median depth. What is, a hand before the lens, may be
/// taken for a mover.
const NEAREST_SHARE: f64 = 0.2;

/// How far keypoint `i` is, in sigmas of pixel noise, from every place where the static world could have shown it in an
/// older frame: the piece of its epipolar line from the nearest depth to infinity. `None` when it is not found again.
/// `nearby` is scratch.
///
/// The camera's own motion sets what this can see. While it stands still the piece is a point and every motion shows.
/// Once it has moved, motion along the piece does not: a surface that moves as the camera does, or straight along its
/// lines of sight, looks like a static one of another depth.
pub(super) fn residual(
    ctx: &Context,
    obs: &Observation,
    i: usize,
    now_from_world: &Se3,
    scene_depth: f64,
    then: &Remembered,
    nearby: &mut Vec<u32>,
) -> Option<f64> {
    let then_from_now = then.camera_from_world * now_from_world.inverse();
    let ray = ctx.camera.unproject(obs.pixel[i], 1.0);
    let at = |depth: f64| ctx.camera.project(then_from_now.transform(&(ray * depth)));
    let far: Vector3<f64> = then_from_now.rotation * ray;
    let (near, far) = (at(NEAREST_SHARE * scene_depth)?, ctx.camera.project(far)?);
    let j = find_again(ctx, obs, i, at(scene_depth)?, then, nearby)?;
    let sigma = KEYPOINT_SIGMA_PX * ctx.scales[usize::from(obs.octave[i])] * std::f64::consts::SQRT_2;
    Some(distance_to_piece(then.obs.pixel[j], near, far) / sigma)
}

/// Distance of a pixel from the piece of a line between two others.
fn distance_to_piece(p: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (along, from_a) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length2 = along[0] * along[0] + along[1] * along[1];
    let share = (from_a[0] * along[0] + from_a[1] * along[1]) / length2;
    // A piece without length is a point.
    let share = if length2 > 0.0 { share.clamp(0.0, 1.0) } else { 0.0 };
    let off = [from_a[0] - share * along[0], from_a[1] - share * along[1]];
    (off[0] * off[0] + off[1] * off[1]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::distance_to_piece;

    #[test]
    fn beyond_its_ends_a_piece_is_farther_than_its_line() {
        let (a, b) = ([0.0, 0.0], [10.0, 0.0]);
        assert_eq!(distance_to_piece([4.0, 3.0], a, b), 3.0);
        assert_eq!(distance_to_piece([14.0, 3.0], a, b), 5.0);
        assert_eq!(distance_to_piece([-3.0, 4.0], a, b), 5.0);
        assert_eq!(distance_to_piece([3.0, 4.0], a, a), 5.0);
    }
}
