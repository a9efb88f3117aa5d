//! What the SLAM sees of an image: ORB features, camera geometry, keypoint look-up and place recognition.
//!
//! Every kernel that touches pixels or descriptors computes with integers; [`Kernels`] picks code for the CPU at run
//! time, and the results are the same bits everywhere. The pieces, in the order a frame meets them:
//!
//! * [`gray_from_rgb`]: brightness of a colour image.
//! * [`OrbExtractor`]: corners over an image pyramid with a direction and a 256-bit descriptor.
//! * [`Camera`]: projection, lens distortion and its inverse.
//! * [`KeypointGrid`]: which keypoints lie near a pixel.
//! * [`hamming`], [`hamming_many`], [`hamming_at`]: distance between descriptors.
//! * [`PlaceIndex`]: which keyframes show the same place.

mod camera;
mod descriptor;
mod error;
mod grid;
mod image;
mod kernels;
mod orb;
mod place;

pub use camera::{Bounds, Camera, Distortion};
pub use descriptor::{Descriptor, hamming, hamming_at, hamming_many};
pub use error::VisionError;
pub use grid::KeypointGrid;
pub use image::{GrayImage, Image, gray_from_rgb};
pub use kernels::Kernels;
pub use orb::{Features, OrbConfig, OrbExtractor, Workspace};
pub use place::PlaceIndex;
