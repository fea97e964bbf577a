//! Missions with no-fly zones (decisions D14 and D15): no strategy and no plan leads into one, by the library `geo`.

use crate::support::scenario_of;
use geo::{Coord, LineString, Polygon, Relate};
use proptest::prelude::*;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_mission::{Mission, Plant};
use skysink_planner::geometry::turns::Turns;
use skysink_planner::mission_table::MissionTable;
use skysink_planner::settings;
use skysink_planner::strategies::names;

/// A wall, a hook, and a block that overlaps the hook.
const ZONES: [&[[f64; 2]]; 3] = [
    &[[100.0, 60.0], [140.0, 60.0], [140.0, 240.0], [100.0, 240.0]],
    &[[180.0, 100.0], [260.0, 100.0], [260.0, 130.0], [210.0, 130.0], [210.0, 200.0], [180.0, 200.0]],
    &[[190.0, 180.0], [240.0, 190.0], [235.0, 230.0]],
];

/// A mission of 300 m × 300 m with the first `count` zones.
fn scenario(count: usize, seed: u64, strategy: &'static str, keys: &str) -> Scenario {
    let zones: Vec<String> = ZONES[..count].iter().map(|corners| format!("{{ polygon_m = {corners:?} }}")).collect();
    let text = format!(
        "name = 'x'\nseed = {seed}\nslots = 120\n[area]\nside_m = 300.0\nno_fly = [{}]\n[sensors]\ncount = 60\n\
         sampling_bps = [100.0, 900.0]\n[uav]\nstart_m = [160.0, 80.0]\n{keys}\n[planner]\nhorizon.iterations = 100\n\
         offline.steps = 2000\nbest-of = {{ iterations = 100, window = 10 }}\n",
        zones.join(", ")
    );
    scenario_of(&text, strategy)
}

fn polygons(count: usize) -> Vec<Polygon> {
    let line = |corners: &&[[f64; 2]]| LineString::from(corners.iter().map(|&[x, y]| (x, y)).collect::<Vec<_>>());
    ZONES[..count].iter().map(|corners| Polygon::new(line(corners), vec![])).collect()
}

/// Whether the segment between two positions has a point in the interior of a zone (DE-9IM).
fn enters(zones: &[Polygon], from: &FlightReport, to: &FlightReport) -> bool {
    let [from, to] = [from, to].map(|report| Coord { x: report.x_m, y: report.y_m });
    let way = LineString::from(vec![from, to]);
    from != to && zones.iter().any(|zone| zone.relate(&way).matches("T********").expect("a pattern"))
}

/// Flies all strategies around one to three zones.
fn fly_all(keys: &str) {
    for (seed, strategy) in (1..).zip(names()) {
        for count in 1..=3 {
            let scenario = scenario(count, seed, strategy, keys);
            let zones = polygons(count);
            let list = SensorList::of(&scenario).unwrap();
            let table = MissionTable::of(&scenario, &list.nodes());
            let mut last = *Plant::new(&scenario, &list).flight(UAV);
            let mut served = std::collections::BTreeSet::new();
            for record in Mission::new(&scenario, &list).unwrap() {
                let flight = record.flights()[UAV];
                assert!(!enters(&zones, &last, &flight), "{strategy}, {count} zones, slot {}", record.slot());
                assert_eq!(flight.hold, HoldReason::None as u32, "{strategy}, {count} zones, slot {}", record.slot());
                served.extend(flight.served_links().iter().map(|link| link.sensor));
                last = flight;
            }
            assert!(served.iter().all(|&id| table.is_reachable(id)), "{strategy}");
            let servable = table.reachable().count();
            assert!(servable > 30, "{servable}");
            // Those that go round must not get stuck.
            let least = match strategy {
                "tour" => servable * 2 / 3,

                "round-robin" | "max-age-first" => servable / 3,
                _ => 0,
            };
            let is_held_up = !keys.is_empty();
            assert!(is_held_up || served.len() >= least, "{strategy}, {count} zones: {} of {servable}", served.len());
        }
    }
}

#[test]
fn no_strategy_flies_into_a_zone() {
    fly_all("");
}

