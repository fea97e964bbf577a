//! Values of command-line options that several programs read.

use std::str::FromStr;

use crate::geodata::projection::Origin;

/// A parser of numbers by a test that is false for NaN; others are refused as not `expected`.
pub fn number(
    expected: &'static str,
    is_accepted: fn(f64) -> bool,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| {
        let number = text.parse().ok().filter(|&number| is_accepted(number));
        number.ok_or_else(|| format!("expected {expected}"))
    }
}

/// A parser of finite numbers above 0.
pub fn positive() -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    number("a number above 0", |number| number > 0.0 && number.is_finite())
}

/// `LAT,LON` [°].
impl FromStr for Origin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pair = text.split_once(',');
        pair.and_then(|(lat, lon)| Some(Self { lat_deg: lat.trim().parse().ok()?, lon_deg: lon.trim().parse().ok()? }))
            .filter(|origin| (-90.0..=90.0).contains(&origin.lat_deg) && (-180.0..=180.0).contains(&origin.lon_deg))
            .ok_or_else(|| {
                "expected a latitude, -90 to 90, and a longitude, -180 to 180, such as 47.3977,8.5456".to_owned()
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_accepted_by_the_test_alone() {
        let fraction = number("a fraction from 0 to 1", |number| (0.0..=1.0).contains(&number));
        assert_eq!(["0", "1", "5e-1"].map(&fraction), [0.0, 1.0, 0.5].map(Ok));
        for text in ["", "NaN", "-0.1", "1.1", "inf", "one", "0,5"] {
            assert_eq!(fraction(text), Err("expected a fraction from 0 to 1".to_owned()), "{text}");
        }
        assert!(["0", "inf", "-1", "NaN"].iter().all(|text| positive()(text).is_err()) && positive()("1e-9").is_ok());
    }

    #[test]
    fn origins_are_latitude_and_longitude() {
        assert_eq!(" -90, 180 ".parse(), Ok(Origin { lat_deg: -90.0, lon_deg: 180.0 }));
        for text in ["", "1", "90.1,0", "0,-180.1", "NaN,0", "0,NaN", "1;2", "1,2,3"] {
            assert!(text.parse::<Origin>().is_err(), "{text}");
        }
    }
}
