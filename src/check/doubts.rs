//! Warnings about the places of sensor nodes, zones, buildings and the boundary.

use skysink_common::error::InputError;
use skysink_common::geodata::plausible::{FieldPlaces, distance};
use skysink_common::geometry::Position;
use skysink_common::scenario::{Scenario, SimplifiedZones};
use skysink_common::sensors::SensorList;

/// What was ignored in the files of the scenario, how its zones are simplified, and which of its places were probably
/// not meant, a line each.
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
        ground_m: list.ground_m(),
        node_name: &node_name,
        polygons: &scenario.polygons,
        comm_radius_m: scenario.link.comm_radius_m,
    };
    let notes = scenario.notes.iter().cloned().chain(simplified(scenario));
    notes.chain(places.doubts()).chain(short_maps(scenario, list)).collect()
}

/// The map of links does not cover, up to a cell, where some SNs are served.
fn short_maps(scenario: &Scenario, list: &SensorList) -> Option<String> {
    let map = scenario.link.map.as_ref()?;
    let uav = &scenario.uav;
    let altitudes_m = uav.climb().map_or([uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m]);
    let sides_m = [scenario.area.width_m(), scenario.area.height_m()];
    let radius_m = scenario.link.comm_radius_m;
    let is_short = |id: &usize| {
        let sensor = list.sensors()[*id].position;
        let served_m = |axis: usize| match axis {
            2 => altitudes_m,
            _ => [(sensor[axis] - radius_m).max(0.0), (sensor[axis] + radius_m).min(sides_m[axis])],
        };
        map.axes_m(&sensor).is_some_and(|axes_m| {
            axes_m.iter().enumerate().any(|(axis, along_m)| {
                let cell_m = along_m.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
                let [low_m, high_m] = served_m(axis);
                let [first_m, last_m] = [along_m[0], along_m[along_m.len() - 1]];
                // A single place along the ground is a link that is the same everywhere.
                (axis == 2 || along_m.len() > 1)
                    && low_m <= high_m
                    && (first_m > low_m + cell_m || last_m < high_m - cell_m)
            })
        })
    };
    let mut short = (0..list.sensors().len()).filter(is_short);
    let first = short.next()?;
    let span = |along_m: &Vec<f64>| match &along_m[..] {
        [only_m] => format!("{only_m}"),
        [first_m, .., last_m] => format!("{first_m} to {last_m}"),
        [] => String::new(),
    };
    let [x, y, z] = map.axes_m(&list.sensors()[first].position)?.each_ref().map(span);
    let more = match short.count() {
        0 => String::new(),
        others => format!(", and those of {others} more sensor nodes"),
    };
    Some(format!(
        "the links of {} are given for x = {x}, y = {y}, z = {z} m{more}: constant beyond, where they are served, too",
        list.label(first)
    ))
}

/// Outlines of zones have too many corners.
fn simplified(scenario: &Scenario) -> Option<String> {
    let SimplifiedZones { corners, given_corners, grown_m, .. } = scenario.simplified_zones();
    (corners < given_corners).then(|| {
        let most_m = scenario.area.simplify_m();
        let grown = distance(grown_m);
        format!(
            "the {given_corners} corners of zones, buildings and boundary are simplified to {corners}: closed ground \
             grows by up to {grown} (area.simplify_m, at most {most_m} m)"
        )
    })
}