#[test]
fn a_thin_zone_causes_no_holds() {
    let text = "name='needle'\nslots=700\n[area]\nside_m=300.0\nno_fly=[{polygon_m=[[300.0,200.0],[10.0,200.5],[300.0,201.0]]}]\n\
                [sensors]\ncount=30\n[uav]\nendurance_s=7000.0\nstart_m=[150.0,50.0]\n";
    for strategy in ["mes", "edf", "tour", "round-robin"] {
        let scenario = scenario_of(text, strategy);
        let list = SensorList::of(&scenario).unwrap();
        let mut last = *Plant::new(&scenario, &list).flight(UAV);
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights()[UAV];
            let plan = record.plans()[UAV].map(|plan| plan.waypoint());
            assert_eq!(flight.hold, 0, "{strategy}, slot {}: {:?} to {plan:?}", record.slot(), last.position());
            last = flight;
        }
    }
}

#[test]
fn the_return_path_on_battery_leads_around_zones() {
    let keys =
        "must_land = true\nbattery = { capacity_j = 12000.0 }\n[base]\nposition_m = [60.0, 150.0]\ncharge_w = 900.0";
    fly_all(keys);
    for (seed, strategy) in (1..).zip(names()) {
        let scenario = scenario(3, seed, strategy, keys);
        let list = SensorList::of(&scenario).unwrap();
        let flights: Vec<FlightReport> =
            Mission::new(&scenario, &list).unwrap().map(|record| record.flights()[UAV]).collect();
        let least_j = flights.iter().map(|flight| flight.energy_j).fold(f64::INFINITY, f64::min);
        assert!(least_j >= 1_200.0 - 1e-6, "{strategy}: {least_j} J");
        let end = flights[flights.len() - 1];
        assert!((end.x_m - 60.0).hypot(end.y_m - 150.0) <= 1.0 + 1e-6, "{strategy} ends at {}, {}", end.x_m, end.y_m);
    }
}

/// A town with a tall block and a low one, over which the UAV flies, and SNs that are 2 m high.
fn town(strategy: &'static str) -> Scenario {
    let text = "name = 'town'\nslots = 150\n[area]\nside_m = 200.0\nbuilding = [\
                { polygon_m = [[40, 40], [90, 40], [90, 90], [40, 90]], height_m = 50 },\
                { polygon_m = [[120, 30], [140, 30], [140, 170], [120, 170]], height_m = 15 }]\n\
                [sensors]\ncount = 50\nheight_m = 2.0\nsampling_bps = [500.0, 3000.0]\n[uav]\naltitude_m = 40.0\n\
                [link]\nmodel = 'buildings'\ncomm_radius_m = 50.0\ntx_power_w = 0.002\n\
                [planner]\nhorizon.iterations = 100\noffline.steps = 2000\nbest-of = { iterations = 100, window = 10 }\n";
    scenario_of(text, strategy)
}

/// Whether a link of the town is in sight, by hand: the walls are along the axes.
fn is_in_sight(sensor: [f64; 3], uav: [f64; 3]) -> bool {
    [([40.0, 40.0], [90.0, 90.0], 50.0), ([120.0, 30.0], [140.0, 170.0], 15.0)].iter().all(|(low, high, top_m)| {
        let slabs = [(0, low[0], high[0]), (1, low[1], high[1]), (2, f64::NEG_INFINITY, *top_m)];
        let [from, to] = slabs.iter().fold([0.0f64, 1.0], |[from, to], &(axis, low, high)| {
            let along = uav[axis] - sensor[axis];
            let [a, b] = [(low - sensor[axis]) / along, (high - sensor[axis]) / along];
            [from.max(a.min(b)), to.min(a.max(b))]
        });
        from >= to
    })
}

#[test]
fn links_among_buildings_have_the_rate_of_their_state() {
    let rate_bps = |snr_db: f64, exponent: f64, distance_m: f64| {
        5e6 * (1.0 + 10f64.powf(snr_db / 10.0) * distance_m.powf(-exponent)).log2()
    };
    let mut states = [0, 0];
    for strategy in names() {
        let scenario = town(strategy);
        let list = SensorList::of(&scenario).unwrap();
        let nodes = list.nodes();
        let mut served = 0;
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights()[UAV];
            served += flight.served;
            for link in flight.served_links() {
                let node = nodes[link.sensor as usize];
                let expected = is_in_sight([node.x_m, node.y_m, 2.0], [flight.x_m, flight.y_m, 40.0]);
                assert_eq!(link.line_of_sight == 1, expected, "{strategy}, slot {}, SN {}", record.slot(), link.sensor);
                states[usize::from(expected)] += 1;
                // p β0/(σ² Γ): 2 mW are −27 dBW, σ² is −130 dBW, β0 −60 dB and Γ 8.2 dB.
                let snr_db = 10.0 * 0.002f64.log10() + 130.0 - 60.0 - 8.2;
                let distance_m = (node.x_m - flight.x_m).hypot(node.y_m - flight.y_m).hypot(38.0);
                let expected_bps = match expected {
                    true => rate_bps(snr_db, 2.5, distance_m),
                    false => rate_bps(snr_db - 20.0, 3.5, distance_m),
                };
                assert!((link.rate_bps / expected_bps - 1.0).abs() < 1e-9, "{} and {expected_bps}", link.rate_bps);
            }
        }
        assert!(served > 100, "{strategy}: {served}");
    }
    assert!(states.iter().all(|&count| count > 500), "{states:?}");
}

