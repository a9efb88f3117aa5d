//! Small models, run: by rten, and by ONNX Runtime where `ORT_DYLIB_PATH` names its library.

use crate::onnx::{Output, model};
use schemas::Stamp;
use segment::{Mask, Network, NetworkSpec, Picture, Runtime, SegmentError, Segmenter as _};
use std::fs;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};
use tempfile::TempDir;

const SIZE: (usize, usize) = (8, 4);

/// Made once: ONNX Runtime has one environment a process.
fn runtimes() -> &'static [Runtime] {
    static RUNTIMES: OnceLock<Vec<Runtime>> = OnceLock::new();
    RUNTIMES.get_or_init(make_runtimes)
}

fn make_runtimes() -> Vec<Runtime> {
    let mut runtimes = vec![Runtime::rten().unwrap()];
    match std::env::var_os("ORT_DYLIB_PATH") {
        #[cfg(feature = "ort")]
        Some(path) => runtimes.push(Runtime::onnx_runtime(&[PathBuf::from(path)]).unwrap()),
        _ => eprintln!("skipped: ONNX Runtime (feature ort and ORT_DYLIB_PATH)"),
    }
    runtimes
}

struct Files {
    folder: TempDir,
    tomls: Vec<PathBuf>,
}

impl Files {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), tomls: Vec::new() }
    }

    fn add(mut self, name: &str, outputs: &[Output<'_>], text: &str) -> Self {
        let at = |extension: &str| self.folder.path().join(format!("{name}.{extension}"));
        fs::write(at("onnx"), model(SIZE.1, SIZE.0, outputs)).unwrap();
        let head = format!(
            "name = \"{name}\"\nlicence = \"MIT\"\nmodel = \"{name}.onnx\"\n{text}\n\
             [input]\ntensor = \"x\"\nwidth = {}\nheight = {}\n",
            SIZE.0, SIZE.1
        );
        fs::write(at("toml"), head).unwrap();
        self.tomls.push(at("toml"));
        self
    }

    /// By each runtime, which must agree.
    fn segment(&self) -> Result<Mask, SegmentError> {
        let spec = Arc::new(NetworkSpec::read(&self.tomls, None)?);
        let picture =
            Picture { stamp: Stamp(0), index: 0, width: SIZE.0, height: SIZE.1, rgb: vec![90; SIZE.0 * SIZE.1 * 3] };
        let mut masks = Vec::new();
        for runtime in runtimes() {
            let mask = Network::load(&spec, runtime)?.segment(&picture)?.unwrap();
            assert_eq!(Network::load(&spec, runtime)?.segment(&picture)?.unwrap(), mask, "{:?}", runtime.info());
            masks.push(mask);
        }
        assert!(masks.windows(2).all(|pair| pair[0].instance == pair[1].instance));
        Ok(masks.remove(0))
    }
}

const WALL_FLOOR: &str = r#"
kind = "semantic"
classes = { person = [2], stuff = { 0 = [9, "wall"], 1 = [3, "floor"] } }
merge = { stuff_area = 4, person_margin = 0.5 }
output = { scores = "y" }
"#;

/// Wall above, floor below, in the right quarter a person that is nearly as likely.
fn wall_floor() -> Vec<f32> {
    let mut scores = vec![0.0; 3 * 32];
    for (at, score) in scores.iter_mut().enumerate() {
        let (class, row, column) = (at / 32, at % 32 / 8, at % 8);
        *score = match class {
            0 => f32::from(row < 2),
            1 => f32::from(row >= 2),
            _ => {
                if column >= 6 {
                    0.75
                } else {
                    0.0
                }
            }
        };
    }
    scores
}

#[test]
fn stuff_never_covers_people() {
    let mask = Files::new().add("s", &[("y", &[1, 3, 4, 8], &wall_floor())], WALL_FLOOR).segment().unwrap();
    let row = |class: u16| [class, class, class, class, class, class, 0, 0];
    assert_eq!(mask.class, [row(9), row(9), row(3), row(3)].concat());
    assert_eq!(mask.segments.iter().map(|s| (s.category_id, s.area)).collect::<Vec<_>>(), [(3, 12), (9, 12)]);
}

#[test]
fn doubt_is_about_standing_still_not_about_which_stuff() {
    let text = r#"
kind = "semantic"
classes = { stuff = { 0 = [9, "wall"], 1 = [3, "floor"] } }
merge = { stuff_area = 1, stuff_margin = 2.2 }
output = { scores = "y" }
"#;
    // Two columns a case: wall, floor, and two ignored channels.
    let cases = [
        [2.0, 1.9, 0.0, -9.0_f32], // 14.1 : 1 for stuff, although the wall alone has only 7.4 : 1
        [2.0, 0.0, 0.0, -9.0],     // 8.4 : 1
        [2.5, -9.0, 0.0, 0.0],     // 12.2 : 2
        [3.0, -9.0, 3.1, -9.0],    // an ignored channel is the best
    ];
    let scores: Vec<f32> = (0..4 * 32).map(|at| cases[at % 8 / 2][at / 32]).collect();
    let mask = Files::new().add("s", &[("y", &[1, 4, 4, 8], &scores)], text).segment().unwrap();
    assert_eq!(mask.class, [[9, 9, 0, 0, 0, 0, 0, 0]; 4].concat());
}

