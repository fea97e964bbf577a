//! The map of links of a scenario, at the places of its sensor nodes (decision D32).

use std::sync::Arc;

use crate::channel::{LinkBudget, LinkMap};
use crate::error::InputError;
use crate::geometry::Position;
use crate::scenario::Scenario;
use crate::sensors::SensorList;

/// The map of a checked scenario at the places of its sensor nodes; `None` with other models.
///
/// # Errors
/// If there is a grid for an unknown sensor node, or a sensor node without one.
pub fn placed(scenario: &Scenario) -> Result<Option<Arc<LinkMap>>, InputError> {
    let (Some(map), Some(file)) = (&scenario.link.map, &scenario.link.file) else { return Ok(None) };
    check_keys(scenario, map)?;
    let (names, has_others) = map.names();
    if map.is_placed() {
        return Ok(Some(Arc::clone(map)));
    }
    let refuse = |message: String| InputError::new("channel", &scenario.beside(file), message);
    let list = SensorList::without_arrivals(scenario)?;
    let count = list.sensors().len();
    let by_id = |name: &String| LinkMap::id_of(name).filter(|id| *id < count);
    let are_ids = names.iter().all(|name| by_id(name).is_some());
    let are_names = names.iter().all(|name| list.ids_named(name).next().is_some());
    let id = |name: &String| {
        let mut named = list.ids_named(name).filter(|_| !map.are_ids() && (are_names || !are_ids));
        let first = named.next();
        if let (Some(first), Some(second)) = (first, named.next()) {
            let expected = "expected names of one sensor node each, or ids";
            return Err(refuse(format!("sensor `{name}`: SN {first} and SN {second} have this name: {expected}")));
        }
        let id = first.or_else(|| by_id(name));
        id.ok_or_else(|| refuse(format!("sensor `{name}`: expected the name or the id of a sensor node, or nothing")))
    };
    let ids = names.iter().map(id).collect::<Result<Vec<usize>, _>>()?;
    if let Some(again) = (1..ids.len()).find(|&index| ids[..index].contains(&ids[index])) {
        let label = list.label(ids[again]);
        return Err(refuse(format!("sensor `{}`: {label} has two grids: expected one", names[again])));
    }
    for (other, sensor) in list.sensors().iter().enumerate() {
        if !has_others && !ids.contains(&other) {
            let label = list.label(other);
            return Err(refuse(format!("no grid for {label}: expected one, or rows without a sensor for all others")));
        }
        let is_above = |&&id: &&usize| id != other && list.sensors()[id].position == sensor.position;
        if let Some(&id) = ids.iter().find(is_above) {
            let [one, two] = [id, other].map(|id| list.label(id));
            return Err(refuse(format!("{one} has a grid of its own at the place of {two}: expected other places")));
        }
    }
    let places: Vec<Position> = ids.into_iter().map(|id| list.sensors()[id].position).collect();
    Ok(Some(LinkMap::clone(map).at_places(&places).shared()))
}

/// Checks the keys that depend on what the levels of `map` are.
fn check_keys(scenario: &Scenario, map: &LinkMap) -> Result<(), InputError> {
    let residual_m = scenario.link.residual_m.filter(|residual_m| *residual_m > 0.0);
    if let Some(residual_m) = residual_m.filter(|_| scenario.link.residual_db.is_none()) {
        let expected = "a residual that stays beside its standard deviation, link.residual_db";
        return Err(scenario.refusal("link.residual_m", &residual_m.into(), expected));
    }
    if map.has_rates() {
        let of_snr = "none beside a map of rates (rate_bps in link.file)";
        if let Some(residual_db) = scenario.link.residual_db.filter(|residual_db| *residual_db > 0.0) {
            return Err(scenario.refusal("link.residual_db", &residual_db.into(), of_snr));
        }
        if let Some(rates) = &scenario.link.rates {
            return Err(scenario.refusal("link.rates", &rates.display().to_string().into(), of_snr));
        }
    }
    let LinkBudget { law_snr_db, law_exponent, beacon_radius_m, .. } = scenario.link;
    let of_snrs = [("law_snr_db", law_snr_db), ("law_exponent", law_exponent), ("beacon_radius_m", beacon_radius_m)];
    let given = of_snrs.into_iter().find_map(|(key, value)| Some((key, value?)));
    if let Some((key, value)) = given.filter(|_| map.has_rates()) {
        let of_snr = "none beside a map of rates (rate_bps in link.file)";
        return Err(scenario.refusal(&format!("link.{key}"), &value.into(), of_snr));
    }
    Ok(())
}
