//! ORB features: FAST corners over an image pyramid, spread by a quadtree, with direction and descriptor
//! (Rublee et al., "ORB: an efficient alternative to SIFT or SURF", ICCV 2011; spreading as in ORB-SLAM).
//!
//! Where the usual implementations differ on purpose: non-maximum suppression sees the whole level, so a corner on the
//! seam of two cells is found once; all choices are total orders; a keypoint's level-0 pixel is where its pixel centre
//! really lies, not its level coordinates times the scale (which is off by up to 1.3 pixels at octave 7).

mod config;
mod corners;
mod pattern;
mod pyramid;
mod spread;

pub use config::OrbConfig;
pub(crate) use pattern::PAIRS;

use slam_math::{Buffer, Buffers};

use crate::kernels::{Moments, PATCH_MARGIN};
use crate::stereo::{self, StereoOptions};
use crate::{Descriptor, GrayImage, Kernels, VisionError};
use corners::Corner;
pub(crate) use pyramid::Pyramid;

/// The features of an image; entry `i` of every list belongs to keypoint `i`. Sorted by octave, then y, then x.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Features {
    /// Pixel in the image as given (level 0, lens distortion included).
    pub pixel: Buffer<[f32; 2]>,
    /// Pyramid level, 0 = full resolution.
    pub octave: Buffer<u8>,
    /// Direction of the patch's intensity centroid, radians in (-pi, pi], clockwise from x as y points down.
    pub angle: Buffer<f32>,
    /// FAST score: largest threshold at which the pixel is still a corner.
    pub response: Buffer<u8>,
    /// Steered BRIEF on the blurred level.
    pub descriptor: Buffer<Descriptor>,
}

impl Features {
    /// Room for so many.
    fn new(buffers: &Buffers, n: usize) -> Self {
        let mut features = Self {
            pixel: buffers.empty(),
            octave: buffers.empty(),
            angle: buffers.empty(),
            response: buffers.empty(),
            descriptor: buffers.empty(),
        };
        features.pixel.reserve(n);
        features.octave.reserve(n);
        features.angle.reserve(n);
        features.response.reserve(n);
        features.descriptor.reserve(n);
        features
    }

    /// Number of keypoints.
    #[must_use]
    pub fn len(&self) -> usize {
        self.pixel.len()
    }

    /// Whether there is no keypoint.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pixel.is_empty()
    }
}

/// Parts of an image, so that what moves leaves keypoints to what stands still.
pub struct Parts<'a> {
    /// What a pixel of the image shows.
    pub of_pixel: &'a dyn Fn([f32; 2]) -> Part,
    /// Keypoints on [`Part::Preferred`] as a share of all that a level may have, 0 to 1. Where others took more of those, and there
    /// are corners, these come on top.
    pub floor: f64,
}

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// What keypoints are wanted on most.
    Preferred,
    /// Whatever else has corners.
    Other,
    /// Keypoints are of no use here.
    Useless,
}

/// Memory that [`OrbExtractor::extract_with`] uses again for every frame. Never changes a result.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    /// Where the features' memory comes from and goes back to.
    pub buffers: Buffers,
    pyramid: Pyramid,
    scores: Vec<u8>,
    peaks: Vec<u8>,
    corners: Vec<Corner>,
    preferred: Vec<Corner>,
    spread: spread::Scratch,
    cell_columns: Vec<(usize, usize)>,
    blurred: Vec<u8>,
    padded_row: Vec<u8>,
    centers: Vec<usize>,
    moments: Vec<Moments>,
    turns: Vec<[f32; 2]>,
    /// Of the left picture, while the right one is in work.
    left_pyramid: Pyramid,
}

/// Finds and describes keypoints.
#[derive(Debug, Clone)]
pub struct OrbExtractor {
    config: OrbConfig,
    kernels: Kernels,
    scales: Vec<f64>,
    quotas: Vec<usize>,
}

impl OrbExtractor {
    /// An extractor with the fastest kernels of this CPU. Fails when a setting is out of range.
    pub fn new(config: &OrbConfig) -> Result<Self, VisionError> {
        Self::with_kernels(config, Kernels::detect())
    }

    /// An extractor with the given kernels; the features are the same with any.
    pub fn with_kernels(config: &OrbConfig, kernels: Kernels) -> Result<Self, VisionError> {
        config.validate()?;
        Ok(Self { config: config.clone(), kernels, scales: config.scales(), quotas: config.quotas() })
    }

    /// Size of a pixel of `octave` in pixels of the image: `scale_factor^octave`. Panics for octaves that don't exist.
    #[must_use]
    pub fn scale(&self, octave: u8) -> f64 {
        self.scales[usize::from(octave)]
    }

    /// [`OrbExtractor::scale`] of every octave.
    #[must_use]
    pub fn scales(&self) -> &[f64] {
        &self.scales
    }

    /// At most `config.features` keypoints of an image, and those that `parts` adds. Images too small for a patch (38 pixels) have none.
    ///
    /// Panics when `gray.data` does not hold `width * height` values.
    #[must_use]
    pub fn extract(&self, gray: &GrayImage) -> Features {
        self.extract_with(gray, None, &mut Workspace::default())
    }

