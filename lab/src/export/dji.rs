//! DJI's route file: a KMZ archive with WPML, `template.kml` for editing and `waylines.wpml` for the aircraft.
//!
//! Format: DJI's Cloud API, "DJI WPML", 1.0.2: the elements that it requires of a route of waypoints, in the order of
//! its samples. No aircraft has flown a file of this format.

use std::io::{Cursor, Write};

use skysink_common::geodata::projection::GeodeticPosition;
use zip::write::SimpleFileOptions;
use zip::{DateTime, ZipWriter};

use super::altitude::AltitudeReference;
use super::dji_drone::DjiDrone;
use super::format::{ExportFormat, ExportedMission, MissionFormat, WriteFormat};
use super::items::VehicleItem;
use super::mission_options::VehicleMissionOptions;
use super::vehicle::{MissionPart, VehicleMission};

/// The same mission for DJI's `--drone`: a stop at each waypoint, a hover action for each hold, then the return home.
/// No aircraft has flown one; the format has no geofence.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "dji",
    about: "KMZ with DJI's WPML, for Matrice 300, 350, 30 and Mavic 3E: a vehicle's mission, no geofence; not flown",
    extension: "kmz",
    write: WriteFormat::Mission(MissionFormat {
        write,
        autopilot: None,
        without_fence: Some("no geofence: WPML does not support it; set the distance limits of the aircraft"),
        check,
    }),
};

/// `droneInfo` and `payloadInfo` of an aircraft: its own camera, or a payload of others.
fn info(aircraft: DjiDrone) -> String {
    let (drone, kind, payload) = match aircraft {
        DjiDrone::M300 => (60, None, 65534),
        DjiDrone::M350 => (89, None, 65534),
        DjiDrone::M30 => (67, Some(0), 52),
        DjiDrone::Mavic3e => (77, Some(0), 66),
    };
    let kind = kind.map_or(String::new(), |kind| element("droneSubEnumValue", kind));
    let payload = element("payloadEnumValue", payload) + &element("payloadPositionIndex", 0);
    element("droneInfo", element("droneEnumValue", drone) + &kind) + &element("payloadInfo", payload)
}

/// Highest speed of a leg [m/s]: the range that is published for the leg to the first waypoint, which holds for every
/// drone.
const MAX_SPEED_MPS: f64 = 15.0;

/// Least of `takeOffSecurityHeight` [m].
const LEAST_TAKE_OFF_M: f64 = 1.2;

/// Refuses what the format does not hold.
fn check(mission: &VehicleMission, options: &VehicleMissionOptions) -> Result<Vec<String>, String> {
    let is_msl = mission.reference == AltitudeReference::Msl;
    let fastest_mps = mission.parts.iter().flat_map(waypoints).map(|waypoint| waypoint.leg_mps).fold(0.0, f64::max);
    if options.drone.is_none() {
        return Err(
            "--format dji: expected --drone m300, m350, m30 or mavic-3e, the aircraft that the file is for".to_owned()
        );
    }
    if options.autopilot.is_some() {
        return Err("--autopilot: DJI's aircraft have their own: omit this option".to_owned());
    }
    if mission.reference == AltitudeReference::Terrain {
        let expected = "expected relative, or msl with --geoid";
        return Err(format!("--altitude terrain: a route file has no altitudes above the ground below: {expected}"));
    }
    if is_msl != options.geoid.is_some() {
        return Err("--altitude msl, --geoid: expected both, for DJI flies above the ellipsoid, or neither".to_owned());
    }
    if fastest_mps > MAX_SPEED_MPS {
        return Err(format!(
            "a leg at {fastest_mps} m/s: expected at most {MAX_SPEED_MPS} m/s for DJI, by uav.max_speed_mps"
        ));
    }
    if mission.parts.iter().any(|part| waypoints(part).len() < 2) {
        return Err("a single waypoint: expected two or more for DJI".to_owned());
    }
    Ok(vec!["warning: not flown: the file follows DJI's published format, but no aircraft has flown one".to_owned()])
}

