//! A map of links from arrays: `x_m`, `y_m` and `z_m`, and `snr_db` or `rate_bps` of the shape [N, z, y, x], in memory
//! or as NumPy saves them in an `.npz` file.

use std::io::{Cursor, Read};
use std::path::Path;

use rustc_hash::FxHashMap;
use zip::ZipArchive;
use zip::result::ZipError;

use super::{LevelGrid, LinkMap, MOST_POINTS, NO_LINK, SNRS_DB};
use crate::error::quoted;

/// The extension of the file.
const EXTENSION: &str = "npz";

/// Bytes of an array beside its values, of at most 8 bytes each.
const HEADER_BYTES: u64 = 1 << 16;

/// The first bytes of an array in a file.
const MAGIC: &[u8] = b"\x93NUMPY";

/// An array of a file.
struct NumpyArray {
    shape: Vec<usize>,
    values: Vec<f64>,
}

/// Whether a file is named as one of arrays.
pub(super) fn is_named(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == EXTENSION)
}

/// Reads the map in the bytes of a file, with the `steps` of SNRs.
///
/// # Errors
/// If it is no such file, an array is missing or invalid, or the arrays are no grid.
pub(super) fn read(bytes: &[u8], steps: Option<Vec<[f64; 2]>>) -> Result<LinkMap, String> {
    let expected = "expected arrays x_m, y_m, z_m, and snr_db or rate_bps, saved by numpy.savez";
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("{error}: {expected}"))?;
    let mut array = |name: &str| -> Result<Option<NumpyArray>, String> {
        let file = match archive.by_name(&format!("{name}.npy")) {
            Err(ZipError::FileNotFound) => return Ok(None),
            file => file.map_err(|error| format!("{name}: {error}"))?,
        };
        let mut content = Vec::new();
        file.take(HEADER_BYTES + 8 * MOST_POINTS as u64)
            .read_to_end(&mut content)
            .map_err(|error| format!("{name}: {error}"))?;
        NumpyArray::parse(&content).map(Some).map_err(|message| format!("{name}: {message}"))
    };
    let needed = |name: &str, array: Option<NumpyArray>| array.ok_or_else(|| format!("no array {name}: {expected}"));
    let snrs_db = array("snr_db")?;
    let rates_bps = array("rate_bps")?;
    if snrs_db.is_some() && rates_bps.is_some() {
        return Err(format!("snr_db and rate_bps: {expected}"));
    }
    let are_rates = rates_bps.is_some();
    let levels = needed("snr_db", snrs_db.or(rates_bps))?;
    let mut axes_m = [const { Vec::new() }; 3];
    for (axis_m, name) in axes_m.iter_mut().zip(AXES) {
        *axis_m = needed(name, array(name)?)?.values;
    }
    let steps = steps.filter(|_| !are_rates);
    if !are_rates && steps.is_none() {
        return Err("snr_db: expected the rates of each SNR as link.rates, or rate_bps".to_owned());
    }
    LinkMap::of_arrays(axes_m, &levels.shape, &levels.values, steps)
}

/// The names of the axes.
const AXES: [&str; 3] = ["x_m", "y_m", "z_m"];

