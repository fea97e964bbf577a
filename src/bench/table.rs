//! The report as tables that a person can read: a column for each key of a row.

use std::fmt;

use toml::{Table, Value};

use super::Report;
use crate::report;

impl fmt::Display for Report {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = Table::try_from(self).expect("plain keys and values");
        for (part, value) in report {
            match value {
                Value::Array(rows) => show(formatter, &part, &rows)?,
                Value::Table(mut row) => {
                    for rows in row.values().filter_map(Value::as_array) {
                        show(formatter, &part, rows)?;
                    }
                    row.retain(|_, value| !value.is_array());
                    show(formatter, &part, &[Value::Table(row)])?;
                }
                value => write!(formatter, "skysink {part} {}", text(&part, &value))?,
            }
        }
        Ok(())
    }
}

/// Writes the rows of a part as a table. The first distribution of a row is shown whole, the others, which it is compared
/// with, by median and 99th percentile.
fn show(formatter: &mut fmt::Formatter<'_>, part: &str, rows: &[Value]) -> fmt::Result {
    let mut table = report::table();
    for row in rows.iter().filter_map(Value::as_table) {
        let mut header = Vec::new();
        let mut cells = Vec::new();
        let mut quantiles = usize::MAX;
        for (key, value) in row {
            let heading = key.trim_end_matches("_us").replace('_', " ");
            if let Value::Table(spread) = value {
                for (key, value) in spread.iter().take(quantiles) {
                    let quantile = key.trim_end_matches("_us");
                    header.push(if quantile == "p50" { format!("{heading} p50") } else { quantile.to_owned() });
                    cells.push(text(key, value));
                }
                quantiles = 2;
            } else {
                header.push(heading);
                cells.push(text(key, value));
            }
        }
        table.set_header(header).add_row(cells);
    }
    write!(formatter, "\n\n{part}\n{}", report::with_numbers_right(table))
}

/// A single value: a time, if its key ends so, or a ratio.
fn text(key: &str, value: &Value) -> String {
    match value {
        Value::Float(time_us) if key.ends_with("_us") => us(*time_us),
        Value::Float(number) => ratio(*number),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// A time, to three digits.
fn us(us: f64) -> String {
    match us {
        ..1.0 => format!("{:.0} ns", us * 1e3),
        ..10.0 => format!("{us:.2} µs"),
        ..100.0 => format!("{us:.1} µs"),
        ..1_000.0 => format!("{us:.0} µs"),
        ..10_000.0 => format!("{:.2} ms", us / 1e3),
        ..100_000.0 => format!("{:.1} ms", us / 1e3),
        _ => format!("{:.0} ms", us / 1e3),
    }
}

fn ratio(ratio: f64) -> String {
    match ratio {
        ..100.0 => format!("{ratio:.2}"),
        _ => format!("{ratio:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::{ratio, us};

    #[test]
    fn times_are_said_in_three_digits() {
        let said = [0.05, 1.234, 56.78, 567.8, 5_678.0, 56_780.0, 567_800.0].map(us);
        assert_eq!(said, ["50 ns", "1.23 µs", "56.8 µs", "568 µs", "5.68 ms", "56.8 ms", "568 ms"]);
        assert_eq!([0.914, 12.34, 1234.5].map(ratio), ["0.91", "12.34", "1234"]);
    }
}
