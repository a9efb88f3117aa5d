//! The camera model, its ROS form, and the published calibrations of known data sets.

use crate::msg::{CameraInfo, Header, RegionOfInterest};
use serde::{Deserialize, Serialize};

/// Lens distortion.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "lowercase")]
pub enum Distortion {
    /// A pinhole picture.
    #[default]
    None,
    /// Radial-tangential (Brown-Conrady, ROS `plumb_bob`, OpenCV's five parameters).
    Radtan {
        /// Radial, r^2.
        k1: f64,
        /// Radial, r^4.
        k2: f64,
        /// Tangential, along y.
        p1: f64,
        /// Tangential, along x.
        p2: f64,
        /// Radial, r^6.
        k3: f64,
    },
    /// The same with the tangential part taken from the radially bent point: librealsense's "modified" and "inverse"
    /// Brown-Conrady, which it projects alike whatever their names say. The colour camera of a D455 is told by it.
    #[serde(rename = "modified_radtan")]
    ModifiedRadtan {
        /// Radial, r^2.
        k1: f64,
        /// Radial, r^4.
        k2: f64,
        /// Tangential, along y.
        p1: f64,
        /// Tangential, along x.
        p2: f64,
        /// Radial, r^6.
        k3: f64,
    },
}

/// A camera: size and focal lengths in pixels; pixel centres at whole numbers, the first at (0, 0).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CameraModel {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, column.
    pub cx: f64,
    /// Principal point, row.
    pub cy: f64,
    /// Lens distortion.
    pub distortion: Distortion,
}

/// Why numbers are no camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A picture without pixels.
    #[error("camera size {width}x{height} has no pixels")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A focal length that is not a positive number, or another parameter that is not finite.
    #[error("camera parameter {name} = {value} is impossible")]
    Value {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// A distortion model that is not known.
    #[error(
        "distortion model `{model}` with {count} parameters is not supported: use plumb_bob, modified_brown_conrady, \
         inverse_brown_conrady (k1 k2 p1 p2 k3) or none"
    )]
    Distortion {
        /// Its name.
        model: String,
        /// Number of parameters.
        count: usize,
    },
}

const PLUMB_BOB: &str = "plumb_bob";
/// What our recorder calls librealsense's models whose tangential part is taken from the radially bent point.
const MODIFIED: [&str; 2] = ["modified_brown_conrady", "inverse_brown_conrady"];

impl CameraModel {
    /// Checks size, focal lengths and finiteness.
    ///
    /// # Errors
    /// The first impossible value.
    pub fn validated(self) -> Result<Self, CalibrationError> {
        if self.width == 0 || self.height == 0 {
            return Err(CalibrationError::Size { width: self.width, height: self.height });
        }
        let [k1, k2, p1, p2, k3] = self.distortion.parameters();
        let named = [("cx", self.cx), ("cy", self.cy), ("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)];
        let bad_focal = [("fx", self.fx), ("fy", self.fy)].into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0));
        match bad_focal.or_else(|| named.into_iter().find(|(_, v)| !v.is_finite())) {
            Some((name, value)) => Err(CalibrationError::Value { name, value }),
            None => Ok(self),
        }
    }

    /// Where a ray `(x / z, y / z)` of this camera falls in its recorded picture, pixels.
    #[must_use]
    pub fn distorted(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion.parameters();
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let [tx, ty] = match self.distortion {
            Distortion::ModifiedRadtan { .. } => [x * radial, y * radial],
            Distortion::None | Distortion::Radtan { .. } => [x, y],
        };
        let bent = [
            x * radial + 2.0 * p1 * tx * ty + p2 * (r2 + 2.0 * tx * tx),
            y * radial + p1 * (r2 + 2.0 * ty * ty) + 2.0 * p2 * tx * ty,
        ];
        [self.fx * bent[0] + self.cx, self.fy * bent[1] + self.cy]
    }

