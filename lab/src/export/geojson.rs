//! GeoJSON (RFC 7946): the area, the flight, the service points and the sensor nodes as features.

use geojson::{Feature, FeatureCollection, Geometry};
use serde_json::{Value, json};
use skysink_common::geodata::projection::GeodeticPosition;
use skysink_mission::replay::RecordedRun;

use super::format::{ExportFormat, WriteFormat};
use super::track::{GeodeticTrack, TrackPoint};

/// Features with the property `kind`: `area`, `flight`, `no-fly`, `building` (with `height_m`), `service` (with `slot`,
/// `time_s`, `scheduled`), `sensor node` (with `id`, `name`). `skysink new` reads it again.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "geojson",
    about: "GeoJSON, for QGIS and web maps: area, flight, service points, sensor nodes",
    extension: "geojson",
    write: WriteFormat::Flight(|track| collection(track).into_bytes()),
};

/// The features as text.
pub(crate) fn collection(track: &GeodeticTrack<'_>) -> String {
    let border = || track.border.iter().chain(&track.border[..1]).map(ground);
    let RecordedRun { scenario, strategy, .. } = track.run;
    let name = format!("{} {strategy} seed {}", scenario.name, scenario.seed);
    let area = feature(Geometry::new_polygon([border()]), json!({ "kind": "area", "name": name }));
    let zones = track.zones.iter().map(|zone| {
        let corners = zone.corners.iter().chain(&zone.corners[..1]).map(ground);
        let properties = match zone.height_m {
            None => json!({ "kind": "no-fly" }),
            Some(height_m) => json!({ "kind": "building", "height_m": height_m }),
        };
        feature(Geometry::new_polygon([corners]), properties)
    });
    let flight = feature(
        Geometry::new_line_string(track.points.iter().map(in_the_air)),
        json!({ "kind": "flight", "slot_s": scenario.slot_s }),
    );
    let services = track.services().map(|(point, slot)| {
        let properties =
            json!({ "kind": "service", "slot": slot, "time_s": point.time_s, "scheduled": point.served() });
        feature(Geometry::new_point(in_the_air(point)), properties)
    });
    let sensors = track.sensors.iter().enumerate().map(|(id, place)| {
        let name = track.run.list.label(id);
        feature(Geometry::new_point(ground(place)), json!({ "kind": "sensor node", "id": id, "name": name }))
    });
    let features = std::iter::once(area).chain(zones).chain([flight]).chain(services).chain(sensors).collect();
    FeatureCollection { bbox: None, features, foreign_members: None }.to_string() + "\n"
}

fn ground(place: &GeodeticPosition) -> [f64; 2] {
    [place.lon_deg, place.lat_deg]
}

/// Longitude, latitude, and the altitude above the ground.
fn in_the_air(point: &TrackPoint<'_>) -> [f64; 3] {
    [point.place.lon_deg, point.place.lat_deg, point.position.z]
}

fn feature(geometry: Geometry, properties: Value) -> Feature {
    let properties = properties.as_object().cloned();
    Feature { geometry: Some(geometry), properties, ..Feature::default() }
}
