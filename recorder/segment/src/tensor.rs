//! Numbers with a shape, as networks take and give them.

/// A dense row-major array of 32-bit floats.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Extents, outermost first.
    pub shape: Vec<usize>,
    /// Their product many values.
    pub data: Vec<f32>,
}

impl Tensor {
    /// A tensor, if the values fill the shape.
    #[must_use]
    pub fn new(shape: Vec<usize>, data: Vec<f32>) -> Option<Self> {
        let count = shape.iter().try_fold(1_usize, |count, extent| count.checked_mul(*extent))?;
        (count == data.len()).then_some(Self { shape, data })
    }

    /// Its extents without a leading batch of one, if there are `N` of them.
    pub(crate) fn extents<const N: usize>(&self) -> Option<[usize; N]> {
        let inner = if self.shape.len() == N + 1 && self.shape[0] == 1 { &self.shape[1..] } else { &self.shape };
        inner.try_into().ok().filter(|extents: &[usize; N]| extents.iter().all(|extent| *extent > 0))
    }
}

/// The place of the largest value; of equal ones the first. NaN is never the largest.
pub(crate) fn argmax(values: impl IntoIterator<Item = f32>) -> Option<(usize, f32)> {
    let mut best: Option<(usize, f32)> = None;
    for (at, value) in values.into_iter().enumerate() {
        if best.map_or(!value.is_nan(), |(_, top)| value > top) {
            best = Some((at, value));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_and_values_agree() {
        assert!(Tensor::new(vec![2, 2], vec![0.0; 3]).is_none());
        let tensor = Tensor::new(vec![1, 2, 3], vec![0.0; 6]).unwrap();
        assert_eq!(tensor.extents::<2>(), Some([2, 3]));
        assert_eq!(tensor.extents::<3>(), Some([1, 2, 3]));
        assert_eq!(tensor.extents::<4>(), None);
        assert_eq!(argmax([f32::NAN, 1.0, 3.0, 3.0, f32::NAN]), Some((2, 3.0)));
        assert_eq!(argmax([f32::NAN]), None);
    }
}
