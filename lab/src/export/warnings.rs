//! Warnings about missions that are probably unintended.

use skysink_common::scenario::{Overrides, Scenario};

use super::altitude::AltitudeReference;
use super::clearance::{LegClearance, MissionClearance};
use super::track::GeodeticTrack;
use super::vehicle::VehicleMission;

/// Altitude above the ground up to which many countries let UAVs fly without a permission [m].
const PERMITTED_M: f64 = 120.0;

/// Corners of a geofence, all its polygons together, that most vehicles take.
const MAX_CORNERS: usize = 60;

/// The warnings about the mission of a track with this clearance, and a geofence of `corners` if it has one.
pub fn of(
    track: &GeodeticTrack<'_>,
    mission: &VehicleMission,
    clearance: &MissionClearance,
    corners: Option<usize>,
) -> Vec<String> {
    let mut warnings = Vec::from_iter(paper_values(&track.run.scenario));
    warnings.extend(near_home(clearance));
    warnings.extend(near_legs(clearance));
    warnings.extend(high(mission));
    let charging = track.flown().iter().filter(|point| point.is_on_ground()).count();
    if charging > 0 {
        let charging_s = charging as f64 * track.run.scenario.slot_s;
        warnings.push(format!(
            "hovers for {charging_s:.0} s in which the plan charges on the ground: land there yourself, and go on when \
             it has charged"
        ));
    }
    warnings.extend(corners.and_then(|corners| many_corners(track, corners)));
    let parts = mission.parts.len();
    if parts > 1 {
        warnings.push(format!("{parts} parts: the vehicle lands between them, while the sensor nodes go on sampling"));
    }
    warnings
}

/// A home on the geofence or near it, or outside.
fn near_home(clearance: &MissionClearance) -> Option<String> {
    let margin_m = clearance.margin_m;
    let home_m = clearance.home_m.filter(|home_m| clearance.is_near(*home_m))?;
    let place = if home_m < 0.0 { "outside of the geofence" } else { "from the geofence" };
    let away_m = home_m.abs();
    Some(format!(
        "home is {away_m:.1} m {place}, expected {margin_m} m inside: vehicles do not arm there, or breach it as they \
         take off: widen it with --fence-margin"
    ))
}

/// Legs that come near to the geofence, a zone, a building or the ground.
fn near_legs(clearance: &MissionClearance) -> impl Iterator<Item = String> {
    let MissionClearance { legs, margin_m, ground, zones, buildings, fence, .. } = clearance.clone();
    let obstacles = [
        (fence, "lead out of the geofence or pass", "it", "widen it with --fence-margin"),
        (zones, "pass", "a zone", "the model may touch zones: draw them as much larger as your vehicle needs"),
        (buildings, "pass", "a building", "draw it larger and higher, or fly higher"),
        (Some(ground), "pass", "the ground", "fly higher"),
    ];
    let near = obstacles.into_iter().filter_map(|(clearance, pass, what, remedy)| {
        Some((clearance.filter(|clearance| clearance.near > 0)?, pass, what, remedy))
    });
    near.map(move |(LegClearance { least_m, near }, pass, what, remedy)| {
        let least_m = least_m.max(0.0);
        format!("{near} of {legs} legs {pass} within {margin_m} m of {what}, {least_m:.1} m at least: {remedy}")
    })
}

/// A geofence of more corners than many vehicles store, which count those of all polygons.
fn many_corners(track: &GeodeticTrack<'_>, of_border: usize) -> Option<String> {
    let zones = track.zones.iter().filter(|zone| zone.is_tall).map(|zone| zone.corners.len());
    let [polygons, corners] = [1 + zones.clone().count(), of_border + zones.sum::<usize>()];
    let of = if polygons == 1 { "1 polygon".to_owned() } else { format!("{polygons} polygons") };
    (corners > MAX_CORNERS).then(|| {
        format!(
            "a geofence of {corners} corners in {of}: many vehicles take {MAX_CORNERS} in all, and refuse the upload \
             or drop the fence: draw boundary, zones and buildings with fewer"
        )
    })
}

/// Waypoints that are high above the ground.
fn high(mission: &VehicleMission) -> Option<String> {
    let over_hills_m = mission.parts.iter().filter_map(|part| part.highest_m).reduce(f64::max);
    let flown_m = || mission.stops.iter().map(|stop| stop.position.z).reduce(f64::max);
    let highest_m = over_hills_m.or_else(flown_m).filter(|highest_m| *highest_m > PERMITTED_M)?;
    let remedy = match mission.reference {
        AltitudeReference::Terrain => "",
        _ if over_hills_m.is_none() => "",
        _ => ": give --home-ground, or fly --altitude terrain with an autopilot that has it",
    };
    Some(format!("waypoints up to {highest_m:.0} m above the ground, more than {PERMITTED_M} m{remedy}"))
}

/// Whether the vehicle or the radio are those of the paper, over a field that is not.
fn paper_values(scenario: &Scenario) -> Option<String> {
    let paper = Scenario::letter(Overrides::default()).ok()?;
    let is_its_field = scenario.area == paper.area && scenario.sensors == paper.sensors;
    let uav = &scenario.uav;
    let is_its_flight = uav.max_speed_mps == paper.uav.max_speed_mps && uav.acceleration_mps2.is_none();
    let flight = is_its_flight.then(|| {
        format!("uav.max_speed_mps = {}, at {} m and without acceleration", uav.max_speed_mps, uav.altitude_m)
    });
    let radio = (scenario.link == paper.link).then(|| "[link]".to_owned());
    let same: Vec<String> = flight.into_iter().chain(radio).collect();
    (!is_its_field && !same.is_empty()).then(|| {
        format!("{} as in the paper, over a field of your own: set those of your vehicle and radio", same.join(" and "))
    })
}
