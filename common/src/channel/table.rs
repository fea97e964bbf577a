//! A channel of one's own: the distribution of the rate over distance and altitude, as a table (decision D30).

use std::path::Path;
use std::sync::Arc;

use rand::RngExt;

use super::model::{ChannelModel, Draw, Slopes, Uplink};
use crate::csv_rows::{grid_axes, read_rows};
use crate::error::{InputError, read_text};
use crate::interpolation::interpolate;
use crate::keys::Only;
use crate::random::{Purpose, Streams};
use crate::shared::SharedValues;

/// The file of the models `table` and `map`.
pub(crate) const FILE: Only =
    Only { key: "model", values: &["table", "map"], expected: Some("it only with model = \"table\" or \"map\"") };

/// Most rates of a table.
const MOST_RATES: usize = 1_000_000;

/// Steps of the probability in a mean over draws.
const STEPS: u32 = 1 << 12;

/// Rates over a grid of horizontal distances, altitudes and probabilities: quantiles, which do not fall with the
/// probability.
///
/// Between the points of the grid the rate is linear in each of the three, beyond its ends constant.
#[derive(Debug, Clone, PartialEq)]
pub struct RateTable {
    distances_m: Vec<f64>,
    altitudes_m: Vec<f64>,
    probabilities: Vec<f64>,
    /// [bit/s], by distance, then altitude, then probability.
    rates_bps: Vec<f64>,
    /// Means over all probabilities [bit/s], by distance, then altitude.
    means_bps: Vec<f64>,
    /// The highest rates of each probability, over all distances and altitudes [bit/s].
    highest_bps: Vec<f64>,
}

/// The columns of the file.
const COLUMNS: [&str; 4] = ["distance_m", "altitude_m", "probability", "rate_bps"];

impl RateTable {
    /// The table of these `rates_bps` [bit/s], by distance, then altitude, then probability, all three ascending.
    ///
    /// # Errors
    /// A message with the value and what was expected.
    pub fn new(
        distances_m: Vec<f64>,
        altitudes_m: Vec<f64>,
        probabilities: Vec<f64>,
        rates_bps: Vec<f64>,
    ) -> Result<Self, String> {
        for (name, values, most) in [
            ("distance_m", &distances_m, f64::MAX),
            ("altitude_m", &altitudes_m, f64::MAX),
            ("probability", &probabilities, 1.0),
        ] {
            let is_refused = |value: &&f64| !(0.0..=most).contains(*value);
            if let Some(value) = values.iter().find(is_refused) {
                let expected = if most == 1.0 { "0 to 1" } else { "a finite number, 0 or above" };
                return Err(format!("{name} = {value}: expected {expected}"));
            }
            if values.is_empty() || !values.is_sorted_by(|before, after| before < after) {
                return Err(format!("{name}: expected ascending values, at least one"));
            }
        }
        let points = distances_m.len() * altitudes_m.len() * probabilities.len();
        if rates_bps.len() != points || points > MOST_RATES {
            let found = rates_bps.len();
            return Err(format!(
                "{found} rates: expected {points}, one for each distance, altitude and probability, at most \
                 {MOST_RATES}"
            ));
        }
        if let Some(rate_bps) = rates_bps.iter().find(|rate_bps| !(0.0..=1e300).contains(*rate_bps)) {
            return Err(format!("rate_bps = {rate_bps:e}: expected a rate from 0 to 1e300"));
        }
        let by_point = || rates_bps.chunks(probabilities.len());
        if let Some(point) = by_point().position(|rates_bps| !rates_bps.is_sorted()) {
            let distance_m = distances_m[point / altitudes_m.len()];
            let altitude_m = altitudes_m[point % altitudes_m.len()];
            return Err(format!(
                "rate_bps at distance_m = {distance_m}, altitude_m = {altitude_m}: expected rates that do not fall \
                 with the probability"
            ));
        }
        let means_bps = by_point().map(|rates_bps| mean(&probabilities, rates_bps)).collect();
        let highest = |index: usize| by_point().map(|rates_bps| rates_bps[index]).fold(0.0, f64::max);
        let highest_bps = (0..probabilities.len()).map(highest).collect();
        Ok(Self { means_bps, highest_bps, distances_m, altitudes_m, probabilities, rates_bps })
    }

    /// Distances [m], altitudes [m] and probabilities of the grid, each ascending.
    pub fn axes(&self) -> [&[f64]; 3] {
        [&self.distances_m, &self.altitudes_m, &self.probabilities]
    }

