//! GeoJSON: points and polygons, in features, collections or alone; longitude first.

use ::geojson::{Feature, GeoJson, Geometry, GeometryValue};
use serde_json::Value;

use super::{FoundPoint, FoundPoints, FoundPolygon, with_causes};

/// Finds the points and polygons of the text of a file.
///
/// # Errors
/// If it is not GeoJSON.
pub fn find(text: &str) -> Result<FoundPoints, String> {
    let file: GeoJson = text.parse().map_err(|error| format!("{}: expected GeoJSON", with_causes(&error)))?;
    let mut found = FoundPoints::default();
    match &file {
        GeoJson::Geometry(geometry) => found.add_geojson(geometry, &[]),
        GeoJson::Feature(feature) => found.add_feature(feature),
        GeoJson::FeatureCollection(collection) => {
            collection.features.iter().for_each(|feature| found.add_feature(feature));
        }
    }
    Ok(found)
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

impl FoundPoints {
    fn add_feature(&mut self, feature: &Feature) {
        match &feature.geometry {
            Some(geometry) => self.add_geojson(geometry, &properties(feature)),
            None => self.ignored += 1,
        }
    }

    fn add_geojson(&mut self, geometry: &Geometry, properties: &[(String, String)]) {
        let place = |coordinates: &::geojson::Position| {
            let at = |index| coordinates.as_slice().get(index).copied();
            FoundPoint {
                position: [1, 0].map(|index| at(index).unwrap_or(f64::NAN)),
                altitude_m: at(2),
                properties: properties.to_vec(),
            }
        };
        match &geometry.value {
            GeometryValue::Point { coordinates } => self.points.push(place(coordinates)),
            GeometryValue::MultiPoint { coordinates } if !coordinates.is_empty() => {
                self.points.extend(coordinates.iter().map(place))
            }
            GeometryValue::GeometryCollection { geometries } if !geometries.is_empty() => {
                geometries.iter().for_each(|geometry| self.add_geojson(geometry, properties));
            }
            GeometryValue::Polygon { coordinates } => self.add_polygon(coordinates, properties),
            GeometryValue::MultiPolygon { coordinates } if !coordinates.is_empty() => {
                coordinates.iter().for_each(|polygon| self.add_polygon(polygon, properties));
            }
            _ => self.ignored += 1,
        }
    }

    fn add_polygon(&mut self, rings: &[Vec<::geojson::Position>], properties: &[(String, String)]) {
        self.ignored += 1;
        let place = |corner: &::geojson::Position| {
            [1, 0].map(|index| corner.as_slice().get(index).copied().unwrap_or(f64::NAN))
        };
        let rings = rings.iter().map(|ring| ring.iter().map(place).collect()).collect();
        self.polygons.push(FoundPolygon { rings, extruded_m: None, properties: properties.to_vec() });
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
            (found.points[0].position, found.points[0].altitude_m, found.ignored),
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
        assert_eq!((found.points.len(), found.ignored), (1, 4));
        assert!(find(&features[0]).unwrap().points.is_empty());
    }

    #[test]
    fn invalid_geojson_is_refused() {
        assert!(find("{\"a\": 1}").unwrap_err().ends_with("expected GeoJSON"));
        assert!(find("{\"type\":\"Point\",\"coordinates\":[1]}").is_err());
    }
}
