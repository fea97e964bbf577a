//! Missions with no-fly zones (decisions D14 and D15): no strategy and no plan leads into one, by the library `geo`.

use std::path::Path;

use geo::{Coord, LineString, Polygon, Relate};
use proptest::prelude::*;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_mission::{Mission, Plant};
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
         offline.steps = 2000\n",
        zones.join(", ")
    );
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(&text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap()
}

fn polygons(count: usize) -> Vec<Polygon> {
    let line = |corners: &&[[f64; 2]]| LineString::from(corners.iter().map(|&[x, y]| (x, y)).collect::<Vec<_>>());
    ZONES[..count].iter().map(|corners| Polygon::new(line(corners), vec![])).collect()
}

/// Whether the way between two positions has a point in the interior of a zone (DE-9IM).
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
                let flight = record.flights[UAV];
                assert!(!enters(&zones, &last, &flight), "{strategy}, {count} zones, slot {}", record.slot());
                assert_eq!(flight.hold, HoldReason::None as u32, "{strategy}, {count} zones, slot {}", record.slot());
                served.extend(flight.served_links().iter().map(|link| link.sensor));
                last = flight;
            }
            assert!(served.iter().all(|&id| table.is_servable(id)), "{strategy}");
            let servable = table.servable().count();
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
fn a_needle_holds_no_strategy_up() {
    let text = "name='needle'\nslots=700\n[area]\nside_m=300.0\nno_fly=[{polygon_m=[[300.0,200.0],[10.0,200.5],[300.0,201.0]]}]\n\
                [sensors]\ncount=30\n[uav]\nendurance_s=7000.0\nstart_m=[150.0,50.0]\n";
    for strategy in ["mes", "edf", "tour", "round-robin"] {
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let scenario = Scenario::parse(text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let mut last = *Plant::new(&scenario, &list).flight(UAV);
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights[UAV];
            let plan = record.plans[UAV].map(|plan| plan.waypoint());
            assert_eq!(flight.hold, 0, "{strategy}, slot {}: {:?} to {plan:?}", record.slot(), last.position());
            last = flight;
        }
    }
}

#[test]
fn with_a_battery_the_way_home_leads_around_zones() {
    let keys =
        "must_land = true\nbattery = { capacity_j = 12000.0 }\n[base]\nposition_m = [60.0, 150.0]\ncharge_w = 900.0";
    fly_all(keys);
    for (seed, strategy) in (1..).zip(names()) {
        let scenario = scenario(3, seed, strategy, keys);
        let list = SensorList::of(&scenario).unwrap();
        let flights: Vec<FlightReport> =
            Mission::new(&scenario, &list).unwrap().map(|record| record.flights[UAV]).collect();
        let least_j = flights.iter().map(|flight| flight.energy_j).fold(f64::INFINITY, f64::min);
        assert!(least_j >= 1_200.0 - 1e-6, "{strategy}: {least_j} J");
        let end = flights[flights.len() - 1];
        assert!((end.x_m - 60.0).hypot(end.y_m - 150.0) <= 1.0 + 1e-6, "{strategy} ends at {}, {}", end.x_m, end.y_m);
    }
}

#[test]
fn errors_of_position_lead_into_no_zone() {
    for (seed, strategy) in (1..).zip(names()) {
        let scenario = scenario(3, seed, strategy, "position_error_m = 4.0");
        let list = SensorList::of(&scenario).unwrap();
        let zones = polygons(3);
        let mut last = *Plant::new(&scenario, &list).flight(UAV);
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights[UAV];
            assert!(!enters(&zones, &last, &flight), "{strategy}, slot {}", record.slot());
            last = flight;
        }
    }
}

#[test]
fn an_area_with_a_boundary_has_its_sensor_nodes_and_flights_within() {
    let text = "name = 'x'\nslots = 80\n[area]\nboundary_m = [[10, 10], [90, 10], [90, 40], [40, 40], [40, 90], [10, 90]]\n\
                [uav]\nstart_m = [20.0, 20.0]\n[sensors]\ncount = 50\n";
    let corners = [(10.0, 10.0), (90.0, 10.0), (90.0, 40.0), (40.0, 40.0), (40.0, 90.0), (10.0, 90.0)];
    let boundary = Polygon::new(LineString::from(corners.to_vec()), vec![]);
    for strategy in ["tour", "round-robin", "uts", "horizon"] {
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let scenario = Scenario::parse(text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let is_within = |x: f64, y: f64| boundary.relate(&geo::Point::new(x, y)).is_covers();
        assert!(list.sensors().iter().all(|sensor| is_within(sensor.position.x, sensor.position.y)));
        let mut last = *Plant::new(&scenario, &list).flight(UAV);
        for record in Mission::new(&scenario, &list).unwrap() {
            let flight = record.flights[UAV];
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
    fn no_plan_leads_into_a_zone(
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
