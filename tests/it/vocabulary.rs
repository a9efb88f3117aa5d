//! A vocabulary of the user's finds places in a replay, and its digest is part of the run.

use crate::support::{SMALL_CAMERA, pslam, pslam_exits, small_world, text, write_log};
use serde_json::Value;
use slam_vision::{OrbConfig, OrbExtractor, Vocabulary, VocabularyOptions, Workspace, gray_from_rgb};
use std::fs;
use std::path::Path;

/// Words of the room's own pictures, as a file.
fn vocabulary_file(path: &Path, depth: u32) {
    let world = fixtures::World::new(&small_world(20)).unwrap();
    let extractor = OrbExtractor::new(&OrbConfig::default()).unwrap();
    let (width, height) = (SMALL_CAMERA.width as usize, SMALL_CAMERA.height as usize);
    let features = |frame| {
        let gray = gray_from_rgb(&world.frame(frame).rgb, width, height).unwrap();
        extractor.extract_with(&gray, None, &mut Workspace::default()).descriptor.to_vec()
    };
    let pictures: Vec<_> = (0..20).step_by(5).map(features).collect();
    let options = VocabularyOptions { branching: 8, depth, ..VocabularyOptions::default() };
    fs::write(path, Vocabulary::train(&pictures, &options).unwrap().to_text()).unwrap();
}

fn run_json(run: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(run.join("run.json")).unwrap()).unwrap()
}

#[test]
fn a_given_vocabulary_is_used_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (log, words) = (path("a.mcap"), path("words.txt"));
    write_log(&small_world(24), &log, &mut |_| {});
    vocabulary_file(&words, 3);
    let config = |name: &str, words: &Path| {
        fs::write(path(name), format!("[looping]\nvocabulary = '{}'\n", words.display())).unwrap();
        path(name)
    };
    let replay = |out: &str, config: &Path| {
        pslam_exits(0, &["replay", text(&log), "-o", text(&path(out)), "--config", text(config)]);
        run_json(&path(out))
    };
    let with = replay("with", &config("with.toml", &words));
    let digest = format!("blake3:{}", blake3_of(&words));
    assert!(with["header"]["config"].as_str().unwrap().contains(&digest), "{with}");
    assert_eq!(with["vocabulary"].as_str(), words.to_str());
    pslam_exits(0, &["verify", text(&path("with"))]);

    // Its place makes no difference, its content does.
    fs::copy(&words, path("copy.txt")).unwrap();
    let copy = replay("copy", &config("copy.toml", &path("copy.txt")));
    assert_eq!(copy["fingerprint"], with["fingerprint"]);
    vocabulary_file(&words, 2);
    assert_ne!(replay("other", &config("other.toml", &words))["fingerprint"], with["fingerprint"]);
    let refused = pslam(&["verify", text(&path("with"))]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("give the right file"), "{refused:?}");

    // What is no vocabulary is told by file and line; a run's own configuration names no file.
    let whole = fs::read(path("copy.txt")).unwrap();
    let hostile: [(&str, &[u8], &str); 4] = [
        ("cut", &whole[..whole.len() / 2], "line"),
        ("empty", b"", "line 1"),
        ("zeros", &[0; 5000], "line 1"),
        ("scoring-5", b"10 6 5 0\n", "scoring"),
    ];
    for (name, bytes, word) in hostile {
        fs::write(path(name), bytes).unwrap();
        let output =
            pslam(&["replay", text(&log), "-o", text(&path("no")), "--config", text(&config("no.toml", &path(name)))]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{name}: {told}");
        assert!(told.contains(name) && told.contains(word) && !told.contains("panicked"), "{name}: {told}");
    }
    let own = path("with").join("config.toml");
    let output = pslam(&["replay", text(&log), "-o", text(&path("no")), "--config", text(&own)]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && told.contains("give the path"), "{told}");
}

/// As any other program computes it.
fn blake3_of(path: &Path) -> String {
    blake3::hash(&fs::read(path).unwrap()).to_hex().to_string()
}
