//! The rules of zones and buildings: polygons, and ways that lead where the UAV has to go.

use serde::Serialize;
use toml::Value;

use super::mission::Scenario;
use crate::airspace::{Airspace, MAX_CORNERS, Ring};
use crate::error::InputError;
use crate::geometry::Position;

/// Checks the border, the zones and the buildings of `scenario`, and that its start and its base lie outside of them.
pub(super) fn check(scenario: &Scenario) -> Result<(), InputError> {
    let area = &scenario.area;
    let no_fly = area.no_fly.iter().flatten().map(|zone| &zone.polygon_m).enumerate();
    let no_fly = no_fly.map(|(index, corners)| (format!("area.no_fly[{index}].polygon_m"), corners, false));
    let buildings = area.building.iter().flatten().map(|building| &building.polygon_m).enumerate();
    let buildings = buildings.map(|(index, corners)| (format!("area.building[{index}].polygon_m"), corners, false));
    let border = area.boundary_m.iter().map(|corners| ("area.boundary_m".to_owned(), corners, true));
    let mut count = 0;
    for (key, corners, is_border) in border.chain(no_fly).chain(buildings) {
        let ring = Ring::of(corners, is_border);
        ring.map_err(|expected| scenario.refusal(&key, &toml_of(corners), expected))?;
        count += corners.len();
        if count > MAX_CORNERS {
            let expected = format!("at most {MAX_CORNERS} corners in all zones and buildings");
            return Err(scenario.refusal(&key, &Value::Integer(corners.len() as i64), &expected));
        }
    }
    if count == 0 {
        return Ok(());
    }
    let start = scenario.start().xy();
    let refuse = |key: &str, position: &Position, expected: &str| {
        Err(scenario.refusal(key, &toml_of(&[position.x, position.y]), expected))
    };
    if !Airspace::without_ways(scenario).contains(&start) {
        return refuse("uav.start_m", &start, "a position outside of zones and buildings, within the boundary");
    }
    match scenario.base.and_then(|base| base.position_m).map(Position::from) {
        Some(base) if !Airspace::of(scenario).is_reachable(&base) => {
            let expected = "a position that the UAV can fly to from its start, around zones and buildings";
            refuse("base.position_m", &base, expected)
        }
        _ => Ok(()),
    }
}

fn toml_of(value: &impl Serialize) -> Value {
    Value::try_from(value).expect("numbers are TOML")
}
