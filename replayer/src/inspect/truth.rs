//! What is only known at the end: the final trajectory beside the true one, and the error over time.

use rrd::{At, Lines3d, Points3d, Radius, Rgba, RrdError, RrdWriter, Scalars, SeriesLines};
use slam::Sensor;
use slam_math::{Se3, Sim3};

use super::style;
use super::world::point;
use crate::eval::{EvalOptions, Evaluation, Trajectory, evaluate};

/// Entity of the error over time.
pub const ERROR: &str = "/plots/error";

/// Logs the final trajectory and, where the truth can be laid over it, the truth and the error; tells whether it could. A
/// path that `sensor` gives no unit of length is compared with its scale free.
pub fn log(
    file: &mut RrdWriter,
    sensor: Sensor,
    times: &[At],
    estimate: &Trajectory,
    truth: Option<&Trajectory>,
) -> Result<bool, RrdError> {
    let centers = estimate.poses.iter().map(|pose| point(&pose.world_from_camera.translation)).collect();
    log_line(file, "/world/trajectory/final", centers, style::PALE)?;
    let Some(truth) = truth else { return Ok(false) };
    // A track too short or too straight for an alignment simply has no truth to show.
    let Ok(evaluation) = evaluate(truth, estimate, None, &EvalOptions::for_sensor(sensor.name())) else {
        return Ok(false);
    };
    let estimate_from_truth = truth_from_estimate(&evaluation).inverse();
    let inside = |ns: i64| match (estimate.poses.first(), estimate.poses.last()) {
        (Some(first), Some(last)) => (nanoseconds(first.stamp)..=nanoseconds(last.stamp)).contains(&ns),
        _ => false,
    };
    let kept: Vec<(i64, [f32; 3])> = truth
        .poses
        .iter()
        .map(|pose| (nanoseconds(pose.stamp), pose.world_from_camera.translation))
        .filter(|(ns, _)| inside(*ns))
        .map(|(ns, t)| (ns, point(&estimate_from_truth.transform(&t))))
        .collect();
    log_line(file, "/world/trajectory/true", kept.iter().map(|k| k.1).collect(), style::GOLD)?;
    let names = SeriesLines { names: &["error, mm"], colors: &[style::GOLD], widths: &[1.5] };
    file.log(ERROR, At::Static, &names)?;
    for &at in times {
        let At::Frame { sensor_time_ns, .. } = at else { continue };
        let sample = evaluation.samples.iter().find(|s| nanoseconds(s.stamp) == sensor_time_ns);
        let error_mm = sample.map_or(f64::NAN, |s| s.translation_m * 1000.0);
        file.log(ERROR, at, &Scalars { values: &[error_mm] })?;
        let next = kept.partition_point(|(ns, _)| *ns < sensor_time_ns);
        let positions: Vec<[f32; 3]> = kept.get(next).map(|k| k.1).into_iter().collect();
        let here = Points3d {
            positions: &positions,
            colors: &[style::GOLD],
            radii: &[Radius::Ui(5.0)],
            ..Points3d::default()
        };
        file.log("/world/trajectory/true/camera", at, &here)?;
    }
    Ok(true)
}

fn nanoseconds(stamp: schemas::Stamp) -> i64 {
    stamp.0
}

fn log_line(file: &mut RrdWriter, entity: &str, line: Vec<[f32; 3]>, color: Rgba) -> Result<(), RrdError> {
    file.log(entity, At::Static, &Lines3d { strips: &[line], colors: &[color], radii: &[Radius::Ui(1.2)] })
}

fn truth_from_estimate(evaluation: &Evaluation) -> Sim3 {
    let m = &evaluation.truth_from_estimate;
    let se3 = Se3 {
        rotation: nalgebra::Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]),
        translation: nalgebra::Vector3::new(m[3], m[7], m[11]),
    };
    Sim3 { scale: evaluation.scale, se3 }
}
