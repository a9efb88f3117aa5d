//! `pslam import`.

use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use recorder::import::{
    BagOptions, CameraSource, EurocOptions, KittiOptions, PanopticSource, TruthOf, TumOptions, euroc, kitti, png,
    realsense, rosbag2, tum,
};
use recorder::realsense::Library;
use schemas::calibration::{CameraModel, Distortion, Preset};
use schemas::topics;
use std::path::{Path, PathBuf};

/// Kinds of folders.
#[derive(Debug, clap::Subcommand)]
pub enum Source {
    /// TUM RGB-D, Bonn RGB-D Dynamic, OpenLORIS: rgb.txt, depth.txt, groundtruth.txt.
    Tum(Box<Tum>),
    /// EuRoC MAV (ASL format): mav0/cam0, cam1, imu0 and ground truth.
    Euroc(Euroc),
    /// KITTI odometry: calib.txt, times.txt, image_0, image_1 and poses.
    Kitti(Kitti),
    /// A ROS 2 bag with MCAP storage: a folder with metadata.yaml, or its file.
    Rosbag2(Rosbag2),
    /// Numbered pictures and CSV tables, as `pslam export png` writes them.
    Png(Png),
    /// A recording of librealsense: .bag, or .db3 with librealsense 2.58 and newer.
    Realsense(Realsense),
}

impl Source {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        match self {
            Self::Tum(command) => command.run(progress),
            Self::Euroc(command) => command.run(progress),
            Self::Kitti(command) => command.run(progress),
            Self::Rosbag2(command) => command.run(progress),
            Self::Png(command) => command.run(progress),
            Self::Realsense(command) => command.run(),
        }
    }
}

