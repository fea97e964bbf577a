//! `sca`: successive convex approximation (SCA) of the whole flight and its times, before take-off.
//!
//! The first plan is fly, hover and communicate: the round of `tour`, on which the UAV stays with a sensor node until
//! its queue is empty, or for one slot if that loses less. In each step the services that save nothing are left out,
//! and a cone program moves all stops and their times at once, with tangents as bounds of rates and bits. The best
//! flight is flown without changes.
//!
//! Source: Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless Communication With Rotary-Wing UAV", IEEE
//! Transactions on Wireless Communications 18(4), 2019; C. Zhan, Y. Zeng, R. Zhang, "Energy-Efficient Data Collection
//! in UAV Enabled Wireless Sensor Network", IEEE Wireless Communications Letters, 2018; C. You, R. Zhang, "Hybrid
//! Offline-Online Design for UAV-Enabled Data Harvesting in Probabilistic LoS Channels", IEEE Transactions on Wireless
//! Communications, 2020. There objectives are energy and rates; here the loss, with stops in range. (Of the second
//! the title was read, of the others the abstracts.)

mod program;
mod rehearsal;
mod stops;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::{Position, above};
use skysink_common::keys::Accepts;
use skysink_common::message::MAX_PATH_POINTS;

use super::tour;
use super::turns::InTurn;
use crate::mission_table::MissionTable;
use crate::serving::Serving;
use crate::strategy::{Decision, Registered, Setup, Strategy, View};
use rehearsal::{FlightPlan, Rehearsal};
use stops::{TimedStop, stops_of};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("sca", "successive convex approximation of the flight and its times, before take-off", |setup| {
        Box::new(Approximation::new(setup))
    })
    .with_state()
    .with_path()
    .with_keys::<ScaKeys>();

skysink_common::keys! {
    /// `[planner.sca]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct ScaKeys {
        /// Most convex approximations; 0 flies the round alone.
        iterations: u32 = 20, Accepts::Whole(0, 1000);
    }
}

/// Most services of a plan; a longer mission is planned in parts.
const MOST_SERVICES: u64 = 20_000;

/// Most slots of a plan times SNs.
const MOST_SENSOR_SLOTS: u64 = 100_000_000;

/// Approximations in a row that need not lose less than the best so far.
const PATIENCE: u32 = 3;

/// Relative decrease of the loss that counts.
const SETTLED: f64 = 1e-9;

struct Approximation {
    iterations: u32,
    /// Whether what is left in the queues is lost, too.
    collects: bool,
    round: InTurn,
    serving: Serving,
    plan: FlightPlan,
    /// The planned waypoints after the last decided one.
    path: Vec<Point3<f64>>,
}

impl Approximation {
    fn new(setup: &Setup) -> Self {
        let ScaKeys { iterations } = setup.scenario.planner_keys("planner.sca").expect("they were checked");
        Self {
            iterations,
            collects: setup.settings.objective.is_collect(),
            round: tour::round(setup),
            serving: Serving::new(setup),
            plan: FlightPlan::default(),
            path: Vec::with_capacity(MAX_PATH_POINTS),
        }
    }

    /// The best flight of all approximations from the slot of `view` on.
    fn best<'a>(&mut self, view: &View<'a>) -> Rehearsal<'a> {
        self.round.restart(); // so that a plan does not depend on the one before, which a restarted process lacks
        let mut best = self.first_round(view);
        let mut at = stops_of(&best);
        let mut fruitless = 0;
        // On a grid the points of stops are cells, not a convex set.
        let iterations = if view.table.motion.is_by_cells() { 0 } else { self.iterations };
        for _ in 0..iterations {
            if view.stop.requested().is_some() || fruitless == PATIENCE {
                break;
            }
            let Some(improved) = program::improved(&best, &at) else { break };
            let [exact, hurried] = [false, true].map(|hurries| self.flown(view, &improved, hurries));
            let flight = if hurried.cost() < exact.cost() { hurried } else { exact };
            at = stops_of(&flight);
            fruitless += 1;
            if flight.cost() < best.cost() * (1.0 - SETTLED) {
                best = flight;
                fruitless = 0;
            }
        }
        best
    }

    /// The better of two rounds: one that stays until queues are empty, and one that does not.
    fn first_round<'a>(&mut self, view: &View<'a>) -> Rehearsal<'a> {
        let [draining, passing] = [true, false].map(|drains| {
            let mut flight = Rehearsal::new(view, slots_of(view), self.collects);
            self.round.begin_with(None, drains);
            flight.follow(&mut self.round);
            flight
        });
        if passing.cost() < draining.cost() { passing } else { draining }
    }

    /// The flight from stop to stop, and then along the round, from the SN that overflows soonest on.
    fn flown<'a>(&mut self, view: &View<'a>, stops: &[TimedStop], hurries: bool) -> Rehearsal<'a> {
        let mut flight = Rehearsal::new(view, slots_of(view), self.collects);
        stops.iter().for_each(|stop| flight.visit(&mut self.serving, stop, hurries));
        self.round.begin_with(flight.most_urgent(), true);
        flight.follow(&mut self.round);
        flight
    }
}

