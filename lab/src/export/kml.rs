//! KML 2.2, for Google Earth: the area, the flight above the ground, the service points and the sensor nodes.

use std::collections::HashMap;

use kml::types::{AltitudeMode, Coord, Folder, Geometry, LineString, LinearRing, Placemark, Point, Polygon};
use kml::{Kml, KmlDocument, KmlVersion, KmlWriter};
use skysink_common::geodata::projection::GeodeticPosition;

use super::altitude::AltitudeReference;
use super::format::{ExportFormat, MissionOf, WriteFormat};
use super::vehicle::{MissionPart, VehicleItem, VehicleMission};

/// The document.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "kml",
    about: "KML, for Google Earth: area, flight, service points, sensor nodes",
    extension: "kml",
    write: WriteFormat::MissionMap(write),
};

/// Distance between the points of a flight that follows the ground [m].
const STEP_M: f64 = 50.0;

fn write(of: &MissionOf<'_>) -> Vec<u8> {
    let MissionOf { track, mission, .. } = of;
    let border = track.border.iter().chain(&track.border[..1]).map(ground).collect::<Vec<_>>();
    let area = Geometry::Polygon(Polygon { tessellate: true, ..Polygon::new(LinearRing::from(border), vec![]) });
    let zones = track.zones.iter().map(|zone| {
        let corner = |place| Coord { z: zone.height_m, ..ground(place) };
        let corners = zone.corners.iter().chain(&zone.corners[..1]).map(corner).collect::<Vec<_>>();
        let polygon = Polygon::new(LinearRing::from(corners), vec![]);
        let (name, polygon) = match zone.height_m {
            None => ("no-fly zone", Polygon { tessellate: true, ..polygon }),
            Some(_) => {
                ("building", Polygon { extrude: true, altitude_mode: AltitudeMode::RelativeToGround, ..polygon })
            }
        };
        placemark(name.to_owned(), String::new(), Geometry::Polygon(polygon))
    });
    let flights = (1..).zip(&mission.parts).map(|(number, part)| {
        let name = if mission.parts.len() == 1 { "flight".to_owned() } else { format!("flight, part {number}") };
        let coords: Vec<Coord> = flight(of, part);
        let (altitude_mode, _) = altitude(mission, 0.0);
        let line = LineString { altitude_mode, ..LineString::from(coords) };
        placemark(name, track.name(), Geometry::LineString(line))
    });
    let services = mission.services.iter().map(|&(index, altitude_m)| {
        let point = &track.points[index];
        let (altitude_mode, z) = altitude(mission, altitude_m);
        let at = Coord::new(point.place.lon_deg, point.place.lat_deg, Some(z));
        let geometry = Geometry::Point(Point { altitude_mode, ..Point::from(at) });
        let slot = point.slot.map_or(0, |slot| slot.slot);
        placemark(format!("slot {slot}"), format!("{}, {} s", track.served_labels(point), point.time_s), geometry)
    });
    let sensors = track.sensors.iter().enumerate().map(|(id, place)| {
        placemark(track.run.list.label(id), String::new(), Geometry::Point(Point::from(ground(place))))
    });
    let services = folder("service points", services.collect());
    let sensors = folder("sensor nodes", sensors.collect());
    let area = placemark("area".to_owned(), String::new(), area);
    let elements = std::iter::once(area).chain(zones).chain(flights).chain([services, sensors]).collect();
    let attrs = HashMap::from([("xmlns".to_owned(), "http://www.opengis.net/kml/2.2".to_owned())]);
    let document = Kml::Document { attrs: HashMap::new(), elements };
    let document = Kml::KmlDocument(KmlDocument { version: KmlVersion::V22, attrs, elements: vec![document] });
    let mut text = b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n".to_vec();
    KmlWriter::from_writer(&mut text).write(&document).expect("a vector takes everything");
    text
}

fn folder(name: &str, elements: Vec<Kml>) -> Kml {
    Kml::Folder(Folder { name: Some(name.to_owned()), elements, ..Folder::default() })
}

fn placemark(name: String, description: String, geometry: Geometry) -> Kml {
    let description = Some(description).filter(|text| !text.is_empty());
    Kml::Placemark(Placemark { name: Some(name), description, geometry: Some(geometry), ..Placemark::default() })
}

fn ground(place: &GeodeticPosition) -> Coord {
    Coord::new(place.lon_deg, place.lat_deg, None)
}

/// The points of the flight of a part: take-off, waypoints and landing.
fn flight(of: &MissionOf<'_>, part: &MissionPart) -> Vec<Coord> {
    let home = of.track.points[0].place;
    let at = |place: &GeodeticPosition, altitude_m: f64| Coord::new(place.lon_deg, place.lat_deg, Some(altitude_m));
    let mission = of.mission;
    let ground_m = altitude(mission, if mission.reference == AltitudeReference::Msl { home_m(mission) } else { 0.0 }).1;
    let mut coords = vec![at(&home, ground_m)];
    for item in &part.items {
        match item {
            VehicleItem::TakeOff { home, altitude_m } => coords.push(at(home, ground_m + altitude_m)),
            VehicleItem::Waypoint { place, altitude_m, .. } => {
                let end = at(place, altitude(mission, *altitude_m).1);
                let begin = coords[coords.len() - 1];
                coords.extend(between(mission, &begin, &end));
                coords.push(end);
            }
            VehicleItem::Speed { .. } => {}
            VehicleItem::Return => coords.push(at(&home, ground_m)),
        }
    }
    coords
}

/// The points between two that follow the ground, if the mission does: a line of KML is straight between its points.
fn between(mission: &VehicleMission, begin: &Coord, end: &Coord) -> Vec<Coord> {
    if mission.reference != AltitudeReference::Terrain {
        return Vec::new();
    }
    let north_m = (end.y - begin.y) * DEGREE_M;
    // The short way around the Earth.
    let east_deg = (end.x - begin.x + 540.0).rem_euclid(360.0) - 180.0;
    let east_m = east_deg * DEGREE_M * begin.y.to_radians().cos();
    let steps = (north_m.hypot(east_m) / STEP_M).ceil().clamp(1.0, MOST_STEPS) as u32;
    let step = |step: u32| {
        let along = |from: f64, to: f64| from + (to - from) * f64::from(step) / f64::from(steps);
        let z = begin.z.zip(end.z).map(|(from, to)| along(from, to));
        Coord::new(along(begin.x, begin.x + east_deg), along(begin.y, end.y), z)
    };
    (1..steps).map(step).collect()
}

/// Most points between two waypoints.
const MOST_STEPS: f64 = 1000.0;

/// Approximate length of a degree of latitude [m].
const DEGREE_M: f64 = 111_000.0;

/// The ground at home [m]; 0 if it is not known.
fn home_m(mission: &VehicleMission) -> f64 {
    mission.home_ground_m.unwrap_or(0.0)
}

/// An altitude of the mission as one of KML [m]: above sea level if the ground at home is known or is not needed, otherwise
/// above the ground.
fn altitude(mission: &VehicleMission, altitude_m: f64) -> (AltitudeMode, f64) {
    match (mission.reference, mission.home_ground_m) {
        (AltitudeReference::Relative, Some(home_m)) => (AltitudeMode::Absolute, home_m + altitude_m),
        (AltitudeReference::Msl, _) => (AltitudeMode::Absolute, altitude_m),
        (AltitudeReference::Relative, None) | (AltitudeReference::Terrain, _) => {
            (AltitudeMode::RelativeToGround, altitude_m)
        }
    }
}
