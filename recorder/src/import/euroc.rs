//! Folders of the EuRoC MAV data set (ASL format): `mav0/cam0`, `cam1`, `imu0`, `state_groundtruth_estimate0`.

use super::camera_file::{Table, yaml_table};
use super::lists::{ListedFile, PoseRow, data_lines, in_order, line_error};
use super::sequence::{ImuRow, Sequence};
use super::{ImportError, PanopticSource, Repairs, SequenceReport, read_text};
use nalgebra::{Matrix3, Vector3};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{CameraInfo, Header};
use schemas::stereo::{StereoError, StereoModel};
use slam_math::Se3;
use std::path::{Path, PathBuf};

/// Whose poses a ground-truth file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TruthOf {
    /// The body, which is the inertial sensor; moved to the left camera by its `T_BS`.
    Body,
    /// The left camera itself.
    LeftCamera,
}

/// How to import an EuRoC folder.
#[derive(Debug, Clone)]
pub struct EurocOptions {
    /// Take the right camera too, if there is one.
    pub stereo: bool,
    /// Ground truth and whose it is. By default `groundtruth_leftcam.csv` beside `mav0` of the left camera, else
    /// `mav0/state_groundtruth_estimate0/data.csv` of the body.
    pub truth: Option<(PathBuf, TruthOf)>,
    /// Labels of the left pictures.
    pub panoptic: Vec<PanopticSource>,
    /// Replace an existing log.
    pub force: bool,
}

impl Default for EurocOptions {
    fn default() -> Self {
        Self { stereo: true, truth: None, panoptic: Vec::new(), force: false }
    }
}

