//! The waypoint file of ArduPilot's ground stations, `QGC WPL 110`: one tab-separated line per item.
//!
//! Format: MAVLink's developer guide, "Plain-Text File Format".

use super::altitude::AltitudeReference;
use super::autopilot::Autopilot;
use super::format::{ExportFormat, ExportedMission, MissionFormat, WriteFormat};
use super::items::{MavlinkItem, VehicleItem};
use super::mission_options::VehicleMissionOptions;
use super::vehicle::{MissionPart, VehicleMission};

/// The same mission, for ArduPilot; the format has no geofence.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "waypoints",
    about: "QGC WPL 110, for Mission Planner and MAVProxy: a vehicle's mission, no geofence",
    extension: "waypoints",
    write: WriteFormat::Mission(MissionFormat {
        write,
        autopilot: Some(Autopilot::Ardupilot),
        without_fence: Some("no geofence: QGC WPL does not support it; use qgc-plan"),
        check,
    }),
};

/// Warns of altitudes above the ground: in this format QGroundControl takes every frame but 3 as above sea level.
fn check(mission: &VehicleMission, options: &VehicleMissionOptions) -> Result<Vec<String>, String> {
    options.check_no_dji()?;
    let frame = AltitudeReference::Terrain as u8;
    let warning = format!(
        "warning: frame {frame}, above the ground below: QGroundControl reads it from this format as above sea level; \
         open the file with Mission Planner or MAVProxy, or use qgc-plan, or --altitude relative"
    );
    Ok(if mission.reference == AltitudeReference::Terrain { vec![warning] } else { Vec::new() })
}

fn write(exported: &ExportedMission<'_>, part: &MissionPart) -> Vec<u8> {
    let place = exported.track.points[0].place;
    let altitude_m = exported.mission.home_ground_m.unwrap_or(0.0);
    let home = VehicleItem::Waypoint { place, altitude_m, hold_s: 0.0 }.mavlink(AltitudeReference::Msl);
    let items = part.items.iter().map(|item| item.mavlink(exported.mission.reference));
    let mut text = "QGC WPL 110\n".to_owned();
    for (index, item) in std::iter::once(home).chain(items).enumerate() {
        let MavlinkItem { command, frame, params } = item;
        // Readers do not accept NaN for the heading, which ArduPilot ignores.
        let [hold, radius, orbit, heading, lat_deg, lon_deg, altitude_m] =
            params.map(|value| if value.is_nan() { 0.0 } else { value });
        let is_current = u8::from(index == 0);
        let line = format!(
            "{index}\t{is_current}\t{frame}\t{command}\t{hold:.3}\t{radius:.3}\t{orbit:.3}\t{heading:.3}\t\
             {lat_deg:.9}\t{lon_deg:.9}\t{altitude_m:.3}\t1\n"
        );
        text.push_str(&line);
    }
    text.into_bytes()
}
