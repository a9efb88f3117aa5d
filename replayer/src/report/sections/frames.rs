//! Pictures.

use super::super::html::{Key, Page, escape, legend};
use super::super::moments::Moment;
use super::super::overlay::{region_keys, stack, verdict_color};
use super::super::{ReportError, Story};
use crate::plot::trajectories::length;
use slam::report::Verdict;

pub fn frames(page: &mut Page, story: &Story) -> Result<(), ReportError> {
    page.section("frames", "Frames");
    let Some(seen) = &story.seen else {
        page.paragraph("Pictures need the run's log: name it after the run.");
        return Ok(());
    };
    page.paragraph(
        "Dots are keypoints in use, crosses are seen moving or on people, squares are filtered for another reason. \
         Tinted areas are regions whose motion is judged; the rest is background.",
    );
    let glyph = |verdict: Verdict| match verdict {
        Verdict::Static => "●",
        verdict if verdict.is_dynamic() => "×",
        _ => "□",
    };
    let verdicts = Verdict::ALL.map(|verdict| Key {
        name: format!("{} {}", glyph(verdict), verdict.name()),
        color: verdict_color(verdict).to_owned(),
    });
    page.raw(legend(&verdicts));
    page.raw(legend(&region_keys()));
    let switches = [("tint", "regions"), ("names", "names"), ("points", "keypoints")];
    let switch =
        |(id, name): (&str, &str)| format!("<label><input type=\"checkbox\" id=\"show-{id}\" checked> {name}</label>");
    page.raw(format_args!("<p class=\"switches\">Show: {}</p>", switches.map(switch).concat()));
    page.raw("<div class=\"frames\">");
    for moment in &seen.moments {
        let text = caption(moment, story);
        page.raw(format_args!(
            "<figure>{}<figcaption>Frame {} <span class=\"note\">{}</span></figcaption></figure>",
            stack(moment, &seen.setup, &format!("Frame {}: {text}", moment.frame))?,
            moment.frame,
            escape(&text)
        ));
    }
    page.raw("</div>");
    Ok(())
}

/// When, why it is shown, and how it stands.
fn caption(moment: &Moment, story: &Story) -> String {
    let Some(row) = story.rows.get(moment.frame) else { return moment.reasons.join(", ") };
    let samples = story.evaluation.as_ref().map(|evaluation| &evaluation.samples);
    let sample = samples.and_then(|s| Some(&s[s.binary_search_by_key(&row.stamp, |s| s.stamp).ok()?]));
    let error = sample.map_or(String::new(), |s| format!(", error {}", length(s.translation_m)));
    let pose = if row.tracked { format!("{:.0} inliers", row.inliers) } else { "no pose".to_owned() };
    let moving = moment.keypoints.iter().filter(|keypoint| keypoint.verdict.is_dynamic()).count();
    let all = moment.keypoints.len();
    format!("{:.2} s ({}): {pose}{error}; {moving} of {all} keypoints move", row.at_s, moment.reasons.join(", "))
}
