//! What several tests need.

use fixtures::{Intrinsics, RenderedFrame, World, WorldConfig};
use panoptic_slam::synthetic;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The repository.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Data sets for development beside the repository; none at a newcomer's.
pub fn shared_data() -> Option<PathBuf> {
    let data = root().join("../shared/data");
    if data.is_dir() {
        return Some(data);
    }
    eprintln!("SKIPPED: {} is not there", data.display());
    None
}

/// Runs the program.
pub fn pslam(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pslam")).args(arguments).output().unwrap()
}

/// Runs it and wants this exit code; gives standard output.
pub fn pslam_exits(code: i32, arguments: &[&str]) -> String {
    let output = pslam(arguments);
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "pslam {}\n{out}{err}", arguments.join(" "));
    assert!(!err.contains("panicked"), "pslam {}\n{err}", arguments.join(" "));
    out.into_owned()
}

/// A quarter of the pixels of the usual camera.
pub const SMALL_CAMERA: Intrinsics =
    Intrinsics { width: 320, height: 240, fx_px: 262.5, fy_px: 262.5, cx_px: 159.5, cy_px: 119.5 };

/// The demo's room and cast at a quarter of the pixels, `frame_count` frames at 30 Hz, the camera as slow as in the demo.
pub fn small_world(frame_count: u32) -> WorldConfig {
    let demo = fixtures::scenario::demo();
    beginning(WorldConfig { camera: SMALL_CAMERA, texels_per_metre: 160.0, ..demo }, frame_count)
}

/// The beginning of a world. The camera's curve has whole cycles a sequence: a shorter sequence gets a smaller curve.
pub fn beginning(mut world: WorldConfig, frame_count: u32) -> WorldConfig {
    let share = f64::from(frame_count) / f64::from(world.frame_count);
    world.frame_count = frame_count;
    let path = &mut world.camera_path;
    path.amplitude_m.iter_mut().chain(&mut path.look_amplitude_m).for_each(|metres| *metres *= share);
    path.sway_m *= share;
    path.sway_rad *= share;
    world
}

/// Writes a log of the world; `edit` may change frames.
pub fn write_log(world: &WorldConfig, path: &Path, edit: &mut dyn FnMut(&mut RenderedFrame)) {
    let world = World::new(world).unwrap();
    synthetic::write_log(&world, "test", path, false, edit, &mut |_, _| {}).unwrap();
}

/// Ready labels for the first pictures of anything of this size, by number: a wall, and a cup that goes from left to right.
pub fn write_masks(folder: &Path, (width, height): (u32, u32), count: u32) {
    std::fs::create_dir_all(folder.join("class")).unwrap();
    let categories = r#"[{"id": 1, "name": "wall"}, {"id": 2, "name": "cup", "isthing": 1}]"#;
    std::fs::write(folder.join("categories.json"), categories).unwrap();
    for number in 0..count {
        let cup = number % (width / 2)..number % (width / 2) + width / 8;
        let row: Vec<u16> = (0..width).map(|x| if cup.contains(&x) { 2 } else { 1 }).collect();
        let png = recorder::picture::encode_gray16(width, height, &row.repeat(height as usize)).unwrap();
        std::fs::write(folder.join(format!("class/{number}.png")), png).unwrap();
    }
}

/// As text, for arguments.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
