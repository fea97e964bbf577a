//! `mes`: mobile element scheduling by minimum weighted sum first (MWSF).
//!
//! In every slot the UAV flies straight toward the sensor node (SN) of least `w u_i + (1 − w) F_i`. `u_i = (B −
//! B_i(t−1))/(s_i τ)` is the deadline of [`edf`] and `F_i = ‖L_u(t−1) − L_i‖/(V τ)` the flight time, both in slots from
//! now, and w is `planner.mes.deadline_weight`. With w = 1 it is `edf`. The SN is served as soon as it is in range,
//! with the n − 1 fullest of the others.
//!
//! Source: the papers of `edf`. There costs are travel times, and a data transfer takes no time. Their heuristics are
//! EDF, EDF with k-lookahead (the best order of the k earliest deadlines; not implemented here) and MWSF. (Known from
//! citations. Which weight the authors recommend is not known here.)
//!
//! Adapted to slots: the choice is repeated in every slot, with deadlines counted from that slot; absolute deadlines
//! would add the same constant to every sum. The flight time is not rounded up to whole slots. The default weight, 0.1,
//! is this project's own: about the least loss at the settings of `docs/src/look-ahead.md`.
//!
//! [`edf`]: super::edf

use serde::{Deserialize, Serialize};
use skysink_common::keys::Accepts;

use super::edf::toward_least;
use crate::strategy::{Registered, Setup, Strategy};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("mes", "minimum weighted sum first: weighs deadline against flight time", |setup| {
        let keys: MesKeys = setup.scenario.planner_keys("planner.mes").expect("they were checked");
        mes(setup, keys.deadline_weight)
    })
    .without_weights()
    .with_keys::<MesKeys>();

skysink_common::keys! {
    /// `[planner.mes]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct MesKeys {
        /// Weight of the deadline, `w`; the flight time has the rest, 1 − w.
        deadline_weight: f64 = 0.1, Accepts::Number("a weight from 0 to 1", |weight| (0.0..=1.0).contains(&weight));
    }
}

/// Toward the SN with the least weighted sum. No decision if no SN samples.
fn mes(setup: &Setup, deadline_weight: f64) -> Box<dyn Strategy> {
    toward_least(setup, move |view, id| {
        let deadline_slots = view.belief.deadline_slots(id)?;
        let away_m = view.table.motion.distance_m(view.table.sensors.position(id), &view.ground());
        let flight_slots = away_m / view.table.limits.reach_m;
        Some(deadline_weight * deadline_slots + (1.0 - deadline_weight) * flight_slots)
    })
}

#[cfg(test)]
mod tests {
    use super::super::edf;
    use super::*;
    use crate::strategy::OwnedSetup;
    use crate::strategy::tests::{field, view};
    use proptest::prelude::*;
    use skysink_common::keys::Keys;

    /// The field of these SNs, x, y [m] and rate [bit/s], with buffers of 1 000 bit.
    fn field_of(sensors: &[[f64; 3]]) -> OwnedSetup {
        field(sensors.iter().map(|&[x_m, y_m, sampling_bps]| ([x_m, y_m], sampling_bps, 1_000)))
    }

    /// Where it flies from (50, 50).
    fn waypoint(weight: f64, sensors: &[[f64; 3]], queues_bits: &[u32]) -> Option<[f64; 2]> {
        let field = field_of(sensors);
        mes(&field.setup(), weight)
            .plan(&view(&field.table, 1, [50.0, 50.0], queues_bits))
            .map(|decision| decision.waypoint.xy().into())
    }

    #[test]
    fn mes_flies_to_the_least_weighted_sum() {
        // SN 0: 1 slot to go (30 m), 10 slots of room (100 bit at 10). SN 1: 1/3 slot (10 m), 10.5 slots.
        let sensors = [[50.0, 80.0, 10.0], [60.0, 50.0, 10.0]];
        let queues_bits = [900, 895];
        // w = 0.5: 5.5 and 5.4167. w = 0.6: 6.4 and 6.4333. The sums are equal at 0.5 w = (2/3) (1 − w), w = 4/7.
        assert_eq!(waypoint(0.5, &sensors, &queues_bits), Some([60.0, 50.0]));
        assert_eq!(waypoint(0.571, &sensors, &queues_bits), Some([60.0, 50.0]));
        assert_eq!(waypoint(0.572, &sensors, &queues_bits), Some([50.0, 80.0]));
        assert_eq!(waypoint(0.6, &sensors, &queues_bits), Some([50.0, 80.0]));
    }

    #[test]
    fn mes_without_deadline_weight_flies_to_the_nearest_sampling_node() {
        let sensors = [[50.0, 51.0, 0.0], [50.0, 90.0, 400.0], [45.0, 50.0, 1.0]];
        assert_eq!(waypoint(0.0, &sensors, &[1_000, 1_000, 0]), Some([45.0, 50.0]));
        assert_eq!(waypoint(0.5, &sensors[..1], &[1_000]), None, "nobody samples");
        assert_eq!(waypoint(0.5, &[], &[]), None);
    }

    #[test]
    fn a_weight_outside_0_to_1_is_refused() {
        let is_refused = |weight: f64| MesKeys::KEYS[0].accepts.refusal(&weight.into()).is_some();
        assert!([-0.001, 1.001, f64::NAN, f64::INFINITY].into_iter().all(is_refused));
        assert!(![0.0, 1.0].into_iter().any(is_refused));
    }

    proptest! {
        #[test]
        fn mes_with_full_deadline_weight_equals_edf(
            sensors in prop::collection::vec(([0.0..100.0, 0.0..100.0, 0.0..90.0], 0u32..1_000), 0..12),
        ) {
            let (sensors, queues_bits): (Vec<[f64; 3]>, Vec<u32>) = sensors.into_iter().unzip();
            let field = field_of(&sensors);
            let view = view(&field.table, 1, [50.0, 50.0], &queues_bits);
            let decided = mes(&field.setup(), 1.0).plan(&view);
            let by_edf = (edf::STRATEGY.make)(&field.setup()).plan(&view);
            prop_assert_eq!(format!("{decided:?}"), format!("{by_edf:?}"));
        }

        /// The rule in other words: no SN has a smaller sum than the one that is flown to.
        #[test]
        fn no_sensor_node_has_a_smaller_sum(
            sensors in prop::collection::vec(([0.0..100.0, 0.0..100.0, 1.0..90.0], 0u32..1_000), 1..12),
            weight in 0.0f64..1.0,
        ) {
            let (sensors, queues_bits): (Vec<[f64; 3]>, Vec<u32>) = sensors.into_iter().unzip();
            let sum = |id: usize| -> f64 {
                let [x_m, y_m, sampling_bps] = sensors[id];
                let deadline_s = f64::from(1_000 - queues_bits[id]) / sampling_bps;
                weight * deadline_s + (1.0 - weight) * (x_m - 50.0).hypot(y_m - 50.0) / 30.0
            };
            let best = (0..sensors.len()).min_by(|&a, &b| sum(a).total_cmp(&sum(b))).unwrap();
            let [x_m, y_m] = waypoint(weight, &sensors, &queues_bits).unwrap();
            let away = [sensors[best][0] - 50.0, sensors[best][1] - 50.0];
            let flown = [x_m - 50.0, y_m - 50.0];
            let fraction = (30.0 / away[0].hypot(away[1])).min(1.0);
            prop_assert!((flown[0] - fraction * away[0]).abs() < 1e-9 && (flown[1] - fraction * away[1]).abs() < 1e-9);
        }
    }
}
