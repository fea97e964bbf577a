//! QGroundControl's plan: JSON with a mission of simple items, surveys and corridors, the geofence, and home.
//!
//! Format: QGroundControl's developer guide, "Plan File Format", version 1, and what its versions 3.5 to 5.0 write.

use serde_json::{Map, Value};
use skysink_common::error::quoted;
use skysink_common::geodata::{SourceText, Zone, check_geodetic};

use super::commands::ForeignItem;
use super::fence::{of_circle, of_polygon};
use super::foreign_plan::{PlanFile, PlanHome};
use crate::export::Autopilot;

/// `MAV_TYPE` of vehicles with wings, whose speed is `cruiseSpeed`.
const WINGED: [f64; 8] = [1.0, 19.0, 20.0, 21.0, 22.0, 23.0, 24.0, 25.0];

/// `MAV_AUTOPILOT_ARDUPILOTMEGA`.
const ARDUPILOT: f64 = 3.0;

/// QGroundControl's altitude mode of altitudes above the terrain that it has computed itself.
const COMPUTED: f64 = 3.0;

/// Altitudes that differ by less are one [m].
const SAME_M: f64 = 1e-3;

/// The keys of a plan, its mission and its fence.
const KEYS: [(&str, &[&str]); 3] = [
    ("", &["fileType", "geoFence", "groundStation", "mission", "rallyPoints", "version"]),
    (
        "mission",
        &[
            "cruiseSpeed",
            "firmwareType",
            "globalPlanAltitudeMode",
            "hoverSpeed",
            "items",
            "plannedHomePosition",
            "vehicleType",
            "version",
        ],
    ),
    ("geoFence", &["circles", "polygons", "polygon", "version"]),
];

/// Reads the text of a file.
///
/// # Errors
/// If it is no plan, or an item or a part of the fence is not of the format.
pub fn parse(source: &SourceText<'_>) -> Result<PlanFile, String> {
    let plan: Value = serde_json::from_str(source.text).map_err(|error| format!("expected JSON: {error}"))?;
    let kind = plan.get("fileType").and_then(Value::as_str).unwrap_or_default();
    if kind != "Plan" {
        return Err(format!("fileType = `{}`: expected `Plan`", quoted(kind)));
    }
    let mission = plan.get("mission").filter(|mission| mission.is_object()).ok_or("mission: expected a table")?;
    let version = number(mission, "version").map_err(|message| format!("mission.{message}"))?;
    if version != 2.0 {
        let expected = "expected 2; open the file in QGroundControl and save it again";
        return Err(format!("mission.version = {version}: {expected}"));
    }
    let of_mission = |key| number(mission, key).map_err(|message| format!("mission.{message}"));
    let is_winged = WINGED.contains(&of_mission("vehicleType")?);
    let key = if is_winged { "cruiseSpeed" } else { "hoverSpeed" };
    let speed_mps = of_mission(key)?;
    if speed_mps <= 0.0 {
        return Err(format!("mission.{key} = {speed_mps}: expected a speed above 0 m/s"));
    }
    let autopilot = if of_mission("firmwareType")? == ARDUPILOT { Autopilot::Ardupilot } else { Autopilot::Px4 };
    let mut unused = unknown_keys(&plan);
    if is_winged {
        unused.push("that the vehicle has wings (it turns and holds as a copter)".to_owned());
    }
    unused.extend(rally_points(&plan));
    let all = array(mission, "items").map_err(|message| format!("mission.{message}"))?;
    let mut items = Vec::with_capacity(all.len());
    for (value, number) in all.iter().zip(1..) {
        add_items(value, &format!("item {number}"), &mut items, &mut unused)?;
    }
    Ok(PlanFile {
        is_waypoints: false,
        autopilot,
        home: Some(home(mission)?),
        speed_mps: Some(speed_mps),
        items,
        fence: plan.get("geoFence").map_or(Ok(Vec::new()), fence)?,
        unused,
    })
}

