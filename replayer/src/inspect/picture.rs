//! What lies on the picture: inputs as logged, and what the panoptic filter found in them.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use rrd::{
    At, Boxes2d, ClassIds, Colormap, EncodedDepthImage, EncodedImage, ImageCodec, Points2d, Radius, RrdError,
    RrdWriter, SegmentationImage,
};
use slam::input::{DepthImage, FrameInput, PanopticMask, Setup};
use slam::report::{FrameReport, KeypointClass, KeypointReport, RegionReport, RegionState};

use super::{ColorPicture, InspectError, style};

/// Depths at the ends of the colour map, metres: fixed, so that colours do not flicker. Indoor depth cameras.
const DEPTH_RANGE_M: [f32; 2] = [0.3, 5.0];
/// Residual shown in full red, pixels. Keypoints are located to about one.
const EPIPOLAR_LIMIT_PX: f64 = 4.0;
/// Residual shown in full red, standard deviations.
const MOTION_LIMIT_SIGMAS: f64 = 6.0;
/// Smallest share of the picture whose region gets a box: specks would bury the picture under their texts.
const BOX_SHARE: f64 = 0.004;
/// The same for regions without a verdict yet, which come and go with the segmentation's noise.
const NEW_BOX_SHARE: f64 = 0.02;

/// Colour or grey picture, depth, segmentation and the unknown area.
pub fn log_inputs(
    file: &mut RrdWriter,
    at: At,
    input: &FrameInput,
    color: Option<ColorPicture<'_>>,
) -> Result<(), InspectError> {
    let (grey, width, height) = (&input.gray, input.gray.width, input.gray.height);
    let packed;
    let (bytes, codec) = match color {
        Some(picture) => (picture.bytes, picture.codec),
        None => {
            packed = png("grey picture", &grey.data, [width, height], ExtendedColorType::L8)?;
            (packed.as_slice(), ImageCodec::Png)
        }
    };
    let picture = EncodedImage { bytes, codec, opacity: Some(1.0), draw_order: Some(0.0) };
    file.log("/world/camera/color", at, &picture)?;
    if let Some(right) = &input.right {
        let bytes = png("right picture", &right.data, [right.width, right.height], ExtendedColorType::L8)?;
        let picture = EncodedImage { bytes: &bytes, codec: ImageCodec::Png, opacity: Some(1.0), draw_order: Some(0.0) };
        file.log("/world/camera/right", at, &picture)?;
    }
    if let Some(depth) = &input.depth {
        log_depth(file, at, depth)?;
    }
    if let Some(mask) = &input.panoptic {
        log_segmentation(file, at, mask)?;
    }
    Ok(())
}

fn log_depth(file: &mut RrdWriter, at: At, depth: &DepthImage) -> Result<(), InspectError> {
    // The encoder takes samples in the machine's byte order.
    let samples: Vec<u8> = depth.units.iter().flat_map(|units| units.to_ne_bytes()).collect();
    let png = png("depth picture", &samples, [depth.width, depth.height], ExtendedColorType::L16)?;
    let image = EncodedDepthImage {
        png: &png,
        units_per_metre: (1.0 / depth.metres_per_unit) as f32,
        colormap: Colormap::Turbo,
        range_m: Some(DEPTH_RANGE_M),
        draw_order: Some(1.0),
    };
    Ok(file.log("/world/camera/depth", at, &image)?)
}

fn log_segmentation(file: &mut RrdWriter, at: At, mask: &PanopticMask) -> Result<(), RrdError> {
    let wide: Vec<u16> = mask.ids.iter().map(|&id| mask.segment(id).map_or(0, |s| s.category)).collect();
    let narrow: Option<Vec<u8>> = wide.iter().map(|&class| u8::try_from(class).ok()).collect();
    let classes = narrow.as_deref().map_or(ClassIds::U16(&wide), ClassIds::U8);
    let unknown: Vec<u8> = mask.ids.iter().map(|&id| u8::from(id == 0)).collect();
    let image = |classes, draw_order| SegmentationImage {
        width: mask.width as u32,
        height: mask.height as u32,
        classes,
        opacity: Some(0.65),
        draw_order: Some(draw_order),
    };
    file.log("/world/camera/segmentation", at, &image(classes, 2.0))?;
    file.log("/world/camera/unknown", at, &image(ClassIds::U8(&unknown), 3.0))
}

