//! QGroundControl's plan: JSON with the mission, the area as geofence, and home.
//!
//! Format: QGroundControl's developer guide, "Plan File Format", version 1.

use serde_json::{Value, json};

use skysink_common::geodata::projection::GeodeticPosition;

use super::format::{ExportFormat, WriteFormat};
use super::track::GeodeticTrack;
use super::vehicle::VehicleItem;

/// QGroundControl's code for altitudes relative to home.
const RELATIVE: u32 = 1;

/// The plan file.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "qgc-plan",
    about: "QGroundControl plan: a vehicle's mission, with area and zones as geofence",
    extension: "plan",
    write: WriteFormat::Mission(write, ""),
};

fn write(track: &GeodeticTrack<'_>, items: &[VehicleItem]) -> Vec<u8> {
    let home = track.points[0].place;
    let speed_mps = track.run.scenario.uav.max_speed_mps;
    let polygon = |inclusion: bool, corners: &[GeodeticPosition]| {
        let corners: Vec<_> = corners.iter().map(|place| [place.lat_deg, place.lon_deg]).collect();
        json!({ "version": 1, "inclusion": inclusion, "polygon": corners })
    };
    let zones = track.zones.iter().filter(|zone| zone.is_tall).map(|zone| polygon(false, &zone.corners));
    let fence: Vec<_> = std::iter::once(polygon(true, &track.border)).chain(zones).collect();
    let plan = json!({
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {
            "version": 2,
            "circles": [],
            "polygons": fence,
        },
        "rallyPoints": { "version": 2, "points": [] },
        "mission": {
            "version": 2,
            "firmwareType": 12, // MAV_AUTOPILOT_PX4
            "vehicleType": 2, // MAV_TYPE_QUADROTOR
            "cruiseSpeed": speed_mps,
            "hoverSpeed": speed_mps,
            "globalPlanAltitudeMode": RELATIVE,
            // The vehicle sets the altitude above sea level when it is armed.
            "plannedHomePosition": [home.lat_deg, home.lon_deg, 0.0],
            "items": items.iter().zip(1..).map(|(item, number)| simple_item(item, number)).collect::<Vec<_>>(),
        },
    });
    (serde_json::to_string_pretty(&plan).expect("plain numbers and strings") + "\n").into_bytes()
}

/// An item in the format of the plan; `number` starts at 1.
fn simple_item(item: &VehicleItem, number: u32) -> Value {
    let mavlink = item.mavlink();
    let mut value = json!({
        "type": "SimpleItem",
        "autoContinue": true,
        "command": mavlink.command,
        "doJumpId": number,
        "frame": mavlink.frame,
        "params": mavlink.params, // NaN is null
    });
    if let VehicleItem::TakeOff { altitude_m, .. } | VehicleItem::Waypoint { altitude_m, .. } = item {
        value["Altitude"] = json!(altitude_m);
        value["AltitudeMode"] = json!(RELATIVE);
        value["AMSLAltAboveTerrain"] = Value::Null;
    }
    value
}