/// Two full SNs, of which a wall hides the one that is a little nearer: a strategy that weighs bits serves the other.
#[test]
fn strategies_know_the_map_of_buildings() {
    let list = "x_m,y_m\n100.0,120.0\n100.0,81.0\n";
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sensors.csv"), list).unwrap();
    let text = "name = 'wall'\nslots = 2\n[area]\nside_m = 200.0\n\
                building = [{ polygon_m = [[90, 89], [110, 89], [110, 90], [90, 90]], height_m = 38 }]\n\
                [sensors]\nfile = 'sensors.csv'\ninitial_queue_mean_bits = 30000\nsampling_bps = 9000.0\n\
                [uav]\naltitude_m = 40.0\nmax_speed_mps = 0.5\nstart_m = [100.0, 100.0]\n\
                [link]\nmodel = 'buildings'\ncomm_radius_m = 60.0\nresource_blocks = 1\ntx_power_w = 0.00002\n";
    for strategy in ["max-weight", "horizon"] {
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let path = folder.path().join("x.toml");
        let scenario = Scenario::parse(text, &path, overrides).and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let record = Mission::new(&scenario, &list).unwrap().nth(1).unwrap();
        let served: Vec<(u32, u32)> =
            record.flights()[UAV].served_links().iter().map(|link| (link.sensor, link.line_of_sight)).collect();
        assert_eq!(served, [(0, 1)], "{strategy}");
    }
}

#[test]
fn position_errors_do_not_enter_zones() {
    for (seed, strategy) in (1..).zip(names()) {
        let scenario = scenario(3, seed, strategy, "position_error_m = 4.0");
        let list = SensorList::of(&scenario).unwrap();
        let zones = polygons(3);
        let mut last = *Plant::new(&scenario, &list).flight(UAV);
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights()[UAV];
            assert!(!enters(&zones, &last, &flight), "{strategy}, slot {}", record.slot());
            last = flight;
        }
    }
}