const THINGS: &str = r#"
kind = "ultralytics-seg"
classes = { thing = { 0 = [1, "person"], 1 = [47, "cup"] } }
merge = { score = 0.5, iou = 0.5, thing_area = 2 }
output = { scores = "boxes", masks = "protos" }
"#;

/// Rows cx cy w h, person, cup, one coefficient; four anchors: a person, the same again worse, a cup over its border, and
/// one below the score.
const BOXES: [f32; 28] = [
    2.0, 2.0, 4.0, 6.0, //
    2.0, 2.0, 2.0, 2.0, //
    4.0, 4.0, 2.0, 2.0, //
    4.0, 4.0, 4.0, 4.0, //
    0.9, 0.8, 0.1, 0.4, //
    0.0, 0.0, 0.95, 0.0, //
    1.0, 1.0, 1.0, 1.0,
];

#[test]
fn things_lie_over_stuff() {
    let things: [Output<'_>; 2] = [("boxes", &[1, 7, 4], &BOXES), ("protos", &[1, 1, 4, 8], &[1.0; 32])];
    let files = Files::new().add("t", &things, THINGS).add("s", &[("y", &[1, 3, 4, 8], &wall_floor())], WALL_FLOOR);
    let mask = files.segment().unwrap();
    // Two pixels of wall and two of floor are left in the sixth column: too few, so unknown.
    assert_eq!(mask.class, [[1, 1, 1, 47, 47, 0, 0, 0]; 4].concat());
    assert_eq!(mask.segments.iter().map(|s| s.score).collect::<Vec<_>>(), [0.95, 0.9]);
}

const QUERIES: &str = r#"
kind = "panoptic-queries"
classes = { thing = { 0 = [1, "person"] }, stuff = { 1 = [9, "wall"] } }
merge = { score = 0.5, visible = 0.8, thing_area = 2, stuff_area = 2 }
"#;

/// Four queries of masks: left half, right half, right half again, everything.
fn query_masks() -> Vec<f32> {
    let inside = |query: usize, column: usize| match query {
        0 => column < 4,
        3 => true,
        _ => column >= 4,
    };
    (0..4 * 32).map(|at| if inside(at / 32, at % 8) { 9.0 } else { -9.0 }).collect()
}

/// Class logits person, wall, other with the class "no object" at a place: a person, a wall, another wall, nothing.
fn query_logits(no_object: Option<usize>) -> Vec<f32> {
    let classes = [[8.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 7.0, 0.0], [0.0, 0.0, 0.0]];
    let with = |(query, logits): (usize, &[f32; 3])| {
        let mut logits = logits.to_vec();
        if let Some(at) = no_object {
            logits.insert(at, if query == 3 { 8.0 } else { 0.0 });
        }
        logits
    };
    classes.iter().enumerate().flat_map(with).collect()
}

#[test]
fn queries_with_and_without_a_class_for_nothing() {
    for (at, options) in [
        (Some(3), "no_object = \"last\""),
        (Some(0), "no_object = \"first\""),
        (None, "no_object = \"none\""),
        (None, "no_object = \"none\", activation = \"sigmoid\""),
    ] {
        let logits = query_logits(at);
        let classes = if at.is_some() { 4 } else { 3 };
        let outputs: [Output<'_>; 2] = [("l", &[1, 4, classes], &logits), ("m", &[1, 4, 4, 8], &query_masks())];
        let text = format!("{QUERIES}output = {{ scores = \"l\", masks = \"m\", {options} }}");
        let mask = Files::new().add("q", &outputs, &text).segment().unwrap();
        assert_eq!(mask.class, [[1, 1, 1, 1, 9, 9, 9, 9]; 4].concat(), "{options}");
        assert_eq!(mask.segments.len(), 2, "{options}: two walls are one segment");
    }
}

#[test]
fn models_that_are_not_what_they_are_described_as() {
    let refused = |outputs: &[Output<'_>], text: &str, reason: &str| {
        let error = Files::new().add("m", outputs, text).segment().unwrap_err().to_string();
        assert!(error.contains("m.onnx") && error.contains(reason), "{error}");
    };
    refused(&[("z", &[1, 3, 4, 8], &wall_floor())], WALL_FLOOR, "has no tensor `y`");
    refused(&[("y", &[96], &wall_floor())], WALL_FLOOR, "[96]");
    refused(&[("y", &[1, 1, 12, 8], &wall_floor())], WALL_FLOOR, "has 1 classes, but class 1");
    let boxes: [Output<'_>; 2] = [("boxes", &[1, 7, 4], &BOXES), ("protos", &[1, 8, 4, 1], &[1.0; 32])];
    refused(&boxes, THINGS, "[1, 7, 4] and [1, 8, 4, 1]");
    let broken = Files::new().add("m", &[("y", &[1, 3, 4, 8], &wall_floor())], WALL_FLOOR);
    fs::write(broken.folder.path().join("m.onnx"), b"no model").unwrap();
    assert!(broken.segment().unwrap_err().to_string().contains("m.onnx"));
}
