//! Calibration files: flat JSON, ORB-SLAM style YAML, ROS camera calibration YAML.
//!
//! All are read into one table of dotted keys and lists of numbers; then the first known name of each parameter wins.

use super::{ImportError, read_text};
use schemas::calibration::{CameraModel, Distortion};
use std::collections::BTreeMap;
use std::path::Path;

/// A calibration, and the depth scale if the file tells one.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFile {
    /// The camera.
    pub camera: CameraModel,
    /// Depth value of one metre, the file's own digits.
    pub depth_units_per_metre: Option<String>,
}

const WIDTH: &[&str] = &["width", "image_width", "camera.width"];
const HEIGHT: &[&str] = &["height", "image_height", "camera.height"];
const DEPTH_SCALE: &[&str] = &["depth_scale", "depthmapfactor", "rgbd.depthmapfactor"];

/// Reads a calibration file; `size` stands in where the file tells no picture size.
pub fn read(path: &Path, size: (u32, u32)) -> Result<CameraFile, ImportError> {
    let text = read_text(path, "")?;
    let json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let table = if json { json_table(&text) } else { yaml_table(&text) };
    let table = table.map_err(|message| ImportError::content(path, message))?;
    let camera = camera(&table, size).map_err(|message| ImportError::content(path, message))?;
    let camera = camera.validated().map_err(|source| ImportError::Calibration { path: path.to_owned(), source })?;
    let depth_units_per_metre = DEPTH_SCALE.iter().find_map(|key| table.get(*key)).and_then(|v| v.first());
    Ok(CameraFile { camera, depth_units_per_metre: depth_units_per_metre.map(|text| plain_decimal(text)) })
}

/// Keys in lower case, values as their own text.
pub type Table = BTreeMap<String, Vec<String>>;

fn camera(table: &Table, size: (u32, u32)) -> Result<CameraModel, String> {
    let number = |key: &str, index: usize| -> Result<Option<f64>, String> {
        let Some(text) = table.get(key).and_then(|values| values.get(index)) else { return Ok(None) };
        text.parse().map(Some).map_err(|_| format!("{key}: `{text}` is not a number"))
    };
    let named = |name: &str| -> Result<Option<f64>, String> {
        for key in [name.to_owned(), format!("camera.{name}"), format!("camera1.{name}")] {
            if let Some(value) = number(&key, 0)? {
                return Ok(Some(value));
            }
        }
        Ok(None)
    };
    // `camera_matrix.data` is the row-major 3x3 matrix: fx 0 cx 0 fy cy 0 0 1.
    let intrinsic = |name: &str, index: usize| -> Result<f64, String> {
        let value = named(name)?.map_or_else(|| number("camera_matrix.data", index), |v| Ok(Some(v)))?;
        value.ok_or_else(|| format!("no {name}: wanted {name}, Camera.{name} or camera_matrix.data"))
    };
    let extent = |keys: &[&str], default: u32| -> Result<u32, String> {
        let Some(text) = keys.iter().find_map(|key| table.get(*key)).and_then(|v| v.first()) else {
            return Ok(default);
        };
        let value = text.parse::<f64>().ok().filter(|v| v.fract() == 0.0 && (1.0..=65536.0).contains(v));
        value.map(|v| v as u32).ok_or_else(|| format!("{}: `{text}` is not a picture size", keys[0]))
    };
    let distortion = match table.get("distortion_coefficients.data") {
        Some(values) => {
            let values = values.iter().map(|v| v.parse::<f64>()).collect::<Result<Vec<_>, _>>();
            let values = values.map_err(|_| "distortion_coefficients.data is no list of numbers".to_owned())?;
            let model = table.get("distortion_model").and_then(|v| v.first()).map_or("plumb_bob", String::as_str);
            Distortion::from_ros(model, &values).map_err(|error| error.to_string())?
        }
        None => {
            let mut values = [0.0; 5];
            for (value, name) in values.iter_mut().zip(["k1", "k2", "p1", "p2", "k3"]) {
                *value = named(name)?.unwrap_or(0.0);
            }
            Distortion::from_parameters(values)
        }
    };
    let (fx, cx, fy, cy) = (intrinsic("fx", 0)?, intrinsic("cx", 2)?, intrinsic("fy", 4)?, intrinsic("cy", 5)?);
    let (width, height) = (extent(WIDTH, size.0)?, extent(HEIGHT, size.1)?);
    Ok(CameraModel { width, height, fx, fy, cx, cy, distortion })
}

/// Flattens nested objects to dotted keys.
fn json_table(text: &str) -> Result<Table, String> {
    fn walk(prefix: &str, value: &serde_json::Value, table: &mut Table) {
        match value {
            serde_json::Value::Object(fields) => {
                for (key, value) in fields {
                    let key = key.to_lowercase();
                    walk(&if prefix.is_empty() { key } else { format!("{prefix}.{key}") }, value, table);
                }
            }
            serde_json::Value::Array(items) => items.iter().for_each(|item| walk(prefix, item, table)),
            serde_json::Value::String(text) => table.entry(prefix.to_owned()).or_default().push(text.clone()),
            other => table.entry(prefix.to_owned()).or_default().push(other.to_string()),
        }
    }
    let value: serde_json::Value = serde_json::from_str(text).map_err(|error| format!("not JSON: {error}"))?;
    let mut table = Table::new();
    walk("", &value, &mut table);
    Ok(table)
}