    /// Reads the file `path`.
    ///
    /// # Errors
    /// If the file cannot be read, or is no table.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text("channel", path)?, path)
    }

    /// Parses the text of the file `path`: a row for each point of the grid, in any order.
    ///
    /// # Errors
    /// If a row is invalid, or the rows are no grid.
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        let refuse = |message: String| InputError::new("channel", path, message);
        let is_finite = |row: &[f64; 4]| row.iter().all(|number| number.is_finite());
        let mut rows = read_rows(text, &COLUMNS, "finite numbers", is_finite).map_err(refuse)?;
        if rows.is_empty() {
            return Err(refuse("line 1: no rows: expected a row for each point of a grid".to_owned()));
        }
        rows.sort_unstable_by(|a, b| a.partial_cmp(b).expect("the numbers are finite"));
        let points: Vec<[f64; 3]> = rows.iter().map(|row| [row[0], row[1], row[2]]).collect();
        let named = |[distance_m, altitude_m, probability]: [f64; 3]| {
            format!("distance_m = {distance_m}, altitude_m = {altitude_m}, probability = {probability}")
        };
        let [distances_m, altitudes_m, probabilities] = grid_axes(&points, named).map_err(refuse)?;
        let rates_bps = rows.iter().map(|row| row[3]).collect();
        Self::new(distances_m, altitudes_m, probabilities, rates_bps).map_err(refuse)
    }

    /// The table as a CSV file; floats round-trip exactly.
    pub fn to_csv(&self) -> String {
        let mut text = COLUMNS.join(",") + "\n";
        let mut rates_bps = self.rates_bps.iter();
        for distance_m in &self.distances_m {
            for altitude_m in &self.altitudes_m {
                for (probability, rate_bps) in self.probabilities.iter().zip(&mut rates_bps) {
                    text.push_str(&format!("{distance_m},{altitude_m},{probability},{rate_bps}\n"));
                }
            }
        }
        text
    }

    /// The table as a channel holds it: equal ones are held once.
    #[must_use]
    pub fn shared(self) -> Arc<Self> {
        static ALL: SharedValues<RateTable> = SharedValues::new();
        ALL.share(self, Self::eq)
    }

    /// Bilinear in distance and altitude, of `value` at the points of the grid.
    fn interpolated(&self, d_m: f64, z_m: f64, value: impl Fn(usize) -> f64) -> f64 {
        let [near, low] = [Step::of(&self.distances_m, d_m), Step::of(&self.altitudes_m, z_m)];
        let at_distance = |distance: usize| low.between(|altitude| value(distance * self.altitudes_m.len() + altitude));
        near.between(at_distance)
    }

    /// The rate [bit/s] at a point of the grid, for a probability.
    fn quantile_bps(&self, point: usize, probability: f64) -> f64 {
        let rates_bps = &self.rates_bps[point * self.probabilities.len()..][..self.probabilities.len()];
        Step::of(&self.probabilities, probability).between(|index| rates_bps[index])
    }

    /// Partial derivatives of the mean by distance and by altitude [bit/s/m].
    fn gradient(&self, d_m: f64, z_m: f64) -> [f64; 2] {
        let [near, low] = [Step::of(&self.distances_m, d_m), Step::of(&self.altitudes_m, z_m)];
        let mean = |distance: usize, altitude: usize| self.means_bps[distance * self.altitudes_m.len() + altitude];
        [
            near.slope(&self.distances_m, |distance| low.between(|altitude| mean(distance, altitude))),
            low.slope(&self.altitudes_m, |altitude| near.between(|distance| mean(distance, altitude))),
        ]
    }
}

/// Mean of a linear interpolant over all probabilities from 0 to 1.
fn mean(probabilities: &[f64], rates_bps: &[f64]) -> f64 {
    let last = rates_bps.len() - 1;
    let between = probabilities.windows(2).zip(rates_bps.windows(2));
    probabilities[0] * rates_bps[0]
        + between.map(|(p, r)| (p[1] - p[0]) * (r[0] + r[1]) / 2.0).sum::<f64>()
        + (1.0 - probabilities[last]) * rates_bps[last]
}

/// A place between two grid values, or at an end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// The lower value.
    pub(super) index: usize,
    /// Fraction of the way to the next; 0 at the ends and beyond.
    pub(super) fraction: f64,
    is_within: bool,
}

impl Step {
    pub(super) fn of(values: &[f64], at: f64) -> Self {
        let above = values.partition_point(|value| *value <= at);
        if above == 0 || above == values.len() {
            return Self { index: above.saturating_sub(1), fraction: 0.0, is_within: false };
        }
        let [low, high] = [values[above - 1], values[above]];
        Self { index: above - 1, fraction: (at - low) / (high - low), is_within: true }
    }

    fn between(self, value: impl Fn(usize) -> f64) -> f64 {
        let low = value(self.index);
        if self.fraction == 0.0 { low } else { interpolate(low, value(self.index + 1), self.fraction) }
    }

