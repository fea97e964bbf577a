//! Cells of the CSV tables that Skysink writes.

/// A number of a column of real numbers. It parses back exactly, and is written with a point also if it is whole, so
/// that no reader takes the column for one of whole numbers.
#[must_use]
pub fn decimal(value: f64) -> String {
    let text = value.to_string();
    if value.is_finite() && !text.contains('.') { text + ".0" } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_real_number_has_a_point_and_parses_back() {
        for (value, text) in [(0.0, "0.0"), (-0.0, "-0.0"), (20.0, "20.0"), (0.5, "0.5"), (-1e-7, "-0.0000001")] {
            assert_eq!(decimal(value), text);
        }
        for value in [1e300, f64::MIN_POSITIVE, 0.1 + 0.2, -1e16] {
            let text = decimal(value);
            assert!(text.contains('.') && text.parse() == Ok(value), "{text}");
        }
        assert_eq!([f64::INFINITY, f64::NAN].map(decimal), ["inf", "NaN"]);
    }
}
