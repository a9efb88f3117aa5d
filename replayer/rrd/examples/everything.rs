//! Writes a file with one of everything this crate can show, over 20 frames: `everything OUT.rrd`.
//!
//! Also a picture test: every view must draw something and report no error.

use std::io::Cursor;

use image::{ExtendedColorType, ImageEncoder as _, codecs::png::PngEncoder};
use rrd::{
    AnnotationContext, At, Blueprint, Boxes2d, Class, ClassIds, Clear, Colormap, Container, EncodedDepthImage,
    EncodedImage, Eye, ImageCodec, Layout, Level, Lines2d, Lines3d, Node, Pinhole, Points2d, Points3d, Radius,
    Rotation, RrdError, RrdWriter, Scalars, SegmentationImage, SeriesLines, Spatial2d, Spatial3d, TextDocument,
    TextLog, Transform, View, ViewCoordinates, ViewKind,
};

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
const FRAMES: i64 = 20;
/// 2023-11-14T22:13:20Z.
const START_NS: i64 = 1_700_000_000_000_000_000;
const CLASSES: [Class<'static>; 4] = [
    Class { id: 0, label: "unknown", color: [255, 0, 200, 120] },
    Class { id: 1, label: "floor", color: [90, 160, 90, 255] },
    Class { id: 2, label: "wall", color: [90, 110, 170, 255] },
    Class { id: 3, label: "box", color: [240, 160, 40, 255] },
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = std::env::args().nth(1).ok_or("usage: everything OUT.rrd")?;
    let path = write(std::path::Path::new(&out), true)?;
    println!("{}", path.display());
    Ok(())
}

/// Writes the file. Shared with the tests.
pub fn write(path: &std::path::Path, force: bool) -> Result<std::path::PathBuf, RrdError> {
    let mut file = RrdWriter::create(path, "rrd-everything", "example", force)?;
    statics(&mut file)?;
    for frame in 0..FRAMES {
        let at = At::Frame { frame, sensor_time_ns: START_NS + frame * 33_333_333 };
        camera(&mut file, at, frame)?;
        world(&mut file, at, frame)?;
        curves(&mut file, at, frame)?;
    }
    file.blueprint(&layout())?;
    file.finish()
}

fn statics(file: &mut RrdWriter) -> Result<(), RrdError> {
    file.log("/", At::Static, &AnnotationContext { classes: &CLASSES })?;
    file.log("/world", At::Static, &ViewCoordinates::RightDownForward)?;
    let pinhole = Pinhole {
        fx: 260.0,
        fy: 260.0,
        cx: 160.0,
        cy: 120.0,
        width: WIDTH,
        height: HEIGHT,
        image_plane_distance: 0.5,
        color: Some([255, 255, 255, 255]),
    };
    file.log("/world/camera", At::Static, &pinhole)?;
    let style = SeriesLines {
        names: &["falling", "rising"],
        colors: &[[230, 80, 80, 255], [80, 160, 230, 255]],
        widths: &[2.0],
    };
    file.log("/plots/values", At::Static, &style)?;
    file.log("/about", At::Static, &TextDocument { markdown: "# Everything\n\nOne of each *kind*." })
}

/// Pixel classes of a frame: floor, wall, an unknown patch, and a box that moves right.
fn class_at(x: u32, y: u32, frame: i64) -> u8 {
    let left = 40 + 8 * frame as u32;
    if (left..left + 60).contains(&x) && (110..180).contains(&y) {
        3
    } else if (240..290).contains(&x) && (40..90).contains(&y) {
        0
    } else if y > 150 {
        1
    } else {
        2
    }
}

fn pixels() -> impl Iterator<Item = (u32, u32)> {
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)))
}

fn png(bytes: &[u8], color: ExtendedColorType) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    PngEncoder::new(&mut out).write_image(bytes, WIDTH, HEIGHT, color).expect("encodes into memory");
    out.into_inner()
}

fn camera(file: &mut RrdWriter, at: At, frame: i64) -> Result<(), RrdError> {
    let classes: Vec<u8> = pixels().map(|(x, y)| class_at(x, y, frame)).collect();
    let shade = |x: u32, y: u32| if (x / 16 + y / 16).is_multiple_of(2) { 30 } else { 0 };
    let rgb: Vec<u8> = pixels()
        .zip(&classes)
        .flat_map(|((x, y), &class)| {
            let [r, g, b, _] = CLASSES[usize::from(class)].color;
            [r / 2, g / 2, b / 2].map(|c| c + shade(x, y))
        })
        .collect();
    let depth_mm: Vec<u8> = pixels()
        .zip(&classes)
        .flat_map(|((_, y), &class)| {
            // The encoder takes native-endian samples.
            match class {
                0 => 0u16,
                1 => (4000 - 12 * (y - 150)) as u16,
                2 => 4000,
                _ => 2000,
            }
            .to_ne_bytes()
        })
        .collect();
    let (rgb, depth) = (png(&rgb, ExtendedColorType::Rgb8), png(&depth_mm, ExtendedColorType::L16));
    let color = EncodedImage { bytes: &rgb, codec: ImageCodec::Png, opacity: None, draw_order: Some(0.0) };
    file.log("/world/camera/color", at, &color)?;
    let depth = EncodedDepthImage {
        png: &depth,
        units_per_metre: 1000.0,
        colormap: Colormap::Turbo,
        range_m: Some([0.5, 5.0]),
        draw_order: Some(1.0),
    };
    file.log("/world/camera/depth", at, &depth)?;
    let segmentation = SegmentationImage {
        width: WIDTH,
        height: HEIGHT,
        classes: ClassIds::U8(&classes),
        opacity: Some(0.6),
        draw_order: Some(2.0),
    };
    file.log("/world/camera/segmentation", at, &segmentation)?;
    let left = 40.0 + 8.0 * frame as f32;
    let boxes = Boxes2d {
        boxes: &[[left, 110.0, 60.0, 70.0]],
        labels: &[format!("box #1 at frame {frame}")],
        class_ids: &[3],
        ..Boxes2d::default()
    };
    file.log("/world/camera/boxes", at, &boxes)?;
    let points = Points2d {
        positions: &[[left, 110.0], [left + 60.0, 110.0], [left + 60.0, 180.0], [left, 180.0]],
        colors: &[[255, 255, 255, 255]],
        radii: &[Radius::Ui(3.0)],
        ..Points2d::default()
    };
    file.log("/world/camera/keypoints", at, &points)?;
    let flow = Lines2d {
        strips: &[vec![[left, 145.0], [left + 8.0, 145.0]], vec![[10.0, 10.0], [300.0, 10.0]]],
        colors: &[[255, 255, 0, 255], [0, 255, 255, 255]],
        ..Lines2d::default()
    };
    file.log("/world/camera/flow", at, &flow)
}