    /// The ROS message, with five parameters (all zero without distortion); a model that ROS has no name for keeps
    /// librealsense's.
    #[must_use]
    pub fn to_camera_info(&self, header: Header) -> CameraInfo {
        let Self { width, height, fx, fy, cx, cy, .. } = *self;
        CameraInfo {
            header,
            height,
            width,
            distortion_model: match self.distortion {
                Distortion::None | Distortion::Radtan { .. } => PLUMB_BOB.to_owned(),
                Distortion::ModifiedRadtan { .. } => MODIFIED[0].to_owned(),
            },
            d: self.distortion.parameters().to_vec(),
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            binning_x: 0,
            binning_y: 0,
            roi: RegionOfInterest::default(),
        }
    }

    /// The camera that a ROS message tells.
    ///
    /// # Errors
    /// An unknown distortion model, or impossible numbers.
    pub fn from_camera_info(info: &CameraInfo) -> Result<Self, CalibrationError> {
        let distortion = Distortion::from_ros(&info.distortion_model, &info.d)?;
        let [fx, _, cx, _, fy, cy, ..] = info.k;
        Self { width: info.width, height: info.height, fx, fy, cx, cy, distortion }.validated()
    }
}

impl Distortion {
    /// k1, k2, p1, p2, k3.
    #[must_use]
    pub fn parameters(&self) -> [f64; 5] {
        match *self {
            Self::None => [0.0; 5],
            Self::Radtan { k1, k2, p1, p2, k3 } | Self::ModifiedRadtan { k1, k2, p1, p2, k3 } => [k1, k2, p1, p2, k3],
        }
    }

    /// From k1, k2, p1, p2, k3; all zero is [`Distortion::None`].
    #[must_use]
    pub fn from_parameters(parameters: [f64; 5]) -> Self {
        let [k1, k2, p1, p2, k3] = parameters;
        if parameters == [0.0; 5] { Self::None } else { Self::Radtan { k1, k2, p1, p2, k3 } }
    }

    /// From a ROS distortion model's name and parameters (four or five; missing ones are zero).
    ///
    /// # Errors
    /// Another model, or more than five parameters.
    pub fn from_ros(model: &str, d: &[f64]) -> Result<Self, CalibrationError> {
        let unsupported = || CalibrationError::Distortion { model: model.to_owned(), count: d.len() };
        let modified = MODIFIED.contains(&model);
        let known = modified || matches!(model, "" | "none" | PLUMB_BOB | "radtan" | "radial-tangential");
        if d.iter().all(|v| *v == 0.0) && known {
            return Ok(Self::None);
        }
        if !known || matches!(model, "" | "none") || !matches!(d.len(), 4 | 5) {
            return Err(unsupported());
        }
        let [k1, k2, p1, p2, k3] = [d[0], d[1], d[2], d[3], d.get(4).copied().unwrap_or(0.0)];
        Ok(if modified { Self::ModifiedRadtan { k1, k2, p1, p2, k3 } } else { Self::Radtan { k1, k2, p1, p2, k3 } })
    }
}

/// Data sets whose calibration is published.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// TUM RGB-D, sequences `freiburg1_*`.
    Freiburg1,
    /// TUM RGB-D, sequences `freiburg2_*`.
    Freiburg2,
    /// TUM RGB-D, sequences `freiburg3_*` (pictures already rectified).
    Freiburg3,
    /// Bonn RGB-D Dynamic.
    Bonn,
}

