//! QGroundControl's plan: JSON with the mission, the area as geofence, and home.
//!
//! Format: QGroundControl's developer guide, "Plan File Format", version 1.

use serde_json::{Value, json};

use skysink_common::geodata::projection::GeodeticPosition;

use super::altitude::AltitudeReference;
use super::format::{ExportFormat, ExportedMission, MissionFormat, WriteFormat};
use super::items::VehicleItem;
use super::vehicle::MissionPart;

/// A mission, the area as inclusion geofence, zones and tall buildings as exclusions, home.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "qgc-plan",
    about: "QGroundControl plan: a vehicle's mission, with area and zones as geofence",
    extension: "plan",
    write: WriteFormat::Mission(MissionFormat {
        write,
        autopilot: None,
        without_fence: None,
        check: |_, options| options.check_no_dji().map(|()| Vec::new()),
    }),
};

fn write(exported: &ExportedMission<'_>, part: &MissionPart) -> Vec<u8> {
    let ExportedMission { track, mission, options, fence } = exported;
    let home = track.points[0].place;
    let speed_mps = track.run.scenario.uav.max_speed_mps;
    let reference = mission.reference;
    let polygon = |inclusion: bool, corners: &[GeodeticPosition]| {
        let corners: Vec<_> = corners.iter().map(|place| [place.lat_deg, place.lon_deg]).collect();
        json!({ "version": 1, "inclusion": inclusion, "polygon": corners })
    };
    let zones = track.zones.iter().filter(|zone| zone.is_tall).map(|zone| polygon(false, &zone.corners));
    let polygons: Vec<_> = std::iter::once(polygon(true, fence)).chain(zones).collect();
    let items = part.items.iter().zip(1..).map(|(item, number)| simple_item(item, reference, number));
    let plan = json!({
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": polygons,
        },
        "rallyPoints": { "version": 2, "points": [] },
        "mission": {
            "version": 2,
            "firmwareType": options.autopilot() as u32,
            "vehicleType": 2, // MAV_TYPE_QUADROTOR
            "cruiseSpeed": speed_mps,
            "hoverSpeed": speed_mps,
            "globalPlanAltitudeMode": reference.altitude_mode(),
            // The vehicle sets the altitude above sea level when it is armed.
            "plannedHomePosition": [home.lat_deg, home.lon_deg, mission.home_ground_m.unwrap_or(0.0)],
            "items": items.collect::<Vec<_>>(),
        },
    });
    (serde_json::to_string_pretty(&plan).expect("plain numbers and strings") + "\n").into_bytes()
}

/// An item in the format of the plan; `number` starts at 1.
fn simple_item(item: &VehicleItem, reference: AltitudeReference, number: u32) -> Value {
    let mavlink = item.mavlink(reference);
    let mut value = json!({
        "type": "SimpleItem",
        "autoContinue": true,
        "command": mavlink.command,
        "doJumpId": number,
        "frame": mavlink.frame,
        "params": mavlink.params, // NaN is null
    });
    let altitude = match item {
        VehicleItem::TakeOff { altitude_m, .. } => Some((altitude_m, AltitudeReference::Relative)),
        VehicleItem::Waypoint { altitude_m, .. } => Some((altitude_m, reference)),
        VehicleItem::Speed { .. } | VehicleItem::Return => None,
    };
    if let Some((altitude_m, reference)) = altitude {
        value["Altitude"] = json!(altitude_m);
        value["AltitudeMode"] = json!(reference.altitude_mode());
        value["AMSLAltAboveTerrain"] = Value::Null;
    }
    value
}