/// The slots that a plan is made for at `view`.
fn slots_of(view: &View) -> u64 {
    let MissionTable { limits, sensors, .. } = view.table;
    let left = (limits.slots + 1).saturating_sub(view.slot);
    let most = (MOST_SERVICES / limits.blocks().max(1) as u64).min(MOST_SENSOR_SLOTS / sensors.count().max(1) as u64);
    left.min(most).max(1)
}

impl Strategy for Approximation {
    /// Flies toward where the plan ends the slot, and serves whom it serves there, then the fullest in range.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if self.plan.index(view.slot).is_none() {
            self.plan = self.best(view).into_plan();
        }
        let index = self.plan.index(view.slot)?;
        let FlightPlan { ends, served, .. } = &self.plan;
        let waypoint = view.table.motion.toward(&view.ground(), &Position::from(ends[index]));
        let decision = self.serving.serve_first(view, &waypoint, |id| served[index].contains(&id));
        self.path.clear();
        let later = ends[index + 1..].iter().take(MAX_PATH_POINTS);
        self.path.extend(later.map(|end| above(&Position::from(*end), decision.waypoint.z)));
        Some(decision)
    }

    fn path(&self) -> &[Point3<f64>] {
        &self.path
    }
}

impl Checkpoint for Approximation {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&self.plan, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let plan: FlightPlan = decode(bytes)?;
        CheckpointError::ensure(plan.ends.len() == plan.served.len(), "whom each slot serves")?;
        CheckpointError::ensure(plan.ends.as_flattened().iter().all(|end_m| end_m.is_finite()), "finite waypoints")?;
        self.plan = plan;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategy::OwnedSetup;
    use crate::strategy::tests::{over, view};
    use proptest::prelude::{ProptestConfig, prop, prop_assert, proptest};
    use skysink_common::geometry::within;
    use skysink_common::message::SensorNode;
    use skysink_common::scenario::{Overrides, Scenario};

    /// A field of 100 m × 100 m with these keys, and SNs by position [m] and rate [bit/s] with buffers of 3 000 bit.
    fn field(keys: &str, sensors: &[([f64; 2], f64)]) -> OwnedSetup {
        let text = format!("name = 'x'\n{keys}");
        let node = |&([x_m, y_m], sampling_bps): &([f64; 2], f64)| SensorNode {
            x_m,
            y_m,
            sampling_bps,
            capacity_bits: 3_000,
            gain: 10f64.powf(-5.2),
            ..SensorNode::default()
        };
        over(
            Scenario::parse(&text, "x.toml".as_ref(), Overrides::default()).unwrap(),
            sensors.iter().map(node).collect(),
        )
    }

