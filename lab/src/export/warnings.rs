//! Warnings about missions that are probably unintended.

use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario};

use super::fence;
use super::track::GeodeticTrack;
use super::vehicle::VehicleMission;

/// Distance from the geofence within which a vehicle may breach it [m].
const NEAR_M: f64 = 2.0;

/// Corners of a geofence that most vehicles take.
const MOST_CORNERS: usize = 60;

/// The warnings about the mission of a track, with the corners of its `fence` if it has one.
pub fn of(track: &GeodeticTrack<'_>, mission: &VehicleMission, fence: Option<&Vec<Position>>) -> Vec<String> {
    let scenario = &track.run.scenario;
    let letters = letters(scenario);
    let places = || track.points.iter().map(|point| point.position.xy());
    let of = track.points.len() - 1;
    let near = fence.map_or(0, |fence| fence::near(fence, places(), NEAR_M));
    let at_the_fence = (near > 0).then(|| {
        format!(
            "{near} of {of} slots end outside of the geofence or within {NEAR_M} m of it: widen it with --fence-margin"
        )
    });
    let airspace = scenario.airspace_without_ways();
    let is_near = |at: &Position| {
        airspace
            .zones_above(track.points[0].position.z)
            .any(|zone| !zone.is_border() && (zone.nearest(at) - at).norm() < NEAR_M)
    };
    let near = places().filter(is_near).count();
    let at_a_zone = (near > 0).then(|| {
        format!(
            "{near} of {of} slots end within {NEAR_M} m of a zone, which the model may touch: draw zones as much larger as your \
             vehicle needs"
        )
    });
    let uavs = scenario.uav.uavs();
    let fleet = (uavs > 1).then(|| {
        format!("{uavs} missions that do not know of each other, and are not in time with the plan: keep them apart yourself")
    });
    let corners = fence.map_or(0, Vec::len);
    let long_fence =
        (corners > MOST_CORNERS).then(|| format!("a geofence of {corners} corners: many vehicles take {MOST_CORNERS}"));
    let parted = (mission.parts.len() > 1).then(|| {
        let parts = mission.parts.len();
        format!("{parts} parts: the vehicle lands between them, while the sensor nodes go on sampling")
    });
    [letters, at_the_fence, at_a_zone, fleet, long_fence, parted].into_iter().flatten().collect()
}

/// Whether the vehicle or the radio are those of the paper, over a field that is not.
fn letters(scenario: &Scenario) -> Option<String> {
    let letter = Scenario::letter(Overrides::default()).ok()?;
    let is_its_field = scenario.area == letter.area && scenario.sensors == letter.sensors;
    let (uav, of_letter) = (&scenario.uav, &letter.uav);
    let is_its_flight = uav.max_speed_mps == of_letter.max_speed_mps && uav.acceleration_mps2.is_none();
    let flight = is_its_flight.then(|| {
        format!("uav.max_speed_mps = {}, at {} m and without acceleration", uav.max_speed_mps, uav.altitude_m)
    });
    let radio = (scenario.link == letter.link).then(|| "[link]".to_owned());
    let same: Vec<String> = flight.into_iter().chain(radio).collect();
    (!is_its_field && !same.is_empty()).then(|| {
        format!("{} as in the paper, over a field of your own: set those of your vehicle and radio", same.join(" and "))
    })
}
