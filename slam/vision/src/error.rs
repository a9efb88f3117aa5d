//! What can be wrong with the inputs of this crate.

/// An input that the vision layer refuses.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VisionError {
    /// The buffer does not hold the promised number of elements.
    #[error("an image of {width} x {height} needs {expected} values, the buffer holds {found}")]
    BufferSize {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Number of values that the size asks for (`usize::MAX` when the product overflows).
        expected: usize,
        /// Number of values given.
        found: usize,
    },
    /// A setting of the extractor is out of range.
    #[error("ORB setting `{name}` = {value} is out of range: it must be {allowed}")]
    Config {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range, in words.
        allowed: &'static str,
    },
    /// A camera parameter is not usable.
    #[error("camera parameter `{name}` = {value} is not usable: it must be {allowed}; correct the calibration")]
    Camera {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range, in words.
        allowed: &'static str,
    },
}