    /// The best flight from (50, 50) with half full queues.
    fn flight(field: &OwnedSetup, iterations: u32) -> Rehearsal<'_> {
        static HALF: [u32; 64] = [1_500; 64];
        let mut strategy = Approximation { iterations, ..Approximation::new(&field.setup()) };
        strategy.best(&view(&field.table, 1, [50.0, 50.0], &HALF[..field.table.sensors.count()]))
    }

    /// A link that carries 1 680 bit in a slot from above, and 420 bit from the rim of its range of 40 m.
    const NARROW: &str = "[link]\nbandwidth_hz = 20000.0\nnoise_dbm = -60.0\ncomm_radius_m = 40.0\n";

    /// SNs on a lattice that the round passes in `count` stops.
    fn lattice(count: usize, sampling_bps: f64) -> Vec<([f64; 2], f64)> {
        let at = |index: usize| [8.0 + (index * 37 % 84) as f64, 6.0 + (index * 53 % 87) as f64];
        (0..count).map(|index| (at(index), sampling_bps)).collect()
    }

    #[test]
    fn two_sensor_nodes_that_sample_more_than_links_carry_are_served_from_between() {
        // d = 10 m to each: 2 · 1 412 bit; above one of them 1 680 + 960 bit.
        let field = field(&format!("slots = 60\n{NARROW}"), &[([70.0, 30.0], 1_500.0), ([90.0, 30.0], 1_500.0)]);
        let [round, best] = [0, 20].map(|iterations| flight(&field, iterations));
        let away_m = |flight: &Rehearsal| (flight.flown[30].end - Position::new(80.0, 30.0)).norm();
        assert!(away_m(&round) > 5.0, "{}", away_m(&round));
        assert!(away_m(&best) < 2.0, "{}", away_m(&best));
        assert!(best.cost() < 0.9 * round.cost(), "{} of {}", best.cost(), round.cost());
    }

    #[test]
    fn approximations_lose_less_than_the_round() {
        let field = field(&format!("slots = 60\n{NARROW}"), &lattice(6, 500.0));
        let [round, best] = [0, 6].map(|iterations| flight(&field, iterations).cost());
        assert!(best < 0.8 * round, "{best} of {round} bit");
    }

    #[test]
    fn a_plan_is_flown_as_rehearsed_and_continues_from_its_checkpoint() {
        let field = field("slots = 40\n", &lattice(12, 120.0));
        let make = || Approximation { iterations: 2, ..Approximation::new(&field.setup()) };
        let expected = flight(&field, 2);
        let mut flown = make();
        let mut ground = [50.0, 50.0];
        for slot in 1..=40 {
            let mut resumed = make();
            let mut bytes = Vec::new();
            flown.save(&mut bytes);
            resumed.restore(&bytes).unwrap();
            let [decision, again] = [&mut flown, &mut resumed].map(|strategy| {
                let decision = strategy.plan(&view(&field.table, slot, ground, &[1_500; 12])).unwrap();
                (decision.waypoint, decision.schedule, strategy.path().to_vec())
            });
            assert_eq!(decision, again, "slot {slot}");
            let rehearsed = &expected.flown[slot as usize - 1];
            assert!((decision.0.xy() - rehearsed.end).norm() < 1e-9, "slot {slot}: {decision:?}");
            assert!(rehearsed.services.iter().all(|service| decision.1.contains(&service.id)), "slot {slot}");
            assert_eq!(decision.2.len(), 40 - slot as usize, "the rest of the plan");
            ground = decision.0.xy().into();
        }
        let mut bytes = Vec::new();
        encode(&FlightPlan { first: 1, ends: vec![[1.0, f64::NAN]], served: vec![Vec::new()] }, &mut bytes);
        assert!(flown.restore(&bytes).is_err());
    }

    #[test]
    fn a_long_mission_is_planned_in_parts() {
        let field = field("slots = 10000\nuav.endurance_s = 1e5\n", &lattice(1, 10.0));
        let view = |slot| view(&field.table, slot, [50.0, 50.0], &[9]);
        assert_eq!([1, 5_001, 9_000].map(|slot| slots_of(&view(slot))), [5_000, 5_000, 1_001]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        #[test]
        fn no_approximation_loses_more_and_all_keep_to_reach_and_range(
            sensors in prop::collection::vec(([0.0..100.0, 0.0..100.0], 20.0..400.0), 1..12),
            is_narrow: bool,
        ) {
            let field = field(&format!("slots = 40\n{}", if is_narrow { NARROW } else { "" }), &sensors);
            let mut least_bits = f64::INFINITY;
            for iterations in 0..4 {
                let flight = flight(&field, iterations);
                prop_assert!(flight.cost() <= least_bits, "{} after {}", flight.cost(), iterations);
                least_bits = flight.cost();
                let mut from = Position::new(50.0, 50.0);
                for slot in &flight.flown {
                    prop_assert!(within(&slot.end, &from, field.table.limits.reach_m), "{} to {}", from, slot.end);
                    let is_in_range = |id| within(field.table.sensors.position(id), &slot.end, field.table.limits.comm_radius_m);
                    prop_assert!(slot.services.iter().all(|service| is_in_range(service.id)));
                    from = slot.end;
                }
            }
        }
    }
}
