//! Numbers with units, short enough for a table.

/// Prefixes of units, the largest first.
const PREFIXES: [(f64, &str); 5] = [(1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, "")];

/// Formats a quantity with three digits and a prefix: `5.88 Mbit`. Lengths below 10 km are in metres. Numbers below 1
/// have at most four decimals.
pub fn scaled(value: f64, unit: &str) -> String {
    let least = if unit == "m" { 1e4 } else { 1e3 };
    let prefix = PREFIXES.into_iter().find(|&(size, _)| value.abs() >= size && value.abs() >= least);
    let (size, prefix) = prefix.unwrap_or((1.0, ""));
    format!("{} {prefix}{unit}", short(value / size))
}

/// Formats a fraction in percent.
pub fn percent(fraction: f64) -> String {
    format!("{} %", short(100.0 * fraction))
}

/// Formats a number with three significant digits, or all integer digits, without trailing zeros.
pub fn short(value: f64) -> String {
    let digits = value.abs().log10().floor();
    let decimals = if digits.is_finite() { (2.0 - digits).clamp(0.0, 4.0) as usize } else { 0 };
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Formats a range, or one value if both ends are equal.
pub fn joined([low, high]: [String; 2]) -> String {
    if low == high { low } else { format!("{low} to {high}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_has_three_digits_and_a_prefix() {
        assert_eq!(scaled(5_876_543.0, "bit"), "5.88 Mbit");
        assert_eq!(scaled(30_000.0, "bit"), "30 kbit");
        assert_eq!(scaled(999.0, "bit"), "999 bit");
        assert_eq!(scaled(0.0, "bit"), "0 bit");
        assert_eq!(scaled(-2.0, "m"), "-2 m");
        assert_eq!(scaled(1234.5, "m"), "1234 m"); // one unit for all lengths of a field, for comparison
        assert_eq!(scaled(12_345.0, "m"), "12.3 km");
        assert_eq!(percent(0.166_66), "16.7 %");
        assert_eq!(percent(0.000_004), "0.0004 %");
    }

    #[test]
    fn a_range_of_equal_ends_is_one_number() {
        assert_eq!(joined([1.0, 1.000_1].map(short)), "1");
        assert_eq!(joined([1.0, 2.5].map(short)), "1 to 2.5");
    }
}
