//! What a sweep takes, before it is flown: a mission of each strategy is begun, and its pace taken for all.

use std::time::{Duration, Instant};

use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;

use super::plan::{MissionKey, Sweep};
use crate::error::LabError;

/// How long a mission is flown for its pace.
const TRIAL: Duration = Duration::from_secs(1);

/// What a sweep takes.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepEstimate {
    /// Missions of all strategies.
    pub missions: usize,
    /// CPU time of all missions [s].
    pub cpu_s: f64,
    /// Each strategy with the time of one of its missions [s].
    pub mission_s: Vec<(String, f64)>,
}

/// Flies parts of missions over the first and the last point of a sweep, at most a second of each.
///
/// # Errors
/// If a mission is refused, or on a stop.
///
/// # Panics
/// Never: a sweep has a point and a seed.
pub fn estimate(sweep: &Sweep, stop: &Stop) -> Result<SweepEstimate, LabError> {
    let definition = &sweep.definition;
    let fields = definition.fields();
    let mut mission_s = Vec::new();
    for (strategy, name) in definition.strategies.iter().enumerate() {
        let trial = |point: usize| trial(sweep, MissionKey { point, strategy, seed: definition.seeds[0] }, stop);
        mission_s.push((name.clone(), (trial(0)? + trial(definition.points.len() - 1)?) / 2.0));
    }
    let cpu_s = mission_s.iter().map(|(_, each_s)| each_s * fields as f64).sum();
    Ok(SweepEstimate { missions: fields * definition.strategies.len(), cpu_s, mission_s })
}

/// How long a mission takes [s].
fn trial(sweep: &Sweep, key: MissionKey, stop: &Stop) -> Result<f64, LabError> {
    let begin = Instant::now();
    let scenario = sweep.scenario(key)?;
    let mut mission = Mission::new(&scenario, &SensorList::of(&scenario)?)?;
    mission.set_stop(stop);
    while mission.next().is_some() && begin.elapsed() < TRIAL {}
    stop.check()?;
    Ok(begin.elapsed().as_secs_f64() * scenario.slots as f64 / mission.slot().max(1) as f64)
}
