//! A frame's report.

use super::step::Step;
use crate::panoptic::{CELL_PX, Evidence, FrameFilter, Region, Track};
use crate::report::{EpipolarReport, FrameReport, KeypointReport, RegionReport};

impl Step<'_> {
    pub(super) fn report(&mut self, tracked: bool, filter: &FrameFilter) -> FrameReport {
        let (obs, buffers) = (&self.frame.obs, &self.ctx.buffers);
        let keypoint = |i: usize| KeypointReport {
            pixel: obs.raw_pixel[i],
            octave: obs.octave[i],
            depth_m: obs.depth_m[i],
            class: filter.class[i],
            verdict: filter.verdict[i],
            epipolar_px: filter.epipolar_px[i],
            motion_sigmas: filter.motion_sigmas[i],
            is_vouched: filter.is_vouched(i),
            point: self.frame.points[i].filter(|_| tracked),
        };
        FrameReport {
            id: self.frame.id,
            stamp: self.frame.stamp,
            state: self.slam.tracker.state,
            map: self.slam.tracker.active,
            camera_from_world: tracked.then_some(self.frame.camera_from_world),
            reference: tracked.then_some(self.frame.reference),
            new_keyframe: self.new_keyframe,
            selection: self.selection,
            keypoints: buffers.collect((0..obs.len()).map(keypoint)),
            regions: buffers.collect(region_reports(filter)),
            region_cells: (filter.regions.width, filter.regions.height, filter.regions.cell.clone()),
            epipolar: filter.epipolar.map(|e| EpipolarReport {
                matches: e.matches,
                inliers: e.inliers,
                degenerate: e.degenerate,
                matrix: std::array::from_fn(|i| e.matrix[(i / 3, i % 3)]),
            }),
            counts: self.counts,
            events: std::mem::take(&mut self.events),
            records: buffers.empty(),
        }
    }
}

fn region_reports(filter: &FrameFilter) -> impl Iterator<Item = RegionReport> {
    let px = |cells: u16| f64::from(cells) * CELL_PX as f64;
    let keypoints_of = move |region: usize| (0..filter.region.len()).filter(move |i| filter.region[*i] == Some(region));
    let one = move |(i, ((region, track), evidence)): (usize, ((&Region, &Track), &Evidence))| {
        let [x0, x1, y0, y1] = region.extent;
        let last = evidence.counts.last().copied().unwrap_or_default();
        RegionReport {
            track: track.id,
            category: region.category,
            bbox: [px(x0), px(y0), px(x1 + 1 - x0), px(y1 + 1 - y0)],
            area_px: region.cells * (CELL_PX * CELL_PX) as u32,
            state: track.state,
            age_frames: track.age,
            free_space_share: evidence.free_space_share(),
            moved_share: evidence.moved_share(),
            samples: last.samples,
            keypoints: last.keypoints,
            disagrees: filter.disagrees_at(i),
            vouched: keypoints_of(i).filter(|keypoint| filter.is_vouched(*keypoint)).count() as u32,
        }
    };
    filter.regions.list.iter().zip(&filter.tracks).zip(&filter.evidence).enumerate().map(one)
}
