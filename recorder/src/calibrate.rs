//! Calibration from views of a printed board: are the intrinsics right, and where was the camera? (Feature `opencv`.)
//!
//! Corners, poses and intrinsics are OpenCV's work (4.6 with its contributed module `aruco`); what is made of them is
//! here. The board's frame has its origin in the upper left corner of the print, x right, y down, z into the paper,
//! metres.

use crate::board::Board;
use opencv::core::{Mat, Point2f, Point3f, Ptr, Size, TermCriteria, ToInputArray, Vector};
use opencv::prelude::*;
use opencv::{aruco, calib3d, core};
use schemas::calibration::{CameraModel, Distortion};
use schemas::sync::PoseSample;
use serde::Serialize;
use slam_math::{Se3, Track};

/// Corners that a view must show: four fix a pose, more tell whether it is right.
const MIN_CORNERS: usize = 8;
/// Views from which intrinsics are estimated at most: they are spread evenly, more change nothing but the time.
const MAX_VIEWS: usize = 60;
/// Views below which intrinsics are not estimated.
const MIN_VIEWS: usize = 10;
/// A view with a larger error is no view of the board, pixels.
const MAX_VIEW_ERROR_PX: f64 = 5.0;

/// Why a calibration failed.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// OpenCV's own complaint.
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
    /// The picture is not what the calibration says.
    #[error("the picture has {found} pixels, the calibration {width} x {height}")]
    Pixels {
        /// Pixels in the picture.
        found: usize,
        /// Width in the calibration.
        width: u32,
        /// Height in the calibration.
        height: u32,
    },
    /// The board was not seen often enough.
    #[error(
        "the board was seen in {views} of {frames} pictures, {MIN_VIEWS} views are needed: show it larger, sharper and \
         without glare, and check --columns, --rows, --square-mm and --marker-mm"
    )]
    TooFew {
        /// Views.
        views: usize,
        /// Pictures looked at.
        frames: usize,
    },
}

/// What the views say.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// Pictures looked at.
    pub frames: usize,
    /// Pictures that show the board.
    pub views: usize,
    /// Corners in them.
    pub corners: usize,
    /// Root mean square of the reprojection error with the intrinsics of the log, pixels.
    pub rms_px: f64,
    /// Intrinsics that fit best.
    pub fitted: CameraModel,
    /// Root mean square of the reprojection error with those, pixels.
    pub fitted_rms_px: f64,
    /// Standard deviations of the fitted fx, fy, cx, cy, pixels.
    pub fitted_sigma_px: [f64; 4],
    /// `board_from_camera` at the pictures' stamps.
    #[serde(skip)]
    pub poses: Vec<PoseSample>,
}

/// Collects views of the board.
pub struct Calibrator {
    board: Board,
    camera: CameraModel,
    dictionary: Ptr<aruco::Dictionary>,
    charuco: Ptr<aruco::CharucoBoard>,
    matrix: Mat,
    distortion: Mat,
    frames: usize,
    views: Vec<View>,
}

/// Numbers and pixels.
type Corners = (Vector<i32>, Vector<Point2f>);

struct View {
    stamp_ns: i64,
    object: Vector<Point3f>,
    image: Vector<Point2f>,
    board_from_camera: Se3,
    square_error: f64,
}

impl Calibrator {
    /// For pictures of a camera with these intrinsics; the board is valid (see [`Board::validated`]).
    ///
    /// # Errors
    /// OpenCV refuses.
    pub fn new(board: Board, camera: CameraModel) -> Result<Self, CalibrateError> {
        let dictionary = aruco::get_predefined_dictionary(aruco::PREDEFINED_DICTIONARY_NAME::DICT_5X5_100)?;
        let (square, marker) = ((board.square_mm * 1e-3) as f32, (board.marker_mm * 1e-3) as f32);
        let (columns, rows) = (board.columns as i32, board.rows as i32);
        let charuco = aruco::CharucoBoard::create(columns, rows, square, marker, &dictionary)?;
        let (matrix, distortion) = opencv_camera(&camera)?;
        Ok(Self { board, camera, dictionary, charuco, matrix, distortion, frames: 0, views: Vec::new() })
    }

