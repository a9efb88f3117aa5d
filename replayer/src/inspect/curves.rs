//! Numbers over time.

use rrd::{At, Rgba, RrdError, RrdWriter, Scalars, SeriesLines};
use slam::report::{FrameReport, KeypointReport, Verdict};

use super::style;

/// One plotted group: entity, names and colours of its curves.
struct Group {
    entity: &'static str,
    names: Vec<&'static str>,
    colors: Vec<Rgba>,
}

const VERDICTS: &str = "/plots/verdicts";
const REGIONS: &str = "/plots/regions";
const EPIPOLAR: &str = "/plots/epipolar";
const MOTION: &str = "/plots/motion";
const SUPPORT: &str = "/plots/epipolar_support";
const MATCHES: &str = "/plots/matches";
const MAP: &str = "/plots/map";
const KEYFRAMES: &str = "/plots/keyframes";
const EDITS: &str = "/plots/edits";

fn groups() -> Vec<Group> {
    let group = |entity, curves: &[(&'static str, Rgba)]| Group {
        entity,
        names: curves.iter().map(|c| c.0).collect(),
        colors: curves.iter().map(|c| c.1).collect(),
    };
    let residuals =
        [("static: median", style::GREEN), ("static: 90 %", style::PALE), ("dynamic: median", style::ORANGE)];
    vec![
        group(VERDICTS, &Verdict::ALL.map(|v| (v.name(), style::verdict(v)))),
        group(REGIONS, &style::REGION_STATES.map(style::region)),
        group(EPIPOLAR, &residuals),
        group(MOTION, &residuals),
        group(SUPPORT, &[("matches on Stuff", style::GREY), ("inliers", style::GREEN)]),
        group(
            MATCHES,
            &[
                ("static keypoints", style::GREY),
                ("after prediction", style::GOLD),
                ("after local map", style::BLUE),
                ("inliers of the pose", style::GREEN),
            ],
        ),
        group(MAP, &[("points of the map", style::PALE), ("offered to the frame", style::BLUE)]),
        group(KEYFRAMES, &[("keyframes", style::BLUE)]),
        group(
            EDITS,
            &[
                ("points created", style::GREEN),
                ("culled", style::ORANGE),
                ("fused", style::BLUE),
                ("outliers of local BA", style::GREY),
            ],
        ),
    ]
}

/// Logs names and colours.
pub fn log_styles(file: &mut RrdWriter) -> Result<(), RrdError> {
    for Group { entity, names, colors } in groups() {
        file.log(entity, At::Static, &SeriesLines { names: &names, colors: &colors, widths: &[1.5] })?;
    }
    Ok(())
}

/// Logs one frame.
pub fn log(file: &mut RrdWriter, at: At, report: &FrameReport) -> Result<(), RrdError> {
    let of_verdict = |v| report.keypoints.iter().filter(|k| k.verdict == v).count() as f64;
    file.log(VERDICTS, at, &Scalars { values: &Verdict::ALL.map(of_verdict) })?;
    let of_state = |s| report.regions.iter().filter(|r| r.state == s).count() as f64;
    file.log(REGIONS, at, &Scalars { values: &style::REGION_STATES.map(of_state) })?;
    file.log(EPIPOLAR, at, &Scalars { values: &residuals(&report.keypoints, |k| k.epipolar_px) })?;
    file.log(MOTION, at, &Scalars { values: &residuals(&report.keypoints, |k| k.motion_sigmas) })?;
    let support = report.epipolar.map_or([f64::NAN; 2], |e| [f64::from(e.matches), f64::from(e.inliers)]);
    file.log(SUPPORT, at, &Scalars { values: &support })?;
    let c = &report.counts;
    let mut counts = |entity, values: &[u32]| {
        let values: Vec<f64> = values.iter().copied().map(f64::from).collect();
        file.log(entity, at, &Scalars { values: &values })
    };
    counts(MATCHES, &[c.static_keypoints, c.motion_matches, c.local_matches, c.inliers])?;
    counts(MAP, &[c.map_points, c.local_points])?;
    counts(KEYFRAMES, &[c.keyframes])?;
    counts(EDITS, &[c.points_created, c.points_culled, c.points_fused, c.ba_outliers])
}

/// Median and 90 % of a residual over static keypoints, median over dynamic ones; NaN (a gap) where there is none.
fn residuals(keypoints: &[KeypointReport], value: impl Fn(&KeypointReport) -> f64) -> [f64; 3] {
    let sorted = |keep: fn(Verdict) -> bool| {
        let kept = keypoints.iter().filter(|k| keep(k.verdict));
        let mut values: Vec<f64> = kept.map(&value).filter(|v| v.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let (still, moving) = (sorted(|v| v == Verdict::Static), sorted(Verdict::is_dynamic));
    [quantile(&still, 50), quantile(&still, 90), quantile(&moving, 50)]
}

/// The value below which `percent` of the sorted values lie; NaN for none.
fn quantile(sorted: &[f64], percent: usize) -> f64 {
    sorted.get(sorted.len() * percent / 100).copied().unwrap_or(f64::NAN)
}
