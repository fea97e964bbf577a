//! The bounds of a mission, as rates, costs and scores.

use skysink_common::loss_rate::fraction;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_planner::bound::{CollectBound, MissionBound, collect_bound, cost_bound, least_weight, mission_bound};
use skysink_planner::settings::{PlanningObjective, Settings};

use crate::summary::score;

/// Bounds of a mission (`docs/src/look-ahead.md`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionBounds {
    /// Lower bound of the loss rate η of every flight; 0 if nothing is sampled.
    pub loss_bound: f64,
    /// Lower bound of the mean loss rate over the draws of a random channel.
    pub expected_loss_bound: Option<f64>,
    /// Lower bound of the cost of every flight by an objective other than the loss.
    pub objective_bound: Option<f64>,
    /// Upper bound of the score of every flight, where no sensor node samples.
    pub score_bound: Option<f64>,
}

/// The bounds of a mission. `known_bits` is the loss of a known flight [bit].
#[must_use]
pub fn bounds(scenario: &Scenario, list: &SensorList, known_bits: u64) -> MissionBounds {
    let sensors = list.sensors_of(scenario);
    let MissionBound { loss_bits, expected_loss_bits } =
        mission_bound(scenario, &sensors, &list.queues_bits(), known_bits);
    let objective = Settings::of(scenario).ok().map(|settings| settings.objective);
    let weights = objective.filter(|objective| !objective.is_loss()).and_then(PlanningObjective::weights);
    let is_collect = objective.is_some_and(PlanningObjective::is_collect);
    let has_score = sensors.sampling_ids().next().is_none();
    let collected = (is_collect || has_score).then(|| collect_bound(scenario, &sensors, &list.queues_bits()));
    let undelivered_bits = |bound: &CollectBound| {
        bound.undelivered_bits.max(least_weight(&sensors) * loss_bits as f64) // what is lost is not delivered
    };
    let cost = weights.map(|weights| cost_bound(scenario, &sensors, &weights, loss_bits));
    MissionBounds {
        loss_bound: loss_rate(loss_bits as f64, scenario, list),
        expected_loss_bound: expected_loss_bits.map(|bits| loss_rate(bits, scenario, list)),
        objective_bound: cost.or_else(|| collected.as_ref().filter(|_| is_collect).map(undelivered_bits)),
        score_bound: collected.filter(|bound| has_score && !bound.delivered_fraction.is_nan()).map(|bound| {
            let left_s = |slots: u64| (scenario.slots - slots) as f64 * scenario.slot_s;
            score(bound.least_slots.map_or(0.0, left_s), bound.delivered_fraction)
        }),
    }
}

/// A loss [bit] as a fraction of the bits that the mission samples (decision D3); 0 if nothing is sampled.
pub fn loss_rate(lost_bits: f64, scenario: &Scenario, list: &SensorList) -> f64 {
    fraction(lost_bits, list.mission_bits(scenario))
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;

    /// The bounds on the undelivered bits and the score for four SNs that hold so much [Mbit], one of which is served
    /// in each of 500 slots of 1 s, at up to 1.4 MHz · 5.55 bit/s/Hz = 7.77 Mbit/s. The first has this weight, the
    /// others 1.
    fn bounds_of(data_mbit: [f64; 4], weight: u32) -> [f64; 2] {
        let folder = tempfile::tempdir().unwrap();
        let rates = "distance_m,altitude_m,probability,rate_bps\n0,20,0.5,7770000\n30,20,0.5,1400000\n";
        std::fs::write(folder.path().join("rates.csv"), rates).unwrap();
        let mut weights = [weight, 1, 1, 1].into_iter();
        let rows = data_mbit.map(|data_mbit| format!("50,50,{},{}\n", data_mbit * 1e6, weights.next().unwrap()));
        std::fs::write(folder.path().join("list.csv"), format!("x_m,y_m,queue_bits,weight\n{}", rows.concat()))
            .unwrap();
        let text = "name = 'x'\nslots = 500\n[sensors]\nfile = 'list.csv'\ncapacity_bits = 2000000000\nsampling_bps = 0.0\n\
                    [link]\nmodel = 'table'\nfile = 'rates.csv'\ncomm_s = 1.0\nresource_blocks = 1\n\
                    [planner]\nobjective = 'collect'\n";
        let path = folder.path().join("x.toml");
        let scenario = Scenario::parse(text, &path, Overrides::default()).unwrap();
        let bounds = bounds(&scenario, &SensorList::of(&scenario).unwrap(), u64::MAX);
        [bounds.objective_bound.unwrap(), bounds.score_bound.unwrap()]
    }

    #[test]
    fn the_score_is_bounded_by_the_best_rate() {
        // 500 s carry 3885 of 4000 Mbit: 100 · 3885/4000 = 97.125, and nothing for the time.
        let [undelivered_bits, score] = bounds_of([1000.0; 4], 1);
        assert_eq!(undelivered_bits, 115e6);
        assert!((score - 97.125).abs() < 1e-9, "{score}");
        // 3000 Mbit take 386.1 s at least: 100 + 500 − 386.1 = 213.9. In whole slots with one SN each they take
        // 249 + 13 + 92 + 34 = 388.
        let [undelivered_bits, score] = bounds_of([1931.74, 96.18, 710.65, 261.43], 1);
        assert_eq!((undelivered_bits, score), (0.0, 212.0));
        // By weights 3, 1, 1, 1: 129 services take all of the first, and 371 carry 2882.67 of the others' 3000 Mbit.
        let [undelivered_bits, _] = bounds_of([1000.0; 4], 3);
        assert!((undelivered_bits - 117.33e6).abs() < 1.0, "{undelivered_bits}");
    }
}
