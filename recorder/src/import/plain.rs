//! Numbered pictures and CSV tables, as `pslam export png` writes them and as anyone can.
//!
//! `color.csv` (`stamp_ns,file`) and `camera.yaml` must be there. Everything else may: `depth.csv` (with `depth_scale` in
//! `camera.yaml`), `right.csv` with `camera_right.yaml`, `ground_truth.csv`, `imu.csv`, and `masks/LAYER/` with its tables.

use super::bag::TopicReport;
use super::camera_file::{self, yaml_table};
use super::lists::{ListedFile, PoseRow, in_order, line_error};
use super::sequence::{ImuRow, read_picture};
use super::{ImportError, Repairs, read_file, read_text};
use crate::log_writer::LogOptions;
use crate::picture::decode_gray16;
use crate::{Beside, LayerSpec, Mask, RgbdLog, RgbdSpec};
use schemas::calibration::CameraModel;
use schemas::msg::{CameraInfo, Category, Header, Segment};
use schemas::stereo::StereoModel;
use schemas::{Stamp, metadata, topics};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Imports a folder into a log at `out`. `progress` hears (messages done, messages in all).
///
/// # Errors
/// A missing, damaged or contradicting file, named with its line or numbers; or the log cannot be written. The unfinished
/// log is then removed.
pub fn png(
    dir: &Path,
    out: &Path,
    force: bool,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<TopicReport, ImportError> {
    let mut repairs = Repairs::default();
    let folder = Folder::read(dir, &mut repairs)?;
    let events = folder.events();
    let Some(span) = events.first().zip(events.last()).map(|(first, last)| (first.0, last.0)) else {
        return Err(ImportError::content(dir, "its tables are empty: nothing to import"));
    };
    let mut log = RgbdLog::create(out, &LogOptions { force, ..LogOptions::default() }, &folder.spec)?;
    let written = folder.write(&mut log, &events, &mut repairs, progress).and_then(|()| {
        let values = repairs.0.iter().map(|(what, count)| (what.clone(), count.to_string()));
        Ok(log.log().metadata(metadata::IMPORT, values.collect())?)
    });
    if let Err(error) = written {
        log.discard();
        return Err(error);
    }
    let taken = folder.counts();
    let (source, log_path, log_bytes) = (dir.to_owned(), out.to_owned(), log.finish()?);
    Ok(TopicReport { source, log: log_path, log_bytes, same_bytes: false, taken, span: Some(span), repairs: repairs.0 })
}

/// What the tables tell; pictures are still on the disk.
struct Folder {
    dir: PathBuf,
    spec: RgbdSpec,
    color: Vec<ListedFile>,
    right: Vec<ListedFile>,
    depth: Vec<ListedFile>,
    poses: Vec<PoseRow>,
    imu: Vec<ImuRow>,
    layers: Vec<Layer>,
}

/// One layer's masks.
struct Layer {
    /// Stamp, class image, instance image.
    masks: Vec<(Stamp, [String; 2])>,
    segments: BTreeMap<Stamp, Vec<Segment>>,
}

/// One thing to write. Declared in the order in which equal stamps are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    Pose(usize),
    Imu(usize),
    Color(usize),
    Right(usize),
    Depth(usize),
    Mask { layer: usize, entry: usize },
}

