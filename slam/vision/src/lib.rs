//! What the SLAM sees of an image: ORB features, camera geometry, keypoint look-up and place recognition.
//!
//! [`Kernels`] picks code for the CPU at run time; the results are the same bits everywhere. The pieces, in the order a
//! frame meets them:
//!
//! * [`gray_from_rgb`]: brightness of a colour image.
//! * [`OrbExtractor`]: corners over an image pyramid with a direction and a 256-bit descriptor.
//! * [`Camera`]: projection, lens distortion and its inverse.
//! * [`KeypointGrid`]: which keypoints lie near a pixel.
//! * [`hamming`], [`hamming_many`], [`nearest_two`]: distance between descriptors.
//! * [`Places`]: which keyframes show the same place, by descriptors ([`PlaceIndex`]) or by the words of a [`Vocabulary`]
//!   ([`WordIndex`]).
//!
//! ```
//! use slam_vision::{OrbConfig, OrbExtractor, Workspace, gray_from_rgb};
//!
//! let extractor = OrbExtractor::new(&OrbConfig { features: 300, ..OrbConfig::default() })?;
//! let mut workspace = Workspace::default();
//! let rgb: Vec<u8> = (0..200 * 150 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
//! let features = extractor.extract_with(&gray_from_rgb(&rgb, 200, 150)?, None, &mut workspace);
//! assert_eq!(features.pixel.len(), features.descriptor.len());
//! # Ok::<(), slam_vision::VisionError>(())
//! ```

mod camera;
mod descriptor;
mod error;
mod grid;
mod image;
mod kernels;
mod orb;
mod place;
mod places;
mod rectify;
mod stereo;
mod vocabulary;

pub use camera::{Bounds, Camera, Distortion};
pub use descriptor::{Descriptor, Nearest, hamming, hamming_many, nearest_two};
pub use error::VisionError;
pub use grid::KeypointGrid;
pub use image::{GrayImage, Image, gray_from_rgb};
pub use kernels::Kernels;
pub use orb::{Features, OrbConfig, OrbExtractor, Part, Parts, Workspace};
pub use place::PlaceIndex;
pub use places::Places;
pub use rectify::Rectifier;
pub use stereo::StereoOptions;
pub use vocabulary::{LineProblem, Vocabulary, VocabularyError, VocabularyOptions, WordIndex, bag_score};
