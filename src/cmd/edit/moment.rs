//! Moments of a log as people write them.

use schemas::Stamp;
use std::str::FromStr;

/// A moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// Nanoseconds after the first picture.
    Relative(i64),
    /// On the log's own timeline.
    Absolute(Stamp),
}

impl Moment {
    pub fn is_relative(&self) -> bool {
        matches!(self, Self::Relative(_))
    }

    pub fn stamp(&self, first: Stamp) -> Stamp {
        match self {
            Self::Relative(ns) => Stamp(first.0.saturating_add(*ns)),
            Self::Absolute(stamp) => *stamp,
        }
    }
}

impl FromStr for Moment {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.contains(['T', 't']) {
            return rfc3339(text).map(Self::Absolute).ok_or_else(|| {
                format!("`{text}` is no time like 2026-11-27T08:39:54.5Z or 2026-11-27T09:39:54+01:00")
            });
        }
        let seconds = |text: &str| Stamp::from_decimal(text).map_err(|error| error.to_string());
        match (text.strip_suffix("ms"), text.strip_suffix('s')) {
            (Some(number), _) => {
                // Exact: the decimal point moves by three.
                let exponent = if number.contains(['e', 'E']) { Err(number) } else { Ok(format!("{number}e-3")) };
                let exponent = exponent.map_err(|number| format!("`{number}` is no plain decimal number"))?;
                Ok(Self::Relative(seconds(&exponent)?.0))
            }
            (None, Some(number)) => Ok(Self::Relative(seconds(number)?.0)),
            (None, None) => Ok(Self::Absolute(seconds(text)?)),
        }
    }
}

/// A point in time by RFC 3339, as nanoseconds since 1970; none for anything else.
fn rfc3339(text: &str) -> Option<Stamp> {
    let (date, time) = text.split_once(['T', 't'])?;
    let number = |text: &str, digits: usize| -> Option<i64> {
        (text.len() == digits && text.bytes().all(|b| b.is_ascii_digit())).then(|| text.parse().ok())?
    };
    let [year, month, day] = date.splitn(3, '-').collect::<Vec<_>>().try_into().ok()?;
    let (year, month, day) = (number(year, 4)?, number(month, 2)?, number(day, 2)?);
    let zone_at = time.find(['Z', 'z', '+', '-'])?;
    let (clock, zone) = time.split_at(zone_at);
    let offset_minutes = match zone {
        "Z" | "z" => 0,
        _ => {
            let (hours, minutes) = zone[1..].split_once(':')?;
            let minutes = number(hours, 2)? * 60 + number(minutes, 2)?;
            if zone.starts_with('-') { -minutes } else { minutes }
        }
    };
    let (clock, fraction) = clock.split_once('.').unwrap_or((clock, "0"));
    let [hour, minute, second] = clock.splitn(3, ':').collect::<Vec<_>>().try_into().ok()?;
    let (hour, minute, second) = (number(hour, 2)?, number(minute, 2)?, number(second, 2)?);
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let february = if leap { 29 } else { 28 };
    let months = [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let in_month = months.get(usize::try_from(month).ok()?.checked_sub(1)?)?;
    if !(1..=*in_month).contains(&day) || hour > 23 || minute > 59 || second > 60 || offset_minutes.abs() >= 24 * 60 {
        return None;
    }
    let years = year - 1970;
    let leap_days = |year: i64| year / 4 - year / 100 + year / 400;
    let days_before: i64 = months.iter().take(month as usize - 1).sum();
    let days = years * 365 + leap_days(year - 1) - leap_days(1969) + days_before + day - 1;
    let seconds = ((days * 24 + hour) * 60 + minute - offset_minutes) * 60 + second;
    let nanos = Stamp::from_decimal(&format!("0.{fraction}")).ok()?.0;
    Some(Stamp(seconds.checked_mul(1_000_000_000)?.checked_add(nanos)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_read_exactly() {
        let read = |text: &str| text.parse::<Moment>();
        assert_eq!(read("1.5s"), Ok(Moment::Relative(1_500_000_000)));
        assert_eq!(read("250ms"), Ok(Moment::Relative(250_000_000)));
        assert_eq!(read("1600000006.666667"), Ok(Moment::Absolute(Stamp(1_600_000_006_666_667_000))));
        let absolute = |seconds: i64, nanos: i64| Ok(Moment::Absolute(Stamp(seconds * 1_000_000_000 + nanos)));
        // GNU date's answers.
        assert_eq!(read("1970-01-01T00:00:00Z"), absolute(0, 0));
        assert_eq!(read("2026-11-27T08:39:54.5Z"), absolute(1_795_768_794, 500_000_000));
        assert_eq!(read("2026-11-27T09:39:54.5+01:00"), absolute(1_795_768_794, 500_000_000));
        assert_eq!(read("2000-02-29T23:59:59-00:30"), absolute(951_870_599, 0));
        for wrong in [
            "",
            "s",
            "1.5 s",
            "2026-11-27",
            "2026-13-01T00:00:00Z",
            "2026-02-29T00:00:00Z",
            "2026-11-27T08:39Z",
            "2026-11-27T08:39:54",
            "nowT",
            "1e3ms",
            "2026-11-27T24:00:00Z",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
