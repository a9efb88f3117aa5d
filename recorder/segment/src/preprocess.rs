//! From a picture to a network's input, and where its pixels went.

use crate::description::{Fit, Input};
use crate::grid::Between;
use crate::{Picture, Tensor};

/// Where a picture lies in a network's input: input coordinate = picture coordinate * scale + offset, both measured at pixel
/// centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Along x and y.
    pub scale: [f32; 2],
    /// Along x and y, input pixels.
    pub offset: [f32; 2],
}

impl Placement {
    /// Where a picture of this size goes.
    #[must_use]
    pub fn new(input: &Input, width: usize, height: usize) -> Self {
        let full = [input.width as f32 / width as f32, input.height as f32 / height as f32];
        let (scale, pad) = match input.fit {
            Fit::Stretch => (full, [0.0, 0.0]),
            Fit::Letterbox => {
                let scale = if full[0] < full[1] { full[0] } else { full[1] };
                let pad = |input: usize, picture: usize| (input as f32 - (picture as f32 * scale).round()) / 2.0;
                ([scale; 2], [pad(input.width, width).floor(), pad(input.height, height).floor()])
            }
        };
        // Pixel centres lie half a pixel inside: (x + 0.5) * scale - 0.5.
        let offset = [0, 1].map(|axis| pad[axis] + 0.5 * scale[axis] - 0.5);
        Self { scale, offset }
    }

    /// The input coordinate of picture column (axis 0) or row (axis 1) `at`.
    #[must_use]
    pub fn to_input(&self, axis: usize, at: f32) -> f32 {
        at * self.scale[axis] + self.offset[axis]
    }

    /// The picture coordinate of an input coordinate.
    #[must_use]
    pub fn to_picture(&self, axis: usize, at: f32) -> f32 {
        (at - self.offset[axis]) / self.scale[axis]
    }
}

/// The input tensor, [1, 3, height, width].
pub fn input_tensor(input: &Input, picture: &Picture, placement: &Placement) -> Tensor {
    let (width, height) = (input.width, input.height);
    let place = |axis: usize, count: usize, extent: usize| -> Vec<Option<Between>> {
        let at = |i: usize| placement.to_picture(axis, i as f32);
        // Outside the picture by half a pixel or more: padding.
        let inside = |at: f32| at > -0.5 && at < extent as f32 - 0.5;
        (0..count).map(|i| Some(at(i)).filter(|at| inside(*at)).map(|at| Between::new(at, extent))).collect()
    };
    let (columns, rows) = (place(0, width, picture.width), place(1, height, picture.height));
    let mut data = vec![0.0; 3 * width * height];
    for (channel, plane) in data.chunks_exact_mut(width * height).enumerate() {
        let byte = if input.bgr { 2 - channel } else { channel };
        let value = |level: f32| (level / input.divisor - input.mean[channel]) / input.std[channel];
        for (row, line) in rows.iter().zip(plane.chunks_exact_mut(width)) {
            for (column, out) in columns.iter().zip(line) {
                *out = value(match (column, row) {
                    (Some(x), Some(y)) => {
                        let at = |x: usize, y: usize| f32::from(picture.rgb[(y * picture.width + x) * 3 + byte]);
                        y.mix(x.mix(at(x.low, y.low), at(x.high, y.low)), x.mix(at(x.low, y.high), at(x.high, y.high)))
                    }
                    _ => f32::from(input.pad),
                });
            }
        }
    }
    Tensor { shape: vec![1, 3, height, width], data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemas::Stamp;

    fn input(width: usize, height: usize, fit: Fit) -> Input {
        Input { width, height, fit, ..Input::default() }
    }

    fn picture(width: usize, height: usize) -> Picture {
        let rgb = (0..width * height * 3).map(|i| (i % 251) as u8).collect();
        Picture { stamp: Stamp(0), index: 0, width, height, rgb }
    }

    #[test]
    fn the_same_size_is_the_same_picture() {
        let (input, picture) = (input(8, 6, Fit::Letterbox), picture(8, 6));
        let tensor = input_tensor(&input, &picture, &Placement::new(&input, 8, 6));
        assert_eq!(tensor.shape, [1, 3, 6, 8]);
        let expected = |i: usize| f32::from(picture.rgb[(i % 48) * 3 + i / 48]) / 255.0;
        assert!((0..144).all(|i| tensor.data[i] == expected(i)));
    }

    #[test]
    fn letterboxes_are_padded_and_found_again() {
        let input = Input { bgr: true, mean: [0.5; 3], std: [0.5; 3], ..input(8, 8, Fit::Letterbox) };
        let placement = Placement::new(&input, 4, 2);
        let tensor = input_tensor(&input, &picture(4, 2), &placement);
        let padded = (114.0 / 255.0 - 0.5) / 0.5;
        assert!(tensor.data[..16].iter().all(|v| *v == padded), "two rows above");
        assert!(tensor.data[48..64].iter().all(|v| *v == padded), "two rows below");
        assert!(tensor.data[16..48].iter().all(|v| *v != padded));
        let top_left_blue = (2.0 / 255.0 - 0.5) / 0.5;
        assert!((tensor.data[16] - top_left_blue).abs() < 1e-6, "blue comes first");
        for at in [0.0, 1.25, 3.0] {
            assert!((placement.to_picture(1, placement.to_input(1, at)) - at).abs() < 1e-5);
        }
    }

    #[test]
    fn stretching_fills_the_input() {
        let input = input(9, 4, Fit::Stretch);
        let placement = Placement::new(&input, 3, 2);
        assert!((placement.to_input(0, -0.5) + 0.5).abs() < 1e-6);
        assert!((placement.to_input(0, 2.5) - 8.5).abs() < 1e-5);
        assert!(input_tensor(&input, &picture(3, 2), &placement).data.iter().all(|v| *v != 114.0 / 255.0));
    }
}
