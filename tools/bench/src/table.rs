//! The report as tables: a column for each key of a row.

use std::time::Duration;

use serde::Serialize;
use skysink::report;
use toml::{Table, Value};

/// The tables of a report: its single values, then a table for each part.
pub fn of(report: &impl Serialize) -> String {
    let mut text = String::new();
    for (part, value) in Table::try_from(report).expect("plain keys and values") {
        match value {
            Value::Array(rows) => text += &table(&part, &rows),
            Value::Table(row) => text += &table(&part, &[Value::Table(row)]),
            value => text += &format!("skysink {part} {}", cell(&part, &value)),
        }
    }
    text
}

/// The rows of a part as a table; a single row as a column, which stays narrow. Of the first distribution of a
/// row the percentiles are shown, of later ones the median.
fn table(part: &str, rows: &[Value]) -> String {
    let mut table = report::table();
    for row in rows.iter().filter_map(Value::as_table) {
        let mut columns = Vec::new();
        let mut quantiles = 3;
        for (key, value) in row {
            let heading = key.trim_end_matches("_us").replace('_', " ");
            let Value::Table(spread) = value else {
                columns.push([heading, cell(key, value)]);
                continue;
            };
            for (key, value) in spread.iter().take(quantiles) {
                let quantile = key.trim_end_matches("_us");
                columns.push([quantile.replace("p50", &format!("{heading} p50")), cell(key, value)]);
            }
            quantiles = 1;
        }
        if rows.len() == 1 {
            table.add_rows(columns);
        } else {
            let [header, cells] = [0, 1].map(|part| columns.iter().map(move |column| column[part].as_str()));
            table.set_header(header).add_row(cells);
        }
    }
    format!("\n\n{part}\n{}", report::with_numbers_from(usize::from(rows.len() == 1), table))
}

/// A single value: a time if its key ends in `_us`, else a ratio.
fn cell(key: &str, value: &Value) -> String {
    match value {
        Value::Float(time_us) if key.ends_with("_us") => {
            // Three digits: 1.23, 12.3 or 123 of a unit.
            let decimals = 2 - (time_us * 1e3).max(1.0).log10() as usize % 3;
            format!("{:.decimals$?}", Duration::try_from_secs_f64(time_us / 1e6).unwrap_or_default())
        }
        Value::Float(ratio) if *ratio < 100.0 => format!("{ratio:.2}"),
        Value::Float(ratio) => format!("{ratio:.0}"),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use skysink_common::pace::Pace;
    use skysink_mission::latency::Spread;
    use skysink_ring::wait::Waiting;

    use super::*;
    use crate::hop::RingCase;
    use crate::ring::RingRow;

    #[test]
    fn the_widest_ring_rows_fit_a_terminal() {
        let case =
            RingCase { sensors: 1_000_000, wait: Waiting::Adaptive, pace: Pace::Factor(200.0), slots: 1, uavs: 1 };
        let times = Spread { p50_us: 12.34, p99_us: 12.34, p999_us: 12.34, max_us: 12.34 };
        let row = || RingRow {
            case,
            slots_per_s: 12_345.0,
            slot: times,
            plan: times,
            hops: times,
            p50_over_floor: 12.34,
            p99_over_p50: 12.34,
        };
        let report = of(&Table::from_iter([("ring".to_owned(), Value::try_from([row(), row()]).unwrap())]));
        assert!(report.lines().all(|line| line.chars().count() <= 80), "{report}");
        for cell in ["1000000", "adaptive", "200x", "12345", "12.3µs", "12.34"] {
            assert!(report.contains(&format!(" {cell} ")), "{cell}: {report}");
        }
    }

    #[test]
    fn times_have_a_unit_and_three_digits_and_ratios_about_as_many() {
        let times = [0.05, 1.234, 567.8, 5_678.0].map(|time_us| cell("p50_us", &Value::Float(time_us)));
        assert_eq!(times, ["50.0ns", "1.23µs", "568µs", "5.68ms"]);
        let ratios = [0.914, 12.34, 1234.5].map(|ratio| cell("ratio", &Value::Float(ratio)));
        assert_eq!(ratios, ["0.91", "12.34", "1234"]);
    }
}
