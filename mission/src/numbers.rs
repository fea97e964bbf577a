//! Numbers of figures: how reports print them, and how evenly they are spread.

/// A whole number with its thousands separated.
#[must_use]
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
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

/// Jain's fairness index, `(Σ x)² / (N Σ x²)`, at most 1 whatever the rounding; 1 if nothing was delivered.
#[must_use]
pub fn jain(values: &[u64]) -> f64 {
    let sum: f64 = values.iter().map(|&value| value as f64).sum();
    let squares: f64 = values.iter().map(|&value| (value as f64).powi(2)).sum();
    if squares > 0.0 { (sum * sum / (values.len() as f64 * squares)).min(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_separated() {
        let counts = [0, 999, 1_000, 12_345, 123_456, 1_234_567];
        assert_eq!(counts.map(grouped), ["0", "999", "1,000", "12,345", "123,456", "1,234,567"]);
    }

    #[test]
    fn fairness_is_1_for_equal_values_and_1_over_n_for_a_single_one() {
        assert_eq!(jain(&[5, 5, 5, 5]), 1.0);
        assert_eq!(jain(&[8, 0, 0, 0]), 0.25);
        assert_eq!(jain(&[1, 2, 3]), 36.0 / 42.0);
    }
}