/// Imports a folder (the one with `mav0` in it, or `mav0` itself) into a log at `out`. Pictures stay as recorded; the
/// calibration in the log tells how to rectify them. `progress` hears (messages done, messages in all).
///
/// # Errors
/// A missing, damaged or contradicting file, named with its line or numbers; or the log cannot be written. The unfinished
/// log is then removed.
pub fn euroc(
    dir: &Path,
    out: &Path,
    options: &EurocOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<SequenceReport, ImportError> {
    let mut repairs = Repairs::default();
    let sequence = read(dir, options, &mut repairs)?;
    sequence.write(out, &options.panoptic, options.force, repairs, progress)
}

fn read(dir: &Path, options: &EurocOptions, repairs: &mut Repairs) -> Result<Sequence, ImportError> {
    let mav = if dir.join("mav0").is_dir() { dir.join("mav0") } else { dir.to_owned() };
    let left = Sensor::read(&mav.join("cam0"))?;
    let mut attachments = vec![left.attachment()];
    let right = if options.stereo && mav.join("cam1").is_dir() {
        let right = Sensor::read(&mav.join("cam1"))?;
        attachments.push(right.attachment());
        let stereo = stereo(&left, &right).map_err(|error| ImportError::content(&right.yaml, error.to_string()))?;
        Some((stereo, pictures(&right.dir, repairs)?))
    } else {
        None
    };
    let imu_dir = mav.join("imu0");
    let imu = if imu_dir.is_dir() { imu(&imu_dir.join("data.csv"), repairs)? } else { Vec::new() };
    let imu_yaml = imu_dir.join("sensor.yaml");
    if imu_yaml.exists() {
        attachments.push(("calibration/imu0/sensor.yaml".to_owned(), imu_yaml));
    }
    let truth = options.truth.clone().or_else(|| find_truth(&mav));
    let (poses, truth_origin) = match &truth {
        None => (Vec::new(), "none".to_owned()),
        Some((path, of)) => {
            let camera = match of {
                TruthOf::Body => left.body_from_sensor,
                TruthOf::LeftCamera => Se3::identity(),
            };
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let whose = if *of == TruthOf::Body { "body poses moved to the left camera" } else { "left camera" };
            (poses(path, &camera, repairs)?, format!("{name}, {whose}"))
        }
    };
    let named = if dir.ends_with("mav0") { dir.parent().unwrap_or(dir) } else { dir };
    let name = named.canonicalize().unwrap_or_else(|_| named.to_owned());
    Ok(Sequence {
        kind: "euroc",
        dir: dir.to_owned(),
        name: name.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        camera: left.camera,
        left: pictures(&left.dir, repairs)?,
        right,
        imu,
        poses,
        truth_origin,
        attachments,
    })
}

/// Rectified as the files say (`pslam export` writes that), else computed from where the cameras are.
fn stereo(left: &Sensor, right: &Sensor) -> Result<StereoModel, StereoError> {
    if let (Some(left), Some(right)) = (left.rectified(), right.rectified()) {
        return StereoModel::from_camera_infos(&left, &right);
    }
    let right_from_left = right.body_from_sensor.inverse() * left.body_from_sensor;
    let rotation: [f64; 9] = std::array::from_fn(|i| right_from_left.rotation[(i / 3, i % 3)]);
    StereoModel::rectify(left.camera, right.camera, rotation, right_from_left.translation.into())
}

fn find_truth(mav: &Path) -> Option<(PathBuf, TruthOf)> {
    let of_body = mav.join("state_groundtruth_estimate0").join("data.csv");
    let of_camera = mav.parent().unwrap_or(mav).join("groundtruth_leftcam.csv");
    // The camera's own poses first: they need no way through the body's frame, which rounds.
    let known = [(of_camera, TruthOf::LeftCamera), (of_body, TruthOf::Body)];
    known.into_iter().find(|(path, _)| path.exists())
}

/// A camera's `sensor.yaml`.
struct Sensor {
    dir: PathBuf,
    yaml: PathBuf,
    camera: CameraModel,
    body_from_sensor: Se3,
    /// `rectification_matrix` and `projection_matrix`, as ROS calibration files name them.
    rectification: Option<([f64; 9], [f64; 12])>,
}

impl Sensor {
    fn read(dir: &Path) -> Result<Self, ImportError> {
        let yaml = dir.join("sensor.yaml");
        let text = read_text(&yaml, " (an EuRoC folder has mav0/cam0/sensor.yaml)")?;
        let parsed = yaml_table(&text).and_then(|table| {
            let rectification = numbers(&table, "rectification_matrix.data").ok();
            let rectification = rectification.zip(numbers(&table, "projection_matrix.data").ok());
            Ok((camera(&table)?, extrinsics(&table)?, rectification))
        });
        let (camera, body_from_sensor, rectification) =
            parsed.map_err(|message| ImportError::content(&yaml, message))?;
        let camera = camera.validated().map_err(|source| ImportError::Calibration { path: yaml.clone(), source })?;
        Ok(Self { dir: dir.to_owned(), yaml, camera, body_from_sensor, rectification })
    }

    fn rectified(&self) -> Option<CameraInfo> {
        let (r, p) = self.rectification?;
        Some(CameraInfo { r, p, ..self.camera.to_camera_info(Header::default()) })
    }

    fn attachment(&self) -> (String, PathBuf) {
        let camera = self.dir.file_name().unwrap_or_default().to_string_lossy();
        (format!("calibration/{camera}/sensor.yaml"), self.yaml.clone())
    }
}

fn numbers<const N: usize>(table: &Table, key: &str) -> Result<[f64; N], String> {
    let texts = table.get(key).ok_or_else(|| format!("no {key}"))?;
    let values: Vec<f64> = texts
        .iter()
        .map(|t| t.parse())
        .collect::<Result<_, _>>()
        .map_err(|_| format!("{key} is no list of numbers"))?;
    let count = values.len();
    values.try_into().map_err(|_| format!("{key} has {count} numbers, wanted {N}"))
}

fn camera(table: &Table) -> Result<CameraModel, String> {
    let word = |key: &str| table.get(key).and_then(|v| v.first()).map_or("", String::as_str);
    if word("camera_model") != "pinhole" {
        return Err(format!("camera_model `{}` is not supported: wanted pinhole", word("camera_model")));
    }
    let [width, height]: [f64; 2] = numbers(table, "resolution")?;
    let whole = |v: f64| v.fract() == 0.0 && (1.0..=65536.0).contains(&v);
    if !whole(width) || !whole(height) {
        return Err(format!("resolution [{width}, {height}] is no picture size"));
    }
    let [fx, fy, cx, cy] = numbers(table, "intrinsics")?;
    let d: Vec<f64> = match numbers::<4>(table, "distortion_coefficients") {
        Ok(d) => d.to_vec(),
        Err(reason) => numbers::<5>(table, "distortion_coefficients").map_err(|_| reason)?.to_vec(),
    };
    let distortion = Distortion::from_ros(word("distortion_model"), &d).map_err(|error| error.to_string())?;
    Ok(CameraModel { width: width as u32, height: height as u32, fx, fy, cx, cy, distortion })
}

/// `T_BS`: the sensor in the body's frame. Its digits are rounded, so the rotation is made one again.
fn extrinsics(table: &Table) -> Result<Se3, String> {
    let t: [f64; 16] = numbers(table, "t_bs.data")?;
    let rotation = Matrix3::from_fn(|r, c| t[4 * r + c]);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).norm();
    if off.is_nan() || off > 1e-3 || rotation.determinant() < 0.0 {
        return Err(format!("T_BS holds no rotation: {t:?}"));
    }
    Ok(Se3 { rotation, translation: Vector3::new(t[3], t[7], t[11]) }.normalized())
}

