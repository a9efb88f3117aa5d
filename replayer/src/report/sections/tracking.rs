//! How the run went: tracking, filter, map, times.

use slam::report::Verdict;

use super::super::Story;
use super::super::chart::{Chart, Series};
use super::super::html::Page;
use super::super::overlay::{category_name, verdict_color};
use super::super::rows::Row;
use super::{end_s, lost_bands, percent};
use crate::run::{RunEvent, StageTime};

/// Events listed; the run's folder has all.
const LISTED_EVENTS: usize = 60;
/// Events marked in a plot.
const MARKED_EVENTS: usize = 12;

fn series(story: &Story, name: &str, color: &'static str, value: fn(&Row) -> f64) -> Series {
    Series::new(name, color, story.rows.iter().map(|row| (row.at_s, value(row))))
}

pub fn tracking(page: &mut Page, story: &Story) {
    page.section("tracking", "Tracking");
    let result = &story.summary.result;
    let lost = lost_bands(story);
    let chart = Chart {
        id: "tracking",
        title: "Keypoints, matches and inliers",
        label: "count",
        unit: "",
        series: vec![
            series(story, "keypoints", "var(--truth)", |row| row.keypoints),
            series(story, "judged static", "var(--s3)", |row| row.static_keypoints),
            series(story, "matches with the local map", "var(--s4)", |row| row.matches),
            series(story, "inliers of the pose", "var(--s1)", |row| row.inliers),
        ],
        stacked: false,
        lost: &lost,
        marks: Vec::new(),
        end_s: end_s(story),
    };
    page.raw(chart.html());
    let states = result.states.iter();
    let states = states.map(|(state, n)| vec![state.clone(), n.to_string(), percent(*n as f64, result.frames as f64)]);
    page.table("Frames by tracking state", &["state", "frames", "share"], &states.collect::<Vec<_>>());
    if result.lost_frames.is_empty() {
        page.paragraph("Every frame has a pose.");
    } else {
        let ranges: Vec<String> =
            result.lost_frames.iter().take(20).map(|r| format!("{}..{}", r.start, r.end)).collect();
        let more = if result.lost_frames.len() > 20 { ", ..." } else { "" };
        page.paragraph(&format!(
            "Frames without a pose: {}{more} (first, and the one after the last).",
            ranges.join(", ")
        ));
    }
}

pub fn filter(page: &mut Page, story: &Story) {
    page.section("filter", "Panoptic filter");
    let Some(seen) = &story.seen else {
        page.paragraph("The run was not gone through again, and its records hold verdicts only as digests.");
        return;
    };
    let total = |verdict: Verdict| seen.verdicts.iter().map(|frame| u64::from(frame[verdict as usize])).sum::<u64>();
    let all: u64 = Verdict::ALL.into_iter().map(total).sum();
    let there: Vec<Verdict> = Verdict::ALL.into_iter().filter(|verdict| total(*verdict) > 0).collect();
    let one = |verdict: &Verdict| {
        let values = story.rows.iter().zip(&seen.verdicts);
        let values = values.map(|(row, frame)| (row.at_s, f64::from(frame[*verdict as usize])));
        Series::new(verdict.name(), verdict_color(*verdict), values)
    };
    let chart = Chart {
        id: "verdicts",
        title: "Keypoints by verdict",
        label: "keypoints",
        unit: "",
        series: there.iter().map(one).collect(),
        stacked: true,
        lost: &[],
        marks: Vec::new(),
        end_s: end_s(story),
    };
    page.raw(chart.html());
    let used = |verdict: &Verdict| if *verdict == Verdict::Static { "used" } else { "filtered" };
    let rows = there.iter().map(|verdict| {
        let n = total(*verdict);
        let mean = n as f64 / seen.verdicts.len().max(1) as f64;
        vec![verdict.name().to_owned(), used(verdict).to_owned(), percent(n as f64, all as f64), format!("{mean:.1}")]
    });
    page.table("Verdicts", &["verdict", "use", "share", "a frame"], &rows.collect::<Vec<_>>());
    if seen.categories.is_empty() {
        page.paragraph("No frame has a mask.");
        return;
    }
    let mut categories: Vec<_> = seen.categories.iter().collect();
    categories.sort_by_key(|(id, presence)| (std::cmp::Reverse(presence.pixels), **id));
    let kind = |id: u16| match seen.setup.categories.iter().find(|known| known.id == id && id != 0) {
        Some(category) if category.is_thing => "thing",
        Some(_) => "stuff",
        None => "no segment",
    };
    let rows = categories.into_iter().map(|(&id, presence)| {
        let share = percent(presence.pixels as f64, seen.masked_pixels as f64);
        let name = category_name(id, &seen.setup).to_owned();
        vec![name, kind(id).to_owned(), presence.frames.to_string(), share]
    });
    let head = ["category", "kind", "frames", "share of all pixels"];
    page.table("Categories in the masks", &head, &rows.collect::<Vec<_>>());
}

