//! Sequences of the KITTI odometry benchmark: `calib.txt`, `times.txt`, `image_0` and `image_1`, poses.

use super::lists::{ListedFile, PoseRow, data_lines, line_error};
use super::sequence::{Sequence, picture_size};
use super::{ImportError, PanopticSource, Repairs, SequenceReport, read_text};
use nalgebra::{Matrix3, Vector3};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Distortion};
use schemas::stereo::StereoModel;
use slam_math::Se3;
use std::path::{Path, PathBuf};

/// How to import a KITTI odometry sequence.
#[derive(Debug, Clone)]
pub struct KittiOptions {
    /// Take the right camera too, if its pictures are there.
    pub stereo: bool,
    /// Take the colour cameras (`image_2`, `image_3`) rather than the grey ones.
    pub color: bool,
    /// Ground truth. By default `poses.txt` in the folder, else `../../poses/NAME.txt`, where the benchmark has it.
    pub poses: Option<PathBuf>,
    /// Labels of the left pictures.
    pub panoptic: Vec<PanopticSource>,
    /// Replace an existing log.
    pub force: bool,
}

impl Default for KittiOptions {
    fn default() -> Self {
        Self { stereo: true, color: false, poses: None, panoptic: Vec::new(), force: false }
    }
}

/// Imports a sequence's folder into a log at `out`. The pictures are rectified already. `progress` hears (messages done,
/// messages in all).
///
/// # Errors
/// A missing, damaged or contradicting file, named with its line or numbers; or the log cannot be written. The unfinished
/// log is then removed.
pub fn kitti(
    dir: &Path,
    out: &Path,
    options: &KittiOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<SequenceReport, ImportError> {
    let sequence = read(dir, options)?;
    sequence.write(out, &options.panoptic, options.force, Repairs::default(), progress)
}

fn read(dir: &Path, options: &KittiOptions) -> Result<Sequence, ImportError> {
    let calibration = dir.join("calib.txt");
    let [left_number, right_number] = if options.color { [2, 3] } else { [0, 1] };
    let left_projection = projection(&calibration, left_number)?;
    let stamps = times(&dir.join("times.txt"))?;
    let folder = |number: usize| dir.join(format!("image_{number}"));
    let left = pictures(&folder(left_number), &stamps)?;
    let Some(first) = left.first() else {
        return Err(ImportError::content(&dir.join("times.txt"), "lists no pictures: nothing to import"));
    };
    let camera = camera(&left_projection, picture_size(Path::new(&first.path))?);
    let camera = camera.validated().map_err(|source| ImportError::Calibration { path: calibration.clone(), source })?;
    let right = if options.stereo && folder(right_number).is_dir() {
        let projection = projection(&calibration, right_number)?;
        // Both P's are of one pinhole camera; their fourth columns differ by the baseline.
        let bf = left_projection[3] - projection[3];
        let stereo = StereoModel::of_rectified(camera, bf);
        let stereo = stereo.map_err(|error| ImportError::content(&calibration, error.to_string()))?;
        Some((stereo, pictures(&folder(right_number), &stamps)?))
    } else {
        None
    };
    let canonical = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    let name = canonical.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let beside = canonical.join(format!("../../poses/{name}.txt"));
    let known = [dir.join("poses.txt"), beside].into_iter().find(|path| path.exists());
    let (poses, truth_origin) = match options.poses.clone().or(known) {
        None => (Vec::new(), "none".to_owned()),
        Some(path) => {
            let origin = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            (poses(&path, &stamps, &offset(&left_projection))?, origin)
        }
    };
    Ok(Sequence {
        kind: "kitti",
        dir: dir.to_owned(),
        name,
        camera,
        left,
        right,
        imu: Vec::new(),
        poses,
        truth_origin,
        attachments: vec![("calibration/calib.txt".to_owned(), calibration)],
    })
}

/// The 3 x 4 projection `P<number>` of `calib.txt`.
fn projection(path: &Path, number: usize) -> Result<[f64; 12], ImportError> {
    let text = read_text(path, " (a KITTI odometry sequence has calib.txt, times.txt and image_0)")?;
    let key = format!("P{number}:");
    let found = data_lines(&text).find_map(|(line, row)| Some((line, row.strip_prefix(&key)?)));
    let Some((line, row)) = found else {
        return Err(ImportError::content(path, format!("no line `{key}`: wanted the projection of camera {number}")));
    };
    let p: [f64; 12] = values(path, line, row)?;
    let shape = p[1] == 0.0 && p[4] == 0.0 && p[8..10] == [0.0; 2] && p[10] == 1.0;
    if shape { Ok(p) } else { Err(line_error(path, line, format!("{p:?} is no projection of a rectified camera"))) }
}

fn camera(p: &[f64; 12], (width, height): (u32, u32)) -> CameraModel {
    CameraModel { width, height, fx: p[0], fy: p[5], cx: p[2], cy: p[6], distortion: Distortion::None }
}

/// `camera_from_camera0`: the fourth column without the intrinsics. All rectified cameras look the same way.
fn offset(p: &[f64; 12]) -> Vector3<f64> {
    let k = Matrix3::new(p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]);
    let z = p[11];
    Vector3::new((p[3] - k[(0, 2)] * z) / k[(0, 0)], (p[7] - k[(1, 2)] * z) / k[(1, 1)], z)
}

