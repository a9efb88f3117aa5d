//! What moves must not use up the keypoints of what stands still: parts of the picture that share them by area.

use slam_math::Buffer;
use slam_vision::Parts;

use crate::context::Context;
use crate::input::PanopticMask;
use crate::observation::round_to_pixel;

/// Areas are counted at every fourth pixel of every fourth row.
const STRIDE: usize = 4;
const STUFF: usize = 0;
const THINGS: usize = 1;
const UNKNOWN: usize = 2;

/// The parts of one picture: Stuff, Things and unknown areas; people are none if they are filtered.
pub(super) struct LabelShares<'a> {
    mask: &'a PanopticMask,
    /// Part of each of the mask's segments.
    part: Buffer<Option<usize>>,
    shares: [f64; 3],
}

impl<'a> LabelShares<'a> {
    pub fn new(ctx: &Context, mask: &'a PanopticMask) -> Self {
        let part_of = |category: u16| {
            if ctx.people.contains(&category) && ctx.config.panoptic.people {
                None
            } else if ctx.is_thing(category) {
                Some(THINGS)
            } else {
                Some(STUFF)
            }
        };
        let part = ctx.buffers.collect(mask.segments.iter().map(|segment| part_of(segment.category)));
        let mut shares = Self { mask, part, shares: [0.0; 3] };
        let mut counts = [0u32; 3];
        for row in mask.ids.chunks_exact(mask.width).step_by(STRIDE) {
            for id in row.iter().step_by(STRIDE) {
                if let Some(part) = shares.of_label(*id) {
                    counts[part] += 1;
                }
            }
        }
        let samples = mask.width.div_ceil(STRIDE) * mask.height.div_ceil(STRIDE);
        shares.shares = counts.map(|count| f64::from(count) / samples as f64);
        shares
    }

    /// Lends the parts to the extractor.
    pub fn with<R>(&self, f: impl FnOnce(&Parts<'_>) -> R) -> R {
        let of_pixel = |pixel: [f32; 2]| {
            let [x, y] = pixel.map(|v| round_to_pixel(f64::from(v)));
            self.of_label(self.mask.at(x, y))
        };
        f(&Parts { of_pixel: &of_pixel, shares: &self.shares })
    }

    fn of_label(&self, label: u16) -> Option<usize> {
        match self.mask.segments.binary_search_by_key(&label, |segment| segment.id) {
            Ok(segment) => self.part[segment],
            Err(_) => Some(UNKNOWN),
        }
    }
}
