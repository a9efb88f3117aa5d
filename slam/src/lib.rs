//! RGB-D SLAM among moving people and unknown moving objects, as a pure function.
//!
//! A library without I/O: [`Slam`] takes [`FrameInput`] values one after the other and returns a [`FrameReport`] for
//! each, the same bits on any x86-64 CPU and for any number of threads. It reads no clock, no environment and no file.
//!
//! ```
//! use slam::{Config, Sensor, Setup, Slam};
//! use slam_vision::{Camera, Distortion};
//!
//! let camera =
//!     Camera { fx: 525.0, fy: 525.0, cx: 320.0, cy: 240.0, width: 640, height: 480, distortion: Distortion::None };
//! let slam = Slam::new(&Config::default(), &Setup { camera, sensor: Sensor::Rgbd, categories: vec![] }).unwrap();
//! assert_eq!(slam.map().keyframe_count(), 0);
//! ```
//!
//! Rooms, lower ones first: `slam-math`, `slam-vision` and `slam-optimize` (crates of their own, so the compiler keeps
//! the order), [`map`], then [`panoptic`], [`tracking`], [`mapping`], [`looping`], [`offline`], then [`pipeline`].

pub mod config;
pub mod context;
pub mod depth;
pub mod input;
pub mod looping;
pub mod map;
pub mod mapping;
pub mod matching;
pub mod observation;
pub mod offline;
pub mod panoptic;
pub mod pipeline;
pub mod report;
pub mod tracking;

pub use config::{Config, ConfigError};
pub use input::{Category, DepthImage, FrameInput, PanopticMask, Segment, Sensor, Setup};
pub use pipeline::{
    Executor, FinalPath, FrontEnd, Inline, Job, JobKind, JobResult, Observer, Slam, SlamError, State, Ticket,
    TrajectoryPose, Unobserved, Work,
};
pub use report::FrameReport;
