//! The flights of a strategy over several fields whose plans were not flown as they were decided.

use std::fmt;

use skysink_common::scenario::Scenario;
use skysink_mission::metrics::MetricValues;
use skysink_mission::unflown::UnflownPlans;

/// The flights of a strategy that held or refused more than 1 % of their slots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnflownFlights {
    /// The strategy, or the run; in a sweep with the point.
    pub name: String,
    /// The seed of the worst.
    seed: u64,
    worst: UnflownPlans,
    /// Their number, and that of all flights.
    flights: usize,
    of: usize,
}

impl UnflownFlights {
    /// Those of these missions over `scenario`, by seed; `None` if there are none.
    pub fn of<'a>(
        name: &str,
        scenario: &Scenario,
        missions: impl Iterator<Item = (u64, &'a MetricValues)>,
    ) -> Option<Self> {
        Self::of_plans(name, missions.map(|(seed, values)| (seed, UnflownPlans::of_values(values, scenario))))
    }

    /// Those of flights with these plans, by seed; `None` for a flight that was flown as it was decided.
    pub fn of_plans(name: &str, flights: impl Iterator<Item = (u64, Option<UnflownPlans>)>) -> Option<Self> {
        let plans: Vec<(u64, Option<UnflownPlans>)> = flights.collect();
        let unflown = || plans.iter().filter_map(|(seed, plans)| Some((*seed, (*plans)?)));
        let (seed, worst) = unflown().rev().max_by_key(|(_, plans)| plans.severity())?; // the first of equals
        Some(Self { name: name.to_owned(), seed, worst, flights: unflown().count(), of: plans.len() })
    }
}

/// Most flights that a warning names.
const NAMED: usize = 4;

/// These flights in one text, the first few by name; `None` if there are none.
#[must_use]
pub fn text_of(flights: &[UnflownFlights]) -> Option<String> {
    let named: Vec<String> = flights.iter().take(NAMED).map(UnflownFlights::to_string).collect();
    let more = flights.len().saturating_sub(NAMED);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    (!flights.is_empty()).then(|| named.join("; ") + &more)
}

impl fmt::Display for UnflownFlights {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, seed, worst, flights, of } = self;
        write!(formatter, "{name}: {worst}")?;
        match of {
            1 => Ok(()),
            _ => write!(formatter, " with seed {seed}, the worst of {flights} such flights of {of}"),
        }
    }
}
