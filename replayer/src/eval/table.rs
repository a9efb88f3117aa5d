//! Evaluations as text for people.

use std::fmt;

use super::{Alignment, DeltaUnit, Evaluation, RpeOptions, Statistics};

impl fmt::Display for Alignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Se3 => "SE3",
            Self::Sim3 => "Sim3",
            Self::None => "none",
        })
    }
}

impl fmt::Display for RpeOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = match self.unit {
            DeltaUnit::Metres => "m",
            DeltaUnit::Seconds => "s",
            DeltaUnit::Frames if self.delta == 1.0 => "frame",
            DeltaUnit::Frames => "frames",
        };
        write!(f, "RPE {} {unit}{}", self.delta, if self.all_pairs { ", all" } else { "" })
    }
}

/// What rounds to zero prints without a minus.
fn unsigned_zero(value: f64) -> f64 {
    if value.abs() < 5e-6 { 0.0 } else { value }
}

/// One line of the table.
fn row(f: &mut fmt::Formatter<'_>, label: &str, unit: &str, s: Option<&Statistics>) -> fmt::Result {
    write!(f, "{label:<16} {unit:<4}")?;
    match s {
        None => writeln!(f, " no such pair: the trajectory is too short"),
        Some(s) => {
            for value in [s.rmse, s.mean, s.median, s.std, s.min, s.max] {
                write!(f, " {value:>9.5}")?;
            }
            writeln!(f, " {:>7}", s.count)
        }
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(c) = self.coverage {
            writeln!(f, "tracked   {} of {} frames ({:.1} %)", c.tracked, c.frames, c.share() * 100.0)?;
        }
        let (pairs, estimated, truth) = (self.pairs, self.estimated_poses, self.true_poses);
        writeln!(f, "paired    {pairs} poses ({estimated} estimated, {truth} true)")?;
        writeln!(f, "path      {:.3} m true, {:.3} m estimated", self.true_length_m, self.estimated_length_m)?;
        writeln!(f, "alignment {}, scale {:.6}", self.alignment, self.scale)?;
        let heads = ["rmse", "mean", "median", "std", "min", "max"];
        write!(f, "\n{:<21}", "")?;
        for head in heads {
            write!(f, " {head:>9}")?;
        }
        writeln!(f, " {:>7}", "pairs")?;
        row(f, "ATE", "m", Some(&self.ate_m))?;
        row(f, "ATE rotation", "deg", Some(&self.ate_rotation_deg))?;
        for rpe in &self.rpe {
            row(f, &rpe.options.to_string(), "m", rpe.translation_m.as_ref())?;
            row(f, "", "deg", rpe.rotation_deg.as_ref())?;
        }
        writeln!(f, "\n{:<21} {:>9} {:>9} {:>9}", "ATE by axis", "rmse", "mean", "max abs")?;
        for (name, axis) in ["x", "y", "z"].iter().zip(&self.axes_m) {
            writeln!(
                f,
                "{name:<16} {:<4} {:>9.5} {:>9.5} {:>9.5}",
                "m",
                axis.rmse,
                unsigned_zero(axis.mean),
                axis.max_abs
            )?;
        }
        Ok(())
    }
}

/// Several estimates against one truth, one line each.
#[derive(Debug, Clone, Copy)]
pub struct Comparison<'a>(pub &'a [(&'a str, &'a Evaluation)]);

impl fmt::Display for Comparison<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.0.iter().map(|(name, _)| name.chars().count()).fold(8, usize::max);
        let rpe: &[_] = self.0.first().map_or(&[], |(_, first)| &first.rpe);
        write!(f, "{:<width$} {:>9} {:>11} {:>9} {:>9}", "estimate", "tracked", "ATE rmse m", "median", "max")?;
        for rpe in rpe {
            write!(f, " {:>13}", format!("{} m", rpe.options))?;
        }
        writeln!(f)?;
        for (name, e) in self.0 {
            let tracked = e.coverage.map_or("-".to_owned(), |c| format!("{:.1} %", c.share() * 100.0));
            let ate = &e.ate_m;
            write!(f, "{name:<width$} {tracked:>9} {:>11.5} {:>9.5} {:>9.5}", ate.rmse, ate.median, ate.max)?;
            for rpe in &e.rpe {
                let text = rpe.translation_m.map_or("-".to_owned(), |s| format!("{:.5}", s.rmse));
                write!(f, " {text:>13}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