/// Home of a mission.
fn home(mission: &Value) -> Result<PlanHome, String> {
    let refuse = |message: &str| format!("mission.plannedHomePosition: {message}");
    let home = array(mission, "plannedHomePosition").map_err(|message| format!("mission.{message}"))?;
    let numbers: Vec<Option<f64>> = home.iter().map(Value::as_f64).collect();
    let (position, altitude_m) = match numbers[..] {
        [Some(lat_deg), Some(lon_deg)] => ([lat_deg, lon_deg], None),
        [Some(lat_deg), Some(lon_deg), altitude_m] => ([lat_deg, lon_deg], altitude_m),
        _ => return Err(refuse("expected latitude, longitude and altitude")),
    };
    check_geodetic(position).map_err(|expected| refuse(&expected))?;
    Ok(PlanHome { position, altitude_m })
}

/// Adds a simple item, or those of a survey or a corridor.
fn add_items(value: &Value, place: &str, items: &mut Vec<ForeignItem>, unused: &mut Vec<String>) -> Result<(), String> {
    let refuse = |message: String| format!("{place}: {message}");
    let kind = value.get("type").and_then(Value::as_str).unwrap_or_default();
    if kind == "SimpleItem" {
        if value.get("autoContinue") == Some(&Value::Bool(false)) {
            unused.push(format!("the pause after {place} (autoContinue)"));
        }
        items.push(simple_item(value, place).map_err(refuse)?);
        return Ok(());
    }
    if kind != "ComplexItem" {
        return Err(refuse(format!("type = `{}`: expected `SimpleItem` or `ComplexItem`", quoted(kind))));
    }
    let complex = value.get("complexItemType").and_then(Value::as_str).unwrap_or_default();
    if !["survey", "CorridorScan"].contains(&complex) {
        let expected = "expected `survey` or `CorridorScan`";
        return Err(refuse(format!("complexItemType = `{}`: {expected}", quoted(complex))));
    }
    let place = format!("{place} ({complex})");
    let refuse = |message: String| format!("{place}: {message}");
    let transects = value.get("TransectStyleComplexItem").unwrap_or(&Value::Null);
    let inner = array(transects, "Items").map_err(|message| refuse(format!("TransectStyleComplexItem.{message}")))?;
    if inner.is_empty() {
        let expected = "expected its waypoints; open the file in QGroundControl and save it again";
        return Err(refuse(format!("TransectStyleComplexItem.Items: none: {expected}")));
    }
    let camera = transects.get("CameraCalc").unwrap_or(&Value::Null);
    let is_computed = camera.get("DistanceMode").and_then(Value::as_f64) == Some(COMPUTED)
        || transects.get("FollowTerrain") == Some(&Value::Bool(true));
    let above_ground_m = match is_computed {
        true => Some(number(camera, "DistanceToSurface").map_err(|message| refuse(format!("CameraCalc.{message}")))?),
        false => None,
    };
    for (value, number) in inner.iter().zip(1..) {
        let place = format!("{place}, its item {number}");
        let item = simple_item(value, &place).map_err(|message| format!("{place}: {message}"))?;
        items.push(ForeignItem { above_ground_m: item.above_ground_m.or(above_ground_m), ..item });
    }
    Ok(())
}

/// A simple item. Its key `Altitude` differs from parameter 7 where QGroundControl has computed an altitude above sea
/// level from it.
fn simple_item(value: &Value, place: &str) -> Result<ForeignItem, String> {
    let code = |key: &str, most: u16| {
        let code = number(value, key)?;
        let is_code = (0.0..=f64::from(most)).contains(&code) && code.fract() == 0.0;
        is_code.then_some(code).ok_or_else(|| format!("{key} = {code}: expected a whole number up to {most}"))
    };
    let command = code("command", u16::MAX)? as u16;
    let frame = code("frame", u16::from(u8::MAX))? as u8;
    let all = array(value, "params")?;
    let mut params = [f64::NAN; 7];
    if all.len() != params.len() {
        return Err(format!("{} params: expected {}", all.len(), params.len()));
    }
    for ((param, value), number) in params.iter_mut().zip(all).zip(1..) {
        *param = match value {
            Value::Null => f64::NAN,
            value => {
                value.as_f64().ok_or_else(|| format!("parameter {number} = {}: expected a number", shown(value)))?
            }
        };
    }
    let shown_m = value.get("Altitude").and_then(Value::as_f64);
    let is_computed = |shown_m: &f64| [0, 5].contains(&frame) && (shown_m - params[6]).abs() > SAME_M;
    Ok(ForeignItem { place: place.to_owned(), command, frame, params, above_ground_m: shown_m.filter(is_computed) })
}

