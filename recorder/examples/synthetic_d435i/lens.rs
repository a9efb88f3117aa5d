//! A picture as a bent lens shows it.

use schemas::alignment::Intrinsics;

/// What `lens` makes of a pinhole picture of the same size, focal lengths and centre; black where that has nothing.
pub fn bend(rgb: &[u8], lens: &Intrinsics) -> Vec<u8> {
    let (width, height) = (lens.width as usize, lens.height as usize);
    let mut out = Vec::with_capacity(rgb.len());
    for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
        let [x, y] = lens.direction([column as f32, row as f32]);
        let at = [x * lens.fx + lens.cx, y * lens.fy + lens.cy];
        let corner = at.map(f32::floor);
        let inside = corner[0] >= 0.0 && corner[1] >= 0.0;
        let [left, top] = corner.map(|value| value as usize);
        if !inside || left + 1 >= width || top + 1 >= height {
            out.extend([0; 3]);
            continue;
        }
        let [right, down] = [at[0] - corner[0], at[1] - corner[1]];
        let channel = |c: usize| {
            let pixel = |row: usize, column: usize| f32::from(rgb[3 * (row * width + column) + c]);
            let above = pixel(top, left) * (1.0 - right) + pixel(top, left + 1) * right;
            let below = pixel(top + 1, left) * (1.0 - right) + pixel(top + 1, left + 1) * right;
            (above * (1.0 - down) + below * down).round() as u8
        };
        out.extend([0, 1, 2].map(channel));
    }
    out
}
