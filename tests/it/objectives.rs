//! Missions for other objectives than the least loss (decisions D36 and D39), in one process and in a ring.

use crate::support::Place;

#[test]
fn ring_and_single_process_fly_the_same_for_sums_of_costs_and_shared_time() {
    let place = Place::new();
    for (objective, uavs) in [("\"age\"", 1), ("{ loss = 1.0, age = 0.5, peak_age = 1e-6, deadline = 10.0 }", 2)] {
        let flight = place.flight("smoke").set("slots", 30).set("planner.objective", objective).force();
        let flight = flight.set("sensors.deadline_s", 9).set("link.setup_s", 0.02).set("link.sharing", "equal");
        let flight = flight.set("uav.count", uavs).strategy("horizon");
        flight.set("planner.horizon.iterations", 50).without_viewer().run();
        place.assert_trace_as_simulated("run");
    }
}
