//! The search of a slot: it anneals the plan, and adapts its temperature.

use skysink_common::random::Purpose;

use super::anneal::{Best, Cooling, SearchSteps, SearchStyle, anneal};
use super::carried_plan::CarriedPlan;
use super::forecast::Forecast;
use super::keys::LookAheadPart;
use super::objective::Objective;
use super::states::HoverStore;
use super::timelines::Timelines;

/// Ceiling of the temperature at the mission's end; 1 at its beginning.
const LAST_CEILING: f64 = 0.1;

/// Fraction of free resource blocks from which on the temperature is not reduced.
const FREE: f64 = 0.5;

/// Largest increase of the cost by a search, as a fraction of the avoidable cost; beyond it the search is undone.
pub(super) const MOST_RISE: f64 = 0.02;

/// Lowest temperature; above 0, so that [`REHEATING`] can raise it.
const LEAST_TEMPERATURE: f64 = 1e-9;

/// Factor of the temperature after a search that increased the cost.
pub(super) const COOLING: f64 = 0.95;

/// Factor of the temperature after a search that reduced the cost.
pub(super) const REHEATING: f64 = 1.05;

/// Temperatures of a search for a plan that hovers, as fractions of the mean data of a sensor: at the beginning of the
/// first search, of later ones, and at the end.
const HOVER_TEMPERATURES: [f64; 3] = [0.3, 0.02, 1e-3];

/// Fraction of all data that is little to leave.
const LITTLE: f64 = 0.05;

/// Sensors from which on a search takes all its steps.
const MANY_SENSORS: u64 = 16;

/// The steps in a row without a better plan after which a search of `steps` ends: by the square of the sensors, as
/// there are changes of a plan.
fn patience(steps: u64, sensors: usize) -> u64 {
    match sensors as u64 {
        MANY_SENSORS.. => u64::MAX,
        few => (steps * few * few).div_ceil(MANY_SENSORS * MANY_SENSORS),
    }
}

impl<O: Objective<Style: SearchStyle<O, Store = Timelines<O>>>> CarriedPlan<O> {
    /// Anneals the plan; restores the initial plan if the cost ends much higher.
    ///
    /// The temperature is proportional to the cost per stop beyond the bound, and falls with the fraction of free
    /// resource blocks, because a cycle of full groups can only get worse. It is lowered after a search that increased
    /// the cost, and raised after one that reduced it, up to a ceiling that falls over the mission.
    pub(super) fn improve(&mut self, slot: u64, steps: u32, forecast: &mut Forecast<O>, is_over: &dyn Fn() -> bool) {
        let begun_cost = forecast.cost;
        if steps == 0 || begun_cost == 0.0 {
            return; // nothing costs less than 0, and the bound takes time
        }
        let model = &mut self.model;
        let begun = forecast.stops();
        let window = &forecast.window;
        let least = window.least(model);
        if begun_cost <= least {
            return; // nothing can be better
        }
        let blocks = model.table.limits.blocks() as f64 * f64::from(window.slots);
        let free = (1.0 - forecast.trace.visits.len() as f64 / blocks).max(0.0);
        let freedom = (free / FREE).min(1.0).powi(2);
        let avoidable = (begun_cost - forecast.store.beyond - least).max(0.0) * freedom;
        // A window that ends before the mission has no final temperature.
        let progress = if window.beyond_slots > 0.0 { 1.0 } else { slot as f64 / self.slots as f64 };
        let ceiling = LAST_CEILING.powf(progress);
        let is_annealed = self.keys.without != Some(LookAheadPart::Annealing);
        let temperature = if is_annealed { self.state.temperature.min(ceiling) } else { 0.0 };
        let cooling = Cooling::FarAhead(avoidable / begun.len().max(1) as f64 * temperature);
        let mut random = self.streams.stream(Purpose::Horizon, slot, 0);
        let mut search = SearchSteps { is_over, random: &mut random, counts: &mut self.counts, patience: u64::MAX };
        anneal(model, forecast, cooling, steps.into(), &mut search, None);
        // The schedules depend on the buffers, and the search copies legs without recomputing them. Reload the plan, so
        // that the next slot resumes from exactly this plan.
        forecast.load(model, forecast.stops());
        let rise = forecast.cost - begun_cost;
        if rise > 0.0 {
            self.state.temperature = (self.state.temperature * COOLING).max(LEAST_TEMPERATURE);
        } else if rise < 0.0 {
            self.state.temperature = (self.state.temperature * REHEATING).min(1.0);
        }
        if rise > avoidable * MOST_RISE {
            forecast.load(model, begun);
        }
    }
}

impl<O: Objective<Style: SearchStyle<O, Store = HoverStore<O>>>> CarriedPlan<O> {
    /// Anneals a plan that hovers from a temperature in parts of the mean data of a sensor, higher if it `is_first`,
    /// and loads the best plan found. In a field of few sensors a later one ends once it finds no better plan. The next
    /// search takes fewer steps if this one was in vain: it found no better plan, and little is left.
    pub(super) fn improve_points(
        &mut self,
        slot: u64,
        steps: u64,
        is_first: bool,
        forecast: &mut Forecast<O>,
        is_over: &dyn Fn() -> bool,
    ) {
        if steps == 0 {
            return; // with the stops that now take no slot: they may again
        }
        let model = &mut self.model;
        forecast.store.keeps_idle = false;
        forecast.load(model, forecast.stops());
        let least = forecast.window.least(model);
        let mean = -least / forecast.open(model).len().max(1) as f64;
        let temperature = HOVER_TEMPERATURES[usize::from(!is_first)];
        let cooling = match self.keys.without {
            Some(LookAheadPart::Annealing) => Cooling::Everywhere(0.0),
            _ => Cooling::Geometric { first: mean * temperature, last: mean * HOVER_TEMPERATURES[2] },
        };
        let mut best: Best = (forecast.cost, forecast.stops());
        let begun_cost = best.0;
        let mut random = self.streams.stream(Purpose::Collect, slot, 0);
        let patience = if is_first { u64::MAX } else { patience(steps, model.sensors.len()) };
        let mut search = SearchSteps { is_over, random: &mut random, counts: &mut self.counts, patience };
        anneal(model, forecast, cooling, steps, &mut search, Some(&mut best));
        let is_vain = best.0 >= begun_cost && best.0 <= least * (1.0 - LITTLE);
        forecast.load(model, best.1);
        forecast.store.keeps_idle = true;
        self.state.vain_searches = if is_vain { self.state.vain_searches.saturating_add(1) } else { 0 };
    }
}
