//! Numbers as printed reports show them.

/// A whole number with its thousands separated.
#[must_use]
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index) % 3 == 0 {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number with six decimals, or fewer if it is large.
#[must_use]
pub fn figure(number: f64) -> String {
    match number.abs() {
        ..10.0 => format!("{number:.6}"),
        10.0..1e4 => format!("{number:.2}"),
        1e4..1e9 => format!("{number:.0}"),
        _ => format!("{number:.4e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_separated() {
        let counts = [0, 999, 1_000, 12_345, 123_456, 1_234_567];
        assert_eq!(counts.map(grouped), ["0", "999", "1,000", "12,345", "123,456", "1,234,567"]);
    }
}