/// A waypoint of a route.
struct RoutePoint {
    place: GeodeticPosition,
    /// In the altitude reference of the mission [m].
    altitude_m: f64,
    hold_s: f64,
    /// Speed on the leg to it [m/s].
    leg_mps: f64,
}

/// The waypoints of a part.
fn waypoints(part: &MissionPart) -> Vec<RoutePoint> {
    let mut leg_mps = MAX_SPEED_MPS;
    let waypoint = |item: &VehicleItem| match *item {
        VehicleItem::Waypoint { place, altitude_m, hold_s } => Some(RoutePoint { place, altitude_m, hold_s, leg_mps }),
        VehicleItem::Speed { speed_mps } => {
            leg_mps = speed_mps;
            None
        }
        VehicleItem::TakeOff { .. } | VehicleItem::Return => None,
    };
    part.items.iter().filter_map(waypoint).collect()
}

fn write(exported: &ExportedMission<'_>, part: &MissionPart) -> Vec<u8> {
    let route = Route::of(exported, part);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().last_modified_time(DateTime::default()); // the same bytes at any time
    for (name, text) in [("wpmz/template.kml", route.template()), ("wpmz/waylines.wpml", route.waylines())] {
        archive.start_file(name, options).expect("a file in memory");
        archive.write_all(text.as_bytes()).expect("a file in memory");
    }
    archive.finish().expect("an archive in memory").into_inner()
}

/// What both files of a route are written from.
struct Route {
    waypoints: Vec<RoutePoint>,
    /// `droneInfo` and `payloadInfo`.
    drone: String,
    /// The altitude of the take-off above home [m].
    take_off_m: f64,
    /// The altitude of a return above home [m].
    return_m: f64,
    /// Height of the sea level above the ellipsoid [m]; `None` if altitudes are above home.
    geoid_m: Option<f64>,
}

impl Route {
    fn of(exported: &ExportedMission<'_>, part: &MissionPart) -> Self {
        let ExportedMission { mission, options, .. } = exported;
        let take_off_m = part.items.iter().find_map(|item| match item {
            VehicleItem::TakeOff { altitude_m, .. } => Some(*altitude_m),
            _ => None,
        });
        let highest_m = part.path.iter().map(|node| node.z).fold(0.0, f64::max);
        Self {
            waypoints: waypoints(part),
            drone: options.drone.map_or(String::new(), info),
            take_off_m: rounded(take_off_m.unwrap_or_default().max(LEAST_TAKE_OFF_M)),
            return_m: mission.return_m.map_or(highest_m, |return_m| return_m.max(highest_m)).ceil(),
            geoid_m: options.geoid,
        }
    }

    /// `missionConfig`, with elements that one of the files has `more`.
    fn config(&self, more: &str) -> String {
        let parts = [
            element("flyToWaylineMode", "safely"),
            element("finishAction", "goHome"),
            element("exitOnRCLost", "executeLostAction"),
            element("executeRCLostAction", "goBack"),
            element("takeOffSecurityHeight", self.take_off_m),
            element("globalTransitionalSpeed", self.waypoints[0].leg_mps),
            more.to_owned(),
            self.drone.clone(),
        ];
        element("missionConfig", parts.concat())
    }

    /// The file that a ground station edits.
    fn template(&self) -> String {
        let mode = if self.geoid_m.is_some() { "EGM96" } else { "relativeToStartPoint" };
        let parts = [
            element("templateType", "waypoint"),
            element("templateId", 0),
            element("waylineCoordinateSysParam", element("coordinateMode", "WGS84") + &element("heightMode", mode)),
            element("autoFlightSpeed", self.speed_mps(0)),
            element("globalHeight", rounded(self.waypoints[0].altitude_m)),
            element("gimbalPitchMode", "manual"),
            element("globalWaypointHeadingParam", heading()),
            element("globalWaypointTurnMode", "toPointAndStopWithDiscontinuityCurvature"),
            element("globalUseStraightLine", 1),
        ];
        let waypoint = |index: usize| {
            let altitude_m = self.waypoints[index].altitude_m;
            let parts = [
                element("ellipsoidHeight", rounded(altitude_m + self.geoid_m.unwrap_or_default())),
                element("height", rounded(altitude_m)),
                element("useGlobalHeight", 0),
                element("useGlobalSpeed", 0),
                element("waypointSpeed", self.speed_mps(index)),
                element("useGlobalHeadingParam", 1),
                element("useGlobalTurnParam", 1),
            ];
            self.placemark(index, &parts.concat())
        };
        let waypoints: String = (0..self.waypoints.len()).map(waypoint).collect();
        let author = element("author", "Skysink");
        document(&format!("{author}{}<Folder>\n{}{waypoints}</Folder>\n", self.config(""), parts.concat()))
    }

