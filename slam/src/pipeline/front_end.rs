//! What can be done with a frame alone: a pure function that a pool may run ahead of tracking.

use std::sync::Arc;

use slam_vision::{OrbExtractor, Parts, StereoOptions, Workspace};

use super::SlamError;
use super::shares::LabelParts;
use crate::config::Config;
use crate::context::Context;
use crate::input::{FrameInput, Sensor, Setup};
use crate::observation::Observation;

/// Turns frames into observations. Cheap to clone, shared by threads.
#[derive(Clone)]
pub struct FrontEnd {
    ctx: Arc<Context>,
    extractor: Arc<OrbExtractor>,
}

impl FrontEnd {
    pub(super) fn new(config: &Config, setup: &Setup) -> Result<Self, SlamError> {
        setup.camera.validate()?;
        let extractor = OrbExtractor::new(&config.orb.to_extractor())?;
        let ctx = Context::new(config, setup, extractor.scales());
        Ok(Self { ctx: Arc::new(ctx), extractor: Arc::new(extractor) })
    }

    /// Configuration, calibration and tables.
    #[must_use]
    pub fn context(&self) -> &Context {
        &self.ctx
    }

    pub(super) fn shared_context(&self) -> Arc<Context> {
        Arc::clone(&self.ctx)
    }

    /// Features of a frame with depth and labels. `workspace` only saves allocations.
    ///
    /// # Errors
    /// Pictures of another size than the calibration's, or with more or fewer pixels than their size says.
    pub fn observe(&self, input: &FrameInput, workspace: &mut Workspace) -> Result<Observation, SlamError> {
        let gray = &input.gray;
        self.check_size(input, "picture", gray.width, gray.height, gray.data.len())?;
        if let Some(right) = &input.right {
            self.check_size(input, "right picture", right.width, right.height, right.data.len())?;
        }
        if let Some(depth) = &input.depth {
            self.check_size(input, "depth image", depth.width, depth.height, depth.units.len())?;
        }
        if let Some(mask) = &input.panoptic {
            self.check_size(input, "panoptic mask", mask.width, mask.height, mask.ids.len())?;
        }
        let mask = input.panoptic.as_deref().filter(|_| self.ctx.config.panoptic.stuff_floor > 0.0);
        Ok(match mask.map(|mask| LabelParts::new(&self.ctx, mask)) {
            Some(shares) => shares.with(|parts| self.extract(input, Some(parts), workspace)),
            None => self.extract(input, None, workspace),
        })
    }

    fn extract(&self, input: &FrameInput, parts: Option<&Parts<'_>>, workspace: &mut Workspace) -> Observation {
        let camera = &self.ctx.camera;
        let (Sensor::Stereo { bf }, Some(right)) = (self.ctx.sensor, &input.right) else {
            let features = self.extractor.extract_with(&input.gray, parts, workspace);
            return Observation::new(features, input, camera, &self.ctx.config.sensor, &workspace.buffers);
        };
        let options = self.stereo_options();
        let (features, disparity) = self.extractor.extract_pair(&input.gray, right, parts, &options, workspace);
        let depth_m = workspace.buffers.collect(disparity.iter().map(|d| d.map_or(0.0, |d| bf / d)));
        Observation::with_depth(features, depth_m, input.panoptic.as_deref(), camera, &workspace.buffers)
    }

    fn stereo_options(&self) -> StereoOptions {
        let s = &self.ctx.config.stereo;
        StereoOptions {
            hamming: s.hamming,
            row_px: s.row_px,
            window_px: s.window_px as usize,
            slide_px: s.slide_px as usize,
            outlier_factor: s.outlier_factor,
            // Nothing is nearer than the two cameras are to each other.
            max_disparity_px: self.ctx.camera.fx,
        }
    }

    fn check_size(
        &self,
        input: &FrameInput,
        what: &'static str,
        width: usize,
        height: usize,
        pixels: usize,
    ) -> Result<(), SlamError> {
        let camera = &self.ctx.camera;
        let (expected_width, expected_height) = (camera.width, camera.height);
        if width != expected_width as usize || height != expected_height as usize {
            return Err(SlamError::Size { frame: input.id.0, what, width, height, expected_width, expected_height });
        }
        if pixels != width * height {
            return Err(SlamError::Pixels { frame: input.id.0, what, pixels, expected: width * height });
        }
        Ok(())
    }
}
