//! What an export says about a vehicle mission.

use super::altitude::AltitudeReference;
use super::autopilot::Autopilot;
use super::clearance::{LegClearance, MissionClearance};
use super::items::VehicleItem;
use super::mission_options::VehicleMissionOptions;
use super::stops::VehicleStop;
use super::track::GeodeticTrack;
use super::vehicle::{MissionPart, VehicleMission};

/// A line for each fact: what was merged and what omitted, home and altitudes, how near legs come to obstacles, the
/// time of each part, and the altitude of a return.
pub fn lines(
    track: &GeodeticTrack<'_>,
    options: &VehicleMissionOptions,
    mission: &VehicleMission,
    clearance: &MissionClearance,
) -> Vec<String> {
    let omitted = (options.min_bits > 0).then(|| omitted(mission));
    let lines = [
        Some(counts(track, mission)),
        omitted,
        Some(home(track, mission)),
        Some(distances(clearance)),
        Some(times(track, options, mission)),
    ];
    lines.into_iter().flatten().chain(return_altitude(options, mission)).collect()
}

fn counts(track: &GeodeticTrack<'_>, VehicleMission { parts, stops, .. }: &VehicleMission) -> String {
    let slots = track.points.len() - 1;
    let services = track.services().count();
    let waypoints = stops.len();
    let serving = stops.iter().filter(|stop| !stop.services.is_empty()).count();
    let is_speed = |item: &&VehicleItem| matches!(item, VehicleItem::Speed { .. });
    let speeds = parts.iter().flat_map(|part| &part.items).filter(is_speed).count();
    let items: usize = parts.iter().map(|part| part.items.len() + 1).sum(); // and home
    let files = if parts.len() == 1 { "1 file".to_owned() } else { format!("{} files", parts.len()) };
    format!(
        "{slots} slot{} ({services} serving) → {waypoints} waypoint{} ({serving} serving), {speeds} change{} of speed \
         → {items} items → {files}",
        plural(slots),
        plural(waypoints),
        plural(speeds)
    )
}

/// The ending of a noun after a count.
fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

fn omitted(VehicleMission { flown, stops, .. }: &VehicleMission) -> String {
    let bits = |stops: &[VehicleStop]| stops.iter().map(|stop| stop.bits).sum::<u64>();
    let of = flown.len();
    let omitted = of - stops.iter().filter(|stop| stop.is_flown()).count();
    let all_bits = bits(flown);
    let omitted_bits = all_bits - bits(stops);
    let percent = 100.0 * omitted_bits as f64 / all_bits.max(1) as f64;
    format!("{omitted} of {of} waypoints omitted, with {omitted_bits} of {all_bits} bits ({percent:.2} %)")
}

fn home(track: &GeodeticTrack<'_>, mission: &VehicleMission) -> String {
    let home = track.points[0].place;
    let above = match mission.reference {
        AltitudeReference::Relative if mission.home_ground_m.is_none() => "home (the ground is taken to be flat)",
        AltitudeReference::Relative => "home",
        AltitudeReference::Terrain => "the ground below (the autopilot needs terrain data)",
        AltitudeReference::Msl => "the level that ground_m is above",
    };
    let altitudes_m = mission.parts.iter().flat_map(|part| &part.items).filter_map(|item| match item {
        VehicleItem::Waypoint { altitude_m, .. } => Some(*altitude_m),
        _ => None,
    });
    let widest = [f64::INFINITY, f64::NEG_INFINITY];
    let [low_m, high_m] =
        altitudes_m.fold(widest, |[low, high], altitude_m| [low.min(altitude_m), high.max(altitude_m)]);
    let range = if low_m == high_m { format!("{low_m} m") } else { format!("{low_m:.1} to {high_m:.1} m") };
    format!("home {} {} (latitude, longitude), waypoints {range} above {above}", home.lat_deg, home.lon_deg)
}

fn distances(clearance: &MissionClearance) -> String {
    let MissionClearance { legs, ground, zones, buildings, fence, .. } = clearance;
    let obstacles = [
        (Some(ground), "the ground"),
        (zones.as_ref(), "a zone"),
        (buildings.as_ref(), "a building"),
        (fence.as_ref(), "the geofence"),
    ];
    let distance = |(clearance, what): (Option<&LegClearance>, &str)| {
        let least_m = clearance?.least_m;
        let side = if least_m < 0.0 { "outside of" } else { "to" };
        Some(format!("{:.1} m {side} {what}", least_m.abs()))
    };
    let distances: Vec<String> = obstacles.into_iter().filter_map(distance).collect();
    format!("least distance of {legs} leg{}: {}", plural(*legs), distances.join(", "))
}

fn times(track: &GeodeticTrack<'_>, options: &VehicleMissionOptions, mission: &VehicleMission) -> String {
    let time = |part: &MissionPart| format!("{:.0} s", part.effort.duration_s);
    let times = mission.parts.iter().map(time).collect::<Vec<_>>().join(" + ");
    let ramp = options.motion(&track.run.scenario).horizontal;
    let jerk = ramp.jerk_mps3.map_or(String::new(), |jerk_mps3| format!(" and {jerk_mps3} m/s³"));
    let planned_s = (track.flown().len() - 1) as f64 * track.run.scenario.slot_s;
    let acceleration_mps2 = ramp.acceleration_mps2;
    let is_over_hills = mission.reference == AltitudeReference::Terrain;
    let hills = if is_over_hills { ", without climbs and descents along the ground" } else { "" };
    let planned = format!("with {acceleration_mps2} m/s²{jerk} (planned: {planned_s} s)");
    format!("estimated from take-off to landing: {times} {planned}{hills}")
}

/// The altitude of a return over hills and roofs, and how high the mission leads; `None` if it is that of the flight.
fn return_altitude(options: &VehicleMissionOptions, mission: &VehicleMission) -> Option<String> {
    let return_m = mission.return_m?.ceil();
    let highest_m = mission.parts.iter().filter_map(|part| part.highest_m).reduce(f64::max);
    let high = highest_m.map_or(String::new(), |highest_m| format!("up to {highest_m:.0} m above the ground; "));
    let parameter = match options.autopilot() {
        _ if options.drone.is_some() => "the file has it as globalRTHHeight".to_owned(),
        Autopilot::Px4 => format!("RTL_RETURN_ALT = {return_m}"),
        // ArduCopter counts in metres since 4.7, in centimetres before.
        Autopilot::Ardupilot => format!("RTL_ALT_M = {return_m}, before ArduCopter 4.7 RTL_ALT = {}", 100.0 * return_m),
    };
    Some(format!("{high}set the return altitude to {return_m} m above home or more: {parameter}"))
}
