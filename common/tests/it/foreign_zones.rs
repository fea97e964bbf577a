//! Zones, buildings and boundaries of foreign programs: what each input becomes, and what is ignored, or the reason why
//! it is refused.

use std::fs;
use std::path::Path;

use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geodata::{ZoneKind, read_zones};

/// What `file` with these bytes becomes: each zone with its number of corners in the plane, and what is ignored, or the
/// refusal.
fn outcome(file: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(file);
    fs::write(&path, bytes).unwrap();
    let refused = |message: String| format!("refused: {}", message.split_once(&format!("{file}: ")).unwrap().1);
    let read = match read_zones(&path) {
        Ok(read) => read,
        Err(refusal) => return refused(refusal.to_string()),
    };
    let [lat_deg, lon_deg] = read.zones[0].corners[0];
    let projection = Projection::at(Origin { lat_deg, lon_deg });
    let zone = |zone: &skysink_common::geodata::Zone| {
        let kind = match zone.kind {
            ZoneKind::NoFly => "zone".to_owned(),
            ZoneKind::Boundary => "boundary".to_owned(),
            ZoneKind::Building(height_m) => format!("building of {height_m} m"),
            ZoneKind::BuildingAboveSea(altitude_m) => format!("building up to {altitude_m} m"),
        };
        match zone.corners_m(&projection, Path::new(file)) {
            Ok(corners_m) => format!("{kind}, {} corners", corners_m.len()),
            Err(refusal) => refused(refusal.to_string()),
        }
    };
    let zones: Vec<String> = read.zones.iter().map(zone).collect();
    let ignored = read.ignored.map(|what| format!("; ignored {what}")).unwrap_or_default();
    format!("{}{ignored}", zones.join(" | "))
}

