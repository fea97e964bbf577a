//! `edf`: earliest deadline first (EDF).
//!
//! The deadline of a sensor node (SN) is the time until its buffer overflows, `u_i = (B − B_i(t−1))/(s_i τ)` [slots].
//! In every slot the UAV flies straight toward the SN of least `u_i`. It serves that SN as soon as it is in range, and
//! with it the n − 1 fullest of the others.
//!
//! Source: A. A. Somasundara, A. Ramamoorthy, M. B. Srivastava, "Mobile Element Scheduling for Efficient Data
//! Collection in Wireless Sensor Networks with Dynamic Deadlines", RTSS 2004; "Mobile Element Scheduling with Dynamic
//! Deadlines", IEEE Transactions on Mobile Computing 6(4), 2007, where EDF is a baseline. There a mobile element visits
//! nodes before their buffers overflow; a visit takes no time, empties the buffer, and sets the node's next deadline.
//! (The abstract of the first and a published summary of the problem were read, not the full texts.)
//!
//! Adapted to slots:
//! - The choice is repeated in every slot. All deadlines decrease by one per slot, down to 0 at a full buffer, so the
//!   choice changes only if a nearer SN becomes full as well, or if the SN was served from a distance.
//! - The mobile element serves only the node that it visits; the UAV serves up to n SNs per slot.

use skysink_common::geometry::distance_squared;

use crate::serving::Serving;
use crate::strategy::{Registered, Setup, Strategy, View, rule};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("edf", "earliest deadline first: fly to the sensor node that overflows soonest", |setup| {
        toward_least(setup, |view, id| view.belief.deadline_slots(id))
    })
    .without_weights();

/// Straight toward the SN of least `cost`, until above it; ties go to the nearest, then to the lowest index. It is
/// served as soon as it is in range, with the fullest of the others. No decision if none has a cost.
pub(crate) fn toward_least(setup: &Setup, cost: impl Fn(&View<'_>, u32) -> Option<f64> + 'static) -> Box<dyn Strategy> {
    let mut serving = Serving::new(setup);
    rule(move |view| {
        let first = least(view, |id| cost(view, id))?;
        let waypoint = view.table.motion.toward(&view.ground(), view.table.sensors.position(first));
        Some(serving.serve_first(view, &waypoint, |id| id == first))
    })
}

/// The SN of least `cost`, ties to the nearest and then to the lowest index; `None` if none has a cost.
fn least(view: &View, cost: impl Fn(u32) -> Option<f64>) -> Option<u32> {
    let ground = view.ground();
    let away_m2 = |id: u32| distance_squared(view.table.sensors.position(id), &ground);
    let mut least: Option<(f64, u32)> = None;
    for id in view.servable() {
        let Some(cost) = cost(id) else { continue };
        let is_less = least.is_none_or(|(least, other)| cost < least || cost == least && away_m2(id) < away_m2(other));
        if is_less {
            least = Some((cost, id));
        }
    }
    least.map(|(_, id)| id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::MissionTable;
    use crate::strategy::tests::{over, view};
    use skysink_common::message::SensorNode;
    use skysink_common::scenario::{Overrides, Scenario};

    /// SNs at these positions [m] that sample so much [bit/s] into 1 000 bit.
    fn edf(sensors: &[([f64; 2], f64)]) -> (MissionTable, Box<dyn Strategy>) {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let node = |&([x_m, y_m], sampling_bps): &([f64; 2], f64)| SensorNode {
            x_m,
            y_m,
            sampling_bps,
            gain: 1e-5,
            capacity_bits: 1_000,
            ..SensorNode::default()
        };
        let field = over(scenario, sensors.iter().map(node).collect());
        let edf = (STRATEGY.make)(&field.setup());
        (field.table, edf)
    }

    fn waypoint(sensors: &[([f64; 2], f64)], queues_bits: &[u32]) -> Option<[f64; 2]> {
        let (table, mut edf) = edf(sensors);
        edf.plan(&view(&table, 1, [50.0, 50.0], queues_bits)).map(|decision| decision.waypoint.xy().into())
    }

    #[test]
    fn edf_flies_to_the_earliest_overflow_not_the_fullest_queue() {
        // 100 bit of room at 10 bit a slot last 10 slots, 500 at 100 last 5.
        assert_eq!(waypoint(&[([50.0, 60.0], 10.0), ([60.0, 50.0], 100.0)], &[900, 500]), Some([60.0, 50.0]));
        // 50 m away, (30, 40): 30 m of it are (18, 24).
        assert_eq!(waypoint(&[([80.0, 90.0], 10.0)], &[0]), Some([68.0, 74.0]));
    }

    #[test]
    fn ties_of_deadline_go_to_the_nearest_then_the_lowest_index() {
        let sensors = [([50.0, 75.0], 10.0), ([50.0, 30.0], 10.0), ([70.0, 50.0], 10.0)];
        assert_eq!(waypoint(&sensors, &[500, 500, 500]), Some([50.0, 30.0]));
    }

    #[test]
    fn idle_sensor_nodes_have_no_deadline_and_give_no_decision() {
        assert_eq!(waypoint(&[([50.0, 60.0], 0.0), ([60.0, 50.0], 1.0)], &[1_000, 0]), Some([60.0, 50.0]));
        assert_eq!(waypoint(&[([50.0, 60.0], 0.0)], &[1_000]), None);
        assert_eq!(waypoint(&[], &[]), None);
    }

    #[test]
    fn the_fullest_queues_in_range_of_the_waypoint_are_served() {
        let sensor = |x_m| ([x_m, 50.0], 10.0);
        let (table, mut edf) =
            edf(&[sensor(50.0), sensor(51.0), sensor(52.0), sensor(53.0), sensor(54.0), sensor(90.0)]);
        let decision = edf.plan(&view(&table, 1, [50.0, 50.0], &[1, 5, 6, 7, 8, 2])).unwrap();
        assert_eq!(decision.schedule[..], [1, 2, 3, 4]);
    }

    #[test]
    fn the_target_is_served_before_fuller_queues() {
        // SN 0 has 2 slots of room, the others 10 and more.
        let sensor = |x_m, sampling_bps| ([x_m, 50.0], sampling_bps);
        let sensors = [sensor(50.0, 400.0), sensor(51.0, 1.0), sensor(52.0, 1.0), sensor(53.0, 1.0), sensor(54.0, 1.0)];
        let (table, mut edf) = edf(&sensors);
        let decision = edf.plan(&view(&table, 1, [45.0, 50.0], &[200, 990, 980, 970, 960])).unwrap();
        assert_eq!((decision.waypoint.x, &decision.schedule[..]), (50.0, &[0, 1, 2, 3][..]));
    }
}
