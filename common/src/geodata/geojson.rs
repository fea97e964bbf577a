//! GeoJSON: points and polygons, in features, collections or alone; longitude or the coordinate to the east first.

mod diagnosis;

use ::geojson::{Feature, GeoJson, Geometry, GeometryValue, JsonObject, Position};
use serde_json::Value;

use super::reference::ReferenceSystem;
use super::{FoundPoint, FoundPoints, FoundPolygon, IgnoredItem, SourceText, check_geodetic, is_closed, kind_of_line};

/// Number beyond those of degrees.
const LEAST_LENGTH: f64 = 360.0;

/// Finds the points and polygons of the text of a file. Its positions are in the system of its member `crs`. Without
/// one they are degrees of WGS84, or lengths of the map that the source is said to have.
///
/// # Errors
/// If it is not GeoJSON, is in a reference system that is not known, or has an invalid position.
pub fn find(source: &SourceText<'_>) -> Result<FoundPoints, String> {
    let file: GeoJson = source.text.parse().map_err(|error| diagnosis::refusal(source.text, &error))?;
    let own = match &file {
        GeoJson::Geometry(geometry) => geometry.foreign_members.as_ref(),
        GeoJson::Feature(feature) => feature.foreign_members.as_ref(),
        GeoJson::FeatureCollection(collection) => collection.foreign_members.as_ref(),
    };
    let own = reference_system(own)?.filter(|system| !system.is_wgs84());
    let read_in = |system| {
        let mut reader = Reader { system, ..Reader::default() };
        let read = reader.add_file(&file);
        (read.map(|()| reader.found), reader.has_lengths)
    };
    match (read_in(own.as_ref()), source.system.filter(|system| system.is_map())) {
        ((Err(_), true), Some(system)) if own.is_none() => read_in(Some(system)).0,
        ((found, _), _) => found,
    }
}

/// The system of a member `crs`, which older GeoJSON has.
fn reference_system(members: Option<&JsonObject>) -> Result<Option<ReferenceSystem>, String> {
    let Some(system) = members.and_then(|members| members.get("crs")).filter(|system| !system.is_null()) else {
        return Ok(None);
    };
    let name = system.pointer("/properties/name").and_then(Value::as_str);
    let shown = name.map_or_else(|| system.to_string(), str::to_owned);
    ReferenceSystem::of_name(&shown).map(Some).map_err(|message| format!("crs {message}"))
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

/// Reads what is in a file.
#[derive(Default)]
struct Reader<'a> {
    /// The system of its positions; `None` for degrees of WGS84.
    system: Option<&'a ReferenceSystem>,
    found: FoundPoints,
    /// Whether a position that was refused is too large for degrees.
    has_lengths: bool,
}