/// `times.txt`: seconds, a line a frame.
fn times(path: &Path) -> Result<Vec<Stamp>, ImportError> {
    let text = read_text(path, " (a KITTI odometry sequence has calib.txt, times.txt and image_0)")?;
    let mut stamps: Vec<Stamp> = Vec::new();
    for (line, row) in data_lines(&text) {
        let (stamp, _) = Stamp::from_decimal_rounded(row).map_err(|e| line_error(path, line, e.to_string()))?;
        if stamp.0 < 0 || stamps.last().is_some_and(|last| *last >= stamp) {
            return Err(line_error(path, line, format!("time {row} is not after the one before it")));
        }
        stamps.push(stamp);
    }
    Ok(stamps)
}

/// `NNNNNN.png` by frame number; a frame without a file is an error, since times would no longer fit.
fn pictures(folder: &Path, stamps: &[Stamp]) -> Result<Vec<ListedFile>, ImportError> {
    let mut files = Vec::with_capacity(stamps.len());
    for (number, stamp) in stamps.iter().enumerate() {
        let path = folder.join(format!("{number:06}.png"));
        if !path.exists() {
            let message = format!("is missing, but times.txt has {} frames", stamps.len());
            return Err(ImportError::content(&path, message));
        }
        files.push(ListedFile { stamp: *stamp, path: path.to_string_lossy().into_owned() });
    }
    Ok(files)
}

/// `world_from_camera0` as rows of 12 numbers, a line a frame, moved to the camera that is imported.
fn poses(path: &Path, stamps: &[Stamp], camera_from_camera0: &Vector3<f64>) -> Result<Vec<PoseRow>, ImportError> {
    let text = read_text(path, "")?;
    let mut rows = Vec::new();
    for ((line, row), stamp) in data_lines(&text).zip(stamps) {
        let v: [f64; 12] = values(path, line, row)?;
        let rotation = Matrix3::from_fn(|r, c| v[4 * r + c]);
        let off = (rotation * rotation.transpose() - Matrix3::identity()).norm();
        if off.is_nan() || off > 1e-3 || rotation.determinant() < 0.0 {
            return Err(line_error(path, line, "holds no rotation".to_owned()));
        }
        let world_from_camera0 = Se3 { rotation, translation: Vector3::new(v[3], v[7], v[11]) };
        let camera0_from_camera = Se3 { translation: -camera_from_camera0, ..Se3::identity() };
        let pose = world_from_camera0 * camera0_from_camera;
        rows.push(PoseRow { stamp: *stamp, translation: pose.translation.into(), quaternion: pose.quaternion_xyzw() });
    }
    let lines = data_lines(&text).count();
    if lines != stamps.len() {
        return Err(ImportError::content(path, format!("{lines} poses for {} frames", stamps.len())));
    }
    Ok(rows)
}

fn values<const N: usize>(path: &Path, line: usize, row: &str) -> Result<[f64; N], ImportError> {
    let parsed: Option<Vec<f64>> =
        row.split_whitespace().map(|t| t.parse().ok().filter(|v: &f64| v.is_finite())).collect();
    let parsed = parsed.ok_or_else(|| line_error(path, line, "holds something that is no number".to_owned()))?;
    let count = parsed.len();
    parsed.try_into().map_err(|_| line_error(path, line, format!("{count} numbers, wanted {N}")))
}
