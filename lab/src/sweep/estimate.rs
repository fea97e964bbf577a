//! Estimates the duration of a sweep from the first slots of a mission of each strategy.

use std::time::{Duration, Instant};

use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;

use super::definition::MissionKey;
use super::plan::Sweep;
use crate::error::LabError;

/// Duration of a trial, after its first slot.
const TRIAL: Duration = Duration::from_secs(1);

/// Estimates the mean duration of the missions of each strategy [s], by trials at the first and the last point of the
/// sweep. A trial simulates the first slot, in which a strategy may do a long search, and then further slots for at
/// most `TRIAL`.
///
/// # Errors
/// If a mission is refused, or on a stop.
pub fn estimate(sweep: &Sweep, stop: &Stop) -> Result<Vec<f64>, LabError> {
    let definition = &sweep.definition;
    let mean_s = |strategy: usize| {
        let trial = |point: usize| trial(sweep, MissionKey { point, strategy, seed: definition.seeds[0] }, stop);
        let last = definition.points.len() - 1;
        let first_s = trial(0)?;
        Ok(if last == 0 { first_s } else { (first_s + trial(last)?) / 2.0 })
    };
    (0..definition.strategies.len()).map(mean_s).collect()
}

/// The estimated duration of a mission [s].
fn trial(sweep: &Sweep, key: MissionKey, stop: &Stop) -> Result<f64, LabError> {
    let begin = Instant::now();
    let scenario = sweep.scenario(key)?;
    let mut mission = Mission::until(&scenario, &SensorList::of(&scenario)?, stop)?;
    mission.next();
    let first = begin.elapsed();
    while begin.elapsed() < first + TRIAL && mission.next().is_some() {}
    stop.check()?;
    Ok(extrapolate(first, begin.elapsed(), mission.slot(), scenario.slots).as_secs_f64())
}

/// Extrapolates the duration of a mission with `slots` slots. `first` is the duration of set-up and first slot, `took`
/// that of all `flown` slots.
fn extrapolate(first: Duration, took: Duration, flown: u64, slots: u64) -> Duration {
    let others = flown.saturating_sub(1).max(1);
    first + (took - first).mul_f64(slots.saturating_sub(1) as f64 / others as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_scales_all_slots_but_the_first() {
        let seconds = Duration::from_secs;
        assert_eq!(extrapolate(seconds(30), seconds(31), 11, 501), seconds(30 + 50));
        assert_eq!(extrapolate(seconds(30), seconds(30), 1, 1), seconds(30));
        assert_eq!(extrapolate(seconds(2), seconds(6), 5, 5), seconds(6));
    }
}
