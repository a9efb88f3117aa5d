//! Time as a whole number of nanoseconds.

use serde::{Deserialize, Serialize};
use std::fmt;

const NANOS_PER_SECOND: i128 = 1_000_000_000;
/// Digits beyond this cannot matter for an `i64` of nanoseconds and are refused before any arithmetic.
const MAX_TEXT_BYTES: usize = 80;

/// A time in nanoseconds on the log's one timeline (for imported data sets: the source's own epoch).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct Stamp(pub i64);

/// Why a decimal text is not a stamp.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StampError {
    /// Not a decimal number.
    #[error("`{0}` is not a time in decimal seconds, like 1600000006.666667")]
    NotANumber(String),
    /// More than nine decimals that are not zero.
    #[error("`{0}` is finer than a nanosecond and cannot be kept exactly")]
    TooFine(String),
    /// Beyond what 64 bits of nanoseconds hold (about ±292 years).
    #[error("`{0}` s does not fit into 64 bits of nanoseconds")]
    OutOfRange(String),
    /// The ROS message time has 31 bits of seconds and none below zero.
    #[error("{0} ns does not fit a ROS time (0 <= seconds < 2^31)")]
    NotRosTime(i64),
}

impl Stamp {
    /// Reads seconds in decimal (`1600000006.666667`, also `1.6e9`) without any floating point.
    ///
    /// # Errors
    /// Text that is no number, does not fit, or has digits below one nanosecond.
    pub fn from_decimal(text: &str) -> Result<Self, StampError> {
        match Self::from_decimal_rounded(text)? {
            (stamp, true) => Ok(stamp),
            (_, false) => Err(StampError::TooFine(text.to_owned())),
        }
    }

    /// As [`Stamp::from_decimal`], but rounds digits below a nanosecond (half away from zero); the flag tells whether
    /// the text was kept exactly.
    ///
    /// # Errors
    /// Text that is no number or does not fit.
    pub fn from_decimal_rounded(text: &str) -> Result<(Self, bool), StampError> {
        let not_a_number = || StampError::NotANumber(text.to_owned());
        let out_of_range = || StampError::OutOfRange(text.to_owned());
        if text.len() > MAX_TEXT_BYTES {
            return Err(not_a_number());
        }
        let (mantissa, exponent) = match text.find(['e', 'E']) {
            Some(at) => (&text[..at], text[at + 1..].parse::<i32>().map_err(|_| not_a_number())?),
            None => (text, 0),
        };
        let (negative, digits) = match mantissa.as_bytes().first() {
            Some(b'-') => (true, &mantissa[1..]),
            Some(b'+') => (false, &mantissa[1..]),
            _ => (false, mantissa),
        };
        let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
        let all_digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
        if whole.len() + fraction.len() == 0 || !all_digits(whole) || !all_digits(fraction) {
            return Err(not_a_number());
        }
        // The value is 0.DIGITS * 10^point seconds; nanoseconds are the digits up to `point + 9`.
        let point = whole.len() as i64 + i64::from(exponent) + 9;
        let digits: Vec<u8> = whole.bytes().chain(fraction.bytes()).map(|b| b - b'0').collect();
        let digit = |place: i64| usize::try_from(place).ok().and_then(|i| digits.get(i)).copied().unwrap_or(0);
        let leading_zeros = digits.iter().take_while(|d| **d == 0).count();
        if leading_zeros < digits.len() && point - leading_zeros as i64 > 20 {
            return Err(out_of_range());
        }
        let start = leading_zeros as i64;
        let mut nanos = (start..point.max(start)).fold(0_i128, |sum, place| {
            if leading_zeros == digits.len() { 0 } else { sum * 10 + i128::from(digit(place)) }
        });
        let exact = (point.max(0)..digits.len() as i64).all(|place| digit(place) == 0);
        if !exact && point >= 0 && digit(point) >= 5 {
            nanos += 1;
        }
        let signed = if negative { -nanos } else { nanos };
        i64::try_from(signed).map(|n| (Self(n), exact)).map_err(|_| out_of_range())
    }

    /// Seconds with nine decimals: exact, and read back by [`Stamp::from_decimal`] to the same value.
    #[must_use]
    pub fn to_decimal9(self) -> String {
        let nanos = i128::from(self.0);
        let sign = if nanos < 0 { "-" } else { "" };
        let (seconds, rest) = (nanos.abs() / NANOS_PER_SECOND, nanos.abs() % NANOS_PER_SECOND);
        format!("{sign}{seconds}.{rest:09}")
    }

    /// Seconds as a float, for plots and rates only: above 2^53 ns it is not exact.
    #[must_use]
    pub fn as_seconds_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }

    /// Distance to another stamp in nanoseconds, without overflow.
    #[must_use]
    pub fn abs_diff(self, other: Self) -> u64 {
        self.0.abs_diff(other.0)
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.to_decimal9())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn reads_what_data_sets_write() {
        let cases = [
            ("1600000006.666667", 1_600_000_006_666_667_000),
            ("1305031102.1753040", 1_305_031_102_175_304_000),
            ("0", 0),
            ("12", 12_000_000_000),
            (".5", 500_000_000),
            ("7.", 7_000_000_000),
            ("-0.000000001", -1),
            ("1.341839113693333387e+09", 1_341_839_113_693_333_387),
            ("5e-9", 5),
            ("0.0000000010", 1),
            ("000000000000000000000000012.5", 12_500_000_000),
            ("9223372036.854775807", i64::MAX),
            ("-9223372036.854775808", i64::MIN),
            ("0e99", 0),
        ];
        for (text, nanos) in cases {
            assert_eq!(Stamp::from_decimal(text), Ok(Stamp(nanos)), "{text}");
        }
    }

    #[test]
    fn refuses_what_it_cannot_keep() {
        for text in ["", ".", "-", "nan", "1,5", "1 2", "0x10", "1.2.3", "1e", "1e5000000000", "--1", "1e1.5", "é"] {
            assert!(matches!(Stamp::from_decimal(text), Err(StampError::NotANumber(_))), "{text}");
        }
        for text in ["9223372036.854775808", "1e300", "99999999999999999999999"] {
            assert!(matches!(Stamp::from_decimal(text), Err(StampError::OutOfRange(_))), "{text}");
        }
        assert!(matches!(Stamp::from_decimal("1.0000000001"), Err(StampError::TooFine(_))));
        assert!(matches!(Stamp::from_decimal("1e-300"), Err(StampError::TooFine(_))));
        assert_eq!(Stamp::from_decimal_rounded("1.0000000005"), Ok((Stamp(1_000_000_001), false)));
        assert_eq!(Stamp::from_decimal_rounded("1.00000000049"), Ok((Stamp(1_000_000_000), false)));
        assert_eq!(Stamp::from_decimal_rounded("-6e-10"), Ok((Stamp(-1), false)));
        assert_eq!(Stamp::from_decimal_rounded("6e-20"), Ok((Stamp(0), false)));
    }

    proptest! {
        #[test]
        fn text_round_trip_is_exact(nanos: i64) {
            prop_assert_eq!(Stamp::from_decimal(&Stamp(nanos).to_decimal9()), Ok(Stamp(nanos)));
        }

        #[test]
        fn any_text_gives_a_value_or_an_error(text in "[-+]?[0-9]{0,25}\\.?[0-9]{0,25}(e[-+]?[0-9]{0,9})?") {
            let _ = Stamp::from_decimal_rounded(&text);
        }
    }
}
