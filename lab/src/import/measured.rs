//! Links by place from SNRs that were measured at some places: means by bin, and between bins a law of the distance
//! with the residuals of the bins about it.
//!
//! At a node of the grid without a bin, `SNR = a − 10 n lg D + Σ w_k ρ_k / (1 + Σ w_k)` with the residual `ρ_k` of each
//! bin about the law and `w_k = e^{−d_k/l}` of its distance, of which the length `l` is the one that predicts bins best
//! from all others. The sum is that of kriging with one weight, as by arXiv 2603.10362.

use skysink_common::geometry::Position;

/// Path loss exponents of a law.
const EXPONENTS: [f64; 2] = [1.0, 10.0];

/// Path loss exponent of a law of bins that are all at one distance.
const USUAL_EXPONENT: f64 = 2.5;

/// Lengths over which residuals are similar, in sides of a bin.
const LENGTHS: [f64; 6] = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0];

/// Bins that are predicted from the others.
const MOST_PREDICTED: usize = 2_000;

/// The grid of a map at one altitude, whose node (0, 0) is the corner of the area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapGrid {
    /// Between nodes, and the side of a bin about each [m].
    pub step_m: f64,
    /// Nodes to the east and to the north.
    pub nodes: [usize; 2],
    /// Altitude [m].
    pub altitude_m: f64,
}

/// The mean of what was measured of a sensor node nearest to a node of the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredBin {
    node: usize,
    at: Position,
    mean_db: f64,
    /// Number of SNRs, and the sum of the squares of their differences from the mean [dB²].
    count: usize,
    squares_db2: f64,
    /// lg of the slant range in metres from the sensor node.
    log_range: f64,
}

/// What was measured of all sensor nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    grid: MapGrid,
    /// The bins of each sensor node, by node of the grid.
    bins: Vec<Vec<MeasuredBin>>,
    places: Vec<Position>,
    /// Over which residuals are similar, `l` [m].
    pub length_m: f64,
    /// Root mean square of the errors of bins that are predicted from all others [dB], with residuals and by the law
    /// alone.
    pub errors_db: [f64; 2],
}

/// `SNR = snr_db − 10 · exponent · lg D`, with the slant range D [m].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedLaw {
    /// At 1 m [dB].
    pub snr_db: f64,
    /// Path loss exponent.
    pub exponent: f64,
}

/// Sums over bins, from which a law is fitted.
#[derive(Debug, Clone, Copy, Default)]
struct LawSums {
    count: f64,
    logs: f64,
    levels: f64,
    squares: f64,
    products: f64,
}

impl MapGrid {
    /// The grid over an area of these sides [m], with steps of at least `step_m` and at most `most` nodes.
    #[must_use]
    pub fn over(sides_m: [f64; 2], step_m: f64, most: usize, altitude_m: f64) -> Self {
        let mut step_m = step_m;
        loop {
            let nodes = sides_m.map(|side_m| (side_m / step_m).ceil() as usize + 1);
            if nodes[0].saturating_mul(nodes[1]) <= most.max(4) {
                return Self { step_m, nodes, altitude_m };
            }
            step_m = (step_m * 1.1).ceil();
        }
    }

    /// The position of a node [m].
    pub fn position(&self, node: usize) -> Position {
        let [columns, _] = self.nodes;
        Position::new((node % columns) as f64, (node / columns) as f64) * self.step_m
    }

    /// The node that is nearest to a position in the area.
    fn nearest(&self, at: &Position) -> usize {
        let [column, row] = [0, 1].map(|axis| (at[axis] / self.step_m).round().max(0.0) as usize);
        row.min(self.nodes[1] - 1) * self.nodes[0] + column.min(self.nodes[0] - 1)
    }

    /// Positions to the east, to the north and up [m].
    pub fn axes_m(&self) -> [Vec<f64>; 3] {
        let along_m =
            |axis: usize| (0..self.nodes[axis]).map(|node| (node as f64 * self.step_m * 1e3).round() / 1e3).collect();
        [along_m(0), along_m(1), vec![self.altitude_m]]
    }
}

impl LawSums {
    fn add(&mut self, bin: &MeasuredBin, sign: f64) {
        self.count += sign;
        self.logs += sign * bin.log_range;
        self.levels += sign * bin.mean_db;
        self.squares += sign * bin.log_range * bin.log_range;
        self.products += sign * bin.log_range * bin.mean_db;
    }

    fn of<'a>(bins: impl IntoIterator<Item = &'a MeasuredBin>) -> Self {
        let mut sums = Self::default();
        bins.into_iter().for_each(|bin| sums.add(bin, 1.0));
        sums
    }

    /// The law of least squares with an exponent in [`EXPONENTS`].
    fn law(&self) -> FittedLaw {
        let spread = self.squares - self.logs * self.logs / self.count;
        let slope = (self.products - self.logs * self.levels / self.count) / spread;
        let exponent = -slope / 10.0;
        let is_spread = spread > 1e-9 * self.squares && exponent.is_finite();
        let exponent = if is_spread { exponent.clamp(EXPONENTS[0], EXPONENTS[1]) } else { USUAL_EXPONENT };
        FittedLaw { snr_db: (self.levels + 10.0 * exponent * self.logs) / self.count, exponent }
    }
}

