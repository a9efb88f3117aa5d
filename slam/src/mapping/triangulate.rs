//! Points from two views, for keypoints whose depth is missing or worse than the parallax.

use nalgebra::Vector3;
use slam_math::{Buffer, KeyFrameId, Se3};
use slam_optimize::triangulate;
use slam_vision::hamming;

use super::create::add_point;
use super::{Editor, YoungPoints};
use crate::context::Context;
use crate::map::{KeyFrame, Map, MapEdit, NewPoint};

/// Matches free keypoints of a keyframe with those of its neighbours along epipolar lines and makes points. Returns how
/// many.
pub(super) fn triangulate_with_neighbours(
    ctx: &Context,
    editor: &mut Editor<'_>,
    young: &mut YoungPoints,
    id: KeyFrameId,
) -> u32 {
    let Some(keyframe) = editor.map().keyframe(id) else { return 0 };
    let count = if ctx.is_monocular() { ctx.config.monocular.neighbours } else { ctx.config.mapping.neighbours };
    let neighbours = ctx.buffers.collect(keyframe.best_covisible(count));
    let mut created = 0;
    for &neighbour in &neighbours {
        let map = editor.map();
        let (Some(a), Some(b)) = (map.keyframe(id), map.keyframe(neighbour)) else { continue };
        if (a.center() - b.center()).norm() < min_baseline(ctx, map, b) {
            continue;
        }
        let frame = a.frame;
        let made = |&(i, j): &(usize, usize)| {
            make_point(ctx, a, i, b, j).map(|position| (i, j, position, a.class[i].joined(b.class[j])))
        };
        let found = ctx.buffers.collect(epipolar_matches(ctx, a, b).iter().filter_map(made));
        for &(i, j, position, class) in &found {
            let point = editor.map().next_point();
            let new = NewPoint { position, keyframe: id, index: i as u32, frame, class };
            add_point(ctx, editor, young, new);
            editor.apply(MapEdit::Observe(point, neighbour, j as u32));
            editor.refresh(ctx, point);
            created += 1;
        }
    }
    created
}

