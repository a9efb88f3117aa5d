//! The real detector on pictures of our board.
#![cfg(feature = "opencv")]

use nalgebra::Vector6;
use recorder::board::Board;
use recorder::calibrate::{CalibrateError, Calibrator};
use schemas::calibration::{CameraModel, Distortion};
use slam_math::{Rng, Se3};

const CAMERA: CameraModel =
    CameraModel { width: 640, height: 480, fx: 615.0, fy: 613.0, cx: 321.5, cy: 238.0, distortion: Distortion::None };

/// What a camera sees of the board that lies in z = 0, origin at its upper left corner; the room behind is grey.
fn view(board: &Board, board_from_camera: &Se3) -> Vec<u8> {
    let per_square = 80;
    let (width, height, print) = board.picture(per_square).unwrap();
    let pixels_per_m = f64::from(per_square) / (board.square_mm * 1e-3);
    let sample = |x: f64, y: f64| {
        let (x, y) = (x * pixels_per_m + f64::from(per_square), y * pixels_per_m + f64::from(per_square));
        let inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height);
        if inside { f64::from(print[y as usize * width as usize + x as usize]) } else { 128.0 }
    };
    let centre = board_from_camera.translation;
    let mut out = Vec::new();
    for row in 0..CAMERA.height {
        for column in 0..CAMERA.width {
            let mut sum = 0.0;
            // Nine rays a pixel: corners get the grey edges that sub-pixel detection lives on.
            for step in 0..9 {
                let (u, v) =
                    (f64::from(column) + f64::from(step % 3 - 1) / 3.0, f64::from(row) + f64::from(step / 3 - 1) / 3.0);
                let ray = nalgebra::Vector3::new((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0);
                let ray = board_from_camera.rotation * ray;
                let along = -centre.z / ray.z;
                sum += if along > 0.0 { sample(centre.x + along * ray.x, centre.y + along * ray.y) } else { 128.0 };
            }
            out.push((sum / 9.0).round() as u8);
        }
    }
    out
}

/// Views from about half a metre before the board, turned by up to 0.4 rad about every axis.
fn poses(board: &Board, count: u32) -> Vec<Se3> {
    let [width, height] = board.size_mm().map(|mm| mm * 1e-3);
    let pose = |i: u32| {
        let mut rng = Rng::at(3, i, 0, 0);
        let mut about = |size: f64| (2.0 * rng.uniform() - 1.0) * size;
        let turn = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, about(0.4), about(0.4), about(0.4)));
        let looked_at = nalgebra::Vector3::new(0.5 * width + about(0.02), 0.5 * height + about(0.02), 0.0);
        let distance = 0.45 + about(0.08);
        Se3 { translation: looked_at - turn.rotation * nalgebra::Vector3::new(0.0, 0.0, distance), ..turn }
    };
    (0..count).map(pose).collect()
}

#[test]
fn poses_and_intrinsics_come_back() {
    let board = Board::default();
    let mut calibrator = Calibrator::new(board, CAMERA).unwrap();
    let truth = poses(&board, 16);
    for (i, pose) in truth.iter().enumerate() {
        let corners = calibrator.frame(i as i64, &view(&board, pose)).unwrap();
        assert!(corners >= 20, "view {i}: {corners} of 24 corners");
    }
    assert_eq!(calibrator.frame(99, &vec![128; 640 * 480]).unwrap(), 0, "no board, no view");
    let found = calibrator.finish().unwrap();
    assert_eq!((found.frames, found.views), (17, 16));
    assert!(found.rms_px < 0.3, "{found:?}");
    let fitted = found.fitted;
    assert!((fitted.fx - CAMERA.fx).abs() < 3.0 && (fitted.cx - CAMERA.cx).abs() < 3.0, "{fitted:?}");
    for (sample, pose) in found.poses.iter().zip(&truth) {
        let error = Se3::from_quaternion(sample.translation_m, sample.rotation_xyzw).inverse() * *pose;
        assert!(error.translation.norm() < 0.003 && error.angle() < 0.006, "{error:?}");
    }
    assert_eq!(found.track().poses().len(), 16);
}

#[test]
fn wrong_intrinsics_are_noticed() {
    let board = Board::default();
    let wrong = CameraModel { fx: 650.0, fy: 648.0, ..CAMERA };
    let mut calibrator = Calibrator::new(board, wrong).unwrap();
    poses(&board, 16).iter().enumerate().for_each(|(i, pose)| {
        calibrator.frame(i as i64, &view(&board, pose)).unwrap();
    });
    let found = calibrator.finish().unwrap();
    assert_eq!(found.contradicted(&wrong), ["fx", "fy"], "{found:?}");
    assert_eq!(found.contradicted(&CAMERA), [""; 0], "{found:?}");
    assert!((found.fitted.fx - CAMERA.fx).abs() < 3.0, "{found:?}");
}

#[test]
fn what_cannot_be_calibrated_is_said() {
    let board = Board::default();
    let mut calibrator = Calibrator::new(board, CAMERA).unwrap();
    assert!(matches!(calibrator.frame(0, &[0; 10]), Err(CalibrateError::Pixels { found: 10, .. })));
    assert!(matches!(calibrator.finish(), Err(CalibrateError::TooFew { views: 0, frames: 0 })));
}