    /// The file that the aircraft flies.
    fn waylines(&self) -> String {
        let mode = if self.geoid_m.is_some() { "WGS84" } else { "relativeToStartPoint" };
        let parts = [
            element("templateId", 0),
            element("executeHeightMode", mode),
            element("waylineId", 0),
            element("autoFlightSpeed", self.speed_mps(0)),
        ];
        let turn = element("waypointTurnMode", "toPointAndStopWithDiscontinuityCurvature")
            + &element("waypointTurnDampingDist", 0);
        let waypoint = |index: usize| {
            let height_m = self.waypoints[index].altitude_m + self.geoid_m.unwrap_or_default();
            let parts = [
                element("executeHeight", rounded(height_m)),
                element("waypointSpeed", self.speed_mps(index)),
                element("waypointHeadingParam", heading()),
                element("waypointTurnParam", &turn),
            ];
            self.placemark(index, &parts.concat())
        };
        let waypoints: String = (0..self.waypoints.len()).map(waypoint).collect();
        let config = self.config(&element("globalRTHHeight", self.return_m));
        document(&format!("{config}<Folder>\n{}{waypoints}</Folder>\n", parts.concat()))
    }

    /// Speed on the leg from a waypoint [m/s], which the format gives there; to the last one after it.
    fn speed_mps(&self, index: usize) -> f64 {
        self.waypoints.get(index + 1).unwrap_or(&self.waypoints[index]).leg_mps
    }

    /// A waypoint with elements of one of the files, and its hover.
    fn placemark(&self, index: usize, parts: &str) -> String {
        let RoutePoint { place, hold_s, .. } = &self.waypoints[index];
        let point = format!("<Point><coordinates>{:.9},{:.9}</coordinates></Point>\n", place.lon_deg, place.lat_deg);
        let hover = if *hold_s > 0.0 { hover(index, *hold_s) } else { String::new() };
        format!("<Placemark>\n{point}{}{parts}{hover}</Placemark>\n", element("index", index))
    }
}

/// The nose in the direction of the leg.
fn heading() -> String {
    element("waypointHeadingMode", "followWayline") + &element("waypointHeadingPathMode", "followBadArc")
}

/// The action of a hold at a waypoint.
fn hover(index: usize, hold_s: f64) -> String {
    let action = [
        element("actionId", 0),
        element("actionActuatorFunc", "hover"),
        element("actionActuatorFuncParam", element("hoverTime", hold_s)),
    ];
    let parts = [
        element("actionGroupId", index),
        element("actionGroupStartIndex", index),
        element("actionGroupEndIndex", index),
        element("actionGroupMode", "sequence"),
        element("actionTrigger", element("actionTriggerType", "reachPoint")),
        element("action", action.concat()),
    ];
    element("actionGroup", parts.concat())
}

/// In whole millimetres [m].
fn rounded(height_m: f64) -> f64 {
    (height_m * 1e3).round() / 1e3
}

/// An element of WPML; numbers and names need no escapes.
fn element(name: &str, content: impl std::fmt::Display) -> String {
    format!("<wpml:{name}>{content}</wpml:{name}>\n")
}

fn document(content: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\" \
         xmlns:wpml=\"http://www.dji.com/wpmz/1.0.2\">\n<Document>\n{content}</Document>\n</kml>\n"
    )
}
