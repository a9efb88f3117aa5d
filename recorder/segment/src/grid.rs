//! Values between the points of a coarse grid.

/// A place between grid points along one axis: the lower point, the upper one, and how far it is to it, 0..1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    pub low: usize,
    pub high: usize,
    pub part: f32,
}

impl Between {
    /// The place at coordinate `at`, grid points at whole numbers; beyond the border the border's value holds.
    pub fn new(at: f32, extent: usize) -> Self {
        let at = at.clamp(0.0, (extent - 1) as f32);
        let low = at as usize;
        Self { low, high: (low + 1).min(extent - 1), part: at - low as f32 }
    }

    /// The value there.
    pub fn mix(self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.part
    }
}

/// The value of a row-major plane at a place.
pub fn bilinear(plane: &[f32], width: usize, x: Between, y: Between) -> f32 {
    let row = |row: usize| x.mix(plane[row * width + x.low], plane[row * width + x.high]);
    y.mix(row(y.low), row(y.high))
}

/// How a network's output grid lies on its input: where the centre of input pixel `u` of `input` stands on a grid of `extent`
/// points.
pub fn on_grid(u: f32, input: usize, extent: usize, align_corners: bool) -> f32 {
    if align_corners {
        if input > 1 { u * (extent - 1) as f32 / (input - 1) as f32 } else { 0.0 }
    } else {
        (u + 0.5) * extent as f32 / input as f32 - 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_and_middles() {
        let plane = [0.0, 10.0, 20.0, 30.0];
        let at = |x, y| bilinear(&plane, 2, Between::new(x, 2), Between::new(y, 2));
        assert_eq!(at(0.5, 0.5), 15.0);
        assert_eq!(at(-3.0, 0.0), 0.0);
        assert_eq!(at(9.0, 9.0), 30.0);
        assert_eq!(on_grid(639.0, 640, 97, true), 96.0);
        assert_eq!(on_grid(0.0, 4, 1, false), -0.375);
        assert_eq!(on_grid(1.5, 4, 4, false), 1.5);
    }
}