    fn slope(self, values: &[f64], value: impl Fn(usize) -> f64) -> f64 {
        if !self.is_within {
            return 0.0;
        }
        (value(self.index + 1) - value(self.index)) / (values[self.index + 1] - values[self.index])
    }
}

/// The parameters of an uplink of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct TableChannel {
    /// The table.
    pub table: Arc<RateTable>,
    /// Time for communication in a slot, `τ_c` [s].
    pub comm_s: f64,
}

impl ChannelModel for TableChannel {
    fn expected_rate_bps(&self, &Uplink { d2_m2, z_m, .. }: &Uplink) -> f64 {
        self.table.interpolated(d2_m2.sqrt(), z_m, |point| self.table.means_bps[point])
    }

    /// With the mean `f(d, z)`, `d = D cos θ` and `z = D sin θ`: `∂f/∂D² = (f_d d + f_z z)/2D²`, and `∂f/∂θ = f_z d −
    /// f_d z` per radian.
    fn slopes(&self, &Uplink { d2_m2, z_m, .. }: &Uplink) -> Slopes {
        let d_m = d2_m2.sqrt();
        let length_m = (d2_m2 + z_m * z_m).sqrt();
        let [by_distance, by_altitude] = self.table.gradient(d_m, z_m);
        Slopes {
            by_distance2: (by_distance * d_m + by_altitude * z_m) / (2.0 * length_m * length_m),
            by_elevation: (by_altitude * d_m - by_distance * z_m).to_radians(),
        }
    }

    fn is_random(&self) -> bool {
        self.table.probabilities.len() > 1
    }

