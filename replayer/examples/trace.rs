//! scratch
use std::path::Path;
use std::sync::Arc;
use replayer::robust::{Perturbation, Sequence};
use replayer::eval::{associate, Trajectory, StampedPose};
use slam::{Config, Inline, Slam, Unobserved};
use slam_math::align::umeyama;
use slam_vision::Workspace;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;
fn config(name: &str) -> Result<Config> {
    let (preset, file) = name.split_once(':').map_or((name, None), |(preset, file)| (preset, Some(file)));
    let config = Config::preset(preset)?;
    let Some(text) = file else { return Ok(config) };
    let text = if text.contains('=') { text.replace(';', "\n") } else { std::fs::read_to_string(text)? };
    Ok(config.with_toml(&text)?)
}
fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let cfg = config(&args[2])?;
    let p: Perturbation = args.get(3).map_or(Ok(Perturbation::AsRecorded), |s| s.parse())?;
    let s = Sequence::open(Path::new(&args[1]), &cfg, None)?;
    let s = p.apply(&s).ok_or("n/a")?;
    let cfg = p.config(&cfg);
    let mut slam = Slam::new(&cfg, &s.setup)?;
    let mut ws = Workspace::default();
    let mut rows = vec![];
    for input in &s.frames {
        let obs = Arc::new(slam.front_end().observe(input, &mut ws)?);
        let r = slam.step(input, obs, &mut Inline, &mut Unobserved)?;
        rows.push(r);
    }
    let online = Trajectory { poses: slam.online_trajectory().map(|p| StampedPose { stamp: schemas::Stamp(p.stamp.0), world_from_camera: p.world_from_camera }).collect() };
    let pairs = associate(&s.truth, &online, 0.02)?;
    let t: Vec<_> = pairs.iter().map(|(t, _)| s.truth.poses[*t].world_from_camera.translation).collect();
    let e: Vec<_> = pairs.iter().map(|(_, e)| online.poses[*e].world_from_camera.translation).collect();
    let fit = umeyama(&e, &t, false);
    for r in &rows {
        let c = &r.counts;
        let st = schemas::Stamp(r.stamp.0);
        let mut err = String::from("-");
        if let Some(k) = pairs.iter().position(|(_, e)| online.poses[*e].stamp == st) {
            let d = match &fit { Some(f) => f.transform(&e[k]) - t[k], None => e[k] - e[0] };
            let q = match &fit { Some(f) => f.transform(&e[k]) , None => e[k]};
            err = format!("[{:6.1} {:6.1} {:6.1}] {:6.1}mm  at {:.3} {:.3} {:.3}", d[0]*1e3, d[1]*1e3, d[2]*1e3, d.norm()*1e3, q[0], q[1], q[2]);
        }
        let states: Vec<String> = r.regions.iter().map(|g| format!("{}:{}{}/{:.0}%f{:.2}m{:.2}", g.track, match g.state { slam::report::RegionState::New=>"N", slam::report::RegionState::Static=>"S", slam::report::RegionState::Dynamic=>"D", slam::report::RegionState::Person=>"P" }, g.category, f64::from(g.area_px)/3072.0, g.free_space_share, g.moved_share)).filter(|s| !s.contains("/0%")).collect();
        println!("{:3} {:?} kp {:4} st {:4} mm {:4} lm {:4} in {:4} lp {:5} kf {:3}{} pts {:5} ba- {:3} cr {:4} cu {:4} {:?} {err} {}", r.id.0, r.state, c.keypoints, c.static_keypoints, c.motion_matches, c.local_matches, c.inliers, c.local_points, c.keyframes, if r.new_keyframe.is_some() {"*"} else {" "}, c.map_points, c.ba_outliers, c.points_created, c.points_culled, r.selection, if args.len() > 4 { states.join(" ") } else { String::new() });
        for ev in &r.events { println!("      {}", ev.text); }
    }
    Ok(())
}