    /// Looks for the board in a grey picture, rows joined; gives the number of corners found, 0 when it is not a view.
    ///
    /// # Errors
    /// The picture has another size, or OpenCV refuses.
    pub fn frame(&mut self, stamp_ns: i64, gray: &[u8]) -> Result<usize, CalibrateError> {
        let CameraModel { width, height, .. } = self.camera;
        if gray.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(CalibrateError::Pixels { found: gray.len(), width, height });
        }
        self.frames += 1;
        let picture = Mat::new_rows_cols_with_data(height as i32, width as i32, gray)?;
        let Some((ids, image)) = self.detect(&picture)? else { return Ok(0) };
        let object: Vector<Point3f> = ids.iter().map(|id| self.corner(id)).collect();
        let (mut turn, mut shift) = (Mat::default(), Mat::default());
        if !calib3d::solve_pnp_def(&object, &image, &self.matrix, &self.distortion, &mut turn, &mut shift)? {
            return Ok(0);
        }
        let mut projected = Vector::<Point2f>::new();
        calib3d::project_points_def(&object, &turn, &shift, &self.matrix, &self.distortion, &mut projected)?;
        let square = |(a, b): (Point2f, Point2f)| {
            f64::from(a.x - b.x) * f64::from(a.x - b.x) + f64::from(a.y - b.y) * f64::from(a.y - b.y)
        };
        let square_error = projected.iter().zip(image.iter()).map(square).fold(0.0, |a, b| a + b);
        if (square_error / object.len() as f64).sqrt() > MAX_VIEW_ERROR_PX {
            return Ok(0);
        }
        let board_from_camera = camera_from_board(&turn, &shift)?.inverse();
        let corners = object.len();
        self.views.push(View { stamp_ns, object, image, board_from_camera, square_error });
        Ok(corners)
    }

    /// The corners in a picture, if there are enough.
    fn detect(&self, picture: &impl ToInputArray) -> Result<Option<Corners>, CalibrateError> {
        let (mut markers, mut ids) = (Vector::<Vector<Point2f>>::new(), Vector::<i32>::new());
        aruco::detect_markers_def(picture, &self.dictionary, &mut markers, &mut ids)?;
        if ids.is_empty() {
            return Ok(None);
        }
        let (mut corners, mut numbers) = (Vector::<Point2f>::new(), Vector::<i32>::new());
        aruco::interpolate_corners_charuco_def(&markers, &ids, picture, &self.charuco, &mut corners, &mut numbers)?;
        Ok((numbers.len() >= MIN_CORNERS).then_some((numbers, corners)))
    }

    /// Inner corner by its number, metres.
    fn corner(&self, id: i32) -> Point3f {
        let columns = self.board.columns as i32 - 1;
        let metres = |squares: i32| (f64::from(squares + 1) * self.board.square_mm * 1e-3) as f32;
        Point3f::new(metres(id % columns), metres(id / columns), 0.0)
    }

    /// What all views say together.
    ///
    /// # Errors
    /// Too few views, or OpenCV refuses.
    pub fn finish(self) -> Result<Calibration, CalibrateError> {
        let (views, frames) = (self.views.len(), self.frames);
        if views < MIN_VIEWS {
            return Err(CalibrateError::TooFew { views, frames });
        }
        let (fitted, fitted_rms_px, fitted_sigma_px) = self.fit()?;
        let corners = self.views.iter().map(|view| view.object.len()).sum::<usize>();
        let square_error = self.views.iter().fold(0.0, |sum, view| sum + view.square_error);
        let pose = |view: &View| PoseSample {
            stamp_ns: view.stamp_ns,
            system_ns: None,
            translation_m: view.board_from_camera.translation.into(),
            rotation_xyzw: view.board_from_camera.quaternion_xyzw(),
        };
        Ok(Calibration {
            frames,
            views,
            corners,
            rms_px: (square_error / corners as f64).sqrt(),
            fitted,
            fitted_rms_px,
            fitted_sigma_px,
            poses: self.views.iter().map(pose).collect(),
        })
    }

    /// Best intrinsics, their reprojection error and standard deviations.
    fn fit(&self) -> Result<(CameraModel, f64, [f64; 4]), CalibrateError> {
        let kept = self.views.len().min(MAX_VIEWS);
        let chosen = (0..kept).map(|i| &self.views[i * self.views.len() / kept]);
        let (mut objects, mut images) = (Vector::<Vector<Point3f>>::new(), Vector::<Vector<Point2f>>::new());
        for view in chosen {
            objects.push(view.object.clone());
            images.push(view.image.clone());
        }
        let (mut matrix, mut distortion) = (self.matrix.clone(), self.distortion.clone());
        let (mut turns, mut shifts) = (Mat::default(), Mat::default());
        let (mut sigma, mut sigma_poses, mut errors) = (Mat::default(), Mat::default(), Mat::default());
        let size = Size::new(self.camera.width as i32, self.camera.height as i32);
        let rms = calib3d::calibrate_camera_extended(
            &objects,
            &images,
            size,
            &mut matrix,
            &mut distortion,
            &mut turns,
            &mut shifts,
            &mut sigma,
            &mut sigma_poses,
            &mut errors,
            calib3d::CALIB_USE_INTRINSIC_GUESS,
            TermCriteria::new(core::TermCriteria_COUNT + core::TermCriteria_EPS, 50, 1e-9)?,
        )?;
        let m = |row, column| matrix.at_2d::<f64>(row, column).copied();
        let mut parameters = [0.0; 5];
        for (i, parameter) in parameters.iter_mut().enumerate() {
            *parameter = *distortion.at::<f64>(i as i32)?;
        }
        let sigma = [0, 1, 2, 3].map(|i| sigma.at::<f64>(i).copied().unwrap_or(f64::NAN));
        let fitted = CameraModel {
            fx: m(0, 0)?,
            fy: m(1, 1)?,
            cx: m(0, 2)?,
            cy: m(1, 2)?,
            distortion: Distortion::from_parameters(parameters),
            ..self.camera
        };
        Ok((fitted, rms, sigma))
    }
}

