//! Warnings about missions that are probably unintended.

use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario};

use super::altitude::AltitudeReference;
use super::fence;
use super::track::{GeodeticTrack, TrackPoint};
use super::vehicle::VehicleMission;

/// Distance from the geofence or a zone within which a vehicle may breach it [m].
const NEAR_M: f64 = 2.0;

/// Altitude above the ground up to which many countries let UAVs fly without a permission [m].
const PERMITTED_M: f64 = 120.0;

/// Corners of a geofence that most vehicles take.
const MAX_CORNERS: usize = 60;

/// The warnings about the mission of a track, with the corners of its `fence` if it has one.
pub fn of(track: &GeodeticTrack<'_>, mission: &VehicleMission, fence: Option<&[Position]>) -> Vec<String> {
    let mut warnings = Vec::from_iter(paper_values(&track.run.scenario));
    warnings.extend(fence.and_then(|fence| near_fence(track, fence)));
    warnings.extend(near_zones(track));
    warnings.extend(high(mission));
    let charging = track.flown().iter().filter(|point| point.is_on_ground()).count();
    if charging > 0 {
        let charging_s = charging as f64 * track.run.scenario.slot_s;
        warnings.push(format!(
            "hovers for {charging_s:.0} s in which the plan charges on the ground: land there yourself, and go on when it has charged"
        ));
    }
    let uavs = track.run.scenario.uav.uavs();
    if uavs > 1 {
        warnings.push(format!(
            "{uavs} missions that do not know of each other, and are not in time with the plan: keep them apart yourself"
        ));
    }
    let corners = fence.map_or(0, <[_]>::len);
    if corners > MAX_CORNERS {
        warnings.push(format!("a geofence of {corners} corners: many vehicles take {MAX_CORNERS}"));
    }
    let parts = mission.parts.len();
    if parts > 1 {
        warnings.push(format!("{parts} parts: the vehicle lands between them, while the sensor nodes go on sampling"));
    }
    warnings
}

/// Slots that end near the geofence, or outside of it.
fn near_fence(track: &GeodeticTrack<'_>, fence: &[Position]) -> Option<String> {
    let ends = &track.points[1..];
    let near = fence::count_near(fence, ends.iter().map(|point| point.position.xy()), NEAR_M);
    let of = ends.len();
    (near > 0).then(|| {
        format!(
            "{near} of {of} slots end outside of the geofence or within {NEAR_M} m of it: widen it with --fence-margin"
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
        _ => ": give --home-ground, or fly --altitude terrain",
    };
    Some(format!("waypoints up to {highest_m:.0} m above the ground, more than {PERMITTED_M} m{remedy}"))
}

/// Slots that end near a zone.
fn near_zones(track: &GeodeticTrack<'_>) -> Option<String> {
    let airspace = track.run.scenario.airspace_without_ways();
    let is_near = |point: &&TrackPoint<'_>| {
        let at = point.position.xy();
        let mut zones = airspace.zones_above(point.position.z).filter(|zone| !zone.is_border());
        zones.any(|zone| (zone.nearest(&at) - at).norm() < NEAR_M)
    };
    let ends = &track.points[1..];
    let near = ends.iter().filter(is_near).count();
    let of = ends.len();
    (near > 0).then(|| {
        format!(
            "{near} of {of} slots end within {NEAR_M} m of a zone, which the model may touch: draw zones as much larger as your \
             vehicle needs"
        )
    })
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
