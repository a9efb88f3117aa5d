//! One plot area with its axes.

use super::axis::{Axis, Scale};
use super::svg::{Anchor, Svg};

/// A box with two axes; curves are clipped to it.
pub struct Panel {
    /// Unique in the picture.
    pub id: String,
    /// Above the plot; may be empty.
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub x: Axis,
    pub y: Axis,
}

impl Panel {
    fn frame(&self) -> [f64; 4] {
        let (left, right) = self.x.pixels;
        let (bottom, top) = self.y.pixels;
        [left, top, right - left, bottom - top]
    }

    /// Grid, ticks and names; curves come between this and [`end`](Self::end).
    pub fn begin(&self, svg: &mut Svg) {
        let [left, top, width, height] = self.frame();
        let (right, bottom) = (left + width, top + height);
        let theme = svg.theme();
        let small = format!("fill=\"{}\" font-size=\"12\"", theme.tick);
        let label_style = format!("fill=\"{}\"", theme.label);
        for (value, label) in self.x.ticks() {
            let x = self.x.pixel(value);
            svg.line([x, top, x, bottom], theme.grid, 1.0);
            svg.text((x, bottom + 18.0), Anchor::Middle, &small, &label);
        }
        for (value, label) in self.y.ticks() {
            let y = self.y.pixel(value);
            svg.line([left, y, right, y], theme.grid, 1.0);
            svg.text((left - 8.0, y + 4.0), Anchor::End, &small, &label);
        }
        let head = format!("fill=\"{}\" font-size=\"14\" font-weight=\"bold\"", theme.title);
        svg.text((left, top - 10.0), Anchor::Start, &head, &self.title);
        svg.text((left + width / 2.0, bottom + 38.0), Anchor::Middle, &label_style, &self.x_label);
        let room = if self.y.scale == Scale::Log { 58.0 } else { 50.0 };
        svg.text_up((left - room, top + height / 2.0), &label_style, &self.y_label);
        svg.clip_begin(&self.id, self.frame());
    }

    /// Ends the curves and draws the border.
    pub fn end(&self, svg: &mut Svg) {
        svg.clip_end();
        let [left, top, width, height] = self.frame();
        let ink = svg.theme().ink;
        svg.line([left, top + height, left + width, top + height], ink, 1.2);
        svg.line([left, top, left, top + height], ink, 1.2);
    }

    pub fn pixel(&self, (x, y): (f64, f64)) -> (f64, f64) {
        (self.x.pixel(x), self.y.pixel(y))
    }

    /// One line a run of values. Points that fall on the pixel drawn last are left out, so that a long path stays small.
    pub fn curve(&self, svg: &mut Svg, runs: &[Vec<(f64, f64)>], color: &str, width: f64) {
        for run in runs {
            let mut points: Vec<(f64, f64)> = Vec::new();
            for (i, &value) in run.iter().enumerate() {
                let point = self.pixel(value);
                let near = |last: &(f64, f64)| (last.0 - point.0).abs() + (last.1 - point.1).abs() < 0.4;
                if i + 1 == run.len() || !points.last().is_some_and(near) {
                    points.push(point);
                }
            }
            match points.as_slice() {
                [] => {}
                [alone] => svg.circle(*alone, width / 2.0, color, color),
                points => svg.polyline(points, color, width),
            }
        }
    }

    /// A tinted stretch of the x axis.
    pub fn band(&self, svg: &mut Svg, from: f64, to: f64, color: &str) {
        let [_, top, _, height] = self.frame();
        let (left, right) = (self.x.pixel(from), self.x.pixel(to));
        svg.rect([left, top, (right - left).clamp(1.0, 1e6), height], color, 0.13);
    }
}