pub fn map(page: &mut Page, story: &Story) {
    page.section("map", "Map");
    let lost = lost_bands(story);
    let chart = |id, title, label, series| Chart {
        id,
        title,
        label,
        unit: "",
        series: vec![series],
        stacked: false,
        lost: &lost,
        marks: marks(story),
        end_s: end_s(story),
    };
    let points = series(story, "map points", "var(--s1)", |row| row.map_points);
    page.raw(chart("points", "Map points", "points", points).html());
    let keyframes = series(story, "keyframes", "var(--s2)", |row| row.keyframes);
    page.raw(chart("keyframes", "Keyframes", "keyframes", keyframes).html());
    let result = &story.summary.result;
    let maps = result.maps.iter().map(|map| {
        let written = if result.main_map == Some(map.map) { "yes" } else { "no" };
        vec![format!("map {}", map.map), map.frames.to_string(), written.to_owned()]
    });
    page.table("Maps", &["map", "frames", "in the trajectory"], &maps.collect::<Vec<_>>());
    events(page, story);
}

/// What changed the map as a whole: maps made, loops closed, maps joined, found again.
fn marks(story: &Story) -> Vec<(f64, String)> {
    let events = story.summary.result.events.iter();
    let short = |event: &RunEvent| {
        let words = ["loop", "weld", "joined", "found again", "lost"];
        let word = words.into_iter().find(|word| event.text.contains(word))?;
        let row = story.rows.get(event.frame? as usize)?;
        Some((row.at_s, word.to_owned()))
    };
    events.filter_map(short).take(MARKED_EVENTS).collect()
}

fn events(page: &mut Page, story: &Story) {
    let result = &story.summary.result;
    if result.events.is_empty() {
        page.paragraph("Nothing happened that is worth a line.");
        return;
    }
    // Warnings first: they must not hide behind what is usual.
    let mut events: Vec<&RunEvent> = result.events.iter().collect();
    events.sort_by_key(|event| !event.warning);
    events.truncate(LISTED_EVENTS);
    events.sort_by_key(|event| event.frame);
    let rows = events.iter().map(|event| {
        let row = event.frame.and_then(|frame| story.rows.get(frame as usize));
        vec![
            event.frame.map_or("run".to_owned(), |frame| frame.to_string()),
            row.map_or(String::new(), |row| format!("{:.2} s", row.at_s)),
            if event.warning { "warning" } else { "note" }.to_owned(),
            event.text.clone(),
        ]
    });
    let all = result.events.len() + result.events_left_out;
    let caption = format!("Events: {} of {all}, {} of them warnings", events.len(), result.warnings);
    page.table(&caption, &["frame", "time", "kind", "what"], &rows.collect::<Vec<_>>());
}

pub fn times(page: &mut Page, story: &Story) {
    page.section("times", "Times");
    let timing = match &story.bench {
        None => {
            page.paragraph("As measured when the run was made; not part of its fingerprint.");
            &story.summary.timing
        }
        Some(bench) => {
            let same = bench.fingerprint == story.summary.fingerprint;
            let same = if same { "the same fingerprint" } else { "ANOTHER fingerprint: not the same run" };
            page.paragraph(&format!("As measured by pslam bench on {}, with {same}.", bench.input));
            &bench.timing
        }
    };
    let row = |time: &StageTime, of: &str| {
        let [mean, p50, p95, p99] = [time.mean_ms, time.p50_ms, time.p95_ms, time.p99_ms].map(|ms| format!("{ms:.2}"));
        vec![time.stage.clone(), of.to_owned(), mean, p50, p95, p99, time.count.to_string()]
    };
    let stages = timing.stages.iter().chain([&timing.tracking, &timing.waiting]).map(|time| row(time, "a frame"));
    let jobs = timing.jobs.iter().map(|time| row(time, "a job"));
    let head = ["stage", "ms", "mean", "p50", "p95", "p99", "measured"];
    page.table("Stages and background jobs", &head, &stages.chain(jobs).collect::<Vec<_>>());
    let cpu = timing.cpu_ms_per_frame.map_or(String::new(), |ms| format!(", {ms:.1} ms of processor time a frame"));
    let memory = timing.peak_memory_mib.map_or(String::new(), |mib| format!(", peak memory {mib:.0} MiB"));
    page.paragraph(&format!(
        "{:.1} frames a second with {} threads{cpu}{memory}. \"tracking\" is features, filter, pose and keyframes.",
        timing.frames_per_s, timing.threads
    ));
}
