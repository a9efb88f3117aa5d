//! The order of the rooms (ARCHITECTURE.md): a lower one never looks up.

use crate::support::root;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Folder, package, and the packages of this workspace that it may depend on.
const CRATES: [(&str, &str, &[&str]); 10] = [
    ("schemas", "schemas", &[]),
    ("slam/math", "slam-math", &[]),
    ("slam/vision", "slam-vision", &["slam-math"]),
    ("slam/optimize", "slam-optimize", &["slam-math"]),
    ("slam", "slam", &["slam-math", "slam-vision", "slam-optimize"]),
    ("fixtures", "fixtures", &["slam-math"]),
    ("recorder/segment", "segment", &["schemas"]),
    ("recorder", "recorder", &["schemas", "segment", "slam-math"]),
    ("replayer/rrd", "rrd", &[]),
    ("replayer", "replayer", &["schemas", "segment", "slam", "slam-math", "slam-vision", "rrd"]),
];

/// Rooms inside `slam`, lower ones first. Rooms of one row do not know each other, but for the first row, which is the
/// vocabulary of all.
const ROOMS: [&[&str]; 8] = [
    &["config", "depth", "input", "observation", "report"],
    &["context", "matching"],
    &["map"],
    &["panoptic", "tracking"],
    &["mapping"],
    &["looping"],
    &["offline"],
    &["pipeline"],
];

/// What a pure function does not touch.
const IMPURE: [&str; 12] = [
    "std::fs",
    "std::env",
    "std::time",
    "std::net",
    "std::process",
    "std::thread",
    "std::io",
    "Instant",
    "SystemTime",
    "HashMap",
    "HashSet",
    "println!",
];

fn manifest(folder: &str) -> toml::Table {
    let path = root().join(folder).join("Cargo.toml");
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).parse().unwrap()
}

/// All Rust files under a folder.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

/// Lines of code without comments.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.split("//").next().unwrap_or_default()))
}

#[test]
fn crates_depend_downwards_only() {
    let ours: Vec<&str> = CRATES.iter().map(|(_, name, _)| *name).collect();
    for (folder, name, allowed) in CRATES {
        let manifest = manifest(folder);
        assert_eq!(manifest["package"]["name"].as_str(), Some(name), "{folder}");
        for table in ["dependencies", "build-dependencies"] {
            let dependencies = manifest.get(table).and_then(toml::Value::as_table).cloned().unwrap_or_default();
            for (dependency, _) in dependencies.iter().filter(|(d, _)| ours.contains(&d.as_str())) {
                assert!(
                    allowed.contains(&dependency.as_str()),
                    "{folder}/Cargo.toml: {name} must not know {dependency}"
                );
            }
        }
    }
    let members = manifest("");
    let members = members["workspace"]["members"].as_array().unwrap();
    let unlisted = members.iter().find(|m| !CRATES.iter().any(|(folder, ..)| m.as_str() == Some(*folder)));
    assert_eq!(unlisted, None, "a member of the workspace without a place in the order");
}

/// Violations of the order of rooms in one file.
fn looks_up(room: &str, text: &str) -> Vec<String> {
    let level = |name: &str| ROOMS.iter().position(|row| row.contains(&name));
    let own = level(room).unwrap_or_else(|| panic!("the room {room} has no place in the order"));
    let mut found = Vec::new();
    for (line, code) in code(text) {
        assert!(!code.contains("use crate::{"), "line {line}: one room a `use`, so that this test can read it");
        for part in code.split("crate::").skip(1) {
            let name: String = part.chars().take_while(|c| c.is_ascii_lowercase() || *c == '_').collect();
            let Some(other) = level(&name) else { continue };
            if name != room && (other > own || other == own && own > 0) {
                found.push(format!("line {line}: {room} looks up to {name}"));
            }
        }
    }
    found
}

#[test]
fn rooms_of_the_slam_look_downwards_only() {
    let source = root().join("slam/src");
    let mut rooms: BTreeMap<String, usize> = BTreeMap::new();
    for file in rust_files(&source) {
        let inside = file.strip_prefix(&source).unwrap();
        let room = inside.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs");
        if room == "lib" {
            continue;
        }
        let violations = looks_up(room, &fs::read_to_string(&file).unwrap());
        assert!(violations.is_empty(), "{}: {violations:?}", file.display());
        *rooms.entry(room.to_owned()).or_default() += 1;
    }
    assert_eq!(rooms.len(), ROOMS.iter().map(|row| row.len()).sum::<usize>(), "rooms found: {rooms:?}");
}

#[test]
fn the_order_can_be_broken() {
    assert_eq!(looks_up("map", "use crate::tracking::Pose; // crate::pipeline").len(), 1);
    assert_eq!(looks_up("tracking", "fn f(x: crate::panoptic::X) {}").len(), 1);
    assert!(looks_up("pipeline", "use crate::map::Map;").is_empty());
}

#[test]
fn the_slam_is_pure() {
    for folder in ["slam/src", "slam/math/src", "slam/vision/src", "slam/optimize/src"] {
        for file in rust_files(&root().join(folder)) {
            let text = fs::read_to_string(&file).unwrap();
            for (line, code) in code(&text) {
                let impure = IMPURE.iter().find(|word| code.contains(**word));
                assert_eq!(impure, None, "{} line {line}: {code}", file.display());
            }
        }
    }
}

#[test]
fn libraries_do_not_print() {
    for (folder, ..) in CRATES {
        for file in rust_files(&root().join(folder).join("src")) {
            let text = fs::read_to_string(&file).unwrap();
            let own = text.split("#[cfg(test)]").next().unwrap_or_default();
            for (line, code) in code(own) {
                assert!(!code.contains("print!(") && !code.contains("println!("), "{} line {line}", file.display());
            }
        }
    }
}