/// Distance of the cameras from which two views say more than the depth of one; without depth, more than noise.
fn min_baseline(ctx: &Context, map: &Map, keyframe: &KeyFrame) -> f64 {
    if !ctx.is_monocular() {
        return ctx.bf / ctx.pinhole.fx;
    }
    let points = keyframe.points.iter().flatten().filter_map(|id| map.point(*id));
    let mut depths = ctx.buffers.collect(points.map(|p| keyframe.camera_from_world.transform(&p.position)[2]));
    let middle = depths.len() / 2;
    if depths.is_empty() {
        return f64::INFINITY;
    }
    ctx.config.monocular.min_baseline_share * *depths.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Pairs of free usable keypoints with similar descriptors near each other's epipolar line, each keypoint at most once.
fn epipolar_matches(ctx: &Context, a: &KeyFrame, b: &KeyFrame) -> Buffer<(usize, usize)> {
    let free = |k: &KeyFrame| ctx.buffers.collect((0..k.obs.len()).filter(|i| k.usable[*i] && k.points[*i].is_none()));
    let b_from_a = b.camera_from_world * a.camera_from_world.inverse();
    let epipole = ctx.camera.project(b_from_a.translation);
    let (free_a, free_b) = (free(a), free(b));
    let mut owner: Buffer<Option<(u32, usize)>> = ctx.buffers.filled(b.obs.len(), None);
    for &i in &free_a {
        let ray = ctx.camera.unproject(a.obs.pixel[i], 1.0);
        let line = EpipolarLine::new(ctx, &b_from_a, &ray);
        let mut best: Option<(u32, usize)> = None;
        for &j in &free_b {
            // The line is a sharper and cheaper sieve than the descriptor.
            let scale = ctx.scales[usize::from(b.obs.octave[j])];
            let near_line = line.distance2(b.obs.pixel[j]) < 3.84 * scale * scale;
            if !near_line {
                continue;
            }
            let distance = hamming(&a.obs.descriptor[i], &b.obs.descriptor[j]);
            if distance > ctx.config.tracking.hamming_low || best.is_some_and(|best| (distance, j) >= best) {
                continue;
            }
            let has_depth = a.obs.depth(i).is_some() || b.obs.depth(j).is_some();
            let near_epipole = epipole.is_some_and(|e| squared(e, b.obs.pixel[j]) < 100.0 * scale);
            // Parallax vanishes at the epipole: only depth can make a point there.
            if has_depth || !near_epipole {
                best = Some((distance, j));
            }
        }
        if let Some((distance, j)) = best
            && owner[j].is_none_or(|holder| (distance, i) < holder)
        {
            owner[j] = Some((distance, i));
        }
    }
    let mut pairs = ctx.buffers.collect(owner.iter().enumerate().filter_map(|(j, o)| o.map(|(_, i)| (i, j))));
    pairs.sort_unstable();
    pairs
}

fn squared(a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    dx * dx + dy * dy
}

/// Line of the picture on which a ray of another camera appears.
struct EpipolarLine {
    normal: [f64; 3],
}

impl EpipolarLine {
    fn new(ctx: &Context, b_from_a: &Se3, ray_in_a: &Vector3<f64>) -> Self {
        let n = b_from_a.translation.cross(&(b_from_a.rotation * ray_in_a));
        let p = &ctx.pinhole;
        // K^-T n: from a plane through the camera centre to a line in pixels.
        let (x, y) = (n[0] / p.fx, n[1] / p.fy);
        Self { normal: [x, y, n[2] - x * p.cx - y * p.cy] }
    }

    fn distance2(&self, pixel: [f64; 2]) -> f64 {
        let [a, b, c] = self.normal;
        let value = a * pixel[0] + b * pixel[1] + c;
        value * value / (a * a + b * b)
    }
}

/// Position in the world from whichever is best conditioned: two rays, or one of the depths. `None` when nothing is, or
/// the point does not fit both views.
fn make_point(ctx: &Context, a: &KeyFrame, i: usize, b: &KeyFrame, j: usize) -> Option<Vector3<f64>> {
    let views = [(a, i), (b, j)];
    let rays = views.map(|(k, i)| k.camera_from_world.rotation.transpose() * ctx.camera.unproject(k.obs.pixel[i], 1.0));
    let cos_rays = rays[0].dot(&rays[1]) / (rays[0].norm() * rays[1].norm());
    let half_baseline = ctx.bf / ctx.pinhole.fx / 2.0;
    // cos(2 atan(x)) = (1 - x^2) / (1 + x^2)
    let cos_depth = views.map(|(k, i)| {
        k.obs.depth(i).map_or(2.0, |z| {
            let x = half_baseline / z;
            (1.0 - x * x) / (1.0 + x * x)
        })
    });
    let best_depth = slam_math::float::min(cos_depth[0], cos_depth[1]);
    let position = if cos_rays > 0.0 && cos_rays < best_depth && (best_depth < 2.0 || cos_rays < 0.9998) {
        let normalized = views.map(|(k, i)| ctx.pinhole.ray(k.obs.pixel[i]));
        triangulate(&a.camera_from_world, &b.camera_from_world, normalized[0], normalized[1], 0.0)?
    } else {
        let (k, i) = if cos_depth[0] <= cos_depth[1] { views[0] } else { views[1] };
        k.camera_from_world.inverse().transform(&ctx.camera.unproject(k.obs.pixel[i], k.obs.depth(i)?))
    };
    let fits = |(k, i): (&KeyFrame, usize)| ctx.fits(&k.obs, i, &k.camera_from_world.transform(&position));
    let distances = views.map(|(k, _)| (position - k.center()).norm());
    let scales = views.map(|(k, i)| ctx.scales[usize::from(k.obs.octave[i])]);
    let ratio = (distances[1] / distances[0]) / (scales[1] / scales[0]);
    let slack = 1.5 * ctx.config.orb.scale_factor;
    (views.into_iter().all(fits) && ratio < slack && ratio > 1.0 / slack).then_some(position)
}