/// Fails with all differences at once.
#[track_caller]
fn assert_outcomes<T: AsRef<[u8]>>(file: &str, cases: &[(T, &str)]) {
    let wrong: Vec<String> = cases
        .iter()
        .map(|(input, expected)| (input, outcome(file, input.as_ref()), expected))
        .filter(|(_, found, expected)| found != *expected)
        .map(|(input, found, expected)| {
            let input = String::from_utf8_lossy(input.as_ref()).into_owned();
            format!("{file}: {input:?}\n   found {found:?}\nexpected {expected:?}")
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A closed triangle, longitudes first.
const TRIANGLE: &str = "[8.5,47.5],[8.501,47.5],[8.501,47.501],[8.5,47.5]";

/// One inside of it.
const HOLE: &str = "[8.5005,47.5001],[8.5008,47.5001],[8.5008,47.5003],[8.5005,47.5001]";

/// A feature with these properties and this geometry.
fn feature(properties: &str, geometry: &str, coordinates: &str) -> String {
    format!(
        "{{\"type\":\"Feature\",\"properties\":{{{properties}}},\"geometry\":{{\"type\":\"{geometry}\",\"coordinates\":{coordinates}}}}}"
    )
}

/// A triangle with these properties.
fn triangle(properties: &str) -> String {
    feature(properties, "Polygon", &format!("[[{TRIANGLE}]]"))
}

fn collection(features: &[String]) -> String {
    format!("{{\"type\":\"FeatureCollection\",\"features\":[{}]}}", features.join(","))
}

#[test]
fn geojson_zones_of_other_programs_are_taken_or_refused() {
    let polygon = |rings: &str| feature("\"name\":\"a\"", "Polygon", rings);
    let all = |more: String| collection(&[triangle(""), more]);
    let cases = [
        (format!("\u{feff}{}", triangle("").replace(',', ",\r\n")), "?"),
        (polygon(&format!("[[{}]]", TRIANGLE.rsplit_once(",[").unwrap().0)), "?"),
        (polygon("[[[8.5,47.5],[8.501,47.501],[8.501,47.5],[8.5,47.5]]]"), "?"),
        (polygon(&format!("[[{}]]", TRIANGLE.replace("47.5]", "47.5,410]"))), "?"),
        (polygon(&format!("[[{}]]", TRIANGLE.replace("47.5]", "47.5,410,7]"))), "?"),
        (polygon(&format!("[[{TRIANGLE}],[{HOLE}]]")), "?"),
        (feature("", "MultiPolygon", &format!("[[[{TRIANGLE}]],[[{HOLE}]]]")), "?"),
        (feature("", "MultiPolygon", &format!("[[[{HOLE}]],[[{TRIANGLE}],[{HOLE}]]]")), "?"),
        (polygon("[[[179.999,1],[-179.999,1],[-179.999,1.001],[179.999,1.001],[179.999,1]]]"), "?"),
        (polygon("[[[8.5,47.5],[8.501,47.501],[8.501,47.5],[8.5,47.501],[8.5,47.5]]]"), "?"),
        (polygon("[[[8.5,47.5],[8.501,47.5],[8.5,47.5]]]"), "?"),
        (polygon("[[[8.5,47.5],[8.5,47.5],[8.501,47.5],[8.501,47.501],[8.501,47.501],[8.5,47.5]]]"), "?"),
        (polygon("[]"), "?"),
        (polygon("[[]]"), "?"),
        (polygon("[[[47.5,108.5],[47.5,108.6],[47.6,108.6]]]"), "?"),
        (all(feature("\"name\":\"fence\"", "LineString", &format!("[{TRIANGLE}]"))), "?"),
        (all(feature("\"name\":\"path\"", "LineString", "[[8.5,47.5],[8.6,47.5],[8.5,47.5]]")), "?"),
        (all(feature("\"name\":\"pens\"", "MultiLineString", &format!("[[{TRIANGLE}],[[1,2],[3,4]],[{HOLE}]]"))), "?"),
        (all(feature("\"name\":\"mast\",\"Radius\":15", "Point", "[8.5,47.5]")), "?"),
        (all(feature("\"name\":\"mast\"", "Point", "[8.5,47.5]")), "?"),
        (feature("\"name\":\"mast\",\"radius\":15", "Point", "[8.5,47.5]"), "?"),
        (collection(&[]), "?"),
        (triangle("").replace("\"properties\":{}", "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::2056\"}},\"properties\":null"), "?"),
        (format!("{{\"type\":\"GeometryCollection\",\"geometries\":[{{\"type\":\"Polygon\",\"coordinates\":[[{TRIANGLE}]]}},{{\"type\":\"Point\",\"coordinates\":[8,47]}}]}}"), "?"),
        ("{\"fileType\":\"Plan\",\"geoFence\":{\"circles\":[],\"polygons\":[],\"version\":2},\"version\":1}".to_owned(), "?"),
    ];
    assert_outcomes("a.geojson", &cases);
    assert_outcomes("a.gpx", &[("<gpx><trk><name>fence</name></trk></gpx>", "?")]);
    assert_outcomes("a.plan", &[("{\"fileType\":\"Plan\"}", "?")]);
}

/// A placemark of this name with a geometry.
fn placemark(name: &str, geometry: &str) -> String {
    format!("<Placemark><name>{name}</name>{geometry}</Placemark>")
}

/// A polygon with elements before its boundary.
fn polygon(elements: &str, coordinates: &str) -> String {
    let ring = format!("<LinearRing><coordinates>{coordinates}</coordinates></LinearRing>");
    format!("<Polygon>{elements}<outerBoundaryIs>{ring}</outerBoundaryIs></Polygon>")
}

/// The triangle in KML.
const TUPLES: &str = "8.5,47.5 8.501,47.5 8.501,47.501 8.5,47.5";

fn kml(items: &str) -> String {
    format!("<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>{items}</Document></kml>")
}

#[test]
fn kml_zones_of_other_programs_are_taken_or_refused() {
    let pond = placemark("pond", &polygon("", TUPLES));
    let inner = format!("</outerBoundaryIs><innerBoundaryIs><LinearRing><coordinates>{TUPLES}</coordinates></LinearRing></innerBoundaryIs>");
    let ring = format!("<LinearRing><coordinates>{TUPLES}</coordinates></LinearRing>");
    let with = |more: &str| kml(&format!("{pond}{more}"));
    let cases = [
        (kml(&pond).replace('<', "<k:").replace("<k:/", "</k:"), "?"),
        (kml(&format!("<Folder><Folder><Folder>{pond}</Folder></Folder></Folder>")), "?"),
        (kml(&placemark("two", &format!("<MultiGeometry>{}{}</MultiGeometry>", polygon("", TUPLES), polygon("", TUPLES)))), "?"),
        (kml(&placemark("pond", &polygon("", &TUPLES.replace(' ', "\r\n\t").replace(',', ", ")))), "?"),
        (kml(&pond.replace("</outerBoundaryIs>", &inner)), "?"),
        (kml(&placemark("pond", "<Polygon/>")), "?"),
        (kml(&placemark("pond", &polygon("", ""))), "?"),
        (kml(&placemark("pond", &polygon("", "8.5,47.5 8.501,47.5"))), "?"),
        (kml(&placemark("pond", &polygon("", &TUPLES.replace(' ', ",")))), "?"),
        (kml(&placemark("pond", &polygon("", &TUPLES.replace("47.5 ", "147.5 ")))), "?"),
        (with(&placemark("fence", &ring)), "?"),
        (with(&placemark("fence", &format!("<LineString><coordinates>{TUPLES}</coordinates></LineString>"))), "?"),
        (with(&placemark("path", "<LineString><coordinates>8.5,47.5 8.6,47.5 8.5,47.6</coordinates></LineString>")), "?"),
        (with(&placemark("mast", "<ExtendedData><Data name=\"radius\"><value>15</value></Data></ExtendedData><Point><coordinates>8.5,47.5</coordinates></Point>")), "?"),
        (with("<GroundOverlay><name>map</name></GroundOverlay><NetworkLink/>"), "?"),
        (kml(&placemark("fence", &ring)), "?"),
        (kml(""), "?"),
        (kml(&pond).replace("</Document>", ""), "?"),
    ];
    assert_outcomes("a.kml", &cases);
}

#[test]
fn buildings_of_other_programs_have_heights_or_are_refused() {
    let cases = [
        (triangle("\"height\":12"), "?"),
        (triangle("\"height\":\"12.5 m\""), "?"),
        (triangle("\"HEIGHT\":\" 12m \""), "?"),
        (triangle("\"height_m\":9,\"height\":30"), "?"),
        (triangle("\"height\":\"1.2e1\""), "?"),
        (triangle("\"height\":null"), "?"),
        (triangle("\"building\":\"yes\",\"building:levels\":4"), "?"),
        (triangle("\"height\":\"12,5\""), "?"),
        (triangle("\"height\":\"40 ft\""), "?"),
        (triangle("\"height\":\"40'\""), "?"),
        (triangle("\"height\":0"), "?"),
        (triangle("\"height\":-3"), "?"),
        (triangle("\"height\":true"), "?"),
        (triangle("\"height\":[12]"), "?"),
        (triangle("\"height\":\"12\",\"kind\":\"building\",\"name\":\"shed\""), "?"),
    ];
    assert_outcomes("a.geojson", &cases);
    let extruded = |mode: &str, altitude: &str| {
        let elements = format!("<extrude>1</extrude><altitudeMode>{mode}</altitudeMode>");
        kml(&placemark("shed", &polygon(&elements, &TUPLES.replace("47.5 ", &format!("47.5,{altitude} ")))))
    };
    let data = "<ExtendedData><SchemaData><SimpleData name=\"Height\">7</SimpleData></SchemaData></ExtendedData>";
    let cases = [
        (extruded("relativeToGround", "9"), "?"),
        (extruded("absolute", "480"), "?"),
        (extruded("clampToGround", "9"), "?"),
        (extruded("relativeToGround", "-9"), "?"),
        (extruded("relativeToGround", "high"), "?"),
        (extruded("relativeToGround", "9").replace("<extrude>1</extrude>", ""), "?"),
        (extruded("relativeToGround", "9").replace("<Polygon>", &format!("{data}<Polygon>")), "?"),
    ];
    assert_outcomes("a.kml", &cases);
}

#[test]
fn boundaries_of_other_programs_are_recognised_or_refused() {
    let two = |first: &str, second: &str| collection(&[triangle(first), triangle(second)]);
    let cases = [
        (triangle("\"kind\":\"boundary\""), "?"),
        (triangle("\"Kind\":\" Boundary \""), "?"),
        (triangle("\"name\":\"AREA\""), "?"),
        (triangle("\"name\":\"boundary of the farm\""), "?"),
        (triangle("\"kind\":\"boundary\",\"height\":12"), "?"),
        (triangle("\"kind\":\"fence\",\"name\":\"boundary\""), "?"),
        (triangle("\"kind\":null,\"name\":\"boundary\""), "?"),
        (two("\"kind\":\"boundary\"", "\"name\":\"lake\""), "?"),
        (two("\"kind\":\"boundary\"", "\"kind\":\"area\",\"name\":\"b\""), "?"),
        (feature("\"kind\":\"boundary\"", "MultiPolygon", &format!("[[[{TRIANGLE}]],[[{HOLE}]]]")), "?"),
        (feature("\"kind\":\"boundary\"", "Polygon", &format!("[[{TRIANGLE}],[{HOLE}]]")), "?"),
        (feature("\"kind\":\"boundary\"", "LineString", &format!("[{TRIANGLE}]")), "?"),
        (feature("\"kind\":\"boundary\"", "Polygon", "[[]]"), "?"),
    ];
    assert_outcomes("a.geojson", &cases);
    let data = "<ExtendedData><Data name=\"kind\"><value>boundary</value></Data></ExtendedData>";
    let field = placemark("field", &polygon("", TUPLES));
    let cases = [
        (kml(&field.replace("<Polygon>", &format!("{data}<Polygon>"))), "?"),
        (kml(&field.replace("field", "boundary")), "?"),
        (kml(&format!("<Folder><name>boundary</name>{field}</Folder>")), "?"),
    ];
    assert_outcomes("a.kml", &cases);
}
