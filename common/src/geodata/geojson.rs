//! GeoJSON: points and polygons, in features, collections or alone; longitude first.

use ::geojson::{Feature, GeoJson, Geometry, GeometryValue, JsonObject, Position};
use serde_json::Value;

use super::{FoundPoint, FoundPoints, FoundPolygon, IgnoredItem, check_geodetic, is_closed, kind_of_line, with_causes};
use crate::error::quoted;

/// What names of WGS84, with longitude first or not, end with. GeoJSON files have longitude first in both.
const WGS84: [&str; 3] = ["CRS84", "EPSG:4326", "EPSG/0/4326"];

/// Finds the points and polygons of the text of a file.
///
/// # Errors
/// If it is not GeoJSON, is in another reference system than WGS84, or has an invalid position.
pub fn find(text: &str) -> Result<FoundPoints, String> {
    let file: GeoJson = text.parse().map_err(|error| format!("{}: expected GeoJSON", with_causes(&error)))?;
    let mut found = FoundPoints::default();
    match &file {
        GeoJson::Geometry(geometry) => found.add_geojson(geometry, &[])?,
        GeoJson::Feature(feature) => found.add_feature(feature)?,
        GeoJson::FeatureCollection(collection) => {
            check_reference_system(collection.foreign_members.as_ref())?;
            collection.features.iter().try_for_each(|feature| found.add_feature(feature))?;
        }
    }
    Ok(found)
}

/// Refuses a member `crs`, which older GeoJSON has, of another reference system than WGS84.
fn check_reference_system(members: Option<&JsonObject>) -> Result<(), String> {
    let Some(system) = members.and_then(|members| members.get("crs")).filter(|system| !system.is_null()) else {
        return Ok(());
    };
    let name = system.pointer("/properties/name").and_then(Value::as_str);
    // Without the version in `urn:ogc:def:crs:EPSG::4326` and `urn:ogc:def:crs:OGC:1.3:CRS84`.
    let parts: Vec<&str> = name.unwrap_or_default().rsplit(':').collect();
    let is_wgs84 = match parts[..] {
        [code, _, authority, ..] => WGS84.contains(&format!("{authority}:{code}").as_str()) || code == "CRS84",
        _ => false,
    };
    if is_wgs84 || WGS84.iter().any(|end| name.unwrap_or_default().ends_with(end)) {
        return Ok(());
    }
    let shown = name.map_or_else(|| system.to_string(), str::to_owned);
    Err(format!("crs `{}`: expected WGS84, longitude and latitude (EPSG:4326)", quoted(&shown)))
}

/// The properties of a feature as text; without those that are null.
fn properties(feature: &Feature) -> Vec<(String, String)> {
    let text = |value: &Value| match value {
        Value::Null => None,
        Value::String(text) => Some(text.clone()),
        other => Some(other.to_string()),
    };
    let properties = feature.properties.iter().flatten();
    properties.filter_map(|(name, value)| Some((name.clone(), text(value)?))).collect()
}

/// Latitude, longitude and altitude.
fn read(coordinates: &Position) -> Result<([f64; 2], Option<f64>), String> {
    match *coordinates.as_slice() {
        [lon_deg, lat_deg, ref altitude_m @ ..] if altitude_m.len() < 2 => {
            check_geodetic([lat_deg, lon_deg])?;
            Ok(([lat_deg, lon_deg], altitude_m.first().copied()))
        }
        ref numbers => Err(format!("a position of {} numbers: expected longitude, latitude, altitude", numbers.len())),
    }
}

impl FoundPoints {
    fn add_feature(&mut self, feature: &Feature) -> Result<(), String> {
        check_reference_system(feature.foreign_members.as_ref())?;
        let properties = properties(feature);
        match &feature.geometry {
            Some(geometry) => self.add_geojson(geometry, &properties),
            None => {
                self.ignore("feature without geometry", &properties);
                Ok(())
            }
        }
    }

    fn ignore(&mut self, kind: &'static str, properties: &[(String, String)]) {
        self.ignored.push(IgnoredItem::of(kind, properties));
    }

    fn add_geojson(&mut self, geometry: &Geometry, properties: &[(String, String)]) -> Result<(), String> {
        check_reference_system(geometry.foreign_members.as_ref())?;
        match &geometry.value {
            GeometryValue::Point { coordinates } => self.add_point(coordinates, properties)?,
            GeometryValue::MultiPoint { coordinates } if !coordinates.is_empty() => {
                coordinates.iter().try_for_each(|point| self.add_point(point, properties))?;
            }
            GeometryValue::GeometryCollection { geometries } if !geometries.is_empty() => {
                geometries.iter().try_for_each(|geometry| self.add_geojson(geometry, properties))?;
            }
            GeometryValue::Polygon { coordinates } => self.add_polygon(coordinates, properties)?,
            GeometryValue::MultiPolygon { coordinates } if !coordinates.is_empty() => {
                coordinates.iter().try_for_each(|polygon| self.add_polygon(polygon, properties))?;
            }
            GeometryValue::LineString { coordinates } => {
                self.ignore(kind_of_line(is_closed(coordinates)), properties);
            }
            GeometryValue::MultiLineString { coordinates } if !coordinates.is_empty() => {
                coordinates.iter().for_each(|line| self.ignore(kind_of_line(is_closed(line)), properties));
            }
            _ => self.ignore("feature without geometry", properties),
        }
        Ok(())
    }

    fn add_point(&mut self, coordinates: &Position, properties: &[(String, String)]) -> Result<(), String> {
        let (position, altitude_m) =
            read(coordinates).map_err(|message| format!("{}: {message}", self.next_point(properties)))?;
        self.points.push(FoundPoint { position, altitude_m, properties: properties.to_vec() });
        Ok(())
    }