/// `data.csv` of a camera: `nanoseconds,filename`.
fn pictures(camera_dir: &Path, repairs: &mut Repairs) -> Result<Vec<ListedFile>, ImportError> {
    let list = camera_dir.join("data.csv");
    let text = read_text(&list, " (an EuRoC camera folder has data.csv and data/)")?;
    let mut rows = Vec::new();
    for (line, row) in data_lines(&text) {
        let Some((stamp, name)) = row.split_once(',') else {
            return Err(line_error(&list, line, format!("`{row}` is not `nanoseconds,filename`")));
        };
        let path = camera_dir.join("data").join(name.trim()).to_string_lossy().into_owned();
        rows.push(ListedFile { stamp: nanoseconds(&list, line, stamp, repairs)?, path });
    }
    Ok(in_order(rows, |row| row.stamp, &list, repairs))
}

fn imu(list: &Path, repairs: &mut Repairs) -> Result<Vec<ImuRow>, ImportError> {
    let text = read_text(list, " (an EuRoC imu folder has data.csv)")?;
    let mut rows = Vec::new();
    for (line, row) in data_lines(&text) {
        let (stamp, v) = csv_row::<6>(list, line, row, repairs)?;
        rows.push(ImuRow { stamp, turn_rate: [v[0], v[1], v[2]], acceleration: [v[3], v[4], v[5]] });
    }
    Ok(in_order(rows, |row| row.stamp, list, repairs))
}

/// Ground truth: position and quaternion (w first) of the body; more columns may follow.
fn poses(list: &Path, body_from_camera: &Se3, repairs: &mut Repairs) -> Result<Vec<PoseRow>, ImportError> {
    let text = read_text(list, "")?;
    let mut rows = Vec::new();
    for (line, row) in data_lines(&text) {
        let (stamp, [x, y, z, qw, qx, qy, qz]) = csv_row::<7>(list, line, row, repairs)?;
        let norm = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
        if !(0.5..=2.0).contains(&norm) {
            repairs.count("ground-truth row without a rotation (quaternion near zero) left out");
            continue;
        }
        let pose = if *body_from_camera == Se3::identity() {
            PoseRow { stamp, translation: [x, y, z], quaternion: [qx, qy, qz, qw] }
        } else {
            let camera = Se3::from_quaternion([x, y, z], [qx, qy, qz, qw]) * *body_from_camera;
            PoseRow { stamp, translation: camera.translation.into(), quaternion: camera.quaternion_xyzw() }
        };
        rows.push(pose);
    }
    Ok(in_order(rows, |row| row.stamp, list, repairs))
}

/// A stamp and the `N` numbers after it.
fn csv_row<const N: usize>(
    list: &Path,
    line: usize,
    row: &str,
    repairs: &mut Repairs,
) -> Result<(Stamp, [f64; N]), ImportError> {
    let mut fields = row.split(',').map(str::trim);
    let stamp = nanoseconds(list, line, fields.next().unwrap_or_default(), repairs)?;
    let mut values = [0.0; N];
    for value in &mut values {
        let text = fields.next().ok_or_else(|| {
            line_error(list, line, format!("`{row}` has too few numbers: wanted a stamp and {N} more"))
        })?;
        let number = text.parse().ok().filter(|v: &f64| v.is_finite());
        *value = number.ok_or_else(|| line_error(list, line, format!("`{text}` is not a number")))?;
    }
    Ok((stamp, values))
}

/// Whole nanoseconds; some lists write a fraction behind them.
fn nanoseconds(list: &Path, line: usize, text: &str, repairs: &mut Repairs) -> Result<Stamp, ImportError> {
    let parsed = Stamp::from_decimal_rounded(&format!("{}e-9", text.trim()));
    let (stamp, exact) = parsed.map_err(|_| line_error(list, line, format!("`{text}` is no time in nanoseconds")))?;
    if stamp.0 < 0 {
        return Err(line_error(list, line, format!("time {text} is below zero, which a log cannot hold")));
    }
    if !exact {
        repairs.count("stamp finer than a nanosecond rounded");
    }
    Ok(stamp)
}
