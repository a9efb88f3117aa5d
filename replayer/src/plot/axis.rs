//! Axes: from values to pixels, with ticks that people can read.

use slam_math::float::ln;

/// How values are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    Linear,
    /// Decades; every value must be above 0.
    Log,
}

/// A range of values and the pixels it covers.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    pub scale: Scale,
    /// First and last value, the first below the last.
    pub values: (f64, f64),
    /// Where they are drawn; the first may be the greater (y grows downwards in SVG).
    pub pixels: (f64, f64),
}

impl Axis {
    /// A linear axis; a range without extent gets one.
    pub fn linear(from: f64, to: f64, pixels: (f64, f64)) -> Self {
        let pad = if to - from > 1e-9 { 0.0 } else { 0.5 };
        Self { scale: Scale::Linear, values: (from - pad, to + pad), pixels }
    }

    pub fn pixel(&self, value: f64) -> f64 {
        let (from, to) = self.values;
        let share = match self.scale {
            Scale::Linear => (value - from) / (to - from),
            Scale::Log => (ln(value.clamp(from, to)) - ln(from)) / (ln(to) - ln(from)),
        };
        self.pixels.0 + share * (self.pixels.1 - self.pixels.0)
    }

    /// Round values with their labels: about one in 45 pixels, or the decades.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let (from, to) = self.values;
        if self.scale == Scale::Log {
            let decades = (-9..=9).map(|k| (pow10(k), length_label(k)));
            return decades.filter(|(value, _)| (from..=to * 1.0001).contains(value)).collect();
        }
        let wanted = ((self.pixels.1 - self.pixels.0).abs() / 45.0).clamp(2.0, 12.0);
        let (step, decimals) = nice_step((to - from) / wanted);
        let (first, last) = ((from / step).ceil() as i64, (to / step).floor() as i64);
        let label = |k: i64| format!("{:.decimals$}", k as f64 * step);
        (first..=last).map(|k| (k as f64 * step, label(k))).collect()
    }
}

/// The next 1, 2 or 5 times a power of ten, and the decimals it needs.
fn nice_step(rough: f64) -> (f64, usize) {
    let steps = (-9..=9).flat_map(|k| [1.0, 2.0, 5.0].map(|m| (m * pow10(k), (-k).max(0) as usize)));
    steps.clone().find(|(step, _)| *step >= rough * 0.999).or(steps.last()).unwrap_or((1.0, 0))
}

fn pow10(k: i32) -> f64 {
    // Written as text and read back: the nearest double, with no multiplication errors.
    format!("1e{k}").parse().unwrap_or(1.0)
}

/// A power of ten of metres in the unit that people use for it.
fn length_label(k: i32) -> String {
    match k {
        -3..=-3 => "1 mm".to_owned(),
        -2..=-1 => format!("{} cm", if k == -2 { 1 } else { 10 }),
        0..=2 => format!("{} m", pow10(k)),
        3.. => format!("{} km", pow10(k - 3)),
        _ => format!("{} mm", pow10(k + 3)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: Axis) -> Vec<String> {
        axis.ticks().into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels(Axis::linear(-0.13, 0.41, (0.0, 400.0))), ["-0.1", "0.0", "0.1", "0.2", "0.3", "0.4"]);
        assert_eq!(labels(Axis::linear(0.0, 9.0, (0.0, 350.0))), ["0", "2", "4", "6", "8"]);
        assert_eq!(labels(Axis::linear(0.0, 0.004, (300.0, 0.0))), ["0.000", "0.001", "0.002", "0.003", "0.004"]);
        let log = Axis { scale: Scale::Log, values: (0.0005, 1.0), pixels: (0.0, 300.0) };
        assert_eq!(labels(log), ["1 mm", "1 cm", "10 cm", "1 m"]);
    }

    #[test]
    fn an_axis_without_extent_still_draws() {
        let axis = Axis::linear(3.0, 3.0, (0.0, 100.0));
        assert_eq!(axis.pixel(3.0), 50.0);
        assert!(!axis.ticks().is_empty());
    }
}
