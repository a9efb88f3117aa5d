//! The layout of the TUM RGB-D benchmark, which Bonn RGB-D Dynamic shares.
//!
//! Stamps have nine decimals instead of the benchmark's six, so that every nanosecond is kept; all its tools read them.

use schemas::{Stamp, pairing};

use super::coco::LayerFiles;
use super::lists::{Rows, numbers};
use super::source::Source;
use super::{ExportError, Item, Kind, Layout, picture, yaml};
use crate::OutputFolder;

pub(super) struct Tum {
    color: Rows,
    depth: Rows,
    poses: Rows,
    layers: LayerFiles,
}

impl Tum {
    pub fn new(source: &Source<'_>) -> Result<Self, ExportError> {
        if source.depths.is_empty() {
            let what =
                "the log has no depth, and this layout is for colour and depth: export it as euroc, png or rosbag2";
            return Err(ExportError::Refused(what.to_owned()));
        }
        let (color, depth, poses) = (Rows::default(), Rows::default(), Rows::default());
        Ok(Self { color, depth, poses, layers: LayerFiles::new(source, "rgb") })
    }
}

impl Layout for Tum {
    fn holds(&self, kind: Kind) -> bool {
        matches!(kind, Kind::Color | Kind::Depth | Kind::Mask | Kind::Pose)
    }

    fn take(&mut self, item: Item<'_>, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        match item {
            Item::Color(stamp, image) => {
                let (extension, bytes) = picture::file(stamp, image, &source.camera)?;
                let name = format!("rgb/{}.{extension}", stamp.to_decimal9());
                folder.write(&name, &bytes)?;
                self.layers.picture(stamp, &name);
                self.color.add(stamp, name);
            }
            Item::Depth(stamp, units) => {
                let name = format!("depth/{}.png", stamp.to_decimal9());
                folder.write(&name, &picture::gray16(stamp, source.camera.width, &units)?)?;
                self.depth.add(stamp, name);
            }
            Item::Pose(stamp, values) => {
                self.poses.add(stamp, format!("{} {}", stamp.to_decimal9(), numbers(&values, ' ')));
            }
            Item::Mask(layer, stamp, mask) => self.layers.mask(layer, stamp, &mask, folder, source)?,
            Item::Right(..) | Item::Imu(..) => {}
        }
        Ok(())
    }

    fn finish(&mut self, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        let name = source.name();
        let list = |rows: &Rows| -> String {
            rows.0.iter().map(|(stamp, file)| format!("{} {file}\n", stamp.to_decimal9())).collect()
        };
        let head = |what: &str| format!("# {what}\n# file: '{name}'\n# timestamp filename\n");
        folder.write("rgb.txt", (head("color images") + &list(&self.color)).as_bytes())?;
        folder.write("depth.txt", (head("depth maps") + &list(&self.depth)).as_bytes())?;
        folder.write("associations.txt", self.associations(source.tolerance_ns).as_bytes())?;
        if !self.poses.0.is_empty() {
            let head = format!("# ground truth trajectory\n# file: '{name}'\n# timestamp tx ty tz qx qy qz qw\n");
            folder.write("groundtruth.txt", self.poses.text(&head).as_bytes())?;
        }
        folder.write("camera.yaml", yaml::ros_camera(&source.camera, Some(source.units_per_metre)).as_bytes())?;
        self.layers.finish(folder, source)
    }

    fn notes(&self, source: &Source<'_>) -> Vec<String> {
        let mut notes = Vec::new();
        if source.units_per_metre != 5000.0 {
            let units = source.units_per_metre;
            notes.push(format!(
                "depth values are {units} per metre as in the log; the benchmarks' own tools take 5000: --depth-scale 5000"
            ));
        }
        notes
    }
}

impl Tum {
    /// Pairs as a replay makes them.
    fn associations(&self, tolerance_ns: u64) -> String {
        let stamps = |rows: &Rows| rows.0.keys().copied().collect::<Vec<Stamp>>();
        let (color, depth) = (stamps(&self.color), stamps(&self.depth));
        let pairs = pairing::associate(&color, &depth, tolerance_ns);
        let line = |(c, d): &(usize, usize)| {
            let (c, d) = (color[*c], depth[*d]);
            format!("{} {} {} {}\n", c.to_decimal9(), self.color.0[&c], d.to_decimal9(), self.depth.0[&d])
        };
        pairs.iter().map(line).collect()
    }
}
