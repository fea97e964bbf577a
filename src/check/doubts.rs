//! Warnings about the places of sensor nodes, zones, buildings and the boundary.

use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{FieldPlaces, distance};
use skysink_common::geometry::Position;
use skysink_common::scenario::{Scenario, SimplifiedZones};
use skysink_common::sensors::SensorList;

/// What was ignored in the files of the scenario, how its zones are simplified, and which of its places were probably not meant, a line each.
#[must_use]
pub fn of(scenario: &Scenario, list: &SensorList) -> Vec<String> {
    let nodes: Vec<Position> = list.sensors().iter().map(|sensor| sensor.position).collect();
    let node_name = |node: usize| match scenario.sensor_file() {
        Some(path) => InputError::new("sensor list", &path, SensorList::place_of(&path, node)).to_string(),
        None => format!("SN {node}"),
    };
    let places = FieldPlaces {
        sides_m: [scenario.area.width_m(), scenario.area.height_m()],
        origin: scenario.area.origin(),
        nodes: &nodes,
        node_name: &node_name,
        polygons: &scenario.polygons,
        comm_radius_m: scenario.link.comm_radius_m,
    };
    scenario.notes.iter().cloned().chain(simplified(scenario)).chain(places.doubts()).collect()
}

/// How the outlines of zones are simplified; `None` if they are not.
fn simplified(scenario: &Scenario) -> Option<String> {
    let SimplifiedZones { corners, given_corners, grown_m, .. } = scenario.simplified_zones();
    (corners < given_corners).then(|| {
        let most_m = scenario.area.simplify_m();
        let grown = distance(grown_m);
        format!(
            "the {given_corners} corners of zones, buildings and boundary are simplified to {corners}: closed ground grows \
             by up to {grown} (area.simplify_m, at most {most_m} m)"
        )
    })
}
