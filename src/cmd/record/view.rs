//! A preview in a running Rerun viewer. It takes what is newest when it has time; the recording never waits for it.

use anyhow::Context as _;
use recorder::capture::{CameraSetup, Happening, Onlooker, Status, Stream};
use recorder::mocap::MocapFrame;
use recorder::picture::{encode_gray16, encode_rgb8};
use recorder::realsense::{Format, Frame};
use rrd::{
    At, Blueprint, Colormap, Container, EncodedDepthImage, EncodedImage, ImageCodec, Layout, Level, LiveViewer, Node,
    Play, Points3d, Rotation, Scalars, SeriesLines, Spatial2d, Spatial3d, TextLog, TimePanel, Transform, View,
    ViewCoordinates, ViewKind, ViewerAddress,
};
use schemas::Stamp;
use schemas::msg::level;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Pictures a stream and second.
const PICTURE_NS: i64 = 200_000_000;
/// Motion capture frames a second.
const MOCAP_NS: i64 = 50_000_000;
/// Widest picture, pixels.
const WIDTH: u32 = 320;
/// Depths shown by the ends of the colours, metres.
const RANGE_M: [f32; 2] = [0.2, 5.0];

/// A marker body that is seen: metres and quaternion x y z w in the motion capture's world.
#[derive(Debug)]
struct Body {
    name: String,
    translation: [f64; 3],
    rotation: [f64; 4],
}

/// What waits for the preview's thread: the newest of each stream.
#[derive(Debug, Default)]
struct Waiting {
    pictures: BTreeMap<Stream, (Stamp, Arc<Frame>)>,
    bodies: Option<(Stamp, Vec<Body>)>,
    /// Stamp of the last of each stream that was taken; of the motion capture too.
    taken: BTreeMap<Stream, Stamp>,
}

/// What the sources' threads see of the preview.
#[derive(Debug, Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    changed: Condvar,
    /// Pictures and frames that made room for newer ones.
    replaced: AtomicU64,
    ended: AtomicBool,
    /// Bits of the depth value of one metre.
    units_per_metre: AtomicU32,
}

impl Shared {
    /// Hands something over, if the stream's last one is long enough ago and nobody is at it just now.
    fn offer(&self, stream: Stream, stamp: Stamp, every_ns: i64, put: impl FnOnce(&mut Waiting) -> bool) {
        let Ok(mut waiting) = self.waiting.try_lock() else { return };
        if waiting.taken.get(&stream).is_some_and(|last| stamp.abs_diff(*last) < every_ns.unsigned_abs()) {
            return;
        }
        waiting.taken.insert(stream, stamp);
        if put(&mut waiting) {
            self.replaced.fetch_add(1, Ordering::Relaxed);
        }
        drop(waiting);
        self.changed.notify_one();
    }
}

impl Onlooker for Shared {
    fn camera(&self, setup: &CameraSetup) {
        let units = 1.0 / setup.calibration.depth_units_m.unwrap_or(0.001);
        self.units_per_metre.store(units.to_bits(), Ordering::Relaxed);
    }

    fn picture(&self, stream: Stream, stamp: Stamp, frame: &Arc<Frame>) {
        self.offer(stream, stamp, PICTURE_NS, |waiting| {
            waiting.pictures.insert(stream, (stamp, Arc::clone(frame))).is_some()
        });
    }

    fn mocap(&self, stamp: Stamp, frame: &MocapFrame) {
        self.offer(Stream::Mocap, stamp, MOCAP_NS, |waiting| {
            let seen = frame.bodies.iter().filter_map(|body| {
                let pose = body.world_from_segment?;
                let (translation, rotation) = (pose.translation.into(), pose.quaternion_xyzw());
                Some(Body { name: body.subject.clone(), translation, rotation })
            });
            waiting.bodies.replace((stamp, seen.collect())).is_some()
        });
    }
}

/// The preview of one recording.
pub struct Preview {
    shared: Arc<Shared>,
    viewer: Arc<LiveViewer>,
    thread: Option<JoinHandle<()>>,
    address: ViewerAddress,
    told: bool,
}

