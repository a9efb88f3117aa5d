//! Colours and names: one meaning, one colour, in pictures, in space and in plots.

use rrd::{AnnotationContext, At, Class, Rgba, RrdError, RrdWriter};
use slam::input::{Category, Setup};
use slam::report::{RegionState, Verdict};

/// Nothing to see.
const TRANSPARENT: Rgba = [0, 0, 0, 0];
/// People.
const RED: Rgba = [240, 62, 62, 255];
/// Not known what it is.
const MAGENTA: Rgba = [224, 64, 251, 255];
/// In use.
pub const GREEN: Rgba = [64, 214, 110, 255];
/// Moves.
pub const ORANGE: Rgba = [255, 146, 30, 255];
/// Waits for evidence.
const YELLOW: Rgba = [255, 221, 87, 255];
/// The estimate.
pub const BLUE: Rgba = [77, 166, 255, 255];
/// The truth.
pub const GOLD: Rgba = [255, 196, 61, 255];
/// A place seen again.
pub const LOOP: Rgba = [255, 90, 170, 255];
/// Set aside.
pub const GREY: Rgba = [150, 155, 165, 255];
/// A region against the background.
pub const DISAGREES: Rgba = [255, 255, 255, 255];
/// Old map points speak for it.
pub const VOUCHED: Rgba = [77, 166, 255, 200];
/// Whatever is calm and plenty.
pub const PALE: Rgba = [188, 196, 210, 255];

/// Colour of a verdict.
pub fn verdict(verdict: Verdict) -> Rgba {
    match verdict {
        Verdict::Static => GREEN,
        Verdict::Person => RED,
        Verdict::ThingDynamic => ORANGE,
        Verdict::ThingNew => YELLOW,
        Verdict::UnknownDynamic => MAGENTA,
        Verdict::UnknownNew => [186, 164, 255, 255],
        Verdict::Border => GREY,
        Verdict::FreeSpace => [64, 210, 230, 255],
    }
}

/// All states of a region, in the order of their numbers.
pub const REGION_STATES: [RegionState; 4] =
    [RegionState::New, RegionState::Static, RegionState::Dynamic, RegionState::Person];

/// Name and colour of a region's state.
pub fn region(state: RegionState) -> (&'static str, Rgba) {
    match state {
        RegionState::New => ("new", YELLOW),
        RegionState::Static => ("still", GREEN),
        RegionState::Dynamic => ("moves", ORANGE),
        RegionState::Person => ("person", RED),
    }
}

/// Name of a category; 0 and numbers without one are unknown.
pub fn category_name(category: u16, setup: &Setup) -> &str {
    let known = setup.categories.iter().find(|known| known.id == category && category != 0);
    known.map_or("unknown", |known| known.name.as_str())
}

/// Class of a region's state in pictures; 0 is the background.
pub fn region_class(state: RegionState) -> u16 {
    state as u16 + 1
}

/// What a map point looks like, first match wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum PointState {
    /// There is evidence that it is gone or on a mover.
    Doubted,
    /// Few observations.
    Young,
    /// On a Thing that stands still.
    OnThing,
    /// On an unknown area that stands still.
    OnUnknown,
    /// The rest: on the background, well observed.
    Settled,
}

const POINT_STATES: [(PointState, &str, Rgba); 5] = [
    (PointState::Doubted, "doubted", ORANGE),
    (PointState::Young, "young", [92, 124, 170, 255]),
    (PointState::OnThing, "on a static thing", YELLOW),
    (PointState::OnUnknown, "on a static unknown area", MAGENTA),
    (PointState::Settled, "settled", PALE),
];

/// Logs what class ids mean, each where it is used.
pub fn log_classes(file: &mut RrdWriter, categories: &[Category]) -> Result<(), RrdError> {
    let mut classes = vec![Class { id: 0, label: "unknown", color: MAGENTA }];
    classes.extend(categories.iter().filter(|category| category.id != 0).map(category_class));
    file.log("/world/camera/segmentation", At::Static, &AnnotationContext { classes: &classes })?;

    let unknown = [
        Class { id: 0, label: "claimed by a segment", color: TRANSPARENT },
        Class { id: 1, label: "unknown", color: MAGENTA },
    ];
    file.log("/world/camera/unknown", At::Static, &AnnotationContext { classes: &unknown })?;

    let mut regions = vec![Class { id: 0, label: "background", color: TRANSPARENT }];
    regions.extend(REGION_STATES.map(|state| {
        let (label, color) = region(state);
        Class { id: region_class(state), label, color }
    }));
    file.log("/world/camera/regions", At::Static, &AnnotationContext { classes: &regions })?;

    let verdicts = Verdict::ALL.map(|v| Class { id: v as u16, label: v.name(), color: verdict(v) });
    file.log("/world/camera/keypoints", At::Static, &AnnotationContext { classes: &verdicts })?;

    let points = POINT_STATES.map(|(state, label, color)| Class { id: state as u16, label, color });
    file.log("/world/map", At::Static, &AnnotationContext { classes: &points })
}

/// People red; other Things bright, Stuff dull, each category with a hue of its own.
fn category_class(category: &Category) -> Class<'_> {
    let color = if category.name == "person" {
        RED
    } else if category.is_thing {
        hue_color(category.id, 40, 235)
    } else {
        hue_color(category.id, 70, 150)
    };
    Class { id: category.id, label: &category.name, color }
}

/// A hue by number between two levels of brightness: neighbours in number are far apart in hue (golden section).
fn hue_color(number: u16, low: u16, high: u16) -> Rgba {
    /// Six sections of 256 steps round the colour circle.
    const CIRCLE: u32 = 6 * 256;
    /// Golden section of the circle.
    const STEP: u32 = 949;
    let hue = u32::from(number) * STEP % CIRCLE;
    let ramp = (hue % 256) as u16;
    let up = low + (high - low) * ramp / 255;
    let down = low + (high - low) * (255 - ramp) / 255;
    let (r, g, b) = match hue / 256 {
        0 => (high, up, low),
        1 => (down, high, low),
        2 => (low, high, up),
        3 => (low, down, high),
        4 => (up, low, high),
        _ => (high, low, down),
    };
    [r as u8, g as u8, b as u8, 255]
}

/// Green for 0 through yellow to red for `limit` and above.
pub fn residual(value: f64, limit: f64) -> Rgba {
    let share = ((value / limit).clamp(0.0, 1.0) * 510.0) as u16;
    let (r, g) = if share <= 255 { (share, 255) } else { (255, 510 - share) };
    [r as u8, g as u8, 40, 255]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn categories_that_follow_each_other_look_different() {
        for number in 0..200u16 {
            let (a, b) = (hue_color(number, 40, 235), hue_color(number + 1, 40, 235));
            let distance: i32 = (0..3).map(|i| (i32::from(a[i]) - i32::from(b[i])).abs()).sum();
            assert!(distance > 100, "{number}: {a:?} {b:?}");
        }
    }

    #[test]
    fn residuals_go_from_green_to_red() {
        assert_eq!(residual(0.0, 3.0), [0, 255, 40, 255]);
        assert_eq!(residual(1.5, 3.0), [255, 255, 40, 255]);
        assert_eq!(residual(9.0, 3.0), [255, 0, 40, 255]);
    }
}