impl Reader<'_> {
    fn add_file(&mut self, file: &GeoJson) -> Result<(), String> {
        self.found.system = self.system.cloned();
        match file {
            GeoJson::Geometry(geometry) => self.add_geometry(geometry, &[]),
            GeoJson::Feature(feature) => self.add_feature(feature),
            GeoJson::FeatureCollection(collection) => {
                collection.features.iter().try_for_each(|feature| self.add_feature(feature))
            }
        }
    }

    /// Refuses a member `crs` within a file that names another system than the file.
    fn check_reference_system(&self, members: Option<&JsonObject>) -> Result<(), String> {
        let Some(inner) = reference_system(members)? else { return Ok(()) };
        match self.system {
            Some(system) if inner == *system => Ok(()),
            None if inner.is_wgs84() => Ok(()),
            system => {
                let outer = system.map_or_else(|| "EPSG:4326".to_owned(), ToString::to_string);
                Err(format!("crs {inner} of a part: expected {outer}, that of the file"))
            }
        }
    }

    fn add_feature(&mut self, feature: &Feature) -> Result<(), String> {
        self.check_reference_system(feature.foreign_members.as_ref())?;
        let properties = properties(feature);
        match &feature.geometry {
            Some(geometry) => self.add_geometry(geometry, &properties),
            None => {
                self.ignore("feature without geometry", &properties);
                Ok(())
            }
        }
    }

    fn ignore(&mut self, kind: &'static str, properties: &[(String, String)]) {
        self.found.ignored.push(IgnoredItem::of(kind, properties));
    }

    fn add_geometry(&mut self, geometry: &Geometry, properties: &[(String, String)]) -> Result<(), String> {
        self.check_reference_system(geometry.foreign_members.as_ref())?;
        match &geometry.value {
            GeometryValue::Point { coordinates } => self.add_point(coordinates, properties)?,
            GeometryValue::MultiPoint { coordinates } if !coordinates.is_empty() => {
                coordinates.iter().try_for_each(|point| self.add_point(point, properties))?;
            }
            GeometryValue::GeometryCollection { geometries } if !geometries.is_empty() => {
                geometries.iter().try_for_each(|geometry| self.add_geometry(geometry, properties))?;
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

    /// Latitude, longitude and height.
    fn position(&mut self, coordinates: &Position) -> Result<([f64; 2], Option<f64>), String> {
        let [x, y, ref height_m @ ..] = *coordinates.as_slice() else { return Err(diagnosis::of_length(coordinates)) };
        if height_m.len() > 1 {
            return Err(diagnosis::of_length(coordinates));
        }
        let position = match self.system.and_then(ReferenceSystem::on_earth) {
            Some(system) => system.to_geodetic([x, y])?,
            None => {
                self.has_lengths |= x.abs().max(y.abs()) > LEAST_LENGTH;
                check_geodetic([y, x]).map(|()| [y, x])?
            }
        };
        Ok((position, height_m.first().copied()))
    }

    fn add_point(&mut self, coordinates: &Position, properties: &[(String, String)]) -> Result<(), String> {
        let read = self.position(coordinates);
        let (position, altitude_m) =
            read.map_err(|message| format!("{}: {message}", self.found.next_point(properties)))?;
        self.found.points.push(FoundPoint { position, altitude_m, properties: properties.to_vec() });
        Ok(())
    }

    fn add_polygon(&mut self, rings: &[Vec<Position>], properties: &[(String, String)]) -> Result<(), String> {
        let mut corners = |ring: &Vec<Position>| {
            ring.iter().map(|corner| Ok(self.position(corner)?.0)).collect::<Result<_, String>>()
        };
        let rings = rings.iter().map(&mut corners).collect::<Result<_, String>>();
        let rings = rings.map_err(|message| format!("{}: {message}", self.found.next_polygon(properties)))?;
        let polygon = FoundPolygon { rings, properties: properties.to_vec(), ..FoundPolygon::default() };
        self.found.polygons.push(polygon);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(text: &str) -> Result<FoundPoints, String> {
        super::find(&SourceText { text, ..SourceText::default() })
    }

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

    /// A point with a member `crs` of this name, in the geometry, a feature and a collection.
    fn points_in(name: &str, coordinates: &str) -> [Result<FoundPoints, String>; 3] {
        let crs = format!("\"crs\":{{\"type\":\"name\",\"properties\":{{\"name\":\"{name}\"}}}}");
        let bare = POINT.replace("[13.4,52.5,30]", coordinates);
        let with_crs = |text: &str| text.replacen("{\"type\"", &format!("{{{crs},\"type\""), 1);
        let inner = feature(&bare, "{}");
        let all = format!("{{\"type\":\"FeatureCollection\",\"features\":[{inner}]}}");
        [&bare, &inner, &all].map(|text| find(&with_crs(text)))
    }

    #[test]
    fn the_member_crs_is_followed_wherever_it_stands() {
        for name in [
            "urn:ogc:def:crs:OGC:1.3:CRS84",
            "urn:ogc:def:crs:EPSG::4326",
            "urn:ogc:def:crs:EPSG:6.9:4326",
            "EPSG:4326",
            "http://www.opengis.net/def/crs/EPSG/0/4326",
            "EPSG:4258",
        ] {
            for found in points_in(name, "[13.4,52.5,30]") {
                let found = found.unwrap();
                assert_eq!((found.points[0].position, found.system), ([52.5, 13.4], None), "{name}");
            }
        }
        for found in points_in("urn:ogc:def:crs:EPSG::25832", "[681421.23,5777697.61]") {
            let found = found.unwrap();
            let [lat_deg, lon_deg] = found.points[0].position;
            // 0.01 m is 9e-8° of latitude.
            assert!((lat_deg - 52.119_999_963).abs() < 9e-8 && (lon_deg - 11.650_000_031).abs() < 9e-8);
            assert_eq!(found.system.unwrap().to_string(), "EPSG:25832");
        }
        assert!(find(&POINT.replace("{\"type\"", "{\"crs\":null,\"type\"")).is_ok());
    }

    #[test]
    fn a_reference_system_that_is_not_known_is_refused_with_the_remedy() {
        for name in ["urn:ogc:def:crs:EPSG::14326", "local", "EPSG:26710", "ESRI:102100"] {
            for refused in points_in(name, "[13.4,52.5]") {
                let refused = refused.unwrap_err();
                assert!(refused.starts_with(&format!("crs `{name}`: ")), "{refused}");
                assert!(
                    refused.contains("expected one whose shift to WGS84 is known, such as EPSG:25832"),
                    "{refused}"
                );
            }
        }
        assert!(find(&POINT.replace("{\"type\"", "{\"crs\":{\"type\":\"link\"},\"type\"")).is_err());
        let crs = |code: &str| format!("{{\"crs\":{{\"properties\":{{\"name\":\"EPSG:{code}\"}}}},\"type\"");
        let inner = POINT.replace("{\"type\"", &crs("32633"));
        let outer = feature(&inner, "{}").replacen("{\"type\"", &crs("32632"), 1);
        let expected = "crs EPSG:32633 of a part: expected EPSG:32632, that of the file";
        assert_eq!(find(&outer).unwrap_err(), expected);
        assert_eq!(find(&feature(&inner, "{}")).unwrap_err(), expected.replace("EPSG:32632", "EPSG:4326"));
    }

    #[test]
    fn lengths_without_a_member_crs_are_in_the_system_of_the_source_and_degrees_are_not() {
        let system = ReferenceSystem::of_name("EPSG:25832").unwrap();
        let within = |coordinates: &str| {
            let text = POINT.replace("[13.4,52.5,30]", coordinates);
            super::find(&SourceText { text: &text, system: Some(&system), others: Vec::new() })
        };
        assert_eq!(within("[681421.23,5777697.61]").unwrap().system, Some(system.clone()));
        assert_eq!(within("[13.4,52.5]").unwrap().system, None);
        assert!(within("[52.5,113.4]").unwrap_err().contains("are latitude and longitude swapped?"));
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
