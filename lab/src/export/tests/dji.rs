//! Tests of DJI's format, against the elements that its documentation requires.

use std::io::{Cursor, Read};

use super::*;
use crate::export::dji;
use crate::export::dji_drone::DjiDrone;
use crate::export::format::{ExportedMission, WriteFormat};

/// An element: its name, its text, and its children.
#[derive(Debug, Default, Clone)]
struct Element {
    name: String,
    text: String,
    children: Vec<Element>,
}

impl Element {
    /// The root of a document without attributes that matter, comments or escapes.
    fn parse(text: &str) -> Self {
        let mut open = vec![Self::default()];
        for tag in text.split('<').skip(1).filter(|tag| !tag.starts_with('?')) {
            let (head, after) = tag.split_once('>').unwrap();
            if let Some(name) = head.strip_prefix('/') {
                let closed = open.pop().unwrap();
                assert_eq!(closed.name, name);
                open.last_mut().unwrap().children.push(closed);
            } else {
                let name = head.split(' ').next().unwrap().to_owned();
                open.push(Self { name, text: after.trim().to_owned(), children: Vec::new() });
            }
        }
        let [root] = &open[..] else { panic!("open elements: {open:?}") };
        let [kml] = &root.children[..] else { panic!("{root:?}") };
        kml.clone()
    }

    fn child(&self, name: &str) -> &Self {
        let found = self.children.iter().find(|child| child.name == name || child.name == format!("wpml:{name}"));
        found.unwrap_or_else(|| panic!("no {name} in {}: {:?}", self.name, self.names()))
    }

    fn names(&self) -> Vec<&str> {
        self.children.iter().map(|child| child.name.strip_prefix("wpml:").unwrap_or(&child.name)).collect()
    }

    fn number(&self, name: &str) -> f64 {
        self.child(name).text.parse().unwrap()
    }

    fn all(&self, name: &str) -> Vec<&Self> {
        self.children.iter().filter(|child| child.name == name).collect()
    }
}

fn with_drone() -> VehicleMissionOptions {
    VehicleMissionOptions { drone: Some(DjiDrone::M30), ..forever() }
}

/// What the format says about a mission.
fn checked(run: &RecordedRun, options: &VehicleMissionOptions) -> Result<Vec<String>, String> {
    let WriteFormat::Mission(format) = &dji::FORMAT.write else { panic!("{:?}", dji::FORMAT) };
    (format.check)(&mission(run, options), options)
}

/// The documents of the first part: template and waylines.
fn documents(run: &RecordedRun, options: &VehicleMissionOptions) -> [Element; 2] {
    let WriteFormat::Mission(format) = &dji::FORMAT.write else { panic!("{:?}", dji::FORMAT) };
    checked(run, options).unwrap();
    let track = &track(run);
    let mission = &mission(run, options);
    let exported = ExportedMission { track, mission, options, fence: Vec::new() };
    let bytes = (format.write)(&exported, &mission.parts[0]);
    assert_eq!(bytes, (format.write)(&exported, &mission.parts[0]), "the same bytes at any time");
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    assert_eq!(archive.file_names().collect::<Vec<_>>(), ["wpmz/template.kml", "wpmz/waylines.wpml"]);
    ["wpmz/template.kml", "wpmz/waylines.wpml"].map(|name| {
        let mut text = String::new();
        archive.by_name(name).unwrap().read_to_string(&mut text).unwrap();
        Element::parse(&text)
    })
}

/// 10 m at 10 m/s with a hold of 0.25 s and a slot, 5 m at 5 m/s, and back.
fn short() -> RecordedRun {
    at_most(10.0, run(&[(10.0, Some(1)), (0.0, Some(1)), (5.0, Some(1))]))
}

/// The run of a UAV with this top speed [m/s].
fn at_most(speed_mps: f64, mut run: RecordedRun) -> RecordedRun {
    run.scenario.uav.max_speed_mps = speed_mps;
    run
}

/// A flight of two legs over ground at 500 m.
fn on_a_plateau() -> RecordedRun {
    at_most(10.0, run_in("", "x_m,y_m,ground_m\n0,0,500\n400,0,500\n", &[(10.0, Some(1)), (5.0, Some(1))]))
}

#[test]
fn both_files_have_the_elements_that_the_format_requires_in_its_order() {
    let [template, waylines] = documents(&short(), &with_drone());
    let config = ["flyToWaylineMode", "finishAction", "exitOnRCLost", "executeRCLostAction", "takeOffSecurityHeight"];
    let config = [&config[..], &["globalTransitionalSpeed"]].concat();
    let info = ["droneInfo", "payloadInfo"];
    let [of_template, of_waylines] = [&template, &waylines].map(|kml| kml.child("Document"));
    assert_eq!(of_template.names(), ["author", "missionConfig", "Folder"]);
    assert_eq!(of_template.child("missionConfig").names(), [&config[..], &info].concat());
    assert_eq!(of_waylines.names(), ["missionConfig", "Folder"]);
    assert_eq!(of_waylines.child("missionConfig").names(), [&config[..], &["globalRTHHeight"], &info].concat());
    let head = ["templateType", "templateId", "waylineCoordinateSysParam", "autoFlightSpeed", "globalHeight"];
    let turns = ["gimbalPitchMode", "globalWaypointHeadingParam", "globalWaypointTurnMode", "globalUseStraightLine"];
    let folder = of_template.child("Folder");
    assert_eq!(folder.names(), [&head[..], &turns, &["Placemark"; 3]].concat());
    let placemarks = folder.all("Placemark");
    let global = ["useGlobalHeadingParam", "useGlobalTurnParam"];
    let placemark =
        ["Point", "index", "ellipsoidHeight", "height", "useGlobalHeight", "useGlobalSpeed", "waypointSpeed"];
    assert_eq!(placemarks[2].names(), [&placemark[..], &global].concat());
    assert_eq!(placemarks[0].names(), [&placemark[..], &global, &["actionGroup"]].concat());
    let folder = of_waylines.child("Folder");
    let head = ["templateId", "executeHeightMode", "waylineId", "autoFlightSpeed"];
    assert_eq!(folder.names(), [&head[..], &["Placemark"; 3]].concat());
    let placemarks = folder.all("Placemark");
    let placemark = ["Point", "index", "executeHeight", "waypointSpeed", "waypointHeadingParam", "waypointTurnParam"];
    assert_eq!(placemarks[2].names(), placemark);
    let hover = placemarks[0].child("actionGroup");
    let ids =
        ["actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex", "actionGroupMode", "actionTrigger", "action"];
    assert_eq!(hover.names(), ids);
    assert_eq!(hover.child("action").child("actionActuatorFunc").text, "hover");
}