    fn draw(&self, &Uplink { d2_m2, z_m, .. }: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> Draw {
        let probability: f64 = streams.stream(Purpose::TableDraw, slot, sensor).random();
        let rate_bps = self.table.interpolated(d2_m2.sqrt(), z_m, |point| self.table.quantile_bps(point, probability));
        Draw { line_of_sight: true, rate_bps }
    }

    /// The highest of the table, wherever the UAV is.
    fn best_rate_bps(&self, _: &Uplink) -> f64 {
        self.table.highest_bps.iter().copied().fold(0.0, f64::max)
    }

    fn best_drawn_rate_bps(&self, _: &Uplink, streams: &Streams, slot: u64, sensor: u32) -> f64 {
        let probability: f64 = streams.stream(Purpose::TableDraw, slot, sensor).random();
        Step::of(&self.table.probabilities, probability).between(|index| self.table.highest_bps[index])
    }

    /// The value at the upper end of each of many steps of the probability.
    fn mean_over_draws(&self, &Uplink { d2_m2, z_m, .. }: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let rate_bps = |probability: f64| {
            self.table.interpolated(d2_m2.sqrt(), z_m, |point| self.table.quantile_bps(point, probability))
        };
        if self.is_random() { over_steps(|probability| value(rate_bps(probability))) } else { value(rate_bps(1.0)) }
    }

    fn best_mean_over_draws(&self, _: &Uplink, value: &dyn Fn(f64) -> f64) -> f64 {
        let highest = |probability: f64| {
            Step::of(&self.table.probabilities, probability).between(|index| self.table.highest_bps[index])
        };
        if self.is_random() { over_steps(|probability| value(highest(probability))) } else { value(highest(1.0)) }
    }

    fn depends_on_elevation(&self) -> bool {
        self.table.altitudes_m.len() > 1
    }

    fn has_own_gains(&self) -> bool {
        false
    }
}

/// Mean of a function that does not fall over the upper ends of equal steps from 0 to 1.
fn over_steps(value: impl Fn(f64) -> f64) -> f64 {
    (1..=STEPS).map(|step| value(f64::from(step) / f64::from(STEPS))).sum::<f64>() / f64::from(STEPS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rates of 100 and 300 bit/s above, 0 and 100 at 10 m, at an altitude of 20 m; half of that at 40 m.
    fn table() -> RateTable {
        let rates_bps = vec![100.0, 300.0, 50.0, 150.0, 0.0, 100.0, 0.0, 50.0];
        RateTable::new(vec![0.0, 10.0], vec![20.0, 40.0], vec![0.0, 1.0], rates_bps).unwrap()
    }

    fn channel() -> TableChannel {
        TableChannel { table: table().shared(), comm_s: 0.1 }
    }

    fn uplink(d_m: f64, z_m: f64) -> Uplink {
        Uplink::at(1.0, d_m * d_m, z_m)
    }

    #[test]
    fn the_mean_is_bilinear_and_constant_beyond_the_ends() {
        // Means: 200 and 100 above, 50 and 25 at 10 m.
        let mean = |d_m, z_m| channel().expected_rate_bps(&uplink(d_m, z_m));
        assert_eq!([mean(0.0, 20.0), mean(10.0, 40.0), mean(30.0, 90.0), mean(0.0, 5.0)], [200.0, 25.0, 25.0, 200.0]);
        assert!((mean(5.0, 30.0) - (200.0 + 100.0 + 50.0 + 25.0) / 4.0).abs() < 1e-9);
    }

    #[test]
    fn draws_have_the_mean_of_the_table() {
        let streams = Streams::new(3);
        let rates = (0..20_000).map(|slot| channel().draw(&uplink(0.0, 20.0), &streams, slot, 7).rate_bps);
        let mean = rates.sum::<f64>() / 20_000.0;
        assert!((mean - 200.0).abs() < 5.0 * 200.0 / 12f64.sqrt() / 20_000f64.sqrt(), "{mean}");
    }

    #[test]
    fn a_written_table_reads_back_exactly() {
        let text = table().to_csv();
        assert_eq!(RateTable::parse(&text, Path::new("a.csv")).unwrap(), table());
        let table = table().shared();
        assert!(Arc::ptr_eq(&table, &self::table().shared()), "held once");
    }

    #[test]
    fn an_invalid_channel_table_is_refused() {
        let head = "distance_m,altitude_m,probability,rate_bps\n";
        for (text, message) in [
            ("d,z\n".to_owned(), "header `d,z`: expected distance_m,altitude_m,probability,rate_bps"),
            (format!("{head}0,20,0.5,x\n"), "line 2: `0,20,0.5,x`: expected finite numbers"),
            (format!("{head}0,20,1.5,1\n"), "probability = 1.5: expected 0 to 1"),
            (format!("{head}-1,20,0.5,1\n"), "distance_m = -1: expected a finite number, 0 or above"),
            (format!("{head}0,20,0.5,-1\n"), "rate_bps = -1e0: expected a rate from 0 to 1e300"),
            (format!("{head}0,20,0.5,2e300\n"), "rate_bps = 2e300: expected a rate from 0 to 1e300"),
            (format!("x,{head}"), "header `x,distance_m,altitude_m,probability,rate_bps`: expected"),
            (format!("{head}0,20,0.5,1\n0,20,0.5,2\n"), "probability = 0.5 twice: expected it once"),
            (
                format!("{head}0,20,0.5,1\n5,30,0.5,1\n"),
                "no row with distance_m = 0, altitude_m = 30, probability = 0.5",
            ),
            (format!("{head}0,20,0,9\n0,20,1,8\n"), "expected rates that do not fall with the probability"),
            (head.to_owned(), "line 1: no rows: expected a row for each point"),
        ] {
            let error = RateTable::parse(&text, Path::new("a.csv")).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }

    proptest! {
        #[test]
        fn slopes_are_the_derivatives_of_the_mean(d_m in 0.5..9.5f64, z_m in 21.0..39.0f64) {
            let channel = channel();
            let slopes = channel.slopes(&uplink(d_m, z_m));
            let length_m = d_m.hypot(z_m);
            let angle = z_m.atan2(d_m);
            let at = |length_m: f64, angle: f64| {
                channel.expected_rate_bps(&uplink(length_m * angle.cos(), length_m * angle.sin()))
            };
            let step = 1e-5;
            let by_length = (at(length_m + step, angle) - at(length_m - step, angle)) / (2.0 * step);
            let by_angle = (at(length_m, angle + step) - at(length_m, angle - step)) / (2.0 * step);
            prop_assert!((slopes.by_distance2 - by_length / (2.0 * length_m)).abs() < 1e-4);
            prop_assert!((slopes.by_elevation - by_angle.to_radians()).abs() < 1e-3);
        }

        #[test]
        fn no_draw_exceeds_the_best_rate(d_m in 0.0..20.0f64, z_m in 5.0..60.0f64, slot in 1u64..1_000) {
            let streams = Streams::new(1);
            let drawn_bps = channel().draw(&uplink(d_m, z_m), &streams, slot, 3).rate_bps;
            let best_bps = channel().best_drawn_rate_bps(&uplink(d_m, z_m), &streams, slot, 3);
            prop_assert!(drawn_bps <= best_bps + 1e-9);
            prop_assert!(best_bps <= channel().best_rate_bps(&uplink(d_m, z_m)));
            let mean_bps = channel().mean_over_draws(&uplink(d_m, z_m), &|rate_bps| rate_bps);
            let expected_bps = channel().expected_rate_bps(&uplink(d_m, z_m));
            prop_assert!(mean_bps >= expected_bps - 1e-9 && mean_bps <= expected_bps + 0.1);
            prop_assert!(mean_bps <= channel().best_mean_over_draws(&uplink(d_m, z_m), &|rate_bps| rate_bps) + 1e-9);
        }
    }
}