impl Preview {
    /// Begins to look for the viewer; `name` is the recording's in it.
    pub fn new(address: &ViewerAddress, name: &str) -> anyhow::Result<Self> {
        let viewer = Arc::new(LiveViewer::new(address, "pslam record", name, &layout())?);
        viewer.log("/mocap", At::Static, &ViewCoordinates::RightHandZUp)?;
        let shared = Arc::new(Shared::default());
        shared.units_per_metre.store(1000.0_f32.to_bits(), Ordering::Relaxed);
        let (own, sink) = (Arc::clone(&shared), Arc::clone(&viewer));
        let thread = std::thread::Builder::new().name("preview".to_owned());
        let thread = thread.spawn(move || show_all(&own, &sink)).context("no thread for the preview")?;
        Ok(Self { shared, viewer, thread: Some(thread), address: address.clone(), told: false })
    }

    /// What the recording is to be given.
    pub fn onlooker(&self) -> Arc<dyn Onlooker> {
        Arc::clone(&self.shared) as Arc<dyn Onlooker>
    }

    /// Rates, losses and happenings.
    pub fn status(&mut self, status: &Status) {
        let link = self.viewer.link();
        if !link.connected && !self.told && status.elapsed_s > 2.0 {
            self.told = true;
            eprintln!("warning: no viewer listens at {}: start one with `rerun`; the recording goes on", self.address);
        }
        let now = status.happenings.last().map(|happening| happening.stamp);
        let at = At::Time(now.unwrap_or_else(|| self.last_stamp()).0);
        let names: Vec<&str> = status.streams.iter().map(|stream| stream.stream.name()).collect();
        let curves = SeriesLines { names: &names, colors: &[], widths: &[] };
        let rates: Vec<f64> = status.streams.iter().map(|stream| stream.rate_hz).collect();
        let lost = |s: &recorder::capture::StreamStatus| (s.counts.dropped_device + s.counts.dropped_host) as f64;
        let lost: Vec<f64> = status.streams.iter().map(lost).collect();
        for (entity, values) in [("/status/rate", &rates), ("/status/lost", &lost)] {
            // What cannot be shown is not shown; the recording is what counts.
            let _ = self.viewer.log(entity, at, &curves);
            let _ = self.viewer.log(entity, at, &Scalars { values });
        }
        for Happening { stamp, level, name, text } in &status.happenings {
            let level = match *level {
                level::ERROR => Level::Error,
                level::WARN => Level::Warn,
                _ => Level::Info,
            };
            let _ = self.viewer.log("/log", At::Time(stamp.0), &TextLog { level, text: &format!("{name}: {text}") });
        }
    }

    /// The newest stamp that was seen.
    fn last_stamp(&self) -> Stamp {
        let waiting = self.shared.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.taken.values().copied().max().unwrap_or(Stamp(0))
    }

    /// Ends it; returns in words how it fared.
    pub fn end(mut self) -> String {
        self.shared.ended.store(true, Ordering::Relaxed);
        self.shared.changed.notify_one();
        let _ = self.thread.take().map(JoinHandle::join);
        let link = self.viewer.link();
        let dropped = link.dropped + self.shared.replaced.load(Ordering::Relaxed);
        let place = if link.connected { "shown at" } else { "nobody listens at" };
        format!(
            "preview: {place} {}, {} messages sent, {dropped} left out; the log has everything",
            self.address, link.sent
        )
    }
}

