//! Tables in CSV that a scenario names: all columns are known, in any order. Their rows may be the points of a grid.

use serde::de::DeserializeOwned;

use crate::error::{line_of, quoted};

/// The three axes of a grid, each ascending, that has all `points`, which are sorted, once. Messages name a point as
/// `named` does.
pub(crate) fn grid_axes(points: &[[f64; 3]], named: impl Fn([f64; 3]) -> String) -> Result<[Vec<f64>; 3], String> {
    let axes = [0, 1, 2].map(|axis| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.dedup();
        values
    });
    if let Some(pair) = points.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(format!("{} twice: expected it once", named(pair[0])));
    }
    let [first, second, third] = &axes;
    let mut found = points.iter();
    for &x in first {
        for &y in second {
            for &z in third {
                if found.next() != Some(&[x, y, z]) {
                    return Err(format!("no row with {}: expected one for each point of the grid", named([x, y, z])));
                }
            }
        }
    }
    Ok(axes)
}

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