/// The polygons and circles of a fence; the format's version 1 has one polygon.
fn fence(fence: &Value) -> Result<Vec<Zone>, String> {
    let mut zones = Vec::new();
    let of = |key: &'static str| fence.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let old = of("polygon");
    if !old.is_empty() {
        zones.push(of_polygon("geoFence.polygon".to_owned(), true, &corners("geoFence.polygon", old)?)?);
    }
    for (index, polygon) in of("polygons").iter().enumerate() {
        let place = format!("geoFence.polygons[{index}]");
        let ring = array(polygon, "polygon").map_err(|message| format!("{place}.{message}"))?;
        zones.push(of_polygon(place.clone(), is_inclusion(polygon, &place)?, &corners(&place, ring)?)?);
    }
    for (index, circle) in of("circles").iter().enumerate() {
        let place = format!("geoFence.circles[{index}]");
        let shape = circle.get("circle").unwrap_or(&Value::Null);
        let centre = array(shape, "center").map_err(|message| format!("{place}.circle.{message}"))?;
        let [centre] = corners(&place, std::slice::from_ref(&Value::Array(centre.clone())))?[..] else {
            return Err(format!("{place}: expected a centre"));
        };
        let radius_m = number(shape, "radius").map_err(|message| format!("{place}.circle.{message}"))?;
        zones.push(of_circle(place.clone(), is_inclusion(circle, &place)?, centre, radius_m)?);
    }
    Ok(zones)
}

fn is_inclusion(part: &Value, place: &str) -> Result<bool, String> {
    let is_inclusion = part.get("inclusion").and_then(Value::as_bool);
    is_inclusion.ok_or_else(|| format!("{place}.inclusion: expected true or false"))
}

/// Latitudes and longitudes.
fn corners(place: &str, ring: &[Value]) -> Result<Vec<[f64; 2]>, String> {
    let corner = |value: &Value| match value.as_array().map(|pair| pair.iter().map(Value::as_f64).collect::<Vec<_>>()) {
        Some(pair) if pair.len() >= 2 => Some([pair[0]?, pair[1]?]),
        _ => None,
    };
    let refuse = |value| format!("{place}: {}: expected a latitude and a longitude", shown(value));
    ring.iter().map(|value| corner(value).ok_or_else(|| refuse(value))).collect()
}

/// The rally points, which are not used.
fn rally_points(plan: &Value) -> Option<String> {
    let count = plan.get("rallyPoints")?.get("points")?.as_array()?.len();
    (count > 0).then(|| format!("{count} × rally point"))
}

/// The keys that are not known, such as `geoFence.breachReturn`.
fn unknown_keys(plan: &Value) -> Vec<String> {
    let of_table = |(name, known): (&str, &[&str])| {
        let table = if name.is_empty() { Some(plan) } else { plan.get(name) };
        let keys = table.and_then(Value::as_object).into_iter().flat_map(Map::keys);
        let unknown = keys.filter(|key| !known.contains(&key.as_str()));
        let prefix = if name.is_empty() { String::new() } else { format!("{name}.") };
        unknown.map(|key| format!("{prefix}{}", quoted(key))).collect::<Vec<_>>()
    };
    KEYS.into_iter().flat_map(of_table).collect()
}

fn number(table: &Value, key: &str) -> Result<f64, String> {
    let value = table.get(key);
    let number = value.and_then(Value::as_f64);
    number.ok_or_else(|| format!("{key} = {}: expected a number", value.map_or_else(|| "none".to_owned(), shown)))
}

fn array<'a>(table: &'a Value, key: &str) -> Result<&'a Vec<Value>, String> {
    let value = table.get(key);
    let array = value.and_then(Value::as_array);
    array.ok_or_else(|| format!("{key} = {}: expected a list", value.map_or_else(|| "none".to_owned(), shown)))
}

fn shown(value: &Value) -> String {
    quoted(&value.to_string())
}