/// Regions and keypoints.
pub fn log_findings(file: &mut RrdWriter, at: At, report: &FrameReport, setup: &Setup) -> Result<(), RrdError> {
    log_region_areas(file, at, report, setup)?;
    log_region_boxes(file, at, report, setup)?;
    log_disagreement(file, at, report, setup)?;
    log_keypoints(file, at, &report.keypoints)?;
    log_vouched(file, at, &report.keypoints)?;
    log_residuals(file, at, "/world/camera/epipolar", &report.keypoints, |k| k.epipolar_px / EPIPOLAR_LIMIT_PX)?;
    log_residuals(file, at, "/world/camera/motion", &report.keypoints, |k| k.motion_sigmas / MOTION_LIMIT_SIGMAS)
}

/// Regions are reported on a coarse grid; the picture repeats each cell.
fn log_region_areas(file: &mut RrdWriter, at: At, report: &FrameReport, setup: &Setup) -> Result<(), RrdError> {
    const CELL_PX: usize = 4;
    let (columns, rows, cells) = &report.region_cells;
    if cells.len() != columns * rows || cells.is_empty() {
        return Ok(());
    }
    let state = |cell: u16| report.regions.get(usize::from(cell)).map_or(0, |r| style::region_class(r.state) as u8);
    let cells: Vec<u8> = cells.iter().map(|&cell| state(cell)).collect();
    let (width, height) = (setup.camera.width, setup.camera.height);
    let mut classes = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height as usize {
        let row = &cells[(y / CELL_PX).min(rows - 1) * columns..][..*columns];
        classes.extend((0..width as usize).map(|x| row[(x / CELL_PX).min(columns - 1)]));
    }
    let image = SegmentationImage {
        width,
        height,
        classes: ClassIds::U8(&classes),
        opacity: Some(0.55),
        draw_order: Some(4.0),
    };
    file.log("/world/camera/regions", at, &image)
}

/// Two entities, so that a view can show what moves alone.
fn log_region_boxes(file: &mut RrdWriter, at: At, report: &FrameReport, setup: &Setup) -> Result<(), RrdError> {
    let moves = |region: &RegionReport| matches!(region.state, RegionState::Dynamic | RegionState::Person);
    for (entity, moving) in [("/world/camera/regions/moving", true), ("/world/camera/regions/still", false)] {
        // Those that disagree have a box of their own.
        let regions = report.regions.iter().filter(|region| moves(region) == moving && !region.disagrees);
        let regions: Vec<&RegionReport> = regions.filter(|region| is_large(region, setup)).collect();
        let boxes: Vec<[f32; 4]> = regions.iter().map(|region| region.bbox.map(|v| v as f32)).collect();
        let class_ids: Vec<u16> = regions.iter().map(|region| style::region_class(region.state)).collect();
        let labels: Vec<String> = regions.iter().map(|region| region_label(region, setup)).collect();
        let boxes = Boxes2d {
            boxes: &boxes,
            labels: &labels,
            class_ids: &class_ids,
            radii: &[Radius::Ui(1.0)],
            draw_order: Some(5.0),
            ..Boxes2d::default()
        };
        file.log(entity, at, &boxes)?;
    }
    Ok(())
}

/// Regions that do not move as the background does, whatever their state is yet and however small they are.
fn log_disagreement(file: &mut RrdWriter, at: At, report: &FrameReport, setup: &Setup) -> Result<(), RrdError> {
    let regions: Vec<&RegionReport> = report.regions.iter().filter(|region| region.disagrees).collect();
    let boxes: Vec<[f32; 4]> = regions.iter().map(|region| region.bbox.map(|v| v as f32)).collect();
    let label = |region: &&RegionReport| format!("{}, moves against the background", region_label(region, setup));
    let labels: Vec<String> = regions.iter().map(label).collect();
    let boxes = Boxes2d {
        boxes: &boxes,
        labels: &labels,
        colors: &[style::DISAGREES],
        radii: &[Radius::Ui(2.0)],
        draw_order: Some(5.5),
        ..Boxes2d::default()
    };
    file.log("/world/camera/regions/disagree", at, &boxes)
}

