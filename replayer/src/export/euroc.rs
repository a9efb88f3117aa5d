//! The layout of the EuRoC MAV data set (ASL format).
//!
//! An imported log carries the folder's own `sensor.yaml` files, which are written back as they are. Any other log gets
//! files of its calibration with the left camera as the body.

use std::collections::BTreeMap;

use schemas::Stamp;
use schemas::msg::Header;
use schemas::stereo::StereoModel;
use slam_math::Se3;

use super::coco::LayerFiles;
use super::lists::{Rows, numbers};
use super::source::Source;
use super::{ExportError, Item, Kind, Layout, picture, yaml};
use crate::OutputFolder;
use crate::log::EncodedImage;

/// A calibration file is a page of text.
const MAX_YAML_BYTES: usize = 1 << 20;
const TRUTH_HEAD: &str =
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n";
const IMU_HEAD: &str = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],\
                        a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";

pub(super) struct Euroc {
    left: Rows,
    right: Rows,
    imu: Rows,
    poses: BTreeMap<Stamp, [f64; 7]>,
    layers: LayerFiles,
    /// The original folder's `sensor.yaml` files by sensor.
    yamls: BTreeMap<String, String>,
}

impl Euroc {
    pub fn new(source: &Source<'_>) -> Self {
        Self {
            left: Rows::default(),
            right: Rows::default(),
            imu: Rows::default(),
            poses: BTreeMap::new(),
            layers: LayerFiles::new(source, "mav0/cam0/data"),
            yamls: BTreeMap::new(),
        }
    }
}

impl Layout for Euroc {
    fn holds(&self, kind: Kind) -> bool {
        kind != Kind::Depth
    }

    fn attachment(&mut self, name: &str, data: &[u8]) -> bool {
        let sensor = name.strip_prefix("calibration/").and_then(|name| name.strip_suffix("/sensor.yaml"));
        let text = std::str::from_utf8(data).ok().filter(|text| text.len() <= MAX_YAML_BYTES);
        match (sensor, text) {
            (Some(sensor @ ("cam0" | "cam1" | "imu0")), Some(text)) => {
                self.yamls.insert(sensor.to_owned(), text.to_owned());
                true
            }
            _ => false,
        }
    }

    fn take(&mut self, item: Item<'_>, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        let camera = |name: &str, stamp: Stamp, image: EncodedImage, rows: &mut Rows| -> Result<String, ExportError> {
            let (extension, bytes) = picture::file(stamp, image, &source.camera)?;
            let file = format!("{}.{extension}", stamp.0);
            let path = format!("mav0/{name}/data/{file}");
            folder.write(&path, &bytes)?;
            rows.add(stamp, format!("{},{file}", stamp.0));
            Ok(path)
        };
        match item {
            Item::Color(stamp, image) => {
                let path = camera("cam0", stamp, image, &mut self.left)?;
                self.layers.picture(stamp, &path);
            }
            Item::Right(stamp, image) => drop(camera("cam1", stamp, image, &mut self.right)?),
            Item::Imu(stamp, values) => self.imu.add(stamp, format!("{},{}", stamp.0, numbers(&values, ','))),
            Item::Pose(stamp, values) => drop(self.poses.insert(stamp, values)),
            Item::Mask(layer, stamp, mask) => self.layers.mask(layer, stamp, &mask, folder, source)?,
            Item::Depth(..) => {}
        }
        Ok(())
    }

    fn finish(&mut self, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        let body_from_left = self.calibration(folder, source)?;
        for (name, rows) in [("cam0", &self.left), ("cam1", &self.right)] {
            if !rows.0.is_empty() {
                folder.write(&format!("mav0/{name}/data.csv"), rows.text("#timestamp [ns],filename\n").as_bytes())?;
            }
        }
        if !self.imu.0.is_empty() {
            folder.write("mav0/imu0/data.csv", self.imu.text(IMU_HEAD).as_bytes())?;
        }
        if !self.poses.is_empty() {
            let left_from_body = body_from_left.inverse();
            let of_body = |values: &[f64; 7]| {
                let [x, y, z, qx, qy, qz, qw] = *values;
                let body = Se3::from_quaternion([x, y, z], [qx, qy, qz, qw]) * left_from_body;
                let (t, q) = (body.translation, body.quaternion_xyzw());
                [t.x, t.y, t.z, q[0], q[1], q[2], q[3]]
            };
            let body = if body_from_left == Se3::identity() { self.truth(|v| *v) } else { self.truth(of_body) };
            folder.write("mav0/state_groundtruth_estimate0/data.csv", body.as_bytes())?;
            // The log's own digits, which the way through the body's frame would round.
            folder.write("groundtruth_leftcam.csv", self.truth(|v| *v).as_bytes())?;
        }
        self.layers.finish(folder, source)
    }

    fn notes(&self, source: &Source<'_>) -> Vec<String> {
        let mut notes = Vec::new();
        if source.stereo.is_none() {
            notes.push("one camera: the format holds no depth, so only the pictures are here".to_owned());
        }
        if !self.poses.is_empty() {
            notes.push(
                "poses of the body in state_groundtruth_estimate0, those of the left camera in groundtruth_leftcam.csv \
                 with the log's own digits; velocities and biases are not in a log"
                    .to_owned(),
            );
        }
        notes
    }
}