impl Preset {
    /// All presets with their command line names.
    pub const ALL: [(&'static str, Self); 4] = [
        ("freiburg1", Self::Freiburg1),
        ("freiburg2", Self::Freiburg2),
        ("freiburg3", Self::Freiburg3),
        ("bonn", Self::Bonn),
    ];

    /// The preset with this name.
    #[must_use]
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|(known, _)| *known == name).map(|(_, preset)| preset)
    }

    /// The calibration. Sources: TUM RGB-D benchmark, "File Formats: Intrinsic Camera Calibration" (colour cameras);
    /// Bonn RGB-D Dynamic dataset page, "Camera parameters" (colour).
    #[must_use]
    pub fn camera(self) -> CameraModel {
        let (focal, center, d) = match self {
            Self::Freiburg1 => ([517.3, 516.5], [318.6, 255.3], [0.2624, -0.9531, -0.0054, 0.0026, 1.1633]),
            Self::Freiburg2 => ([520.9, 521.0], [325.1, 249.7], [0.2312, -0.7849, -0.0033, -0.0001, 0.9172]),
            Self::Freiburg3 => ([535.4, 539.2], [320.1, 247.6], [0.0; 5]),
            Self::Bonn => (
                [542.822_841, 542.576_870],
                [315.593_520, 237.756_098],
                [0.039_903, -0.099_343, -0.000_730, -0.000_144, 0.0],
            ),
        };
        let distortion = Distortion::from_parameters(d);
        CameraModel { width: 640, height: 480, fx: focal[0], fy: focal[1], cx: center[0], cy: center[1], distortion }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_survive_the_ros_form() {
        for (name, preset) in Preset::ALL {
            let camera = preset.camera();
            assert_eq!(CameraModel::from_camera_info(&camera.to_camera_info(Header::default())), Ok(camera), "{name}");
            assert_eq!(Preset::by_name(name), Some(preset));
        }
    }

    #[test]
    fn lenses_of_a_realsense_are_read_as_it_means_them() {
        use crate::alignment::{Intrinsics, LensModel};
        let (k, d) = ([380.5, 0.0, 318.25, 0.0, 379.75, 243.5], [-0.055, 0.065, 0.000_6, -0.000_4, -0.021]);
        for (name, model) in [
            ("plumb_bob", LensModel::BrownConrady),
            ("modified_brown_conrady", LensModel::ModifiedBrownConrady),
            ("inverse_brown_conrady", LensModel::InverseBrownConrady),
        ] {
            let mut info = Preset::Freiburg3.camera().to_camera_info(Header::default());
            info.k[..6].copy_from_slice(&k);
            (info.distortion_model, info.d) = (name.to_owned(), d.to_vec());
            let camera = CameraModel::from_camera_info(&info).unwrap();
            let [fx, _, cx, _, fy, cy] = k.map(|value: f64| value as f32);
            let coefficients = d.map(|value: f64| value as f32);
            let told = Intrinsics { width: 640, height: 480, fx, fy, cx, cy, model, coefficients };
            for [x, y] in [[0.0, 0.0], [0.75, -0.5], [-0.8, 0.6]] {
                let (ours, theirs) = (camera.distorted([x, y]), told.project([x as f32, y as f32, 1.0]));
                let apart = [0, 1].map(|axis| (ours[axis] - f64::from(theirs[axis])).abs());
                assert!(apart.iter().all(|pixels| *pixels < 1e-4), "{name}: {ours:?} and {theirs:?}");
            }
            assert_eq!(CameraModel::from_camera_info(&camera.to_camera_info(Header::default())), Ok(camera), "{name}");
        }
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let good = Preset::Freiburg3.camera();
        for bad in [
            CameraModel { width: 0, ..good },
            CameraModel { fx: 0.0, ..good },
            CameraModel { fy: f64::NAN, ..good },
            CameraModel { cx: f64::INFINITY, ..good },
        ] {
            assert!(bad.validated().is_err(), "{bad:?}");
        }
        assert!(Distortion::from_ros("equidistant", &[0.1; 4]).is_err());
        assert!(Distortion::from_ros("plumb_bob", &[0.1; 8]).is_err());
        assert!(Distortion::from_ros("rational_polynomial", &[0.0; 8]).is_err());
        assert_eq!(Distortion::from_ros("", &[]), Ok(Distortion::None));
    }
}