impl FittedLaw {
    fn level_db(&self, log_range: f64) -> f64 {
        self.snr_db - 10.0 * self.exponent * log_range
    }
}

/// The correction of a law at `at` by the residuals of `bins`.
fn correction_db<'a>(
    law: &FittedLaw,
    bins: impl Iterator<Item = &'a MeasuredBin>,
    at: &Position,
    length_m: f64,
) -> f64 {
    let mut weights = 1.0;
    let mut residuals_db = 0.0;
    for bin in bins {
        let weight = (-(bin.at - at).norm() / length_m).exp();
        weights += weight;
        residuals_db += weight * (bin.mean_db - law.level_db(bin.log_range));
    }
    residuals_db / weights
}

impl Measured {
    /// What was measured, `(sensor, position [m], SNR [dB])`, of sensor nodes at `places`; `None` without an SNR.
    #[must_use]
    pub fn of(grid: MapGrid, places: Vec<Position>, heard: &[(usize, Position, f64)]) -> Option<Self> {
        let mut levels: Vec<Vec<Vec<f64>>> = vec![vec![Vec::new(); grid.nodes[0] * grid.nodes[1]]; places.len()];
        for (sensor, at, snr_db) in heard {
            levels[*sensor][grid.nearest(at)].push(*snr_db);
        }
        let log_range = |sensor: usize, at: &Position| log_range(&places[sensor], at, grid.altitude_m);
        let bin = |sensor: usize, node: usize, levels: &[f64]| {
            let mean_db = levels.iter().sum::<f64>() / levels.len() as f64;
            let squares_db2 = levels.iter().map(|level| (level - mean_db).powi(2)).sum();
            let at = grid.position(node);
            MeasuredBin { node, at, mean_db, count: levels.len(), squares_db2, log_range: log_range(sensor, &at) }
        };
        let of_sensor = |(sensor, nodes): (usize, &Vec<Vec<f64>>)| {
            let filled = nodes.iter().enumerate().filter(|(_, levels)| !levels.is_empty());
            filled.map(|(node, levels)| bin(sensor, node, levels)).collect()
        };
        let bins: Vec<Vec<MeasuredBin>> = levels.iter().enumerate().map(of_sensor).collect();
        let mut measured = Self { grid, bins, places, length_m: 0.0, errors_db: [f64::INFINITY; 2] };
        for length_m in LENGTHS.map(|sides| sides * grid.step_m) {
            let errors_db = measured.errors_db(length_m);
            if errors_db[0] < measured.errors_db[0] {
                measured.length_m = length_m;
                measured.errors_db = errors_db;
            }
        }
        (measured.count() > 0).then_some(measured)
    }

    /// Number of bins of all sensor nodes.
    pub fn count(&self) -> usize {
        self.bins.iter().map(Vec::len).sum()
    }

    /// The sensor nodes without a bin.
    pub fn unheard(&self) -> impl Iterator<Item = usize> {
        (0..self.bins.len()).filter(|sensor| self.bins[*sensor].is_empty())
    }

    /// The law of all bins, whatever the sensor node.
    pub fn law(&self) -> FittedLaw {
        LawSums::of(self.bins.iter().flatten()).law()
    }

    /// Standard deviation of SNRs about the mean of their bin [dB]; `None` if no bin has several.
    pub fn residual_db(&self) -> Option<f64> {
        let bins = || self.bins.iter().flatten();
        let freedom: usize = bins().map(|bin| bin.count - 1).sum();
        (freedom > 0).then(|| (bins().map(|bin| bin.squares_db2).sum::<f64>() / freedom as f64).sqrt())
    }

    /// Root mean squares of the errors with which bins follow from all others of their sensor node [dB], with residuals
    /// over `length_m` and by the law alone; 0 without a sensor node of two bins.
    fn errors_db(&self, length_m: f64) -> [f64; 2] {
        let every = self.count().div_ceil(MOST_PREDICTED).max(1);
        let mut squares_db2 = [0.0; 2];
        let mut predicted = 0.0;
        for bins in self.bins.iter().filter(|bins| bins.len() > 1) {
            let all = LawSums::of(bins);
            for left_out in bins.iter().step_by(every) {
                let mut others = all;
                others.add(left_out, -1.0);
                let law = others.law();
                let error_db = left_out.mean_db - law.level_db(left_out.log_range);
                let rest = bins.iter().filter(|bin| bin.node != left_out.node);
                let corrected_db = error_db - correction_db(&law, rest, &left_out.at, length_m);
                squares_db2[0] += corrected_db * corrected_db;
                squares_db2[1] += error_db * error_db;
                predicted += 1.0;
            }
        }
        squares_db2.map(|squares| (squares / f64::max(predicted, 1.0)).sqrt())
    }

