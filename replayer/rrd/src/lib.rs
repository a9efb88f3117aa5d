//! Writes Rerun viewer files (`.rrd`) whose bytes depend on nothing but the calls made.
//!
//! The ordinary Rerun SDK flushes by the clock and draws random ids, so two runs never give the same file. This crate
//! drives the encoder itself: one thread, ids from one counter, no wall-clock timeline, no footer (its manifest comes
//! out of a hash map), and a blueprint with counted ids. The same calls give the same bytes, for one version of the
//! `re_*` crates and one compiler.
//!
//! ```no_run
//! use rrd::{At, Blueprint, Node, Points3d, RrdWriter, View, ViewKind};
//!
//! # fn main() -> Result<(), rrd::RrdError> {
//! let mut file = RrdWriter::create("run.rrd", "panoptic-slam", "kitchen", false)?;
//! let at = At::Frame { frame: 0, sensor_time_ns: 1_700_000_000_000_000_000 };
//! file.log("/world/map", at, &Points3d { positions: &[[0.0, 1.0, 2.0]], ..Points3d::default() })?;
//! file.blueprint(&Blueprint::new(Node::from(View::new(ViewKind::Spatial3d(Default::default()), "map", "/world"))))?;
//! file.finish()?;
//! # Ok(())
//! # }
//! ```
//!
//! Conventions: entity paths are slash-separated (`/world/camera`); colours are sRGB with straight alpha. A log call
//! replaces the items the entity showed before; optional fields left empty keep what they were, so give an entity the
//! same fields each time. Files open in viewers 0.36 and newer; `rerun rrd verify` needs `--check-footers=false`.

mod blueprint;
mod chunks;
mod content;
mod error;
mod live;
mod writer;

pub use blueprint::{
    Blueprint, Container, Eye, Layout, Node, Panel, Play, Spatial2d, Spatial3d, TimePanel, View, ViewKind,
};
pub use content::{
    AnnotationContext, Boxes2d, Class, ClassIds, Clear, Colormap, Content, EncodedDepthImage, EncodedImage, ImageCodec,
    Level, Lines2d, Lines3d, Pinhole, Points2d, Points3d, Radius, Rgba, Rotation, Scalars, SegmentationImage,
    SeriesLines, TextDocument, TextLog, Transform, ViewCoordinates,
};
pub use error::RrdError;
pub use live::{Link, LiveViewer, ViewerAddress};
pub use writer::{At, RrdWriter};
