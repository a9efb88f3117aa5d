//! What moves must not use up the keypoints of what stands still: which parts of the picture they are wanted on.

use slam_math::Buffer;
use slam_vision::{Part, Parts};

use crate::context::Context;
use crate::input::PanopticMask;
use crate::observation::round_to_pixel;

/// The parts of one picture: Stuff is preferred, people are useless if they are filtered.
pub(super) struct LabelParts<'a> {
    mask: &'a PanopticMask,
    /// Part of each of the mask's segments.
    part: Buffer<Part>,
    floor: f64,
}

impl<'a> LabelParts<'a> {
    pub fn new(ctx: &Context, mask: &'a PanopticMask) -> Self {
        let part_of = |category: u16| {
            if ctx.people.contains(&category) && ctx.config.panoptic.people {
                Part::Useless
            } else if ctx.is_thing(category) {
                Part::Other
            } else {
                Part::Preferred
            }
        };
        let part = ctx.buffers.collect(mask.segments.iter().map(|segment| part_of(segment.category)));
        Self { mask, part, floor: ctx.config.panoptic.stuff_floor }
    }

    /// Lends the parts to the extractor.
    pub fn with<R>(&self, f: impl FnOnce(&Parts<'_>) -> R) -> R {
        let of_pixel = |pixel: [f32; 2]| {
            let [x, y] = pixel.map(|v| round_to_pixel(f64::from(v)));
            self.of_label(self.mask.at(x, y))
        };
        f(&Parts { of_pixel: &of_pixel, floor: self.floor })
    }

    fn of_label(&self, label: u16) -> Part {
        match self.mask.segments.binary_search_by_key(&label, |segment| segment.id) {
            Ok(segment) => self.part[segment],
            Err(_) => Part::Other,
        }
    }
}