fn layout() -> Blueprint {
    let view = |kind, name, origin| Node::from(View::new(kind, name, origin));
    let picture = |name, origin| view(ViewKind::Spatial2d(Spatial2d::default()), name, origin);
    let curves = |name, origin| view(ViewKind::TimeSeries { y_range: None }, name, origin);
    let pictures = vec![picture("colour", "/camera/color"), picture("depth", "/camera/depth")];
    let space = view(ViewKind::Spatial3d(Spatial3d { grid: true, eye: None }), "motion capture", "/mocap");
    let status = vec![
        curves("rates, Hz", "/status/rate"),
        curves("lost", "/status/lost"),
        view(ViewKind::TextLog, "happenings", "/log"),
    ];
    let columns = vec![
        Container::new(Layout::Vertical, "camera", pictures).into(),
        space,
        Container::new(Layout::Vertical, "status", status).into(),
    ];
    let root = Container::new(Layout::Horizontal, "recording", columns).into();
    let time = TimePanel { timeline: "sensor_time", play: Play::Following, ..TimePanel::default() };
    Blueprint { time, ..Blueprint::new(root) }
}

/// Shows what waits, until the end.
fn show_all(shared: &Shared, viewer: &LiveViewer) {
    loop {
        let (pictures, bodies) = {
            let waiting = shared.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            let idle = |waiting: &mut Waiting| {
                waiting.pictures.is_empty() && waiting.bodies.is_none() && !shared.ended.load(Ordering::Relaxed)
            };
            // The end may come between the question and the wait.
            let second = std::time::Duration::from_secs(1);
            let waited = shared.changed.wait_timeout_while(waiting, second, idle);
            let mut waiting = waited.unwrap_or_else(PoisonError::into_inner).0;
            (std::mem::take(&mut waiting.pictures), waiting.bodies.take())
        };
        let units = f32::from_bits(shared.units_per_metre.load(Ordering::Relaxed));
        for (stream, (stamp, frame)) in pictures {
            let _ = show_picture(viewer, stream, stamp, &frame, units);
        }
        if let Some((stamp, bodies)) = bodies {
            let _ = show_bodies(viewer, stamp, &bodies);
        }
        if shared.ended.load(Ordering::Relaxed) {
            return;
        }
    }
}

/// Every `step`th pixel of every `step`th row.
fn show_picture(viewer: &LiveViewer, stream: Stream, stamp: Stamp, frame: &Frame, units: f32) -> anyhow::Result<()> {
    let pixel = frame.format.bytes_per_pixel().context("packed pixels")?;
    let step = frame.width.div_ceil(WIDTH).max(1) as usize;
    let (width, height) = ((frame.width as usize).div_ceil(step), (frame.height as usize).div_ceil(step));
    let rows = frame.bytes.chunks_exact(frame.width as usize * pixel).step_by(step);
    let pixels = rows.flat_map(|row| row.chunks_exact(pixel).step_by(step));
    let (width, height, at) = (width as u32, height as u32, At::Time(stamp.0));
    if stream == Stream::Depth {
        let values: Vec<u16> = pixels.map(|two| u16::from_le_bytes([two[0], two[1]])).collect();
        let png = &encode_gray16(width, height, &values)?;
        let (colormap, range_m) = (Colormap::Turbo, Some(RANGE_M));
        let image = EncodedDepthImage { png, units_per_metre: units, colormap, range_m, draw_order: None };
        return Ok(viewer.log("/camera/depth", at, &image)?);
    }
    let order = if frame.format == Format::Bgr8 { [2, 1, 0] } else { [0, 1, 2] };
    let rgb: Vec<u8> = pixels.flat_map(|pixel| order.map(|channel| pixel[channel])).collect();
    let bytes = &encode_rgb8(width, height, &rgb)?;
    let image = EncodedImage { bytes, codec: ImageCodec::Png, opacity: None, draw_order: None };
    Ok(viewer.log("/camera/color", at, &image)?)
}

fn show_bodies(viewer: &LiveViewer, stamp: Stamp, bodies: &[Body]) -> anyhow::Result<()> {
    for Body { name, translation, rotation } in bodies {
        let entity = format!("/mocap/{}", name.replace('/', "_"));
        let (at, labels) = (At::Time(stamp.0), [name.clone()]);
        let pose = Transform { translation: *translation, rotation: Rotation::Quaternion(*rotation) };
        viewer.log(&entity, at, &pose)?;
        viewer.log(&entity, at, &Points3d { positions: &[[0.0; 3]], labels: &labels, ..Points3d::default() })?;
    }
    Ok(())
}
