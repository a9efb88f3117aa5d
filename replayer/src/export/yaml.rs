//! Calibration files in YAML. Numbers stand in the shortest form that reads back as the same 64 bits.

use schemas::calibration::CameraModel;
use schemas::msg::{CameraInfo, Header};
use slam_math::Se3;

use super::lists::numbers;

/// The ROS camera calibration format, with the depth scale if there is depth.
pub(super) fn ros_camera(camera: &CameraModel, depth_scale: Option<f64>) -> String {
    ros_camera_info(&camera.to_camera_info(Header::default()), depth_scale)
}

/// The same of a camera in a pair, which has its own rectification.
pub(super) fn ros_camera_info(info: &CameraInfo, depth_scale: Option<f64>) -> String {
    let scale = depth_scale.map_or(String::new(), |scale| format!("depth_scale: {scale}\n"));
    format!(
        "image_width: {}\nimage_height: {}\ncamera_name: camera\n{}distortion_model: {}\n{}{}{}{scale}",
        info.width,
        info.height,
        matrix("camera_matrix", 3, 3, &info.k),
        info.distortion_model,
        matrix("distortion_coefficients", 1, info.d.len(), &info.d),
        matrix("rectification_matrix", 3, 3, &info.r),
        matrix("projection_matrix", 3, 4, &info.p),
    )
}

/// An EuRoC camera's `sensor.yaml`; with the ROS matrices that tell how pictures of a pair are rectified.
pub(super) fn euroc_camera(
    name: &str,
    camera: &CameraModel,
    body_from_camera: &Se3,
    info: Option<&CameraInfo>,
) -> String {
    let d = camera.distortion.parameters();
    let (r, t) = (&body_from_camera.rotation, &body_from_camera.translation);
    let rows =
        (0..3).map(|i| format!("{}, {}", numbers(&[r[(i, 0)], r[(i, 1)], r[(i, 2)]], ',').replace(',', ", "), t[i]));
    let rows: Vec<String> = rows.chain(["0, 0, 0, 1".to_owned()]).collect();
    let rectified = info.map_or(String::new(), |info| {
        format!("{}{}", matrix("rectification_matrix", 3, 3, &info.r), matrix("projection_matrix", 3, 4, &info.p))
    });
    // The format has four parameters; a fifth is appended where there is one.
    let d = if d[4] == 0.0 { &d[..4] } else { &d[..] };
    format!(
        "%YAML:1.0\n# {name}, by pslam export\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{}]\n\
         resolution: [{}, {}]\ncamera_model: pinhole\nintrinsics: [{}]\ndistortion_model: radial-tangential\n\
         distortion_coefficients: [{}]\n{rectified}",
        rows.join(",\n         "),
        camera.width,
        camera.height,
        list(&[camera.fx, camera.fy, camera.cx, camera.cy]),
        list(d),
    )
}

fn matrix(name: &str, rows: usize, cols: usize, values: &[f64]) -> String {
    format!("{name}:\n  rows: {rows}\n  cols: {cols}\n  data: [{}]\n", list(values))
}

fn list(values: &[f64]) -> String {
    numbers(values, ',').replace(',', ", ")
}
