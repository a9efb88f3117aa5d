//! The extractor on a recorded frame (skipped when the shared recordings are absent).

use std::path::Path;

use slam_vision::{GrayImage, Kernels, OrbConfig, OrbExtractor, gray_from_rgb};

/// First colour frame of a recording, 640 x 480.
fn recorded_frame() -> Option<GrayImage> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/kitchen_static/rgb"));
    let Ok(entries) = std::fs::read_dir(folder) else {
        eprintln!("skipped: no recording at {}", folder.display());
        return None;
    };
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let bytes = std::fs::read(&files[0]).unwrap();
    let mut decoder = zune_jpeg::JpegDecoder::new(zune_core::bytestream::ZCursor::new(&bytes));
    let rgb = decoder.decode().unwrap();
    let (width, height) = decoder.dimensions().unwrap();
    Some(gray_from_rgb(&rgb, width, height).unwrap())
}

#[test]
fn a_recorded_frame_gives_a_thousand_spread_features() {
    let Some(gray) = recorded_frame() else { return };
    let features = OrbExtractor::new(&OrbConfig::default()).unwrap().extract(&gray);
    assert!((950..=1000).contains(&features.len()), "{} features", features.len());

    // Corners are where texture is, but a kitchen has some nearly everywhere.
    let mut filled = [false; 8 * 6];
    for [x, y] in &features.pixel {
        filled[*x as usize * 8 / gray.width + (*y as usize * 6 / gray.height) * 8] = true;
    }
    let filled = filled.iter().filter(|&&cell| cell).count();
    eprintln!("{} features, {filled} of 48 blocks filled", features.len());
    assert!(filled >= 36, "{filled} of 48 blocks have features");
    for octave in 0..8 {
        assert!(features.octave.contains(&octave), "no features at octave {octave}");
    }

    let scalar = OrbExtractor::with_kernels(&OrbConfig::default(), Kernels::scalar()).unwrap();
    assert_eq!(scalar.extract(&gray), features);
}