/// A parameter that differs by more than this share of the focal length, and by more than [`WRONG_SIGMAS`], is wrong: 1 %
/// is 5 mm half a metre away.
const WRONG_SHARE: f64 = 0.01;
/// Standard deviations within which two calibrations agree; those of OpenCV know no lens or print errors.
const WRONG_SIGMAS: f64 = 4.0;

impl Calibration {
    /// Names of the intrinsics of `camera` that the views contradict. The reprojection error does not tell: a wrong focal
    /// length is nearly made up for by a wrong distance.
    #[must_use]
    pub fn contradicted(&self, camera: &CameraModel) -> Vec<&'static str> {
        let f = &self.fitted;
        let pairs =
            [("fx", camera.fx, f.fx), ("fy", camera.fy, f.fy), ("cx", camera.cx, f.cx), ("cy", camera.cy, f.cy)];
        let wrong = pairs.iter().zip(&self.fitted_sigma_px).filter(|((_, given, fitted), sigma)| {
            let difference = (given - fitted).abs();
            difference > WRONG_SHARE * f.fx && difference > WRONG_SIGMAS * **sigma
        });
        wrong.map(|((name, _, _), _)| *name).collect()
    }

    /// The camera's path before the board.
    #[must_use]
    pub fn track(&self) -> Track {
        let pose = |sample: &PoseSample| slam_math::StampedPose {
            stamp_ns: sample.stamp_ns,
            world_from_body: Se3::from_quaternion(sample.translation_m, sample.rotation_xyzw),
        };
        Track::new(self.poses.iter().map(pose).collect())
    }
}

/// Camera matrix and distortion in OpenCV's order k1 k2 p1 p2 k3.
fn opencv_camera(camera: &CameraModel) -> Result<(Mat, Mat), CalibrateError> {
    let CameraModel { fx, fy, cx, cy, .. } = *camera;
    let matrix = Mat::from_slice_2d(&[[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])?;
    // OpenCV's tangential part is taken from the straight point; with a RealSense's millionths the other way of taking it
    // moves no corner by a tenth of a pixel.
    Ok((matrix, Mat::from_slice_2d(&[camera.distortion.parameters()])?))
}

/// From OpenCV's rotation vector and translation.
fn camera_from_board(turn: &Mat, shift: &Mat) -> Result<Se3, CalibrateError> {
    let number = |mat: &Mat, i| mat.at::<f64>(i).copied();
    let turn = nalgebra::Vector6::new(0.0, 0.0, 0.0, number(turn, 0)?, number(turn, 1)?, number(turn, 2)?);
    let translation = nalgebra::Vector3::new(number(shift, 0)?, number(shift, 1)?, number(shift, 2)?);
    Ok(Se3 { translation, ..Se3::exp(&turn) })
}