/// The speed at a waypoint is that of the leg from it. Holds are whole seconds. East of the origin on the equator 10 m
/// are 10/6378137 · 180°/π = 0.000089832°.
#[test]
fn places_speeds_and_hovers_are_those_of_the_mission() {
    let [template, waylines] = documents(&short(), &with_drone());
    let config = waylines.child("Document").child("missionConfig");
    assert_eq!(config.number("globalTransitionalSpeed"), 10.0);
    assert_eq!(
        [config.child("droneInfo").number("droneEnumValue"), config.number("takeOffSecurityHeight")],
        [67.0, 20.0]
    );
    assert_eq!([config.number("globalRTHHeight")], [20.0]);
    let placemarks = waylines.child("Document").child("Folder").all("Placemark");
    let speeds: Vec<f64> = placemarks.iter().map(|waypoint| waypoint.number("waypointSpeed")).collect();
    assert_eq!(speeds, [5.0, 10.0, 10.0]);
    let hovers: Vec<&str> = placemarks
        .iter()
        .filter(|waypoint| waypoint.names().contains(&"actionGroup"))
        .map(|waypoint| {
            &waypoint.child("actionGroup").child("action").child("actionActuatorFuncParam").child("hoverTime").text[..]
        })
        .collect();
    assert_eq!(hovers, ["2", "1"], "1.25 s and 0.25 s");
    let place = &placemarks[0].child("Point").child("coordinates").text;
    assert_eq!(place, "0.000089832,0.000000000", "longitude, latitude");
    for (index, (edited, flown)) in
        template.child("Document").child("Folder").all("Placemark").iter().zip(&placemarks).enumerate()
    {
        assert_eq!([edited.number("index"), flown.number("index")], [index as f64; 2]);
        assert_eq!([edited.number("height"), flown.number("executeHeight")], [20.0; 2]);
        assert_eq!(edited.child("Point").child("coordinates").text, flown.child("Point").child("coordinates").text);
        assert_eq!(edited.number("waypointSpeed"), flown.number("waypointSpeed"));
    }
}

#[test]
fn heights_are_above_home_or_above_the_ellipsoid() {
    let hilly = on_a_plateau();
    let mode = |kml: &Element, name: &str| kml.child("Document").child("Folder").child(name).text.clone();
    let relative = documents(&hilly, &with_drone());
    assert_eq!(mode(&relative[1], "executeHeightMode"), "relativeToStartPoint");
    let options = VehicleMissionOptions { altitude: Some(AltitudeReference::Msl), geoid: Some(47.25), ..with_drone() };
    let [template, waylines] = documents(&hilly, &options);
    assert_eq!(mode(&waylines, "executeHeightMode"), "WGS84");
    let system = template.child("Document").child("Folder").child("waylineCoordinateSysParam");
    assert_eq!(system.child("heightMode").text, "EGM96");
    let edited = template.child("Document").child("Folder").all("Placemark")[0].clone();
    assert_eq!([edited.number("height"), edited.number("ellipsoidHeight")], [520.0, 567.25]);
    let flown = waylines.child("Document").child("Folder").all("Placemark")[0].clone();
    assert_eq!(flown.number("executeHeight"), 567.25);
}

#[test]
fn what_the_format_does_not_hold_is_refused() {
    let slow = short();
    let hilly = on_a_plateau();
    let with = |altitude, geoid| VehicleMissionOptions { altitude, geoid, ..with_drone() };
    for (run, options, expected) in [
        (&slow, VehicleMissionOptions { drone: None, ..with_drone() }, "--format dji: expected --drone"),
        (&slow, with(Some(AltitudeReference::Terrain), None), "--altitude terrain: a route file has no altitudes"),
        (&hilly, with(Some(AltitudeReference::Msl), None), "--altitude msl, --geoid: expected both"),
        (&slow, with(None, Some(47.0)), "--altitude msl, --geoid: expected both"),
        (
            &at_most(20.0, run(&[(20.0, Some(1)), (9.0, Some(1))])),
            with_drone(),
            "a leg at 20 m/s: expected at most 15 m/s",
        ),
        (&run(&[(0.0, Some(1))]), with_drone(), "a single waypoint"),
    ] {
        let text = checked(run, &options).unwrap_err();
        assert!(text.contains(expected), "{text}, expected {expected}");
    }
    assert!(checked(&slow, &with_drone()).unwrap().concat().contains("not flown"));
}