impl Euroc {
    fn truth(&self, of: impl Fn(&[f64; 7]) -> [f64; 7]) -> String {
        let row = |(stamp, values): (&Stamp, &[f64; 7])| {
            let [x, y, z, qx, qy, qz, qw] = of(values);
            format!("{},{}\n", stamp.0, numbers(&[x, y, z, qw, qx, qy, qz], ','))
        };
        TRUTH_HEAD.to_owned() + &self.poses.iter().map(row).collect::<String>()
    }

    /// Writes `sensor.yaml` of every sensor; gives the left camera in the body's frame.
    fn calibration(&self, folder: &OutputFolder, source: &Source<'_>) -> Result<Se3, ExportError> {
        let own = self.yamls.get("cam0").and_then(|text| body_from_sensor(text));
        let complete = source.stereo.is_none() || self.yamls.contains_key("cam1");
        if let Some(body_from_left) = own.filter(|_| complete) {
            for (sensor, text) in &self.yamls {
                folder.write(&format!("mav0/{sensor}/sensor.yaml"), text.as_bytes())?;
            }
            return Ok(body_from_left);
        }
        let infos = source.stereo.map(|stereo| stereo.to_camera_infos(Header::default(), Header::default()));
        let left = infos.as_ref().map(|[left, _]| left);
        let text = yaml::euroc_camera("cam0", &source.camera, &Se3::identity(), left);
        folder.write("mav0/cam0/sensor.yaml", text.as_bytes())?;
        if let (Some(stereo), Some([_, right])) = (source.stereo, &infos) {
            let text = yaml::euroc_camera("cam1", &stereo.right, &left_from_right(&stereo), Some(right));
            folder.write("mav0/cam1/sensor.yaml", text.as_bytes())?;
        }
        Ok(Se3::identity())
    }
}

/// From the rectification: both cameras turn into one frame, in which the right one stands a baseline along x.
fn left_from_right(stereo: &StereoModel) -> Se3 {
    let rotation = |m: &[f64; 9]| Se3 { rotation: nalgebra::Matrix3::from_row_slice(m), ..Se3::identity() };
    let baseline = nalgebra::Vector3::new(stereo.baseline_m(), 0.0, 0.0);
    let apart = Se3 { translation: baseline, ..Se3::identity() };
    rotation(&stereo.rectified_from_left).inverse() * apart * rotation(&stereo.rectified_from_right)
}

/// `T_BS` of a `sensor.yaml`.
fn body_from_sensor(text: &str) -> Option<Se3> {
    let (_, after) = text.split_once("T_BS")?;
    let (list, _) = after.split_once('[')?.1.split_once(']')?;
    let values: Vec<f64> = list.split(',').map(|v| v.trim().parse().ok()).collect::<Option<_>>()?;
    let t: [f64; 16] = values.try_into().ok()?;
    let rotation = nalgebra::Matrix3::from_fn(|r, c| t[4 * r + c]);
    Some(Se3 { rotation, translation: nalgebra::Vector3::new(t[3], t[7], t[11]) }.normalized())
}