#[test]
fn sensor_nodes_and_flights_stay_within_the_boundary() {
    let text = "name = 'x'\nslots = 80\n[area]\nboundary_m = [[10, 10], [90, 10], [90, 40], [40, 40], [40, 90], [10, 90]]\n\
                [uav]\nstart_m = [20.0, 20.0]\n[sensors]\ncount = 50\n";
    let corners = [(10.0, 10.0), (90.0, 10.0), (90.0, 40.0), (40.0, 40.0), (40.0, 90.0), (10.0, 90.0)];
    let boundary = Polygon::new(LineString::from(corners.to_vec()), vec![]);
    for strategy in ["tour", "round-robin", "uts", "horizon"] {
        let scenario = scenario_of(text, strategy);
        let list = SensorList::of(&scenario).unwrap();
        let is_within = |x: f64, y: f64| boundary.relate(&geo::Point::new(x, y)).is_covers();
        assert!(list.sensors().iter().all(|sensor| is_within(sensor.position.x, sensor.position.y)));
        let mut last = *Plant::new(&scenario, &list).flight(UAV);
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights()[UAV];
            let way = LineString::from(vec![(last.x_m, last.y_m), (flight.x_m, flight.y_m)]);
            assert!(
                last.position() == flight.position() || boundary.relate(&way).is_covers(),
                "slot {}",
                record.slot()
            );
            last = flight;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever is planned, no flight enters a zone.
    #[test]
    fn no_plan_enters_a_zone(
        steps in prop::collection::vec((-40.0f64..40.0, -40.0f64..40.0, any::<bool>()), 100)
    ) {
        let scenario = scenario(3, 1, "uts", "");
        let zones = polygons(3);
        let list = SensorList::of(&scenario).unwrap();
        let mut plant = Plant::new(&scenario, &list);
        let mut refused = 0;
        for (x_m, y_m, is_short) in steps {
            let before = *plant.flight(UAV);
            let step = nalgebra::Vector3::new(x_m, y_m, 0.0) * if is_short { 0.3 } else { 1.0 };
            plant.step(&[Some(Plan::fly_to(before.position() + step, Mode::Serve))]);
            let flight = *plant.flight(UAV);
            prop_assert!(!enters(&zones, &before, &flight), "{before:?} {flight:?}");
            let is_through = HoldReason::from_repr(flight.hold) == Some(HoldReason::Zone);
            prop_assert!(!is_through || flight.position() == before.position() && flight.refused == 1);
            refused += u32::from(is_through);
        }
        prop_assert!(refused < 100);
    }
}

#[test]
fn tours_around_walls_are_short() {
    // Walls open in turn at the north and at the south: a round that is short in a straight line crosses them.
    let walls: Vec<String> = (1..=4)
        .map(|wall| {
            let [x_m, low_m] = [100.0 * f64::from(wall), if wall % 2 == 0 { 80.0 } else { 0.0 }];
            let [east_m, high_m] = [x_m + 10.0, low_m + 420.0];
            format!(
                "{{ polygon_m = [[{x_m}, {low_m}], [{east_m}, {low_m}], [{east_m}, {high_m}], [{x_m}, {high_m}]] }}"
            )
        })
        .collect();
    let keys = format!("slots = 600\n[area]\nside_m = 500.0\nno_fly = [{}]", walls.join(", "));
    for seed in 1..=3 {
        let text = format!("name = 'walls'\nseed = {seed}\n{keys}\n");
        let scenario = scenario_of(&text, "tour");
        let list = SensorList::of(&scenario).unwrap();
        let table = MissionTable::of(&scenario, &list.nodes());
        let length_m = |turns: &Turns| -> f64 {
            let next = turns.points.iter().cycle().skip(1);
            let ends = turns.points.iter().zip(next);
            ends.map(|(from, to)| table.airspace.distance_m(&table.airspace.nearest(from), to)).sum()
        };
        let straight = Turns::new(&table.sensors.positions, table.limits.comm_radius_m, &Stop::default());
        let [around_m, straight_m] = [&table.turns(&Stop::default()), &straight].map(length_m);
        assert!(around_m < 0.75 * straight_m, "seed {seed}: {around_m} m and {straight_m} m");
    }
}

#[test]
fn zones_that_share_an_edge_are_flown_around_as_one() {
    let west = "[[100.0, 100.0], [200.0, 100.0], [200.0, 300.0], [100.0, 300.0]]";
    let east = "[[200.0, 100.0], [300.0, 100.0], [300.0, 300.0], [200.0, 300.0]]";
    let on_edge = "[[0.0, 100.0], [300.0, 100.0], [300.0, 300.0], [0.0, 300.0]]";
    for (zones, what) in [
        (format!("no_fly = [{{ polygon_m = {west} }}, {{ polygon_m = {east} }}]"), "parcels"),
        (
            format!(
                "building = [{{ polygon_m = {west}, height_m = 30.0 }}, {{ polygon_m = {east}, height_m = 60.0 }}]"
            ),
            "houses",
        ),
        (format!("no_fly = [{{ polygon_m = {on_edge} }}]"), "a zone on the edge of the area"),
    ] {
        let text = format!(
            "name = 'parcels'\nslots = 150\n[area]\nside_m = 400.0\n{zones}\n[sensors]\ncount = 60\n[uav]\nstart_m = [350.0, 50.0]\n"
        );
        let scenario = scenario_of(&text, "tour");
        let list = SensorList::of(&scenario).unwrap();
        let is_inside = |flight: &FlightReport| {
            let is_between = |at_m: f64, low_m: f64| low_m < at_m && at_m < 299.99;
            let west_m = if what.contains("edge") { -1.0 } else { 100.01 };
            is_between(flight.x_m, west_m) && is_between(flight.y_m, 100.01)
        };
        let inside = Mission::new(&scenario, &list).unwrap().filter(|record| is_inside(&record.flights()[UAV])).count();
        assert_eq!(inside, 0, "slots in {what}");
    }
}
