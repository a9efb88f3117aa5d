//! Floating point functions with one answer on every CPU.
//!
//! `std`'s sine, exponential and so on call the system's libm, whose results differ between CPUs with and without FMA.
//! The crate `libm` is plain Rust: additions, multiplications, divisions and square roots only.

/// Sine of `x` radians.
#[must_use]
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}

/// Cosine of `x` radians.
#[must_use]
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// Tangent of `x` radians.
#[must_use]
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}

/// Angle of the vector `(x, y)` in `(-pi, pi]` radians.
#[must_use]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Arc cosine in radians; the argument is clamped to [-1, 1], so rounding can't give NaN.
#[must_use]
pub fn acos(x: f64) -> f64 {
    libm::acos(x.clamp(-1.0, 1.0))
}

/// Arc sine in radians; the argument is clamped to [-1, 1].
#[must_use]
pub fn asin(x: f64) -> f64 {
    libm::asin(x.clamp(-1.0, 1.0))
}

/// `e^x`.
#[must_use]
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// `e^x - 1`, exact near zero.
#[must_use]
pub fn exp_m1(x: f64) -> f64 {
    libm::expm1(x)
}

/// Natural logarithm.
#[must_use]
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// `x^y`.
#[must_use]
pub fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// The smaller of two numbers; `a` when they compare equal or are unordered.
#[must_use]
pub fn min(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}

/// The larger of two numbers; `a` when they compare equal or are unordered.
#[must_use]
pub fn max(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// Median of the values (the lower one of the two middle values), or `None` for an empty slice. Reorders the slice.
pub fn median_in_place(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = (values.len() - 1) / 2;
    let (_, m, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn min_and_max_prefer_the_first_on_ties() {
        assert!(min(0.0, -0.0).is_sign_positive());
        assert!(max(-0.0, 0.0).is_sign_negative());
        assert_eq!(min(1.0, f64::NAN), 1.0);
    }

    #[test]
    fn median_is_the_lower_middle() {
        assert_eq!(median_in_place(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median_in_place(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.0));
        assert_eq!(median_in_place(&mut []), None);
    }

    /// Golden bits: a platform whose libm differs fails here first.
    #[test]
    fn transcendental_bits_are_pinned() {
        assert_eq!(sin(0.7).to_bits(), 0x3fe4_9d6e_6946_19b8);
        assert_eq!(exp(0.7).to_bits(), 0x4000_1c2a_6126_8987);
        assert_eq!(atan2(0.3, -0.4).to_bits(), 0x4003_fc17_6b7a_8560);
    }
}