    /// [`OrbExtractor::extract`] with keypoints shared among the parts of the image, and buffers kept from earlier frames.
    #[must_use]
    pub fn extract_with(&self, gray: &GrayImage, parts: Option<&Parts<'_>>, workspace: &mut Workspace) -> Features {
        assert_eq!(gray.data.len(), gray.width * gray.height, "pixels of a {} x {} image", gray.width, gray.height);
        let mut pyramid = std::mem::take(&mut workspace.pyramid);
        let mut features = Features::new(&workspace.buffers, self.config.features);
        for octave in 0..self.scales.len() {
            let level = if octave == 0 { gray } else { pyramid.level(self.kernels, gray, octave, self.scales[octave]) };
            if level.width <= 2 * PATCH_MARGIN || level.height <= 2 * PATCH_MARGIN {
                break;
            }
            let ratio = [(gray.width, level.width), (gray.height, level.height)].map(|(a, b)| a as f64 / b as f64);
            let to_base = |corner: &Corner| {
                let along = |value: u32, ratio: f64| ((f64::from(value) + 0.5) * ratio - 0.5) as f32;
                [along(corner.x, ratio[0]), along(corner.y, ratio[1])]
            };
            self.find(level, self.quotas[octave], parts, to_base, workspace);
            self.describe(level, workspace, &mut features);
            for corner in &workspace.corners {
                features.pixel.push(to_base(corner));
                features.octave.push(octave as u8);
                features.response.push(corner.score);
            }
        }
        workspace.pyramid = pyramid;
        features
    }

    /// Features of the left picture of a rectified pair, and the disparity of each, pixels of the picture: by how much the
    /// same thing lies farther left in the right picture. `None` without a sure match. `parts` are those of the left picture.
    ///
    /// Panics when a picture does not hold `width * height` values or the two differ in size.
    #[must_use]
    pub fn extract_pair(
        &self,
        left: &GrayImage,
        right: &GrayImage,
        parts: Option<&Parts<'_>>,
        options: &StereoOptions,
        workspace: &mut Workspace,
    ) -> (Features, Buffer<Option<f64>>) {
        assert_eq!((left.width, left.height), (right.width, right.height), "a rectified pair has one size");
        let in_left = self.extract_with(left, parts, workspace);
        std::mem::swap(&mut workspace.pyramid, &mut workspace.left_pyramid);
        let in_right = self.extract_with(right, None, workspace);
        let left = stereo::View { features: &in_left, image: left, pyramid: &workspace.left_pyramid };
        let right = stereo::View { features: &in_right, image: right, pyramid: &workspace.pyramid };
        let disparity = stereo::match_rows(&left, &right, &self.scales, options, &workspace.buffers);
        (in_left, disparity)
    }

    /// Leaves the corners of a level, at most `quota`, in `workspace.corners`.
    fn find(
        &self,
        level: &GrayImage,
        quota: usize,
        parts: Option<&Parts<'_>>,
        to_base: impl Fn(&Corner) -> [f32; 2],
        workspace: &mut Workspace,
    ) {
        corners::score(self.kernels, level, &self.config, &mut workspace.scores, &mut workspace.cell_columns);
        corners::local_maxima(self.kernels, &workspace.scores, level, &mut workspace.peaks, &mut workspace.corners);
        let Some(parts) = parts else {
            spread::spread(&mut workspace.corners, level.width, level.height, quota, &mut workspace.spread);
            return;
        };
        let part = |corner: &Corner| (parts.of_pixel)(to_base(corner));
        let is_preferred = |corner: &Corner| part(corner) == Part::Preferred;
        let (all, preferred) = (&mut workspace.corners, &mut workspace.preferred);
        all.retain(|corner| part(corner) != Part::Useless);
        preferred.clear();
        preferred.extend(all.iter().filter(|corner| is_preferred(corner)));
        let floor = ((quota as f64 * parts.floor).round() as usize).min(preferred.len());
        spread::spread(all, level.width, level.height, quota, &mut workspace.spread);
        if all.iter().filter(|corner| is_preferred(corner)).count() >= floor {
            return;
        }
        spread::spread(preferred, level.width, level.height, floor, &mut workspace.spread);
        all.append(preferred);
        all.sort_unstable_by_key(|corner| (corner.y, corner.x));
        all.dedup_by_key(|corner| (corner.y, corner.x));
    }

    /// Appends direction and descriptor of every corner in `workspace.corners`.
    fn describe(&self, level: &GrayImage, workspace: &mut Workspace, features: &mut Features) {
        let count = workspace.corners.len();
        if count == 0 {
            return;
        }
        workspace.centers.clear();
        workspace.centers.extend(workspace.corners.iter().map(|c| c.y as usize * level.width + c.x as usize));
        workspace.moments.resize(count, Moments::default());
        self.kernels.moments(&level.data, level.width, &workspace.centers, &mut workspace.moments);
        workspace.turns.clear();
        for moments in &workspace.moments {
            let (x, y) = (f64::from(moments.x), f64::from(moments.y));
            let norm = (x * x + y * y).sqrt();
            // The direction vector itself is the cosine and sine; a patch without direction is not turned.
            workspace.turns.push(if norm > 0.0 { [(x / norm) as f32, (y / norm) as f32] } else { [1.0, 0.0] });
            features.angle.push(slam_math::float::atan2(y, x) as f32);
        }
        workspace.blurred.resize(level.data.len(), 0);
        self.kernels.blur(&level.data, level.width, &mut workspace.padded_row, &mut workspace.blurred);
        let start = features.descriptor.len();
        features.descriptor.resize(start + count, [0; 4]);
        let out = &mut features.descriptor[start..];
        self.kernels.describe(&workspace.blurred, level.width, &workspace.centers, &workspace.turns, out);
    }
}
