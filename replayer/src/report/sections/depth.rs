//! How good this camera's depth is.

use slam::Sensor;
use slam::depth::Miscalibration;

use super::super::Story;
use super::super::html::Page;
use crate::eval::{EvalOptions, evaluate};

/// What pixels say about depth, and what only an outer length can say.
pub fn depth(page: &mut Page, story: &Story) {
    let result = &story.summary.result;
    if result.sensor != Sensor::Rgbd.name() {
        return;
    }
    page.section("depth", "Depth of this camera");
    by_pixels(page, result.depth.as_ref());
    page.paragraph(&scale(story));
}

fn by_pixels(page: &mut Page, found: Option<&Miscalibration>) {
    let Some(found) = found else {
        page.paragraph("Too little was seen to compare depth with what pixels alone say.");
        return;
    };
    let row = |name: &str, what: slam::depth::Estimated, factor: f64, unit: &str| {
        vec![
            name.to_owned(),
            format!("{:.1} {unit}", factor * what.value),
            format!("{:.1} {unit}", factor * what.sigma),
        ]
    };
    let rows = [
        row("offset of all depths", found.offset_m, 1e3, "mm"),
        row("depth picture too far right", found.shift_right_px, 1.0, "px"),
        row("depth picture too far down", found.shift_down_px, 1.0, "px"),
        row("depth older than colour", found.delay_s, 1e3, "ms"),
    ];
    page.table("Depth against pixels", &["what", "found", "standard error"], &rows);
    let told: Vec<String> = found.told().map(|(_, text)| text).collect();
    page.paragraph(&if told.is_empty() {
        "None of this is both beyond four standard errors and large enough to matter.".to_owned()
    } else {
        format!("This camera's {}. Nothing is corrected: calibrate the camera.", told.join("; "))
    });
}

/// A common factor on all depths is the map's own scale.
fn scale(story: &Story) -> String {
    let options = EvalOptions::for_sensor(Sensor::Monocular.name());
    match evaluate(&story.truth, &story.estimate, None, &options) {
        Ok(evaluation) => {
            let percent = 100.0 * (1.0 / evaluation.scale - 1.0);
            let side = if percent < 0.0 { "short" } else { "long" };
            format!(
                "Against the ground truth lengths of this run are {:.1} % too {side}. No pixel shows that: the map takes \
                 over a common factor on all depths.",
                percent.abs()
            )
        }
        Err(_) => {
            "Whether all depths are too long or too short by one factor, no pixel shows: that takes ground truth."
                .to_owned()
        }
    }
}
