//! Terrain (decision D37): an Esri ASCII grid of heights, whether a UAV is in sight over it, and the ground that is too
//! high to be flown over.
//!
//! The header has `ncols`, `nrows`, `xllcorner` and `yllcorner`, or `xllcenter` and `yllcenter`, `cellsize`, and
//! optionally `NODATA_value`; the first row of heights is the northernmost. GDAL writes it of other formats
//! (`gdal_translate -of AAIGrid`).

use std::path::Path;

use nalgebra::Point3;
use skysink_common::error::{InputError, quoted, read_text};
use skysink_common::geodata::ReferenceSystem;
use skysink_common::geometry::Position;

/// The kind of input in error messages.
const WHAT: &str = "terrain";

/// Most cells of a grid.
const MOST_CELLS: usize = 100_000_000;

/// Side of a cell below which it is one of degrees.
const LEAST_CELL_M: f64 = 0.1;

/// Largest side of a cell, and distance of the corner from the origin [m].
const MOST_CELL_M: f64 = 1e6;
const MOST_CORNER_M: f64 = 1e9;

/// The height that stands for none in a grid that does not say which.
const NO_HEIGHT: f64 = -9999.0;

/// The keys of a header; either the corner or the centre of the cell in the south-west.
const KEYS: [&str; 8] = ["ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", NODATA];
const NODATA: &str = "nodata_value";

/// Heights of the ground over square cells.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightGrid {
    /// The south-west corner of all cells [m].
    pub corner: Position,
    /// Side of a cell [m].
    pub cell_m: f64,
    /// Cells to the east and to the north.
    pub cells: [usize; 2],
    /// Heights in the middle of the cells [m], by row from the south; NaN for none.
    pub heights_m: Vec<f64>,
}