/// What importers of one or two cameras share.
#[derive(Debug, clap::Args)]
struct Sequence {
    /// The folder.
    dir: PathBuf,
    /// The log to write.
    #[arg(short, long)]
    out: PathBuf,
    /// Leave the right camera out.
    #[arg(long)]
    mono: bool,
    /// Folder of COCO panoptic PNG files of the left pictures, several times with a name for the layer of each; its JSON is
    /// DIR.json, DIR/panoptic.json or DIR/../panoptic.json.
    #[arg(long, value_name = "[LAYER=]DIR")]
    panoptic: Vec<String>,
    /// The JSON file of --panoptic, if it stands elsewhere.
    #[arg(long, value_name = "FILE", requires = "panoptic")]
    panoptic_json: Option<PathBuf>,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Sequence {
    fn panoptic(&self) -> Vec<PanopticSource> {
        panoptic(&self.panoptic, self.panoptic_json.as_ref())
    }
}

/// `DIR` is the layer that a replay reads, `LAYER=DIR` one with that name.
fn panoptic(dirs: &[String], json: Option<&PathBuf>) -> Vec<PanopticSource> {
    let source = |text: &String| {
        let named = text.split_once('=').filter(|(layer, _)| topics::is_layer_name(layer));
        let (layer, dir) = named.unwrap_or((topics::DEFAULT_LAYER, text));
        PanopticSource { json: json.cloned(), layer: layer.to_owned(), ..PanopticSource::new(Path::new(dir)) }
    };
    dirs.iter().map(source).collect()
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Euroc {
    #[command(flatten)]
    sequence: Sequence,
    /// Ground truth of the body as data.csv; default, without one of the camera: mav0/state_groundtruth_estimate0/data.csv.
    #[arg(long, value_name = "FILE", conflicts_with = "camera_truth")]
    body_truth: Option<PathBuf>,
    /// Ground truth of the left camera in the same layout; default: groundtruth_leftcam.csv.
    #[arg(long, value_name = "FILE")]
    camera_truth: Option<PathBuf>,
}

impl Euroc {
    fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let of_body = self.body_truth.map(|path| (path, TruthOf::Body));
        let of_camera = self.camera_truth.map(|path| (path, TruthOf::LeftCamera));
        let Sequence { dir, out, mono, force, json, .. } = &self.sequence;
        let panoptic = self.sequence.panoptic();
        let options = EurocOptions { stereo: !mono, truth: of_body.or(of_camera), panoptic, force: *force };
        let bar = progress.bar("importing");
        let report = euroc(dir, out, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(*json, "import-sequence/1", &report)?;
        Ok(Outcome::Good)
    }
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Kitti {
    #[command(flatten)]
    sequence: Sequence,
    /// Take the colour cameras, image_2 and image_3.
    #[arg(long)]
    color: bool,
    /// Ground truth; default: poses.txt in the folder, else ../../poses/NAME.txt.
    #[arg(long, value_name = "FILE")]
    poses: Option<PathBuf>,
}

impl Kitti {
    fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let Sequence { dir, out, mono, force, json, .. } = &self.sequence;
        let panoptic = self.sequence.panoptic();
        let options = KittiOptions { stereo: !mono, color: self.color, poses: self.poses, panoptic, force: *force };
        let bar = progress.bar("importing");
        let report = kitti(dir, out, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(*json, "import-sequence/1", &report)?;
        Ok(Outcome::Good)
    }
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Tum {
    /// The folder.
    dir: PathBuf,
    /// The log to write.
    #[arg(short, long)]
    out: PathBuf,
    /// Folder of COCO panoptic PNG files, several times with a name for the layer of each; its JSON is DIR.json,
    /// DIR/panoptic.json or DIR/../panoptic.json.
    #[arg(long, value_name = "[LAYER=]DIR")]
    panoptic: Vec<String>,
    /// The JSON file of --panoptic, if it stands elsewhere.
    #[arg(long, value_name = "FILE", requires = "panoptic")]
    panoptic_json: Option<PathBuf>,
    /// Depth value of one metre; default: the calibration file's, else 5000.
    #[arg(long, value_name = "N")]
    depth_scale: Option<String>,
    /// Colour and depth nearer than this are one frame, milliseconds.
    #[arg(long, value_name = "MS", default_value = "20")]
    max_difference_ms: f64,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    camera: Camera,
}

/// Intrinsics; without any, camera.json or camera.yaml in the folder, else what the folder's name tells.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Intrinsics (default: camera.json or camera.yaml in DIR, else DIR's name)")]
struct Camera {
    /// JSON or YAML file: flat keys, ORB-SLAM style or a ROS camera calibration.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["preset", "fx"])]
    camera: Option<PathBuf>,
    /// freiburg1, freiburg2, freiburg3 or bonn.
    #[arg(long, value_name = "NAME", conflicts_with = "fx")]
    preset: Option<String>,
    /// Focal length, pixels.
    #[arg(long, requires_all = ["fy", "cx", "cy"])]
    fx: Option<f64>,
    /// Focal length, pixels.
    #[arg(long, requires = "fx")]
    fy: Option<f64>,
    /// Principal point, pixels.
    #[arg(long, requires = "fx", allow_negative_numbers = true)]
    cx: Option<f64>,
    /// Principal point, pixels.
    #[arg(long, requires = "fx", allow_negative_numbers = true)]
    cy: Option<f64>,
    /// Picture width, pixels.
    #[arg(long, requires = "fx", default_value = "640")]
    width: u32,
    /// Picture height, pixels.
    #[arg(long, requires = "fx", default_value = "480")]
    height: u32,
    /// Distortion k1,k2,p1,p2,k3 (radtan); default: none.
    #[arg(long, requires = "fx", value_delimiter = ',', num_args = 5, allow_hyphen_values = true)]
    distortion: Vec<f64>,
}

impl Camera {
    fn source(&self) -> anyhow::Result<CameraSource> {
        if let Some(path) = &self.camera {
            return Ok(CameraSource::File(path.clone()));
        }
        if let Some(name) = &self.preset {
            let known = Preset::ALL.map(|(name, _)| name).join(", ");
            let preset = Preset::by_name(name);
            let preset = preset.ok_or_else(|| Usage(format!("there is no camera preset `{name}`; choose {known}")))?;
            return Ok(CameraSource::Preset(preset));
        }
        let (Some(fx), Some(fy), Some(cx), Some(cy)) = (self.fx, self.fy, self.cx, self.cy) else {
            return Ok(CameraSource::Auto);
        };
        let mut parameters = [0.0; 5];
        parameters.iter_mut().zip(&self.distortion).for_each(|(parameter, given)| *parameter = *given);
        let distortion = Distortion::from_parameters(parameters);
        let camera = CameraModel { width: self.width, height: self.height, fx, fy, cx, cy, distortion };
        Ok(CameraSource::Model(camera.validated().map_err(|error| Usage(error.to_string()))?))
    }
}

impl Tum {
    fn options(&self) -> anyhow::Result<TumOptions> {
        let tolerance_ns = self.max_difference_ms * 1e6;
        if !(0.0..=1e12).contains(&tolerance_ns) {
            return Err(
                Usage(format!("--max-difference-ms {} is not between 0 and 1e6", self.max_difference_ms)).into()
            );
        }
        Ok(TumOptions {
            camera: self.camera.source()?,
            depth_units_per_metre: self.depth_scale.clone(),
            tolerance_ns: tolerance_ns.round() as u64,
            panoptic: panoptic(&self.panoptic, self.panoptic_json.as_ref()),
            force: self.force,
        })
    }

    fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let options = self.options()?;
        let bar = progress.bar("importing");
        let report = tum(&self.dir, &self.out, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(self.json, "import-tum/1", &report)?;
        Ok(Outcome::Good)
    }
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Rosbag2 {
    /// The folder, or its MCAP file.
    dir: PathBuf,
    /// The log to write.
    #[arg(short, long)]
    out: PathBuf,
    /// Topic of the colour pictures; default: the only one.
    #[arg(long, value_name = "TOPIC")]
    color: Option<String>,
    /// Topic of the depth images, registered to colour; default: the only one with depth in its name.
    #[arg(long, value_name = "TOPIC")]
    depth: Option<String>,
    /// Topic of the colour camera's calibration; default: camera_info beside the pictures.
    #[arg(long, value_name = "TOPIC")]
    info: Option<String>,
    /// Topic of the camera's true poses (PoseStamped, world_from_camera); default: none.
    #[arg(long, value_name = "TOPIC")]
    pose: Option<String>,
    /// Topic of inertial rows; default: the only one.
    #[arg(long, value_name = "TOPIC")]
    imu: Option<String>,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Rosbag2 {
    fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let Self { dir, out, color, depth, info, pose, imu, force, json } = self;
        let options = BagOptions { color, depth, info, pose, imu, force };
        let bar = progress.bar("importing");
        let report = rosbag2(&dir, &out, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(json, "import-topics/1", &report)?;
        Ok(Outcome::Good)
    }
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Png {
    /// The folder.
    dir: PathBuf,
    /// The log to write.
    #[arg(short, long)]
    out: PathBuf,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Png {
    fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let bar = progress.bar("importing");
        let report = png(&self.dir, &self.out, self.force, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(self.json, "import-topics/1", &report)?;
        Ok(Outcome::Good)
    }
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Realsense {
    /// The recording.
    file: PathBuf,
    /// The log to write.
    #[arg(short, long)]
    out: PathBuf,
    /// librealsense2.so, or the library in the Python wheel pyrealsense2.
    #[arg(long, value_name = "PATH")]
    librealsense: Option<PathBuf>,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Realsense {
    fn run(self) -> anyhow::Result<Outcome> {
        let library = Library::load(self.librealsense.as_deref())?;
        let program = concat!("pslam ", env!("CARGO_PKG_VERSION"));
        let report = realsense(&library, &self.file, &self.out, self.force, program)?;
        stdout::either(self.json, "import-realsense/1", &report)?;
        Ok(Outcome::Good)
    }
}