    fn add_polygon(&mut self, rings: &[Vec<Position>], properties: &[(String, String)]) -> Result<(), String> {
        let ring = |ring: &Vec<Position>| ring.iter().map(|corner| Ok(read(corner)?.0)).collect::<Result<_, String>>();
        let rings = rings.iter().map(ring).collect::<Result<_, String>>();
        let rings = rings.map_err(|message| format!("{}: {message}", self.next_polygon(properties)))?;
        self.polygons.push(FoundPolygon { rings, properties: properties.to_vec(), ..FoundPolygon::default() });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feature(geometry: &str, properties: &str) -> String {
        format!("{{\"type\":\"Feature\",\"properties\":{properties},\"geometry\":{geometry}}}")
    }

    fn collection(features: &[String]) -> FoundPoints {
        find(&format!("{{\"type\":\"FeatureCollection\",\"features\":[{}]}}", features.join(","))).unwrap()
    }

    const POINT: &str = "{\"type\":\"Point\",\"coordinates\":[13.4,52.5,30]}";
    const LINE: &str = "{\"type\":\"LineString\",\"coordinates\":[[0,1],[2,3]]}";

    #[test]
    fn points_of_features_and_collections_are_found() {
        let found = collection(&[feature(POINT, "{}"), feature(LINE, "{}")]);
        assert_eq!(
            (found.points[0].position, found.points[0].altitude_m, found.ignored.len()),
            ([52.5, 13.4], Some(30.0), 1)
        );
        let several = find("{\"type\":\"MultiPoint\",\"coordinates\":[[1,2],[3,4]]}").unwrap();
        assert_eq!(several.points[1].position, [4.0, 3.0]);
    }

    #[test]
    fn properties_of_features_are_text() {
        let found = collection(&[feature(POINT, "{\"rate\":50,\"name\":\"soil-07\",\"tags\":[1],\"owner\":null}")]);
        let mut properties = found.points[0].properties.clone();
        properties.sort();
        let expected = [("name", "soil-07"), ("rate", "50"), ("tags", "[1]")];
        assert_eq!(properties, expected.map(|(name, value)| (name.to_owned(), value.to_owned())));
    }

    #[test]
    fn features_without_a_point_are_counted() {
        let nothing = "{\"type\":\"GeometryCollection\",\"geometries\":[]}";
        let nowhere = "{\"type\":\"MultiPoint\",\"coordinates\":[]}";
        let features = ["null", POINT, LINE, nothing, nowhere].map(|geometry| feature(geometry, "{}"));
        let found = collection(&features);
        assert_eq!((found.points.len(), found.ignored.len()), (1, 4));
        assert!(find(&features[0]).unwrap().points.is_empty());
    }

    #[test]
    fn invalid_geojson_is_refused() {
        assert!(find("{\"a\": 1}").unwrap_err().ends_with("expected GeoJSON"));
        assert!(find("{\"type\":\"Point\",\"coordinates\":[1]}").is_err());
    }

    #[test]
    fn another_reference_system_is_refused_wherever_it_stands() {
        let with = |name: &str| {
            let crs = format!("\"crs\":{{\"type\":\"name\",\"properties\":{{\"name\":\"{name}\"}}}}");
            let point = POINT.replace("{\"type\"", &format!("{{{crs},\"type\""));
            [
                find(&feature(POINT, "{}").replace("{\"type\":\"Feature\"", &format!("{{{crs},\"type\":\"Feature\""))),
                find(&point),
                find(&format!("{{{crs},\"type\":\"FeatureCollection\",\"features\":[{}]}}", feature(POINT, "{}"))),
            ]
        };
        for name in [
            "urn:ogc:def:crs:OGC:1.3:CRS84",
            "urn:ogc:def:crs:EPSG::4326",
            "urn:ogc:def:crs:EPSG:6.9:4326",
            "EPSG:4326",
            "http://www.opengis.net/def/crs/EPSG/0/4326",
        ] {
            assert!(with(name).iter().all(Result::is_ok), "{name}");
        }
        for name in ["urn:ogc:def:crs:EPSG::32632", "EPSG:3857", "urn:ogc:def:crs:EPSG::14326", "local"] {
            for refused in with(name) {
                let expected = format!("crs `{name}`: expected WGS84, longitude and latitude (EPSG:4326)");
                assert_eq!(refused.unwrap_err(), expected);
            }
        }
        assert!(find(&POINT.replace("{\"type\"", "{\"crs\":null,\"type\"")).is_ok());
        assert!(find(&POINT.replace("{\"type\"", "{\"crs\":{\"type\":\"link\"},\"type\"")).is_err());
    }

    #[test]
    fn positions_of_too_many_numbers_are_refused_by_point_and_polygon() {
        let point = POINT.replace("30", "30,31");
        let expected = "point 1: a position of 4 numbers: expected longitude, latitude, altitude";
        assert_eq!(find(&point).unwrap_err(), expected);
        let polygon = "{\"type\":\"Polygon\",\"coordinates\":[[[1,2],[3,4,5,6],[1,3],[1,2]]]}";
        let named = feature(polygon, "{\"name\":\"pond\"}");
        assert_eq!(find(&named).unwrap_err(), expected.replace("point 1", "polygon 1 (`pond`)"));
        assert_eq!(
            find(&POINT.replace("52.5", "95")).unwrap_err(),
            "point 1: latitude 95: expected -90 to 90; are latitude and longitude swapped?"
        );
    }
}