impl Folder {
    fn read(dir: &Path, repairs: &mut Repairs) -> Result<Self, ImportError> {
        let color = listed(dir, "color.csv", repairs)?;
        let Some(first) = color.first() else {
            return Err(ImportError::content(&dir.join("color.csv"), "lists no pictures (stamp_ns,file)"));
        };
        let size = super::sequence::picture_size(Path::new(&first.path))?;
        let (right, depth) = (listed(dir, "right.csv", repairs)?, listed(dir, "depth.csv", repairs)?);
        let yaml = dir.join("camera.yaml");
        let file = camera_file::read(&yaml, size)?;
        let beside = match (right.is_empty(), depth.is_empty()) {
            (false, _) => Beside::Right(stereo(dir, size)?),
            (true, false) => Beside::Depth,
            (true, true) => Beside::Nothing,
        };
        let units = match file.depth_units_per_metre {
            None if beside == Beside::Depth => {
                return Err(ImportError::content(&yaml, "no depth_scale (depth value of one metre)"));
            }
            units => units.unwrap_or_else(|| "1000".to_owned()),
        };
        let name = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
        let name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (mut layers, mut specs) = (Vec::new(), Vec::new());
        for name in layer_names(dir) {
            let (layer, spec) = Layer::read(dir, &name, repairs)?;
            layers.push(layer);
            specs.push(spec);
        }
        let spec = RgbdSpec {
            beside,
            depth_units_per_metre: units,
            layers: specs,
            ..RgbdSpec::new("png", &name, file.camera)
        };
        let poses = rows::<7>(&dir.join("ground_truth.csv"), repairs)?;
        let poses = poses.into_iter().map(|(stamp, [x, y, z, qx, qy, qz, qw])| PoseRow {
            stamp,
            translation: [x, y, z],
            quaternion: [qx, qy, qz, qw],
        });
        let imu = rows::<6>(&dir.join("imu.csv"), repairs)?;
        let imu = imu.into_iter().map(|(stamp, v)| ImuRow {
            stamp,
            turn_rate: [v[0], v[1], v[2]],
            acceleration: [v[3], v[4], v[5]],
        });
        let (poses, imu) = (poses.collect(), imu.collect());
        Ok(Self { dir: dir.to_owned(), spec, color, right, depth, poses, imu, layers })
    }

    /// Everything to write, in order of time.
    fn events(&self) -> Vec<(Stamp, Event)> {
        let mut events: Vec<(Stamp, Event)> = Vec::new();
        events.extend(self.poses.iter().enumerate().map(|(i, row)| (row.stamp, Event::Pose(i))));
        events.extend(self.imu.iter().enumerate().map(|(i, row)| (row.stamp, Event::Imu(i))));
        events.extend(self.color.iter().enumerate().map(|(i, row)| (row.stamp, Event::Color(i))));
        events.extend(self.right.iter().enumerate().map(|(i, row)| (row.stamp, Event::Right(i))));
        if self.spec.beside == Beside::Depth {
            events.extend(self.depth.iter().enumerate().map(|(i, row)| (row.stamp, Event::Depth(i))));
        }
        for (layer, Layer { masks, .. }) in self.layers.iter().enumerate() {
            events.extend(masks.iter().enumerate().map(|(entry, mask)| (mask.0, Event::Mask { layer, entry })));
        }
        events.sort_unstable();
        events
    }

    fn counts(&self) -> BTreeMap<String, u64> {
        let tables = [
            ("color.csv", self.color.len()),
            ("right.csv", self.right.len()),
            ("depth.csv", self.depth.len()),
            ("ground_truth.csv", self.poses.len()),
            ("imu.csv", self.imu.len()),
        ];
        let tables = tables.into_iter().map(|(name, count)| (name.to_owned(), count));
        let layers = self.spec.layers.iter().zip(&self.layers);
        let layers = layers.map(|(spec, layer)| (format!("masks/{}", spec.name), layer.masks.len()));
        tables.chain(layers).filter(|(_, count)| *count > 0).map(|(name, count)| (name, count as u64)).collect()
    }

