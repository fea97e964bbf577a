//! The map of links under a trajectory, in bands of equal width of its level: SNR or rate.

use skysink_common::interpolation::interpolate;
use svg::node::element::{Group, Path};

use super::axis::Panel;

/// Number of bands.
pub const BANDS: usize = 8;

/// How far a cell reaches under the next ones [units], so that antialiasing shows no seams.
const OVERLAP: f64 = 0.6;

/// The levels of the links at the places of an area.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelMap {
    /// What the levels are, with their unit.
    pub label: String,
    /// Side of a cell [m].
    pub cell_m: f64,
    /// The levels in the middles of the cells by row from the south, each from the west; `None` without a link.
    pub rows: Vec<Vec<Option<f64>>>,
}

impl LevelMap {
    /// The lowest and the highest level; `None` without a link.
    pub fn range(&self) -> Option<[f64; 2]> {
        let levels = || self.rows.iter().flatten().flatten().copied();
        let [low, high] = [levels().fold(f64::INFINITY, f64::min), levels().fold(f64::NEG_INFINITY, f64::max)];
        (low <= high).then_some([low, high])
    }

    /// The cells in the bands of `range`: an area for each band, over those of the lower bands.
    pub fn draw(&self, panel: &Panel, [low, high]: [f64; 2]) -> Group {
        let band =
            |level: f64| ((level - low) / (high - low).max(1e-9) * BANDS as f64).min(BANDS as f64 - 1.0) as usize;
        (0..BANDS).fold(Group::new(), |group, lowest| {
            let mut data = String::new();
            for (row, levels) in self.rows.iter().enumerate() {
                let mut column = 0;
                for run in
                    levels.chunk_by(|a, b| a.map(|level| band(level) >= lowest) == b.map(|level| band(level) >= lowest))
                {
                    if run[0].is_some_and(|level| band(level) >= lowest) {
                        data += &self.cells(panel, row, column, run.len());
                    }
                    column += run.len();
                }
            }
            if data.is_empty() { group } else { group.add(Path::new().set("d", data).set("fill", tint(lowest))) }
        })
    }

    /// SVG path data of `count` cells of a row.
    fn cells(&self, panel: &Panel, row: usize, column: usize, count: usize) -> String {
        let corner = |column: usize, row: usize| panel.at(column as f64 * self.cell_m, row as f64 * self.cell_m);
        let [left, bottom] = corner(column, row);
        let [right, top] = corner(column + count, row + 1);
        let [width, height] = [right - left + OVERLAP, bottom - top + OVERLAP];
        format!("M{left:.1},{top:.1}h{width:.1}v{height:.1}h-{width:.1}z")
    }
}

/// Colour of a band: light, so that paths and sensors are visible on it, and darker for higher levels (Purples,
/// ColorBrewer).
pub fn tint(band: usize) -> String {
    const ENDS: [f64; 2] = [0.1, 0.6];
    let fraction = band as f64 / (BANDS - 1) as f64;
    format!("#{:x}", colorous::PURPLES.eval_continuous(interpolate(ENDS[0], ENDS[1], fraction)))
}