impl LinkMap {
    /// The map with the positions `axes_m` of the UAV, east, north and up [m], and `levels` of the `shape`
    /// [N, z, y, x]: SNRs [dB] with the `steps` of their rates, or without them rates [bit/s]; NaN for no link. N is
    /// the number of the SNs, or 1 for all of them.
    ///
    /// # Errors
    /// If a value is out of range, positions do not ascend, or the shape is another.
    pub fn of_arrays(
        axes_m: [Vec<f64>; 3],
        shape: &[usize],
        levels: &[f64],
        steps: Option<Vec<[f64; 2]>>,
    ) -> Result<Self, String> {
        let level = if steps.is_some() { "snr_db" } else { "rate_bps" };
        for (axis_m, name) in axes_m.iter().zip(AXES) {
            let ascends = |pair: &[f64]| pair[0] < pair[1];
            if axis_m.is_empty() || !axis_m.iter().all(|at_m| at_m.is_finite()) || !axis_m.windows(2).all(ascends) {
                return Err(format!("{name}: expected finite numbers that ascend, at least one"));
            }
        }
        let [columns, rows, heights] = axes_m.each_ref().map(Vec::len);
        let count = shape.first().copied().unwrap_or(0);
        if shape != [count, heights, rows, columns] || count == 0 {
            return Err(format!(
                "{level}: shape {shape:?}: expected [N, {heights}, {rows}, {columns}], for z, y and x"
            ));
        }
        let points = shape.iter().try_fold(1usize, |all, along| all.checked_mul(*along));
        if points.is_none_or(|points| points > MOST_POINTS || points != levels.len()) {
            return Err(format!("{level}: shape {shape:?}: expected at most {MOST_POINTS} points"));
        }
        let is_level = |level: &f64| {
            level.is_nan() || if steps.is_some() { SNRS_DB.contains(level) } else { (0.0..=1e300).contains(level) }
        };
        if let Some(wrong) = levels.iter().find(|level| !is_level(level)) {
            let expected = if steps.is_some() { "-300 to 300 dB" } else { "a rate from 0 to 1e300" };
            return Err(format!("{level} = {wrong}: expected {expected}, or nan for no link"));
        }
        let grid = |sensor: usize| {
            let mut of_sensor = Vec::with_capacity(columns * rows * heights);
            for x in 0..columns {
                for y in 0..rows {
                    of_sensor.extend((0..heights).map(|z| {
                        let level = levels[((sensor * heights + z) * rows + y) * columns + x];
                        if level.is_nan() { NO_LINK } else { level }
                    }));
                }
            }
            let highest = of_sensor.iter().copied().fold(NO_LINK, f64::max);
            let name = if count == 1 { String::new() } else { sensor.to_string() };
            (name, LevelGrid { axes_m: axes_m.clone(), levels: of_sensor, highest })
        };
        let mut named: Vec<(String, LevelGrid)> = (0..count).map(grid).collect();
        named.sort_by(|(a, _), (b, _)| a.cmp(b)); // as from a file
        let (names, grids): (Vec<_>, Vec<_>) = named.into_iter().unzip();
        let names = names.into();
        let grids = grids.into();
        Ok(Self { names, are_ids: count > 1, grids, steps, of_places: FxHashMap::default() })
    }
}

impl NumpyArray {
    /// Parses the bytes of an array in NumPy's format 1, 2 or 3, of numbers of 4 or 8 bytes in C order.
    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let expected = "expected an array of numbers in C order, as numpy.savez saves it";
        let refuse = || expected.to_owned();
        let after_magic = bytes.strip_prefix(MAGIC).ok_or_else(refuse)?;
        let (begin, length) = match after_magic {
            [1, _, a, b, ..] => (4, u32::from(u16::from_le_bytes([*a, *b]))),
            [2 | 3, _, a, b, c, d, ..] => (6, u32::from_le_bytes([*a, *b, *c, *d])),
            _ => return Err(refuse()),
        };
        let (header, values) =
            after_magic.get(begin..).and_then(|rest| rest.split_at_checked(length as usize)).ok_or_else(refuse)?;
        let header = std::str::from_utf8(header).map_err(|_| refuse())?;
        let entry = |key: &str| Some(header.split_once(key)?.1.trim_start());
        let quoted_type = entry("'descr':").and_then(|rest| rest.strip_prefix('\'')?.split('\'').next());
        let (width, number): (usize, fn(&[u8]) -> f64) = match quoted_type {
            Some("<f8") => (8, |bytes| f64::from_le_bytes(bytes.try_into().expect("8 bytes"))),
            Some("<f4") => (4, |bytes| f32::from_le_bytes(bytes.try_into().expect("4 bytes")).into()),
            Some("<i8") => (8, |bytes| i64::from_le_bytes(bytes.try_into().expect("8 bytes")) as f64),
            Some("<i4") => (4, |bytes| i32::from_le_bytes(bytes.try_into().expect("4 bytes")).into()),
            other => {
                let found = other.map(quoted).unwrap_or_default();
                return Err(format!("type `{found}`: expected <f8, <f4, <i8 or <i4"));
            }
        };
        if !entry("'fortran_order':").is_some_and(|rest| rest.starts_with("False")) {
            return Err(refuse());
        }
        let sides = entry("'shape':").and_then(|rest| rest.strip_prefix('(')?.split(')').next()).ok_or_else(refuse)?;
        let sides = sides.split(',').map(str::trim).filter(|side| !side.is_empty());
        let shape = sides.map(str::parse).collect::<Result<Vec<usize>, _>>().map_err(|_| refuse())?;
        let points = shape.iter().try_fold(1usize, |all, along| all.checked_mul(*along));
        if points.and_then(|points| points.checked_mul(width)) != Some(values.len()) {
            return Err(format!("shape {shape:?}: expected as many values, at most {MOST_POINTS}"));
        }
        Ok(Self { shape, values: values.chunks_exact(width).map(number).collect() })
    }
}

#[cfg(test)]
mod tests;
