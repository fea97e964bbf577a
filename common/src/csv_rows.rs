//! Tables in CSV that a scenario names: all columns are known, in any order.

use serde::de::DeserializeOwned;

use crate::error::{line_of, quoted};

/// Reads a CSV table that has exactly these `columns`, in any order, as rows in their order. Messages say what is
/// `expected` instead of a row that is of another type or not accepted.
pub(crate) fn read_rows<T: DeserializeOwned>(
    text: &str,
    columns: &[&str],
    expected: &str,
    is_accepted: impl Fn(&T) -> bool,
) -> Result<Vec<T>, String> {
    let listed = |record: &csv::StringRecord| quoted(&record.iter().collect::<Vec<_>>().join(","));
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| format!("line 1: {error}"))?.clone();
    let place = |name: &&str| header.iter().position(|column| column == *name);
    let places = columns.iter().map(place).collect::<Option<Vec<usize>>>();
    let places = places.filter(|places| places.len() == header.len());
    let places = places.ok_or_else(|| format!("header `{}`: expected {}", listed(&header), columns.join(",")))?;
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| {
            let line = line_of(text, error.position());
            format!("line {line}: expected {} fields, as in the header", columns.len())
        })?;
        let ordered: csv::StringRecord = places.iter().map(|&place| &record[place]).collect();
        let row = ordered.deserialize(None).ok().filter(&is_accepted);
        rows.push(row.ok_or_else(|| {
            format!("line {}: `{}`: expected {expected}", line_of(text, record.position()), listed(&record))
        })?);
    }
    Ok(rows)
}
