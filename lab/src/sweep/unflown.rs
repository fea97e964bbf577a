//! The flights of a sweep whose plans were not flown as they were decided.

use skysink_mission::unflown::UnflownPlans;

use super::definition::MissionKey;
use super::journal::{MissionRows, missions_of};
use super::plan::Sweep;
use super::results::named;
use crate::error::LabError;
use crate::unflown::UnflownFlights;

impl UnflownFlights {
    /// Those of a sweep, by point and strategy.
    ///
    /// # Errors
    /// Never for the missions of this sweep.
    pub fn of_sweep(sweep: &Sweep, rows: &MissionRows) -> Result<Vec<Self>, LabError> {
        let definition = &sweep.definition;
        let mut found = Vec::new();
        for point in 0..definition.points.len() {
            for (strategy, name) in definition.strategies.iter().enumerate() {
                let missions = || missions_of(rows, point, strategy).map(|row| (row.key.seed, &row.values));
                // Most flights fly all their plans; only the scenario of others is read.
                if missions().all(|(_, values)| UnflownPlans::has_none(values)) {
                    continue;
                }
                let scenario = sweep.scenario(MissionKey { point, strategy, seed: definition.seeds[0] })?;
                found.extend(Self::of(&named(definition, name, point), &scenario, missions()));
            }
        }
        Ok(found)
    }
}