fn world(file: &mut RrdWriter, at: At, frame: i64) -> Result<(), RrdError> {
    let x = f64::from(frame as i32) * 0.05;
    // Rotated by 0.2 rad about y, as a quaternion in even frames and as a matrix in odd ones: no jump may be seen.
    let (sin_half, cos_half) = (0.099_833_416_646_828_15, 0.995_004_165_278_025_8);
    let (sin, cos) = (0.198_669_330_795_061_2, 0.980_066_577_841_241_6);
    let rotation = if frame % 2 == 0 {
        Rotation::Quaternion([0.0, sin_half, 0.0, cos_half])
    } else {
        Rotation::Matrix([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    };
    file.log("/world/camera", at, &Transform { translation: [x, 0.0, 0.0], rotation })?;
    let path: Vec<[f32; 3]> = (0..=frame).map(|i| [i as f32 * 0.05, 0.0, 0.0]).collect();
    file.log("/world/path", at, &Lines3d { strips: &[path], colors: &[[0, 200, 80, 255]], radii: &[Radius::Ui(1.5)] })?;
    let positions: Vec<[f32; 3]> =
        (0..400).map(|i| [(i % 20) as f32 * 0.2 - 1.5, 0.8, (i / 20) as f32 * 0.2]).collect();
    let class_ids: Vec<u16> = (0..400).map(|i| if i % 20 < 10 { 1 } else { 2 }).collect();
    file.log(
        "/world/map",
        at,
        &Points3d {
            positions: &positions,
            class_ids: &class_ids,
            radii: &[Radius::Scene(0.02)],
            ..Points3d::default()
        },
    )?;
    if frame < 10 {
        let blink = Points3d { positions: &[[0.0, 0.0, 2.0]], colors: &[[255, 0, 0, 255]], ..Points3d::default() };
        file.log("/world/gone_after_9", at, &blink)
    } else {
        file.log("/world/gone_after_9", at, &Clear { recursive: true })
    }
}

fn curves(file: &mut RrdWriter, at: At, frame: i64) -> Result<(), RrdError> {
    let x = f64::from(frame as i32);
    file.log("/plots/values", at, &Scalars { values: &[10.0 - x, x * x / 20.0] })?;
    let level = [Level::Info, Level::Warn, Level::Error][(frame % 3) as usize];
    file.log("/log", at, &TextLog { level, text: &format!("frame {frame} is done") })
}

fn layout() -> Blueprint {
    let eye = Eye { position: [-1.5, -2.0, -3.0], target: [0.3, 0.3, 1.5], up: [0.0, -1.0, 0.0] };
    let space = View::new(ViewKind::Spatial3d(Spatial3d { eye: Some(eye), grid: false }), "world", "/world");
    let bounds = Some([0.0, 0.0, f64::from(WIDTH), f64::from(HEIGHT)]);
    let image = |name, layers: &[&str]| -> Node {
        View::new(ViewKind::Spatial2d(Spatial2d { bounds }), name, "/world/camera").with_contents(layers).into()
    };
    let images = Container::new(
        Layout::Vertical,
        "images",
        vec![
            image("color", &["+ $origin/color", "+ $origin/keypoints", "+ $origin/flow", "+ $origin/boxes"]),
            image("depth", &["+ $origin/depth"]),
            image("classes", &["+ $origin/color", "+ $origin/segmentation"]),
        ],
    );
    let texts = Container::new(
        Layout::Tabs,
        "texts",
        vec![
            View::new(ViewKind::TextLog, "log", "/log").into(),
            View::new(ViewKind::TextDocument, "about", "/about").into(),
        ],
    );
    let side = Container::new(
        Layout::Vertical,
        "side",
        vec![
            View::new(ViewKind::TimeSeries { y_range: Some([-12.0, 20.0]) }, "values", "/plots/values").into(),
            View::new(ViewKind::TextDocument, "about, too", "/about").into(),
            texts.into(),
        ],
    );
    let columns = vec![space.into(), images.into(), side.into()];
    Blueprint::new(Container::new(Layout::Horizontal, "all", columns).with_shares(&[3.0, 2.0, 2.0]).into())
}
