//! GeoJSON: points and polygons, in features, collections or alone; longitude first.

use ::geojson::{Feature, GeoJson, Geometry, GeometryValue};
use serde_json::Value;

use super::imported::{FoundPoint, FoundPoints, FoundPolygon, Imported, with_causes};

/// Reads the sensor nodes of the text of a file.
pub fn read(text: &str) -> Result<Imported, String> {
    Imported::geodetic(find(text)?)
}

/// Finds the points and polygons of the text of a file.
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
                altitude: at(2).unwrap_or_default(),
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

    #[test]
    fn points_of_features_and_collections_are_found() {
        let feature = |geometry: &str| format!("{{\"type\":\"Feature\",\"properties\":{{}},\"geometry\":{geometry}}}");
        let point = "{\"type\":\"Point\",\"coordinates\":[13.4,52.5,30]}";
        let line = "{\"type\":\"LineString\",\"coordinates\":[[0,1],[2,3]]}";
        let text = format!("{{\"type\":\"FeatureCollection\",\"features\":[{},{}]}}", feature(point), feature(line));
        let imported = read(&text).unwrap();
        assert_eq!((imported.sensors[0].position, imported.ignored.len()), ([52.5, 13.4], 2));
        assert!(imported.ignored[1].starts_with("altitudes of 1 points"), "{:?}", imported.ignored);
        let several = "{\"type\":\"MultiPoint\",\"coordinates\":[[1,2],[3,4]]}";
        assert_eq!(read(several).unwrap().sensors[1].position, [4.0, 3.0]);
    }

    #[test]
    fn properties_of_features_are_found() {
        let feature = |properties: &str| {
            format!(
                "{{\"type\":\"Feature\",\"properties\":{properties},\"geometry\":{{\"type\":\"Point\",\"coordinates\":[1,2]}}}}"
            )
        };
        let features =
            [feature("{\"rate\":50,\"name\":\"soil-07\",\"tags\":[1]}"), feature("{\"rate\":\"60\",\"name\":null}")];
        let imported =
            read(&format!("{{\"type\":\"FeatureCollection\",\"features\":[{}]}}", features.join(","))).unwrap();
        let list = "lat_deg,lon_deg,sampling_bps,name\n2,1,50,soil-07\n2,1,60,\n";
        assert_eq!(
            (imported.to_csv([0.0; 2]).as_str(), &imported.ignored[..]),
            (list, &["properties tags".to_owned()][..])
        );
    }

    #[test]
    fn features_without_a_point_are_counted() {
        let point = "{\"type\":\"Point\",\"coordinates\":[13.4,52.5]}";
        let line = "{\"type\":\"LineString\",\"coordinates\":[[0,1],[2,3]]}";
        let nothing = "{\"type\":\"GeometryCollection\",\"geometries\":[]}";
        let nowhere = "{\"type\":\"MultiPoint\",\"coordinates\":[]}";
        let features = ["null", point, line, nothing, nowhere]
            .map(|geometry| format!("{{\"type\":\"Feature\",\"properties\":{{}},\"geometry\":{geometry}}}"));
        let text = format!("{{\"type\":\"FeatureCollection\",\"features\":[{}]}}", features.join(","));
        let imported = read(&text).unwrap();
        assert_eq!(imported.sensors.len(), 1);
        assert_eq!(imported.ignored, ["4 lines, polygons or other items without a point"]);
        assert!(read(&features[0]).unwrap().sensors.is_empty());
    }

    #[test]
    fn invalid_geojson_is_refused() {
        assert!(read("{\"a\": 1}").unwrap_err().ends_with("expected GeoJSON"));
        assert!(read("{\"type\":\"Point\",\"coordinates\":[200,2]}").unwrap_err().contains("longitude 200"));
        assert!(read("{\"type\":\"Point\",\"coordinates\":[1]}").is_err());
    }
}
