//! The plans do not depend on how the sensor nodes are looked up: by the grid or by a loop over all of them.

use std::path::Path;
use std::sync::Arc;

use proptest::prelude::{Strategy as Generator, *};
use skysink_common::geometry::{Position, above};
use skysink_common::message::SensorNode;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::Sensors;
use skysink_common::sensors::grid::Grid;
use skysink_common::stop::Stop;
use skysink_planner::Planner;
use skysink_planner::strategies::look_ahead::{self, OfflineKeys};
use skysink_planner::strategies::names;
use skysink_planner::strategy::Registered;

/// A field over which both planners plan.
#[derive(Debug, Clone)]
struct Case {
    /// Keys of the scenario.
    text: String,
    sensors: Vec<SensorNode>,
    /// Positions of the UAV, and the queues [bit] there.
    slots: Vec<(Position, Vec<u32>)>,
}

impl Case {
    fn scenario(&self, strategy: &'static str) -> Scenario {
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let mut scenario = Scenario::parse(&self.text, Path::new("case.toml"), overrides).unwrap();
        look_ahead::OFFLINE.set_keys(&mut scenario, OfflineKeys { steps: 500 });
        scenario
    }
}

/// A planner that tests every SN in every look around.
fn undivided(scenario: &Scenario, sensors: &[SensorNode]) -> Planner {
    let sensors = Sensors::of(scenario, sensors);
    let grid = Grid::new(&sensors.positions, f64::INFINITY);
    let make = Registered::of(scenario).unwrap().make;
    let sensors = Arc::new(Sensors { grid, ..sensors });
    Planner::over(scenario, sensors, &mut |setup| Ok(make(setup)), None, &Stop::default()).unwrap()
}

/// Shares of the side: anywhere, on the area's border, and on a lattice that is one of cells' borders, too.
fn shares() -> impl Generator<Value = f64> {
    prop_oneof![2 => 0.0..=1.0, 1 => Just(0.0), 1 => Just(1.0), 2 => (0u32..=20).prop_map(|step| f64::from(step) / 20.0)]
}

/// Where SNs stand, as shares of the side: spread, in a cluster, or all in one point.
fn fields() -> impl Generator<Value = Vec<(f64, f64)>> {
    let spread = prop::collection::vec((shares(), shares()), 1..80);
    (spread, prop::sample::select(vec![1.0, 1.0, 0.05, 0.0])).prop_map(|(places, scale)| {
        places.iter().map(|(x, y)| (0.5 + (x - 0.5) * scale, 0.5 + (y - 0.5) * scale)).collect()
    })
}

/// Dense and sparse fields, with a range below and above the area's side, and a reach likewise.
fn cases() -> impl Generator<Value = Case> {
    let limits = (
        prop::sample::select(vec![5.0, 60.0, 100.0, 400.0, 5e4]),
        prop_oneof![Just(10.0), Just(3.0), Just(25.0), Just(700.0)],
        prop_oneof![Just(30.0), Just(5.0), Just(10.0), Just(1e3)],
        prop_oneof![1u32..6, Just(64)],
    );
    let slots = prop::collection::vec((any::<prop::sample::Index>(), shares(), shares(), 0u32..5), 1..5);
    (limits, fields(), slots, any::<u64>()).prop_map(|((side_m, range_m, reach_m, blocks), places, slots, mixer)| {
        let text = format!(
            "name = 'case'\n[area]\nside_m = {side_m:?}\n[uav]\nmax_speed_mps = {reach_m:?}\n[link]\n\
             bandwidth_hz = 5e3\ncomm_radius_m = {range_m:?}\nresource_blocks = {blocks}\n"
        );
        let node =
            |&(x, y): &(f64, f64)| SensorNode { x_m: x * side_m, y_m: y * side_m, gain: 1e-5, ..Default::default() };
        let sensors: Vec<SensorNode> = places.iter().map(node).collect();
        let queue_bits = |id: usize, kind: u32| match kind {
            0 => 30_000,
            1 => (id % 3) as u32,
            _ => (mixer.wrapping_mul(2 * id as u64 + 1) >> 40) as u32 % 30_000,
        };
        let slot = |(own, x, y, kind): (prop::sample::Index, f64, f64, u32)| {
            let over = sensors[own.index(sensors.len())];
            let at = if kind == 4 { [over.x_m, over.y_m] } else { [x * side_m, y * side_m] };
            (Position::from(at), (0..sensors.len()).map(|id| queue_bits(id, kind)).collect())
        };
        let slots = slots.into_iter().map(slot).collect();
        Case { text, sensors, slots }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60 * crate::CASES_FACTOR))]

    /// Debug output shows every bit of a float but a NaN's, of which a plan has some.
    #[test]
    fn plans_do_not_depend_on_the_spatial_index(case in cases()) {
        for strategy in names() {
            let scenario = case.scenario(strategy);
            let mut divided = Planner::new(&scenario, &case.sensors).unwrap();
            let mut undivided = undivided(&scenario, &case.sensors);
            for (number, (position, queues_bits)) in (1..).zip(&case.slots) {
                let [own, expected] = [&mut divided, &mut undivided]
                    .map(|planner| format!("{:?}", planner.step(number, above(position, 20.0), queues_bits)));
                prop_assert_eq!(own, expected, "{}, slot {}", strategy, number);
            }
        }
    }
}