    fn write(
        &self,
        log: &mut RgbdLog,
        events: &[(Stamp, Event)],
        repairs: &mut Repairs,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<(), ImportError> {
        let camera = &self.spec.camera;
        for (done, (stamp, event)) in events.iter().enumerate() {
            log.log().flush_if_due(*stamp)?;
            match *event {
                Event::Pose(i) => log.ground_truth(*stamp, self.poses[i].translation, self.poses[i].quaternion)?,
                Event::Imu(i) => log.log().write(topics::IMU, *stamp, &self.imu[i].message()?)?,
                Event::Color(i) => {
                    let picture = read_picture(&self.color[i], camera, repairs)?;
                    log.color(*stamp, picture.format, &picture.bytes)?;
                }
                Event::Right(i) => {
                    let Beside::Right(stereo) = &self.spec.beside else { continue };
                    let picture = read_picture(&self.right[i], &stereo.right, repairs)?;
                    log.right(*stamp, picture.format, &picture.bytes)?;
                }
                Event::Depth(i) => log.depth(*stamp, &gray16(Path::new(&self.depth[i].path), camera)?)?,
                Event::Mask { layer, entry } => {
                    let (stamp, [class, instance]) = &self.layers[layer].masks[entry];
                    let [class, instance] = [class, instance].map(|name| gray16(&self.dir.join(name), camera));
                    let segments = self.layers[layer].segments.get(stamp).cloned().unwrap_or_default();
                    log.mask(layer, *stamp, &Mask { class: class?, instance: instance?, segments })?;
                }
            }
            progress(done + 1, events.len());
        }
        Ok(())
    }
}

impl Layer {
    fn read(dir: &Path, name: &str, repairs: &mut Repairs) -> Result<(Self, LayerSpec), ImportError> {
        let file = |table: &str| dir.join("masks").join(name).join(table);
        let mut masks = Vec::new();
        for (line, fields) in fields(&file("masks.csv"), true)? {
            let [stamp, class, instance] = fields.as_slice() else {
                return Err(line_error(&file("masks.csv"), line, "not `stamp_ns,class,instance`".to_owned()));
            };
            masks.push((
                stamp_of(&file("masks.csv"), line, stamp)?,
                [inside(&file("masks.csv"), line, class)?, inside(&file("masks.csv"), line, instance)?],
            ));
        }
        let masks = in_order(masks, |mask| mask.0, &file("masks.csv"), repairs);
        let mut segments: BTreeMap<Stamp, Vec<Segment>> = BTreeMap::new();
        for (line, fields) in fields(&file("segments.csv"), true)? {
            let (stamp, segment) = segment(&fields).ok_or_else(|| {
                let head = "not `stamp_ns,id,category_id,score,x,y,width,height,area,is_crowd`";
                line_error(&file("segments.csv"), line, head.to_owned())
            })?;
            segments.entry(stamp).or_default().push(segment);
        }
        let mut categories = Vec::new();
        for (line, fields) in fields(&file("categories.csv"), true)? {
            categories.push(category(&fields).ok_or_else(|| {
                line_error(&file("categories.csv"), line, "not `id,is_thing,red,green,blue,name`".to_owned())
            })?);
        }
        let origin = format!("class and instance images, folder masks/{name}");
        Ok((Self { masks, segments }, LayerSpec { name: name.to_owned(), origin, categories }))
    }
}

/// Folders of `masks/`, sorted; none without it.
fn layer_names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir.join("masks")).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.filter(|name| topics::is_layer_name(name)).collect();
    names.sort();
    names
}

/// Lines behind the head, in fields; none if the file may be missing and is.
fn fields(path: &Path, needed: bool) -> Result<Vec<(usize, Vec<String>)>, ImportError> {
    if !needed && !path.exists() {
        return Ok(Vec::new());
    }
    let text = read_text(path, "")?;
    let lines = text.lines().enumerate().skip(1).filter(|(_, line)| !line.trim().is_empty());
    // Six fields are the most that a name may follow; commas in it are its own.
    let limit = if path.ends_with("categories.csv") { 6 } else { usize::MAX };
    Ok(lines.map(|(i, line)| (i + 1, line.splitn(limit, ',').map(|f| f.trim().to_owned()).collect())).collect())
}

/// `stamp_ns,file` rows with whole paths; none without the table.
fn listed(dir: &Path, name: &str, repairs: &mut Repairs) -> Result<Vec<ListedFile>, ImportError> {
    let path = dir.join(name);
    let mut rows = Vec::new();
    for (line, fields) in fields(&path, name == "color.csv")? {
        let [stamp, file] = fields.as_slice() else {
            return Err(line_error(&path, line, "not `stamp_ns,file`".to_owned()));
        };
        let file = dir.join(inside(&path, line, file)?).to_string_lossy().into_owned();
        rows.push(ListedFile { stamp: stamp_of(&path, line, stamp)?, path: file });
    }
    Ok(in_order(rows, |row| row.stamp, &path, repairs))
}

