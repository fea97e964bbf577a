//! KML 2.2, for Google Earth: the area, the flight above the ground, the service points and the sensor nodes.

use std::collections::HashMap;

use kml::types::{AltitudeMode, Coord, Folder, Geometry, LineString, LinearRing, Placemark, Point, Polygon};
use kml::{Kml, KmlDocument, KmlVersion, KmlWriter};
use skysink_common::geodata::projection::GeodeticPosition;

use super::format::{ExportFormat, WriteFormat};
use super::track::{GeodeticTrack, TrackPoint};

/// The document.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "kml",
    about: "KML, for Google Earth: area, flight, service points, sensor nodes",
    extension: "kml",
    write: WriteFormat::Flight(write),
};

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
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
    let flight = Geometry::LineString(LineString {
        altitude_mode: AltitudeMode::RelativeToGround,
        ..LineString::from(track.points.iter().map(in_the_air).collect::<Vec<_>>())
    });
    let services = track.services().map(|(point, slot)| {
        let altitude_mode = AltitudeMode::RelativeToGround;
        let geometry = Geometry::Point(Point { altitude_mode, ..Point::from(in_the_air(point)) });
        placemark(format!("slot {slot}"), format!("{}, {} s", track.served_labels(point), point.time_s), geometry)
    });
    let sensors = track.sensors.iter().enumerate().map(|(id, place)| {
        placemark(track.run.list.label(id), String::new(), Geometry::Point(Point::from(ground(place))))
    });
    let services = folder("service points", services.collect());
    let sensors = folder("sensor nodes", sensors.collect());
    let area = placemark("area".to_owned(), String::new(), area);
    let flight = placemark("flight".to_owned(), track.name(), flight);
    let elements = std::iter::once(area).chain(zones).chain([flight, services, sensors]).collect();
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

fn in_the_air(point: &TrackPoint<'_>) -> Coord {
    Coord::new(point.place.lon_deg, point.place.lat_deg, Some(point.position.z))
}