impl HeightGrid {
    /// Reads the file `path`.
    ///
    /// # Errors
    /// If it cannot be read, is no grid, or has cells in degrees.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = read_text(WHAT, path)?;
        let refuse = |message: String| InputError::new(WHAT, path, message);
        let grid = Self::parse(&text).map_err(refuse)?;
        match ReferenceSystem::beside(path) {
            Some(system) if !system.is_projected => Err(refuse(format!("{system}: {METRES}"))),
            Some(system) if system.no_metres.is_some() => {
                Err(refuse(format!("{system}: {}: {METRES}", system.no_metres.as_deref().unwrap_or_default())))
            }
            _ => Ok(grid),
        }
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut header = [None; KEYS.len()];
        let mut lines = 0;
        for (index, line) in text.lines().enumerate() {
            let mut words = line.split_whitespace();
            let is_key =
                |word: &&str| word.starts_with(|c: char| c.is_ascii_alphabetic()) && word.parse::<f64>().is_err();
            let Some(key) = words.next().filter(is_key) else { break };
            let known = KEYS.iter().position(|name| name.eq_ignore_ascii_case(key));
            let may_be = |value: &f64| value.is_finite() || key.eq_ignore_ascii_case(NODATA); // GDAL writes `nan`
            let value = words.next().and_then(|word| word.parse().ok()).filter(may_be);
            let (Some(known), Some(value), None) = (known, value, words.next()) else {
                let expected = "expected ncols, nrows, xllcorner, yllcorner, cellsize or NODATA_value, and a number";
                return Err(format!("line {}: `{}`: {expected}", index + 1, quoted(line)));
            };
            header[known] = Some(value);
            lines = index + 1;
        }
        let [columns, rows, west, south, west_centre, south_centre, cell, no_height] = header;
        let needed =
            |value: Option<f64>, key: &str| value.ok_or_else(|| format!("no {key}: expected it in the header"));
        let count = |value: Option<f64>, key: &str| match needed(value, key)? {
            count if count >= 1.0 && count.fract() == 0.0 && count <= MOST_CELLS as f64 => Ok(count as usize),
            other => Err(format!("{key} = {other:?}: expected a whole number of cells, at least 1")),
        };
        let cells = [count(columns, "ncols")?, count(rows, "nrows")?];
        let all = cells[0].checked_mul(cells[1]).filter(|all| *all <= MOST_CELLS);
        let all = all.ok_or_else(|| format!("ncols, nrows = {cells:?}: expected at most {MOST_CELLS} cells"))?;
        let cell_m = needed(cell, "cellsize")?;
        if !(LEAST_CELL_M..=MOST_CELL_M).contains(&cell_m) {
            let are_degrees = cell_m < LEAST_CELL_M;
            let degrees = if are_degrees { format!("; degrees? {METRES}") } else { String::new() };
            return Err(format!("cellsize = {cell_m:?}: expected {LEAST_CELL_M} to {MOST_CELL_M:e} m{degrees}"));
        }
        let of_centre = |centre: Option<f64>| centre.map(|along_m| along_m - cell_m / 2.0);
        let side_m = |value: Option<f64>, key: &str| match needed(value, key)? {
            along_m if along_m.abs() <= MOST_CORNER_M => Ok(along_m),
            along_m => Err(format!("{key} = {along_m:?}: expected -{MOST_CORNER_M:e} to {MOST_CORNER_M:e} m")),
        };
        let west_m = side_m(west.or(of_centre(west_centre)), "xllcorner")?;
        let corner = Position::new(west_m, side_m(south.or(of_centre(south_centre)), "yllcorner")?);
        let no_height = no_height.unwrap_or(NO_HEIGHT);
        let words = text.lines().enumerate().skip(lines);
        let words = words.flat_map(|(index, line)| line.split_whitespace().map(move |word| (index + 1, word)));
        let mut from_north = Vec::with_capacity(all.min(text.len() / 2 + 1));
        let is_missing = |height_m: f64| height_m == no_height || height_m.is_nan() && no_height.is_nan();
        for (line, word) in words {
            let height_m = word.parse().ok().filter(|height_m: &f64| height_m.abs() <= 1e6 || is_missing(*height_m));
            let height_m = height_m.ok_or_else(|| format!("line {line}: `{}`: expected a height [m]", quoted(word)))?;
            from_north.push(if is_missing(height_m) { f64::NAN } else { height_m });
        }
        if from_north.len() != all {
            let [columns, rows] = cells;
            return Err(format!("{} heights: expected ncols × nrows = {columns} × {rows}", from_north.len()));
        }
        let heights_m = from_north.chunks_exact(cells[0]).rev().flatten().copied().collect();
        Ok(Self { corner, cell_m, cells, heights_m })
    }

    /// The cells over the rectangle from the origin to `sides_m` [m] of an area whose coordinates are those of the grid
    /// and `shift` [m].
    ///
    /// # Errors
    /// If there is not a height in each of them.
    pub fn over(&self, sides_m: [f64; 2], shift: [f64; 2]) -> Result<Self, String> {
        let corner = self.corner + nalgebra::Vector2::from(shift);
        let end = |axis: usize| corner[axis] + self.cells[axis] as f64 * self.cell_m;
        let slack_m = 1e-6 * self.cell_m;
        if (0..2).any(|axis| corner[axis] > slack_m || end(axis) < sides_m[axis] - slack_m) {
            let spans =
                |from_m: f64, to_m: f64, axis: usize| format!("{} to {}", from_m - shift[axis], to_m - shift[axis]);
            let found = [0, 1].map(|axis| spans(corner[axis], end(axis), axis));
            let expected = [0, 1].map(|axis| spans(0.0, sides_m[axis], axis));
            return Err(format!(
                "x = {}, y = {} m: expected the ground under all of the area, x = {}, y = {} m",
                found[0], found[1], expected[0], expected[1]
            ));
        }
        let first = [0, 1].map(|axis| ((-corner[axis] / self.cell_m) as usize).min(self.cells[axis] - 1));
        let last = [0, 1].map(|axis| {
            let cell = ((sides_m[axis] - corner[axis]) / self.cell_m).ceil() as usize;
            cell.clamp(first[axis] + 1, self.cells[axis])
        });
        let mut heights_m = Vec::new();
        for row in first[1]..last[1] {
            heights_m.extend_from_slice(&self.heights_m[row * self.cells[0]..][first[0]..last[0]]);
        }
        let cells = [last[0] - first[0], last[1] - first[1]];
        if let Some(hole) = heights_m.iter().position(|height_m| height_m.is_nan()) {
            let [column, row] = [hole % cells[0] + first[0], self.cells[1] - 1 - (hole / cells[0] + first[1])];
            return Err(format!(
                "row {} of the heights, column {}: NODATA_value: expected a height in all of the area",
                row + 1,
                column + 1
            ));
        }
        let begin = Position::new(first[0] as f64, first[1] as f64) * self.cell_m;
        Ok(Self { corner: corner + begin.coords, cell_m: self.cell_m, cells, heights_m })
    }

    /// A position in cells from the middle of the one in the south-west.
    fn in_cells(&self, at: &Position) -> [f64; 2] {
        [0, 1].map(|axis| (at[axis] - self.corner[axis]) / self.cell_m - 0.5)
    }

    fn cell(&self, column: usize, row: usize) -> f64 {
        self.heights_m[row * self.cells[0] + column]
    }

    /// The height of the ground [m], bilinear between the middles of cells and constant beyond the outer ones; `None`
    /// outside of the grid, or without a height.
    pub fn height_m(&self, at: &Position) -> Option<f64> {
        let end = |axis: usize| self.cells[axis] as f64 - 0.5;
        let in_cells = self.in_cells(at);
        if (0..2).any(|axis| !(-0.5..=end(axis)).contains(&in_cells[axis])) {
            return None;
        }
        let [(west, east, eastward), (south, north, northward)] = [0, 1].map(|axis| {
            let along = in_cells[axis].clamp(0.0, (self.cells[axis] - 1) as f64);
            let low = along as usize;
            (low, (low + 1).min(self.cells[axis] - 1), along - along.floor())
        });
        let between =
            |low: f64, high: f64, fraction: f64| if fraction == 0.0 { low } else { low + fraction * (high - low) };
        let along = |row: usize| between(self.cell(west, row), self.cell(east, row), eastward);
        let height_m = if northward == 0.0 { along(south) } else { between(along(south), along(north), northward) };
        height_m.is_finite().then_some(height_m)
    }

    /// Whether all heights are the same.
    pub fn is_flat(&self) -> bool {
        self.heights_m.iter().all(|height_m| *height_m == self.heights_m[0])
    }

    /// The cells that are higher than `limit_m`, by row from the south.
    pub fn above(&self, limit_m: f64) -> Vec<bool> {
        self.heights_m.iter().map(|height_m| *height_m > limit_m).collect()
    }

    /// Whether a UAV is in sight from a point: the ray between them passes above the higher end of every edge that it
    /// crosses between the middles of neighbouring cells.
    pub fn is_in_sight(&self, from: &Point3<f64>, uav: &Point3<f64>) -> bool {
        let [begin, end] = [from, uav].map(|point| self.in_cells(&point.xy()));
        (0..2).all(|axis| {
            let across = 1 - axis;
            let run = end[axis] - begin[axis];
            let lines = || {
                let [low, high] = [begin[axis].min(end[axis]), begin[axis].max(end[axis])];
                let last = high.min((self.cells[axis] - 1) as f64).floor();
                (low.max(0.0).ceil() as usize..).take_while(move |line| *line as f64 <= last)
            };
            run == 0.0
                || lines().all(|line| {
                    let part = (line as f64 - begin[axis]) / run;
                    let at = begin[across] + part * (end[across] - begin[across]);
                    let at = at.clamp(0.0, (self.cells[across] - 1) as f64);
                    let height_m = |at: f64| match axis {
                        0 => self.cell(line, at as usize),
                        _ => self.cell(at as usize, line),
                    };
                    let edge_m = height_m(at.floor()).max(height_m(at.ceil()));
                    part <= 0.0 || from.z + part * (uav.z - from.z) > edge_m
                })
        })
    }
}

/// What a grid has to have.
const METRES: &str = "expected metres, as gdalwarp -t_srs EPSG:32633 makes them for zone 33 of UTM";

#[cfg(test)]
mod tests;