    /// The SNRs [dB] of all sensor nodes, [N, 1, y, x], NaN for a sensor node without a bin.
    pub fn levels_db(&self) -> Vec<f64> {
        let nodes = self.grid.nodes[0] * self.grid.nodes[1];
        let mut levels_db = Vec::with_capacity(self.bins.len() * nodes);
        for (bins, place) in self.bins.iter().zip(&self.places) {
            let law = LawSums::of(bins).law();
            let filled = |node: usize| {
                if bins.is_empty() {
                    return f64::NAN;
                }
                let at = self.grid.position(node);
                law.level_db(log_range(place, &at, self.grid.altitude_m))
                    + correction_db(&law, bins.iter(), &at, self.length_m)
            };
            let first = levels_db.len();
            levels_db.extend((0..nodes).map(filled));
            for bin in bins {
                levels_db[first + bin.node] = bin.mean_db;
            }
        }
        levels_db
    }
}

/// lg of the slant range in metres, of at least 1 m.
fn log_range(place: &Position, at: &Position, altitude_m: f64) -> f64 {
    (at - place).norm().hypot(altitude_m).max(1.0).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: MapGrid = MapGrid { step_m: 10.0, nodes: [21, 11], altitude_m: 30.0 };

    fn snr_db(at: &Position) -> f64 {
        60.0 - 25.0 * log_range(&Position::new(40.0, 50.0), at, 30.0)
    }

    #[test]
    fn a_law_without_residuals_is_found_exactly() {
        let heard: Vec<_> =
            (0..231).step_by(3).map(|node| GRID.position(node)).map(|at| (0, at, snr_db(&at))).collect();
        let measured = Measured::of(GRID, vec![Position::new(40.0, 50.0)], &heard).unwrap();
        let law = measured.law();
        assert!((law.snr_db - 60.0).abs() < 1e-9 && (law.exponent - 2.5).abs() < 1e-9, "{law:?}");
        assert!(measured.errors_db.iter().all(|error_db| *error_db < 1e-9), "{:?}", measured.errors_db);
        for (node, level_db) in measured.levels_db().iter().enumerate() {
            assert!((level_db - snr_db(&GRID.position(node))).abs() < 1e-9, "node {node}");
        }
        assert_eq!(measured.residual_db(), None);
    }

    #[test]
    fn bins_have_the_mean_of_what_was_measured_in_db() {
        let at = Position::new(52.0, 48.0); // nearest to node (5, 5)
        let heard = [(1, at, 3.0), (1, at, 9.0), (1, Position::new(0.0, 0.0), 1.0)];
        let places = vec![Position::new(0.0, 0.0), Position::new(40.0, 50.0)];
        let measured = Measured::of(GRID, places, &heard).unwrap();
        assert_eq!(measured.unheard().collect::<Vec<_>>(), [0]);
        let levels_db = measured.levels_db();
        assert!(levels_db[..231].iter().all(|level_db| level_db.is_nan()));
        assert_eq!(levels_db[231 + 5 * 21 + 5], 6.0);
        // ((3 − 6)² + (9 − 6)²)/1
        assert_eq!(measured.residual_db(), Some(18f64.sqrt()));
        assert_eq!(Measured::of(GRID, vec![at], &[]), None);
    }

    #[test]
    fn residuals_that_stay_predict_better_than_the_law() {
        // Shadows of 8 dB with a period of 120 m, measured at every second node.
        let shadowed = |at: &Position| snr_db(at) + 8.0 * (at.x / 19.0).sin() * (at.y / 19.0).cos();
        let heard: Vec<_> =
            (0..231).step_by(2).map(|node| GRID.position(node)).map(|at| (0, at, shadowed(&at))).collect();
        let measured = Measured::of(GRID, vec![Position::new(40.0, 50.0)], &heard).unwrap();
        let [error_db, law_db] = measured.errors_db;
        assert!(law_db > 3.0 && error_db < 0.8 * law_db, "{:?}", measured.errors_db);
        let levels_db = measured.levels_db();
        let errors = (0..231).map(|node| (levels_db[node] - shadowed(&GRID.position(node))).powi(2));
        let rms_db = (errors.sum::<f64>() / 231.0).sqrt();
        assert!(rms_db < error_db, "{rms_db} dB at all nodes, {error_db} dB without the bin itself");
    }

    /// One residual ρ at the distance d: w/(1 + w) of it, w = e^{−d/l}.
    #[test]
    fn a_residual_counts_by_its_distance() {
        let law = FittedLaw { snr_db: 0.0, exponent: 2.0 };
        let bin = MeasuredBin {
            node: 0,
            at: Position::origin(),
            mean_db: -14.0,
            count: 1,
            squares_db2: 0.0,
            log_range: 1.0, // −20 dB by the law: a residual of 6 dB
        };
        let correction = correction_db(&law, [bin].iter(), &Position::new(3.0, 4.0), 5.0);
        let weight = (-1f64).exp();
        assert!((correction - 6.0 * weight / (1.0 + weight)).abs() < 1e-12, "{correction}");
    }
}
