//! KML 2.2, for Google Earth: the area, the flight above the ground, the service points and the sensor nodes.

use std::collections::HashMap;

use kml::types::{AltitudeMode, Coord, Folder, Geometry, LineString, LinearRing, Placemark, Point, Polygon};
use kml::{Kml, KmlDocument, KmlVersion, KmlWriter};
use skysink_common::geodata::projection::GeodeticPosition;

use super::altitude::AltitudeReference;
use super::format::{ExportFormat, ExportedMission, WriteFormat};
use super::items::VehicleItem;
use super::track::GeodeticTrack;
use super::vehicle::{MissionPart, VehicleMission};

/// The document.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "kml",
    about: "KML, for Google Earth: area, flight, service points, sensor nodes",
    extension: "kml",
    write: WriteFormat::MissionMap(write),
};

/// Distance between the points of a flight that follows the ground [m].
const STEP_M: f64 = 50.0;

/// Most steps between two waypoints.
const MAX_STEPS: f64 = 1000.0;

/// Approximate length of a degree of latitude [m].
const DEGREE_M: f64 = 111_000.0;

fn write(exported: &ExportedMission<'_>) -> Vec<u8> {
    let ExportedMission { track, mission, .. } = exported;
    let altitude_mode = altitude_mode(mission);
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
        let line = LineString { altitude_mode, ..LineString::from(flight(track, mission, part)) };
        placemark(name, track.name(), Geometry::LineString(line))
    });
    let services = mission.parts.iter().flat_map(|part| &part.services).map(|&(index, altitude_m)| {
        let point = &track.points[index];
        let at = Coord::new(point.place.lon_deg, point.place.lat_deg, Some(z_m(mission, altitude_m)));
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

/// The points of the flight of a part: home, take-off, waypoints and landing.
fn flight(track: &GeodeticTrack<'_>, mission: &VehicleMission, part: &MissionPart) -> Vec<Coord> {
    let at = |place: &GeodeticPosition, z_m: f64| Coord::new(place.lon_deg, place.lat_deg, Some(z_m));
    let home = at(&track.points[0].place, home_m(mission));
    let mut coords = vec![home];
    for item in &part.items {
        match item {
            VehicleItem::TakeOff { home, altitude_m } => coords.push(at(home, home_m(mission) + altitude_m)),
            VehicleItem::Waypoint { place, altitude_m, .. } => {
                let end = at(place, z_m(mission, *altitude_m));
                if mission.reference == AltitudeReference::Terrain {
                    let begin = coords[coords.len() - 1];
                    coords.extend(between(&begin, &end));
                }
                coords.push(end);
            }
            VehicleItem::Speed { .. } => {}
            VehicleItem::Return => coords.push(home),
        }
    }
    coords
}

/// The points between two that follow the ground: a line of KML is straight between its points.
fn between(begin: &Coord, end: &Coord) -> impl Iterator<Item = Coord> {
    let north_m = (end.y - begin.y) * DEGREE_M;
    let east_deg = (end.x - begin.x + 540.0).rem_euclid(360.0) - 180.0; // the short way around the Earth
    let east_m = east_deg * DEGREE_M * begin.y.to_radians().cos();
    let steps = (north_m.hypot(east_m) / STEP_M).ceil().clamp(1.0, MAX_STEPS) as u32;
    let (begin, end) = (*begin, *end);
    (1..steps).map(move |step| {
        let along = |from: f64, to: f64| from + (to - from) * f64::from(step) / f64::from(steps);
        let z = begin.z.zip(end.z).map(|(from, to)| along(from, to));
        Coord::new(along(begin.x, begin.x + east_deg), along(begin.y, end.y), z)
    })
}

/// What the altitudes of the file are above: sea level if the ground at home is known or is not needed, otherwise the
/// ground.
fn altitude_mode(mission: &VehicleMission) -> AltitudeMode {
    match mission.reference {
        AltitudeReference::Relative if mission.home_ground_m.is_some() => AltitudeMode::Absolute,
        AltitudeReference::Msl => AltitudeMode::Absolute,
        AltitudeReference::Relative | AltitudeReference::Terrain => AltitudeMode::RelativeToGround,
    }
}

/// Home in the file [m].
fn home_m(mission: &VehicleMission) -> f64 {
    if mission.reference == AltitudeReference::Terrain { 0.0 } else { mission.home_ground_m.unwrap_or(0.0) }
}

/// An altitude of the mission in the file [m].
fn z_m(mission: &VehicleMission, altitude_m: f64) -> f64 {
    if mission.reference == AltitudeReference::Relative { home_m(mission) + altitude_m } else { altitude_m }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_between_divide_a_line_the_short_way_around_the_earth() {
        let [begin, end] =
            [(179.9995, 10.0), (-179.9985, 20.0)].map(|(lon_deg, z_m)| Coord::new(lon_deg, 0.0, Some(z_m)));
        let points: Vec<Coord> = between(&begin, &end).collect();
        let steps = (0.002 * DEGREE_M / STEP_M).ceil();
        assert!(steps > 2.0 && points.len() as f64 == steps - 1.0, "{points:?}");
        for (point, step) in points.iter().zip(1..) {
            let part = f64::from(step) / steps;
            let z_m = point.z.expect("both ends have one");
            assert!((point.x - (179.9995 + 0.002 * part)).abs() < 1e-9, "{point:?}");
            assert!(point.y == 0.0 && (z_m - (10.0 + 10.0 * part)).abs() < 1e-9, "{point:?}");
        }
    }
}
