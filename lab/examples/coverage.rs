//! How often the 95 % intervals of the mean loss rate cover it, resampled from the fields of a flown sweep.
//!
//! ```sh
//! skysink sweep scenarios/sweeps/loss-area.toml
//! cargo run --release -p skysink-lab --example coverage -- runs/loss-area
//! ```
//!
//! For every mean, samples of 20, 50 and 300 fields are drawn with replacement from the sweep's, and the intervals that
//! contain the mean over all of them are counted. The table has the means that are covered least by 20 fields.

use std::error::Error;
use std::path::Path;

use rand::{Rng, RngExt};
use skysink_common::figure::Support;
use skysink_common::random::{Purpose, Streams};
use skysink_lab::statistics::{Concentration, MeanInterval};
use skysink_lab::sweep::folder::FlownSweep;
use skysink_lab::sweep::results::named;
use skysink_mission::metrics::Metric;

/// Samples of each size.
const SAMPLES: u32 = 2_000;

/// Numbers of fields in a sample.
const SIZES: [usize; 3] = [20, 50, 300];

/// Rows of the table.
const ROWS: usize = 12;

/// The fraction of the samples of `n` values whose interval contains the mean of all `values`.
fn coverage(values: &[f64], n: usize, random: &mut impl Rng) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let covers = |_: &u32| {
        let sample: Vec<f64> = (0..n).map(|_| values[random.random_range(0..values.len())]).collect();
        MeanInterval::of(&sample, Support::Fraction).limits.is_some_and(|[low, high]| low <= mean && mean <= high)
    };
    (0..SAMPLES).filter(covers).count() as f64 / f64::from(SAMPLES)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("expected the folder of a sweep")?;
    let flown = FlownSweep::read("sweep", Path::new(&folder))?;
    let mut rows = Vec::new();
    for point in 0..flown.definition.points.len() {
        for (strategy, name) in flown.definition.strategies.iter().enumerate() {
            let values: Vec<f64> = flown.values(point, strategy, Metric::LossRate).into_values().collect();
            if values.iter().all(|value| *value == values[0]) {
                continue;
            }
            let mut random = Streams::new(1).stream(Purpose::Position, point as u64, strategy as u32);
            let covered = SIZES.map(|n| coverage(&values, n, &mut random));
            let trapped = flown.values(point, strategy, Metric::Trapped).into_values().sum::<f64>();
            let concentration = Concentration::of(values.iter().copied());
            let fields = values.len() as f64;
            let fractions = [trapped / fields, concentration.nonzero as f64 / fields];
            rows.push((named(&flown.definition, name, point), fractions, covered));
        }
    }
    rows.sort_by(|one, other| one.2[0].total_cmp(&other.2[0]));
    println!(
        "| mean of | trapped fields | fields that lose data | n = 20 | n = 50 | n = 300 |\n|{}",
        " --- |".repeat(6)
    );
    for (name, fractions, covered) in rows.iter().take(ROWS) {
        let cells = fractions.iter().chain(covered).map(|fraction| format!("{:.1} %", 100.0 * fraction));
        println!("| {name} | {} |", cells.collect::<Vec<_>>().join(" | "));
    }
    Ok(())
}