/// The YAML that calibration files use: `key: value`, one level of nesting, lists in brackets (also over several lines)
/// or as `- ` items.
pub fn yaml_table(text: &str) -> Result<Table, String> {
    let mut table = Table::new();
    let mut parent = String::new();
    let mut key = String::new();
    let mut in_brackets = false;
    for line in text.lines() {
        let line = line.split(" #").next().unwrap_or_default();
        let trimmed = line.trim();
        if trimmed.is_empty() || trimmed.starts_with(['#', '%']) || trimmed == "---" || trimmed == "..." {
            continue;
        }
        if in_brackets || trimmed.starts_with("- ") {
            let items = trimmed.strip_prefix("- ").unwrap_or(trimmed);
            table.entry(key.clone()).or_default().extend(list_items(items));
            in_brackets = in_brackets && !trimmed.contains(']');
            continue;
        }
        let Some((name, value)) = trimmed.split_once(':') else {
            return Err(format!("`{trimmed}` is not `key: value`"));
        };
        let name = name.trim().trim_matches('"').to_lowercase();
        let nested = line.starts_with([' ', '\t']);
        key = if nested && !parent.is_empty() { format!("{parent}.{name}") } else { name.clone() };
        let value = value.trim();
        if !nested {
            parent = if value.is_empty() || value.starts_with("!!") { name } else { String::new() };
        }
        in_brackets = value.contains('[') && !value.contains(']');
        if !value.is_empty() && !value.starts_with("!!") {
            table.insert(key.clone(), list_items(value).collect());
        }
    }
    Ok(table)
}

fn list_items(text: &str) -> impl Iterator<Item = String> + '_ {
    let items = text.split(['[', ']', ',']).map(|item| item.trim().trim_matches(['"', '\'']));
    items.filter(|item| !item.is_empty()).map(str::to_owned)
}

/// `5000.0` as `5000`: the scale is kept as exact text, without a needless tail.
fn plain_decimal(text: &str) -> String {
    match text.split_once('.') {
        Some((whole, fraction)) if fraction.bytes().all(|b| b == b'0') => whole.to_owned(),
        _ => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(name: &str, text: &str) -> Result<CameraFile, ImportError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&path, (640, 480))
    }

    fn radtan(k1: f64, k2: f64, p1: f64, p2: f64, k3: f64) -> Distortion {
        Distortion::Radtan { k1, k2, p1, p2, k3 }
    }

    #[test]
    fn flat_json() {
        let text = r#"{"width": 320, "height": 240, "fx": 525.0, "fy": 526, "cx": 1.5, "cy": 2, "k1": 0.0, "depth_scale": 5000.0, "note": "x"}"#;
        let file = parse("camera.json", text).unwrap();
        let expected = CameraModel {
            width: 320,
            height: 240,
            fx: 525.0,
            fy: 526.0,
            cx: 1.5,
            cy: 2.0,
            distortion: Distortion::None,
        };
        assert_eq!(file, CameraFile { camera: expected, depth_units_per_metre: Some("5000".to_owned()) });
    }

    #[test]
    fn orb_slam_yaml() {
        let text = "%YAML:1.0\n---\n# Camera\nCamera.type: \"PinHole\"\nCamera.fx: 517.3 # px\nCamera.fy: 516.5\nCamera.cx: 318.6\n\
                    Camera.cy: 255.3\n\nCamera.k1: 0.2624\nCamera.k2: -0.9531\nCamera.p1: -0.0054\nCamera.p2: 0.0026\nCamera.k3: 1.1633\n\
                    Camera.width: 640\nCamera.height: 480\nDepthMapFactor: 5000.0\n";
        let file = parse("TUM1.yaml", text).unwrap();
        assert_eq!(file.camera, schemas::calibration::Preset::Freiburg1.camera());
        assert_eq!(file.depth_units_per_metre.as_deref(), Some("5000"));
    }

    #[test]
    fn ros_yaml() {
        let text = "image_width: 848\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [611.5, 0, 433.2,\n\
                    \x20         0, 611.6, 249.5, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n\
                    \x20 data: [0.1, -0.2, 0.001, 0.002, 0.3]\nrectification_matrix:\n  rows: 3\n  data: [1,0,0,0,1,0,0,0,1]\n";
        let camera = parse("camera.yaml", text).unwrap().camera;
        assert_eq!((camera.width, camera.height, camera.fx, camera.fy), (848, 480, 611.5, 611.6));
        assert_eq!((camera.cx, camera.cy, camera.distortion), (433.2, 249.5, radtan(0.1, -0.2, 0.001, 0.002, 0.3)));
    }

    #[test]
    fn unusable_files_say_what_is_missing() {
        let cases = [
            ("a.json", "{\"fx\": 1}", "cx"),
            ("a.json", "{", "not JSON"),
            ("a.yaml", "fx 1\n", "key: value"),
            ("a.yaml", "fx: 1\nfy: 1\ncx: a\ncy: 1\n", "not a number"),
            ("a.json", r#"{"fx": 0, "fy": 1, "cx": 1, "cy": 1}"#, "impossible"),
            ("a.json", r#"{"fx": 1, "fy": 1, "cx": 1, "cy": 1, "width": 1.5}"#, "picture size"),
            (
                "a.yaml",
                "fx: 1\nfy: 1\ncx: 1\ncy: 1\ndistortion_model: equidistant\ndistortion_coefficients:\n  data: [1, 2, 3, 4]\n",
                "equidistant",
            ),
        ];
        for (name, text, expected) in cases {
            let error = parse(name, text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