/// `stamp_ns` and `N` numbers; none without the table.
fn rows<const N: usize>(path: &Path, repairs: &mut Repairs) -> Result<Vec<(Stamp, [f64; N])>, ImportError> {
    let mut rows = Vec::new();
    for (line, fields) in fields(path, false)? {
        let numbers: Option<Vec<f64>> =
            fields.iter().skip(1).map(|v| v.parse().ok().filter(|v: &f64| v.is_finite())).collect();
        let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        let numbers = numbers.ok_or_else(|| line_error(path, line, format!("wanted a stamp and {N} numbers")))?;
        rows.push((stamp_of(path, line, &fields[0])?, numbers));
    }
    Ok(in_order(rows, |row| row.0, path, repairs))
}

fn stamp_of(path: &Path, line: usize, text: &str) -> Result<Stamp, ImportError> {
    let stamp = text.parse().ok().filter(|ns: &i64| *ns >= 0);
    stamp.map(Stamp).ok_or_else(|| line_error(path, line, format!("`{text}` is no time in nanoseconds")))
}

/// A name that leads nowhere else.
fn inside(path: &Path, line: usize, name: &str) -> Result<String, ImportError> {
    let plain = |part| matches!(part, std::path::Component::Normal(_));
    if !name.is_empty() && Path::new(name).components().all(plain) {
        return Ok(name.to_owned());
    }
    Err(line_error(path, line, format!("`{name}` is not a file of the folder")))
}

fn segment(fields: &[String]) -> Option<(Stamp, Segment)> {
    let [stamp, id, category_id, score, x, y, width, height, area, is_crowd] = fields else { return None };
    let segment = Segment {
        id: id.parse().ok()?,
        category_id: category_id.parse().ok()?,
        score: score.parse().ok()?,
        x: x.parse().ok()?,
        y: y.parse().ok()?,
        width: width.parse().ok()?,
        height: height.parse().ok()?,
        area: area.parse().ok()?,
        is_crowd: is_crowd == "1",
    };
    Some((Stamp(stamp.parse().ok()?), segment))
}

fn category(fields: &[String]) -> Option<Category> {
    let [id, is_thing, _, _, _, name] = fields else { return None };
    Some(Category { id: id.parse().ok()?, name: name.clone(), is_thing: is_thing == "1" })
}

fn gray16(path: &Path, camera: &CameraModel) -> Result<Vec<u16>, ImportError> {
    let bytes = read_file(path, " (named in a table of the folder)")?;
    let decoded = decode_gray16(&bytes).map_err(|source| ImportError::Picture { path: path.to_owned(), source });
    let (width, height, pixels) = decoded?;
    if (width, height) != (camera.width, camera.height) {
        let message = format!("{width}x{height} pixels, but the calibration is for {}x{}", camera.width, camera.height);
        return Err(ImportError::content(path, message));
    }
    Ok(pixels)
}

/// Both calibration files as ROS messages, which tell the rectification.
fn stereo(dir: &Path, size: (u32, u32)) -> Result<StereoModel, ImportError> {
    let info = |name: &str| -> Result<CameraInfo, ImportError> {
        let path = dir.join(name);
        let camera = camera_file::read(&path, size)?.camera;
        let table = yaml_table(&read_text(&path, "")?).map_err(|message| ImportError::content(&path, message))?;
        let numbers = |key: &str| -> Result<Vec<f64>, ImportError> {
            let values =
                table.get(key).map(|values| values.iter().map(|v| v.parse().ok()).collect::<Option<Vec<f64>>>());
            values.flatten().ok_or_else(|| ImportError::content(&path, format!("no {key}")))
        };
        let wrong = |_| ImportError::content(&path, "rectification_matrix must have 9 numbers, projection_matrix 12");
        let r = numbers("rectification_matrix.data")?.try_into().map_err(wrong)?;
        let p = numbers("projection_matrix.data")?.try_into().map_err(wrong)?;
        Ok(CameraInfo { r, p, ..camera.to_camera_info(Header::default()) })
    };
    let (left, right) = (info("camera.yaml")?, info("camera_right.yaml")?);
    StereoModel::from_camera_infos(&left, &right).map_err(|error| ImportError::content(dir, error.to_string()))
}
