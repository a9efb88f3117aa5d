//! Values over time.

use slam_math::float::{max, min};

use super::html::{Key, escape, legend};
use crate::plot::axis::Axis;
use crate::plot::panel::Panel;
use crate::plot::svg::{Anchor, Svg};

const WIDTH: f64 = 920.0;
const HEIGHT: f64 = 250.0;
/// Left and right end of the time axis, pixels.
const TIME: (f64, f64) = (70.0, 905.0);
/// Lower and upper end of the values, pixels.
const VALUES: (f64, f64) = (205.0, 12.0);
/// Of a long run this many points are drawn; a plot has not many more pixels.
const DRAWN: usize = 1200;
/// Of so few values each gets a dot.
const FEW: usize = 40;
/// Values that the page keeps for its pointer.
const KEPT: usize = 300;

/// One curve.
pub struct Series {
    pub name: String,
    /// A CSS colour.
    pub color: &'static str,
    /// Seconds and value; not a number where there is none.
    pub values: Vec<(f64, f64)>,
}

impl Series {
    pub fn new(name: &str, color: &'static str, values: impl Iterator<Item = (f64, f64)>) -> Self {
        Self { name: name.to_owned(), color, values: values.collect() }
    }
}

/// A plot of curves, or of areas that stand on one another.
pub struct Chart<'a> {
    /// Unique in the page.
    pub id: &'static str,
    pub title: &'a str,
    /// What is measured, and the unit behind values.
    pub label: &'a str,
    pub unit: &'a str,
    pub series: Vec<Series>,
    pub stacked: bool,
    /// Stretches without a pose, seconds.
    pub lost: &'a [(f64, f64)],
    /// Moments worth a line, with their names.
    pub marks: Vec<(f64, String)>,
    /// End of the time axis, seconds.
    pub end_s: f64,
}

impl Chart<'_> {
    /// The figure.
    pub fn html(&self) -> String {
        let keys: Vec<Key> =
            self.series.iter().map(|s| Key { name: s.name.clone(), color: s.color.to_owned() }).collect();
        let mut keys = legend(&keys);
        if !self.lost.is_empty() {
            keys = keys.replace("</ul>", "<li><i style=\"background:var(--s2);opacity:.25\"></i>no pose</li></ul>");
        }
        format!(
            "<figure><figcaption>{}</figcaption>{keys}<div class=\"plot\" data-range=\"{},{},{:.3}\" data-series=\"{}\">{}\
             </div><output class=\"readout\"></output></figure>",
            escape(self.title),
            TIME.0,
            TIME.1,
            self.end_s,
            escape(&self.kept()),
            self.svg()
        )
    }

    fn svg(&self) -> String {
        let names: Vec<&str> = self.series.iter().map(|s| s.name.as_str()).collect();
        let alt = format!("{}: {} over {:.1} s", self.title, names.join(", "), self.end_s);
        let mut svg = Svg::inline(WIDTH, HEIGHT, &alt);
        let thin: Vec<Vec<(f64, f64)>> = self.series.iter().map(|s| thinned(&s.values)).collect();
        let (least, most) = self.extent(&thin);
        let panel = Panel {
            id: format!("clip-{}", self.id),
            title: String::new(),
            x_label: "time [s]".to_owned(),
            y_label: self.label.to_owned(),
            x: Axis::linear(0.0, max(self.end_s, 1e-3), TIME),
            y: Axis::linear(least, most, VALUES),
        };
        panel.begin(&mut svg);
        for &(from, to) in self.lost {
            panel.band(&mut svg, from, to, "var(--s2)");
        }
        if self.stacked {
            self.areas(&panel, &mut svg, &thin);
        } else {
            for (series, values) in self.series.iter().zip(&thin) {
                panel.curve(&mut svg, &pieces(values), series.color, 1.6);
                // A line through a few values alone would tell more than they do.
                for value in values.iter().filter(|v| values.len() <= FEW && v.1.is_finite()) {
                    svg.circle(panel.pixel(*value), 2.5, series.color, series.color);
                }
            }
        }
        for (at, name) in &self.marks {
            let x = panel.x.pixel(*at);
            svg.dashes([x, VALUES.0, x, VALUES.1], "var(--soft)");
            svg.text_on_curves((x + 4.0, VALUES.1 + 12.0), Anchor::Start, name);
        }
        panel.end(&mut svg);
        svg.finish()
    }

    fn extent(&self, thin: &[Vec<(f64, f64)>]) -> (f64, f64) {
        if self.stacked {
            let columns = thin.first().map_or(0, Vec::len);
            let sum = |i: usize| thin.iter().fold(0.0, |sum, series| sum + series[i].1);
            return (0.0, (0..columns).map(sum).fold(1.0, max) * 1.04);
        }
        let values = || thin.iter().flatten().map(|v| v.1).filter(|v| v.is_finite());
        let (least, most) = (values().fold(0.0, min), values().fold(0.0, max));
        let pad = (most - least) * 0.06;
        (if least < 0.0 { least - pad } else { 0.0 }, if most > least { most + pad } else { 1.0 })
    }

    fn areas(&self, panel: &Panel, svg: &mut Svg, thin: &[Vec<(f64, f64)>]) {
        let mut floor: Vec<f64> = vec![0.0; thin.first().map_or(0, Vec::len)];
        for (series, values) in self.series.iter().zip(thin) {
            let top: Vec<f64> = floor.iter().zip(values).map(|(floor, value)| floor + value.1).collect();
            let upper = values.iter().zip(&top).map(|(v, top)| panel.pixel((v.0, *top)));
            let lower = values.iter().zip(&floor).rev().map(|(v, floor)| panel.pixel((v.0, *floor)));
            let outline: Vec<(f64, f64)> = upper.chain(lower).collect();
            svg.polygon(&outline, series.color);
            floor = top;
        }
    }

    /// For the pointer: a value a column, `null` where there is none.
    fn kept(&self) -> String {
        let column = |at: f64| ((at / max(self.end_s, 1e-3) * KEPT as f64) as usize).min(KEPT - 1);
        let one = |series: &Series| {
            let mut values: Vec<Option<f64>> = vec![None; KEPT];
            for &(at, value) in series.values.iter().filter(|v| v.1.is_finite()) {
                values[column(at)] = Some(rounded(value));
            }
            // Fewer frames than columns: a column without one shows the frame before, but not across a gap.
            let step = series.values.len().checked_sub(1).map_or(1, |n| KEPT / n.max(1) + 1);
            for i in 1..KEPT {
                let before = (i.saturating_sub(step)..i).rev().find_map(|j| values[j]);
                values[i] = values[i].or(before.filter(|_| series.values.len() < KEPT));
            }
            serde_json::json!({ "name": series.name, "unit": self.unit, "values": values })
        };
        serde_json::Value::Array(self.series.iter().map(one).collect()).to_string()
    }
}

/// Four digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// Means of neighbours, so that a long run stays small; a gap stays one.
fn thinned(values: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let size = values.len().div_ceil(DRAWN).max(1);
    let mean = |some: &[(f64, f64)]| (some[0].0, some.iter().fold(0.0, |sum, v| sum + v.1) / some.len() as f64);
    values.chunks(size).map(mean).collect()
}

/// Cut where there is no value.
fn pieces(values: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let pieces = values.split(|v| !v.1.is_finite());
    pieces.filter(|piece| !piece.is_empty()).map(<[_]>::to_vec).collect()
}
