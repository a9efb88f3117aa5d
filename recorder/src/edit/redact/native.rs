//! Depth as the depth camera sees it: redacted where its points fall into the colour picture's redacted part.

use super::area::Cover;
use schemas::alignment::{Extrinsics, Intrinsics};
use schemas::msg::{CameraInfo, Extrinsics as ExtrinsicsMessage};

/// From native depth to the colour picture.
#[derive(Debug, Clone)]
pub struct NativeDepth {
    depth: Intrinsics,
    color: Intrinsics,
    color_from_depth: Extrinsics,
    units_m: f32,
}

impl NativeDepth {
    /// Prepares a rig; none for a lens that is not known.
    pub fn new(depth: &CameraInfo, color: &CameraInfo, rig: &ExtrinsicsMessage, units_m: f32) -> Option<Self> {
        let (depth, color) = (Intrinsics::from_camera_info(depth)?, Intrinsics::from_camera_info(color)?);
        Some(Self { depth, color, color_from_depth: Extrinsics::from_message(rig), units_m })
    }

    /// Size of a native depth image.
    pub fn size(&self) -> (usize, usize) {
        (self.depth.width as usize, self.depth.height as usize)
    }

    /// Which measurements go: those whose pixel touches a redacted pixel of colour, and those that colour does not see, since
    /// no mask can tell who is there. `pixels` are rows joined.
    pub fn covered(&self, pixels: &[u16], cover: &Cover) -> Vec<bool> {
        let width = self.depth.width as usize;
        let gone = |(index, value): (usize, &u16)| {
            let (column, row) = ((index % width) as f32, (index / width) as f32);
            *value > 0 && !self.is_visible(column, row, f32::from(*value) * self.units_m, cover)
        };
        pixels.iter().enumerate().map(gone).collect()
    }

    /// Whether the pixel, from its upper left to its lower right corner, falls on pixels that stay.
    fn is_visible(&self, column: f32, row: f32, depth_m: f32, cover: &Cover) -> bool {
        let corners = [[column - 0.5, row - 0.5], [column + 0.5, row + 0.5]].map(|corner| {
            let [x, y] = self.depth.direction(corner);
            let point = self.color_from_depth.transform([depth_m * x, depth_m * y, depth_m]);
            (point[2] > 0.0).then(|| self.color.project(point))
        });
        let [Some([u0, v0]), Some([u1, v1])] = corners else { return false };
        let range = |a: f32, b: f32, end: usize| {
            let (first, last) = if a <= b { (a.round(), b.round()) } else { (b.round(), a.round()) };
            (first >= 0.0 && last < end as f32).then_some(first as usize..=last as usize)
        };
        let (Some(columns), Some(rows)) = (range(u0, u1, cover.width), range(v0, v1, cover.height)) else {
            return false;
        };
        rows.into_iter().all(|row| columns.clone().all(|column| !cover.has(row * cover.width + column)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::area::Area;
    use super::*;

    const SIZE: (usize, usize) = (64, 48);

    fn info() -> CameraInfo {
        let k = [50.0, 0.0, 32.0, 0.0, 50.0, 24.0, 0.0, 0.0, 1.0];
        CameraInfo { width: SIZE.0 as u32, height: SIZE.1 as u32, k, ..CameraInfo::default() }
    }

    fn rig(x_m: f64) -> ExtrinsicsMessage {
        let rotation = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        ExtrinsicsMessage { rotation, translation: [x_m, 0.0, 0.0], ..ExtrinsicsMessage::default() }
    }

    #[test]
    fn a_measurement_goes_where_its_point_is_redacted() {
        // Redacted in colour: columns 40 to 49. The depth camera sits 0.1 m to the left: at 1 m it sees the same point 5
        // pixels before, at 5 m one pixel.
        let mut mask = vec![0; SIZE.0 * SIZE.1];
        mask.iter_mut().enumerate().filter(|(i, _)| (40..50).contains(&(i % SIZE.0))).for_each(|(_, value)| *value = 1);
        let cover = Cover::of(SIZE, &[(Area::new(&mask, SIZE.0, &|value| value == 1), 0)]);
        let native = NativeDepth::new(&info(), &info(), &rig(0.1), 0.001).unwrap();
        for (units, shift) in [(1000, 5), (5000, 1)] {
            let covered = native.covered(&vec![units; SIZE.0 * SIZE.1], &cover);
            let row = &covered[24 * SIZE.0..25 * SIZE.0];
            for (column, gone) in row.iter().enumerate() {
                let seen = column + shift;
                if (40..50).contains(&seen) || seen >= SIZE.0 {
                    assert!(gone, "{units} column {column}");
                }
                if seen + 1 < 40 || (51..SIZE.0 - 1).contains(&seen) {
                    assert!(!gone, "{units} column {column}");
                }
            }
        }
        // Nothing measured, nothing to take away; a lens that is not known is not guessed.
        assert!(!native.covered(&vec![0; SIZE.0 * SIZE.1], &cover).contains(&true));
        let odd = CameraInfo { distortion_model: "fisheye".to_owned(), ..info() };
        assert!(NativeDepth::new(&odd, &info(), &rig(0.1), 0.001).is_none());
    }
}
