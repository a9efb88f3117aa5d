//! Label errors on top of those that a mask has.

use slam::PanopticMask;
use slam_math::Rng;

/// Seed of all draws here.
const SEED: u64 = 0x6c_61_62_65;
/// Borders are off by up to so many pixels: real networks' are by 2 to 6.
const SHIFT_PX: i64 = 4;
/// Chance that a segment is missed in a burst of frames.
const MISSED_SHARE: f64 = 0.06;
/// Length of a burst, frames.
const BURST_FRAMES: u32 = 4;
/// Chance of a cell of the blob grid to be unknown, and its side in pixels.
const VOID_SHARE: f64 = 0.06;
const VOID_PX: usize = 60;
/// Frames after which the blobs are drawn anew.
const VOID_FRAMES: u32 = 10;

/// A mask with more errors: each segment is off by some pixels, some are missed for some frames, and blobs are unknown.
/// A function of the mask and the frame's index alone.
pub(super) fn with_noise(mask: &PanopticMask, frame: u32) -> PanopticMask {
    let (width, height) = (mask.width, mask.height);
    let burst = frame / BURST_FRAMES;
    let moved = |index: usize| {
        let mut rng = Rng::at(SEED, frame, 0, index as u32);
        let mut off = || rng.below(2 * SHIFT_PX as usize + 1) as i64 - SHIFT_PX;
        [off(), off()]
    };
    let offset: Vec<[i64; 2]> = (0..mask.segments.len()).map(moved).collect();
    // A segment has no identity over frames but its category.
    let is_missed = |category: u16| Rng::at(SEED, burst, 1, u32::from(category)).uniform() < MISSED_SHARE;
    let missed: Vec<bool> = mask.segments.iter().map(|segment| is_missed(segment.category)).collect();
    let mut ids = vec![0; width * height];
    for y in 0..height {
        for x in 0..width {
            let own = mask.ids[y * width + x];
            let mut id = own;
            // A segment that is moved here covers what was here.
            if let Ok(index) = mask.segments.binary_search_by_key(&own, |segment| segment.id) {
                let [dx, dy] = offset[index];
                id = mask.at((x as i64 - dx).clamp(0, width as i64 - 1), (y as i64 - dy).clamp(0, height as i64 - 1));
                if mask.segments.binary_search_by_key(&id, |segment| segment.id).is_ok_and(|index| missed[index]) {
                    id = 0;
                }
            }
            let (column, row) = ((x / VOID_PX) as u32, (y / VOID_PX) as u32);
            let mut void = Rng::at(SEED, frame / VOID_FRAMES, 2, column << 16 | row);
            ids[y * width + x] = if void.uniform() < VOID_SHARE { 0 } else { id };
        }
    }
    PanopticMask { width, height, ids, segments: mask.segments.clone() }
}