/// Whether a region is large enough to speak about.
pub fn is_large(region: &RegionReport, setup: &Setup) -> bool {
    let share = if region.state == RegionState::New { NEW_BOX_SHARE } else { BOX_SHARE };
    let picture_px = f64::from(setup.camera.width) * f64::from(setup.camera.height);
    f64::from(region.area_px) >= share * picture_px
}

/// Class, track and verdict; for what is judged by evidence, the larger share of it that speaks for motion, and how many keypoints
/// old map points vouch for.
fn region_label(region: &RegionReport, setup: &Setup) -> String {
    let name = style::category_name(region.category, setup);
    if region.state == RegionState::Person {
        return format!("{name} #{}", region.track);
    }
    let shares = [region.moved_share, region.free_space_share];
    let moving = shares.into_iter().filter(|share| share.is_finite()).fold(0.0, slam_math::float::max);
    let vouched = if region.vouched > 0 { format!(", {} vouched for", region.vouched) } else { String::new() };
    format!("{name} #{} {} {:.0}%{vouched}", region.track, style::region(region.state).0, 100.0 * moving)
}

fn log_keypoints(file: &mut RrdWriter, at: At, keypoints: &[KeypointReport]) -> Result<(), RrdError> {
    let positions: Vec<[f32; 2]> = keypoints.iter().map(position).collect();
    let class_ids: Vec<u16> = keypoints.iter().map(|keypoint| keypoint.verdict as u16).collect();
    let radius = |keypoint: &KeypointReport| Radius::Ui(if keypoint.point.is_some() { 3.0 } else { 1.7 });
    let radii: Vec<Radius> = keypoints.iter().map(radius).collect();
    let points = Points2d {
        positions: &positions,
        class_ids: &class_ids,
        radii: &radii,
        draw_order: Some(6.0),
        ..Points2d::default()
    };
    file.log("/world/camera/keypoints", at, &points)
}

/// Halos under the keypoints that map points vouch for. Where the label says background they change nothing and are left away.
fn log_vouched(file: &mut RrdWriter, at: At, keypoints: &[KeypointReport]) -> Result<(), RrdError> {
    let vouched = keypoints.iter().filter(|keypoint| keypoint.is_vouched && keypoint.class != KeypointClass::Stuff);
    let positions: Vec<[f32; 2]> = vouched.map(position).collect();
    let points = Points2d {
        positions: &positions,
        colors: &[style::VOUCHED],
        radii: &[Radius::Ui(5.0)],
        draw_order: Some(5.8),
        ..Points2d::default()
    };
    file.log("/world/camera/vouched", at, &points)
}

/// Keypoints that have the residual, coloured by it; `share` is 1 for what is shown in full red.
fn log_residuals(
    file: &mut RrdWriter,
    at: At,
    entity: &str,
    keypoints: &[KeypointReport],
    share: impl Fn(&KeypointReport) -> f64,
) -> Result<(), RrdError> {
    let tested: Vec<&KeypointReport> = keypoints.iter().filter(|keypoint| share(keypoint).is_finite()).collect();
    let positions: Vec<[f32; 2]> = tested.iter().map(|keypoint| position(keypoint)).collect();
    let colors: Vec<rrd::Rgba> = tested.iter().map(|keypoint| style::residual(share(keypoint), 1.0)).collect();
    let points = Points2d {
        positions: &positions,
        colors: &colors,
        radii: &[Radius::Ui(2.5)],
        draw_order: Some(7.0),
        ..Points2d::default()
    };
    file.log(entity, at, &points)
}

/// The slam counts from the centre of the first pixel, the viewer from its corner.
fn position(keypoint: &KeypointReport) -> [f32; 2] {
    keypoint.pixel.map(|v| (v + 0.5) as f32)
}

/// Packs samples as PNG, quickly rather than tightly.
fn png(
    what: &'static str,
    samples: &[u8],
    [width, height]: [usize; 2],
    color: ExtendedColorType,
) -> Result<Vec<u8>, InspectError> {
    let expected = width * height * usize::from(color.bits_per_pixel() / 8);
    if samples.len() != expected {
        let reason = format!("it has {} bytes instead of {expected}", samples.len());
        return Err(InspectError::Picture { what, width, height, reason });
    }
    let mut bytes = Vec::with_capacity(expected / 2);
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub)
        .write_image(samples, width as u32, height as u32, color)
        .map_err(|e| InspectError::Picture { what, width, height, reason: e.to_string() })?;
    Ok(bytes)
}
