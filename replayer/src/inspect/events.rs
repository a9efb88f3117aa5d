//! Lines of the text log: what the slam says, and what changed from one frame to the next.

use std::collections::BTreeMap;

use rrd::{At, Level, RrdError, RrdWriter, TextLog};
use slam::input::Setup;
use slam::report::{FrameReport, RegionReport, RegionState, Selection, TrackingState};

use super::{picture, style};

const LOG: &str = "/log";

/// What held in the last frame.
#[derive(Default)]
pub struct Events {
    tracking: TrackingState,
    selection: Selection,
    /// State of each region, by track.
    regions: BTreeMap<u32, RegionState>,
}

impl Events {
    /// Logs one frame.
    pub fn log(&mut self, file: &mut RrdWriter, at: At, report: &FrameReport, setup: &Setup) -> Result<(), RrdError> {
        let mut say = |level, text: &str| file.log(LOG, at, &TextLog { level, text });
        for event in &report.events {
            say(if event.warning { Level::Warn } else { Level::Info }, &event.text)?;
        }
        if report.state != self.tracking {
            self.tracking = report.state;
            let (level, text) = tracking(report.state);
            say(level, text)?;
        }
        if report.selection != self.selection {
            self.selection = report.selection;
            let (level, text) = selection(report.selection);
            say(level, text)?;
        }
        if let Some(keyframe) = report.new_keyframe {
            say(Level::Info, &format!("new keyframe {keyframe}: {} points in the map", report.counts.map_points))?;
        }
        for region in &report.regions {
            let before = self.regions.insert(region.track, region.state);
            if let Some(text) = verdict_change(region, before, setup) {
                say(Level::Info, &text)?;
            }
        }
        Ok(())
    }
}

fn tracking(state: TrackingState) -> (Level, &'static str) {
    match state {
        TrackingState::NotInitialized => (Level::Warn, "no map yet"),
        TrackingState::Ok => (Level::Info, "tracking"),
        TrackingState::RecentlyLost => (Level::Error, "track lost: looking for a known place"),
        TrackingState::Lost => (Level::Error, "track lost for long: a new map begins when a picture allows"),
    }
}

fn selection(selection: Selection) -> (Level, &'static str) {
    match selection {
        Selection::Static => (Level::Info, "tracks by static keypoints again"),
        Selection::WithUnconfirmed => (Level::Warn, "too few static keypoints: unconfirmed ones help"),
        Selection::WithBorders => {
            (Level::Warn, "too few static keypoints: unconfirmed ones and those beside people and movers are used too")
        }
        Selection::AllButPeople => (Level::Warn, "far too few static keypoints: all but people are used"),
        Selection::Everything => (Level::Warn, "no keypoints but those on people fix the pose: all are used"),
    }
}

/// A region of some size whose verdict changed; that new ones become static or people is no news.
fn verdict_change(region: &RegionReport, before: Option<RegionState>, setup: &Setup) -> Option<String> {
    let news = match (before?, region.state) {
        (a, b) if a == b => return None,
        (_, RegionState::Dynamic) => "begins to move",
        (RegionState::Dynamic, RegionState::Static) => "stands still again: back in use",
        (RegionState::Dynamic, RegionState::New) => "may have come to rest",
        _ => return None,
    };
    picture::is_large(region, setup).then(|| {
        format!("{} #{} {news} ({})", style::category_name(region.category, setup), region.track, evidence(region))
    })
}

fn evidence(region: &RegionReport) -> String {
    let percent = |share: f64| if share.is_finite() { 100.0 * share } else { 0.0 };
    let (moved, free) = (percent(region.moved_share), percent(region.free_space_share));
    let against = if region.disagrees { ", its map points move against the background" } else { "" };
    format!("{moved:.0} % of keypoints moved, {free:.0} % of depth in free space{against}")
}
