//! Vehicles that climb, and hover, apart when a run begins.

use nalgebra::Point2;
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::Scenario;

/// Least distance between two vehicles that begin [m].
const APART_M: f64 = 5.0;

/// Checks that the vehicles of a fleet start apart, by at least 5 m and `uav.separation_m`.
///
/// # Errors
/// `uav.starts_m`, with the first place that is too near to one before it.
pub fn check_starts(scenario: &Scenario) -> Result<(), InputError> {
    let places: Vec<_> = scenario.starts().map(|start| start.xy()).collect();
    let Some(place) = first_near(&places, apart_m(scenario)) else { return Ok(()) };
    let expected = format!("starts at least {} m apart, for vehicles", apart_m(scenario));
    Err(scenario.refusal("uav.starts_m", &vec![place.x, place.y].into(), &expected))
}

/// The same for the vehicles that fly on in a run that is resumed, where they were after its last `slot`.
pub(crate) fn check_resumed(scenario: &Scenario, slot: u64, reports: &[FlightReport]) -> Result<(), InputError> {
    let flies = |report: &&FlightReport| ![Mode::Down, Mode::Return].contains(&report.flown_mode());
    let places: Vec<_> = reports.iter().filter(flies).map(|report| report.position().xy()).collect();
    let Some(place) = first_near(&places, apart_m(scenario)) else { return Ok(()) };
    let expected = format!("vehicles at least {} m apart, where they begin after slot {slot}", apart_m(scenario));
    Err(InputError::of_argument("vehicle", &format!("{}, {}", place.x, place.y), expected))
}

fn apart_m(scenario: &Scenario) -> f64 {
    scenario.uav.separation_m.unwrap_or(0.0).max(APART_M)
}

/// The first place that is nearer than `apart_m` to one before it.
fn first_near(places: &[Point2<f64>], apart_m: f64) -> Option<Point2<f64>> {
    let is_near = |uav: &usize| places[..*uav].iter().any(|other| (places[*uav] - other).norm() < apart_m);
    (1..places.len()).find(is_near).map(|uav| places[uav])
}
