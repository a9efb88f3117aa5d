//! Numbered pictures and CSV tables, for programs that know no data set's layout.

use std::fmt::Write as _;

use schemas::msg::{Header, Segment};
use schemas::{Stamp, pairing};

use super::lists::{Rows, numbers};
use super::source::Source;
use super::{ExportError, Item, Kind, Layout, category_color, depth_color, picture, yaml};
use crate::OutputFolder;
use crate::log::MaskPixels;
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct Plain {
    color: Rows,
    right: Rows,
    depth: Rows,
    poses: Rows,
    imu: Rows,
    /// By layer: its masks, and their segments.
    masks: BTreeMap<String, (Rows, Rows)>,
}

impl Plain {
    pub fn new() -> Self {
        Self::default()
    }
}

impl Layout for Plain {
    fn holds(&self, _: Kind) -> bool {
        true
    }

    fn take(&mut self, item: Item<'_>, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        match item {
            Item::Color(stamp, image) => {
                let (extension, bytes) = picture::file(stamp, image, &source.camera)?;
                let name = format!("color/{}.{extension}", number(&source.frames, stamp));
                folder.write(&name, &bytes)?;
                self.color.add(stamp, format!("{},{name}", stamp.0));
            }
            Item::Right(stamp, image) => {
                let (extension, bytes) = picture::file(stamp, image, &source.camera)?;
                let name = format!("right/{}.{extension}", number(&source.rights, stamp));
                folder.write(&name, &bytes)?;
                self.right.add(stamp, format!("{},{name}", stamp.0));
            }
            Item::Depth(stamp, units) => {
                let (width, number) = (source.camera.width, number(&source.depths, stamp));
                let name = format!("depth/{number}.png");
                folder.write(&name, &picture::gray16(stamp, width, &units)?)?;
                let shown: Vec<u8> =
                    units.iter().flat_map(|u| depth_color(f64::from(*u) / source.units_per_metre)).collect();
                let shown = picture::rgb8(stamp, width, source.camera.height, &shown)?;
                folder.write(&format!("depth_color/{number}.png"), &shown)?;
                self.depth.add(stamp, format!("{},{name}", stamp.0));
            }
            Item::Pose(stamp, values) => self.poses.add(stamp, format!("{},{}", stamp.0, numbers(&values, ','))),
            Item::Imu(stamp, values) => self.imu.add(stamp, format!("{},{}", stamp.0, numbers(&values, ','))),
            Item::Mask(layer, stamp, mask) => self.mask(layer, stamp, &mask, folder, source)?,
        }
        Ok(())
    }

    fn finish(&mut self, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        let tables = [
            ("color.csv", "stamp_ns,file\n", &self.color),
            ("right.csv", "stamp_ns,file\n", &self.right),
            ("depth.csv", "stamp_ns,file\n", &self.depth),
            ("ground_truth.csv", "stamp_ns,tx,ty,tz,qx,qy,qz,qw\n", &self.poses),
            ("imu.csv", "stamp_ns,wx,wy,wz,ax,ay,az\n", &self.imu),
        ];
        for (name, head, rows) in tables.into_iter().filter(|(.., rows)| !rows.0.is_empty()) {
            folder.write(name, rows.text(head).as_bytes())?;
        }
        folder.write("frames.csv", self.frames(source.tolerance_ns).as_bytes())?;
        for (layer, (masks, segments)) in &self.masks {
            let file = |name: &str| format!("masks/{layer}/{name}.csv");
            folder.write(&file("masks"), masks.text("stamp_ns,class,instance\n").as_bytes())?;
            let head = "stamp_ns,id,category_id,score,x,y,width,height,area,is_crowd\n";
            let lines = segments.0.values().map(String::as_str);
            let segments: String = std::iter::once(head).chain(lines).collect();
            folder.write(&file("segments"), segments.as_bytes())?;
            folder.write(&file("categories"), categories(source, layer).as_bytes())?;
        }
        let units = (!source.depths.is_empty()).then_some(source.units_per_metre);
        match source.stereo.map(|stereo| stereo.to_camera_infos(Header::default(), Header::default())) {
            None => folder.write("camera.yaml", yaml::ros_camera(&source.camera, units).as_bytes())?,
            Some([left, right]) => {
                folder.write("camera.yaml", yaml::ros_camera_info(&left, units).as_bytes())?;
                folder.write("camera_right.yaml", yaml::ros_camera_info(&right, None).as_bytes())?;
            }
        }
        Ok(())
    }
}

impl Plain {
    fn mask(
        &mut self,
        layer: &str,
        stamp: Stamp,
        mask: &MaskPixels,
        folder: &OutputFolder,
        source: &Source<'_>,
    ) -> Result<(), ExportError> {
        let (width, number) = (source.camera.width, number(&source.frames, stamp));
        let file = |kind: &str| format!("masks/{layer}/{kind}/{number}.png");
        folder.write(&file("class"), &picture::gray16(stamp, width, &mask.class)?)?;
        folder.write(&file("instance"), &picture::gray16(stamp, width, &mask.instance)?)?;
        let shown: Vec<u8> = mask.class.iter().flat_map(|id| category_color(*id)).collect();
        folder.write(&file("color"), &picture::rgb8(stamp, width, source.camera.height, &shown)?)?;
        let (masks, segments) = self.masks.entry(layer.to_owned()).or_default();
        masks.add(stamp, format!("{},{},{}", stamp.0, file("class"), file("instance")));
        let mut lines = String::new();
        for Segment { id, category_id, score, x, y, width, height, area, is_crowd } in &mask.segments {
            let is_crowd = u8::from(*is_crowd);
            // Writing to a String cannot fail.
            let _ =
                writeln!(lines, "{},{id},{category_id},{score},{x},{y},{width},{height},{area},{is_crowd}", stamp.0);
        }
        segments.add(stamp, lines);
        Ok(())
    }

    /// Pictures with what belongs to them, as a replay pairs them.
    fn frames(&self, tolerance_ns: u64) -> String {
        let stamps = |rows: &Rows| rows.0.keys().copied().collect::<Vec<Stamp>>();
        let color = stamps(&self.color);
        let partners = |rows: &Rows| -> BTreeMap<usize, String> {
            let others = stamps(rows);
            let pairs = pairing::associate(&color, &others, tolerance_ns);
            pairs.into_iter().map(|(c, o)| (c, rows.0[&others[o]].clone())).collect()
        };
        let (depth, right) = (partners(&self.depth), partners(&self.right));
        let none = ",".to_owned();
        let mut text = "index,stamp_ns,color,depth_stamp_ns,depth,right_stamp_ns,right\n".to_owned();
        for (index, row) in self.color.0.values().enumerate() {
            let [depth, right] = [&depth, &right].map(|of| of.get(&index).unwrap_or(&none));
            let _ = writeln!(text, "{index},{row},{depth},{right}");
        }
        text
    }
}

/// Place in the order of time, six digits.
fn number(stamps: &[Stamp], stamp: Stamp) -> String {
    format!("{:06}", stamps.binary_search(&stamp).unwrap_or_else(|at| at))
}

/// Names may hold anything but line ends, so they stand last.
fn categories(source: &Source<'_>, layer: &str) -> String {
    let row = |c: &schemas::msg::Category| {
        let [r, g, b] = category_color(c.id);
        format!("{},{},{r},{g},{b},{}\n", c.id, u8::from(c.is_thing), c.name.replace(['\n', '\r'], " "))
    };
    let rows: String = source.log.categories(layer).iter().map(row).collect();
    format!("id,is_thing,red,green,blue,name\n{rows}")
}
