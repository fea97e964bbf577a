//! Zones, buildings and boundaries of foreign programs: what each input becomes, and what is ignored, or the reason why
//! it is refused.

use std::fs;
use std::path::Path;

use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geodata::{ZoneKind, read_zones};

use crate::outcomes::assert_outcomes;

/// What `file` with these bytes becomes: each zone with its number of corners in the plane, and what is ignored, or the
/// refusal.
fn outcome(file: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(file);
    fs::write(&path, bytes).unwrap();
    let refused = |message: String| format!("refused: {}", message.split_once(&format!("{file}: ")).unwrap().1);
    let read = match read_zones(&path, None) {
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
        (format!("\u{feff}{}", triangle("").replace(',', ",\r\n")), "zone, 3 corners"),
        (polygon(&format!("[[{}]]", TRIANGLE.rsplit_once(",[").unwrap().0)), "zone, 3 corners"),
        (polygon("[[[8.5,47.5],[8.501,47.501],[8.501,47.5],[8.5,47.5]]]"), "zone, 3 corners"),
        (polygon(&format!("[[{}]]", TRIANGLE.replace("47.5]", "47.5,410]"))), "zone, 3 corners"),
        (polygon(&format!("[[{}]]", TRIANGLE.replace("47.5]", "47.5,410,7]"))), "refused: polygon 1 (`a`): a position of 4 numbers: expected longitude, latitude, altitude"),
        (polygon(&format!("[[{TRIANGLE}],[{HOLE}]]")), "refused: polygon 1 (`a`): a hole: expected a polygon without holes"),
        (feature("", "MultiPolygon", &format!("[[[{TRIANGLE}]],[[{HOLE}]]]")), "zone, 3 corners | zone, 3 corners"),
        (feature("", "MultiPolygon", &format!("[[[{HOLE}]],[[{TRIANGLE}],[{HOLE}]]]")), "refused: polygon 2: a hole: expected a polygon without holes"),
        (polygon("[[[179.999,1],[-179.999,1],[-179.999,1.001],[179.999,1.001],[179.999,1]]]"), "zone, 4 corners"),
        (polygon("[[[8.5,47.5],[8.501,47.501],[8.501,47.5],[8.5,47.501],[8.5,47.5]]]"), "refused: polygon 1 (`a`): expected at least three corners of a polygon without crossings"),
        (polygon("[[[8.5,47.5],[8.501,47.5],[8.5,47.5]]]"), "refused: polygon 1 (`a`): expected at least three corners of a polygon without crossings"),
        (polygon("[[[8.5,47.5],[8.5,47.5],[8.501,47.5],[8.501,47.501],[8.501,47.501],[8.5,47.5]]]"), "zone, 5 corners"),
        (polygon("[]"), "refused: polygon 1 (`a`): no corners: expected at least three"),
        (polygon("[[]]"), "refused: polygon 1 (`a`): no corners: expected at least three"),
        (polygon("[[[47.5,108.5],[47.5,108.6],[47.6,108.6]]]"), "refused: polygon 1 (`a`): latitude 108.5: expected -90 to 90; are latitude and longitude swapped?"),
        (all(feature("\"name\":\"fence\"", "LineString", &format!("[{TRIANGLE}]"))), "zone, 3 corners; ignored 1 × closed line (`fence`); only polygons are zones: draw what must not be entered as such"),
        (all(feature("\"name\":\"path\"", "LineString", "[[8.5,47.5],[8.6,47.5],[8.5,47.5]]")), "zone, 3 corners; ignored 1 × line (`path`)"),
        (all(feature("\"name\":\"pens\"", "MultiLineString", &format!("[[{TRIANGLE}],[[1,2],[3,4]],[{HOLE}]]"))), "zone, 3 corners; ignored 2 × closed line (`pens`, `pens`), 1 × line (`pens`); only polygons are zones: draw what must not be entered as such"),
        (all(feature("\"name\":\"mast\",\"Radius\":15", "Point", "[8.5,47.5]")), "zone, 3 corners; ignored 1 × circle (`mast`); only polygons are zones: draw what must not be entered as such"),
        (all(feature("\"name\":\"mast\"", "Point", "[8.5,47.5]")), "zone, 3 corners; ignored 1 × point (`mast`)"),
        (feature("\"name\":\"mast\",\"radius\":15", "Point", "[8.5,47.5]"), "refused: no polygons, only 1 × circle (`mast`): expected a polygon for each zone"),
        (collection(&[]), "refused: no polygons: expected a polygon for each zone"),
        (triangle("").replace("\"properties\":{}", "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::2056\"}},\"properties\":null"), "refused: polygon 1: 8.5, 47.5: expected lengths of a map, not degrees"),
        (polygon("[[[682000,5778300],[682100,5778300],[682100,5778400],[682000,5778300]]]").replace("\"properties\"", "\"crs\":{\"properties\":{\"name\":\"EPSG:25832\"}},\"properties\""), "zone, 3 corners"),
        (polygon("[[[682000,5778300],[682100,5778300],[682100,5778400]]]"), "refused: polygon 1 (`a`): latitude 5778300: expected -90 to 90; no degrees of WGS84 (EPSG:4326), but metres of a projection such as UTM (--crs of `skysink new`)?"),
        (polygon("[[[8.5,47.5],[NaN,NaN],[8.501,47.501]]]"), "refused: polygon 1 (`a`): coordinates [NaN,NaN]: expected longitude and latitude"),
        (format!("{{\"type\":\"GeometryCollection\",\"geometries\":[{{\"type\":\"Polygon\",\"coordinates\":[[{TRIANGLE}]]}},{{\"type\":\"Point\",\"coordinates\":[8,47]}}]}}"), "zone, 3 corners; ignored 1 × point"),
        ("{\"fileType\":\"Plan\",\"geoFence\":{\"circles\":[],\"polygons\":[],\"version\":2},\"version\":1}".to_owned(), "refused: Error while deserializing GeoJSON: missing field `type` at line 1 column 83: expected GeoJSON"),
    ];
    assert_outcomes(outcome, "a.geojson", &cases);
    assert_outcomes(
        outcome,
        "a.gpx",
        &[(
            "<gpx><trk><name>fence</name></trk></gpx>",
            "refused: GPX has no polygons: expected KML, KMZ or GeoJSON, with a polygon for each zone",
        )],
    );
    assert_outcomes(
        outcome,
        "a.plan",
        &[("{\"fileType\":\"Plan\"}", "refused: `.plan`: expected a file named .kml, .kmz, .geojson, .json")],
    );
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
    let inner = format!(
        "</outerBoundaryIs><innerBoundaryIs><LinearRing><coordinates>{TUPLES}</coordinates></LinearRing></innerBoundaryIs>"
    );
    let ring = format!("<LinearRing><coordinates>{TUPLES}</coordinates></LinearRing>");
    let with = |more: &str| kml(&format!("{pond}{more}"));
    let cases = [
        (kml(&pond).replace('<', "<k:").replace("<k:/", "</k:"), "zone, 3 corners"),
        (kml(&format!("<Folder><Folder><Folder>{pond}</Folder></Folder></Folder>")), "zone, 3 corners"),
        (
            kml(&placemark(
                "two",
                &format!("<MultiGeometry>{}{}</MultiGeometry>", polygon("", TUPLES), polygon("", TUPLES)),
            )),
            "zone, 3 corners | zone, 3 corners",
        ),
        (kml(&placemark("pond", &polygon("", &TUPLES.replace(' ', "\r\n\t").replace(',', ", ")))), "zone, 3 corners"),
        (
            kml(&pond.replace("</outerBoundaryIs>", &inner)),
            "refused: polygon 1 (`pond`): a hole: expected a polygon without holes",
        ),
        (kml(&placemark("pond", "<Polygon/>")), "refused: polygon 1 (`pond`): no corners: expected at least three"),
        (kml(&placemark("pond", &polygon("", ""))), "refused: polygon 1 (`pond`): no corners: expected at least three"),
        (
            kml(&placemark("pond", &polygon("", "8.5,47.5 8.501,47.5"))),
            "refused: polygon 1 (`pond`): expected at least three corners of a polygon without crossings",
        ),
        (
            kml(&placemark("pond", &polygon("", &TUPLES.replace(' ', ",")))),
            "refused: polygon 1 (`pond`): coordinates `8.5,47.5,8.501,47.5,8.501,47.501,8.5,47.5`: 8 numbers: expected longitude, latitude and altitude with commas, and a blank between positions",
        ),
        (
            kml(&placemark("pond", &polygon("", &TUPLES.replace("47.5 ", "147.5 ")))),
            "refused: polygon 1 (`pond`): latitude 147.5: expected -90 to 90; are latitude and longitude swapped?",
        ),
        (
            with(&placemark("fence", &ring)),
            "zone, 3 corners; ignored 1 × closed line (`fence`); only polygons are zones: draw what must not be entered as such",
        ),
        (
            with(&placemark("fence", &format!("<LineString><coordinates>{TUPLES}</coordinates></LineString>"))),
            "zone, 3 corners; ignored 1 × closed line (`fence`); only polygons are zones: draw what must not be entered as such",
        ),
        (
            with(&placemark("path", "<LineString><coordinates>8.5,47.5 8.6,47.5 8.5,47.6</coordinates></LineString>")),
            "zone, 3 corners; ignored 1 × line (`path`)",
        ),
        (
            with(&placemark(
                "mast",
                "<ExtendedData><Data name=\"radius\"><value>15</value></Data></ExtendedData><Point><coordinates>8.5,47.5</coordinates></Point>",
            )),
            "zone, 3 corners; ignored 1 × circle (`mast`); only polygons are zones: draw what must not be entered as such",
        ),
        (
            with("<GroundOverlay><name>map</name></GroundOverlay><NetworkLink/>"),
            "zone, 3 corners; ignored 1 × link, 1 × overlay (`map`)",
        ),
        (
            kml(&placemark("fence", &ring)),
            "refused: no polygons, only 1 × closed line (`fence`): expected a polygon for each zone",
        ),
        (kml(""), "refused: no polygons: expected a polygon for each zone"),
        (
            kml(&pond).replace("</Document>", ""),
            "refused: ill-formed document: expected `</Document>`, but `</kml>` was found: expected a KML file",
        ),
    ];
    assert_outcomes(outcome, "a.kml", &cases);
}

#[test]
fn buildings_of_other_programs_have_heights_or_are_refused() {
    let cases = [
        (triangle("\"height\":12"), "building of 12 m, 3 corners"),
        (triangle("\"height\":\"12.5 m\""), "building of 12.5 m, 3 corners"),
        (triangle("\"HEIGHT\":\" 12m \""), "building of 12 m, 3 corners"),
        (triangle("\"height_m\":9,\"height\":30"), "refused: polygon 1: height_m 9 and height 30: expected one height"),
        (triangle("\"kind\":\"no-fly\",\"height\":30"), "zone, 3 corners"),
        (triangle("\"height\":\"1.2e1\""), "building of 12 m, 3 corners"),
        (triangle("\"height\":null"), "zone, 3 corners"),
        (triangle("\"building\":\"yes\",\"building:levels\":4"), "zone, 3 corners"),
        (triangle("\"height\":\"12,5\""), "refused: polygon 1: height 12,5: expected metres, or feet as in `40 ft`"),
        (triangle("\"height\":\"40 ft\""), "building of 12.192 m, 3 corners"),
        (triangle("\"height\":\"40'\""), "building of 12.192 m, 3 corners"),
        (triangle("\"height\":0"), "refused: polygon 1: height 0: expected a finite number above 0"),
        (triangle("\"height\":-3"), "refused: polygon 1: height -3: expected a finite number above 0"),
        (triangle("\"height\":true"), "refused: polygon 1: height true: expected metres, or feet as in `40 ft`"),
        (triangle("\"height\":[12]"), "refused: polygon 1: height [12]: expected metres, or feet as in `40 ft`"),
        (triangle("\"height\":\"12\",\"kind\":\"building\",\"name\":\"shed\""), "building of 12 m, 3 corners"),
    ];
    assert_outcomes(outcome, "a.geojson", &cases);
    let extruded = |mode: &str, altitude: &str| {
        let elements = format!("<extrude>1</extrude><altitudeMode>{mode}</altitudeMode>");
        kml(&placemark("shed", &polygon(&elements, &TUPLES.replace("47.5 ", &format!("47.5,{altitude} ")))))
    };
    let data = "<ExtendedData><SchemaData><SimpleData name=\"Height\">7</SimpleData></SchemaData></ExtendedData>";
    let cases = [
        (extruded("relativeToGround", "9"), "building of 9 m, 3 corners"),
        (extruded("absolute", "480"), "building up to 480 m, 3 corners"),
        (
            extruded("clampToGround", "9"),
            "zone, 3 corners; ignored 1 × altitude of a polygon clamped to the ground (`shed`)",
        ),
        (extruded("relativeToGround", "-9"), "zone, 3 corners"),
        (
            extruded("relativeToGround", "high"),
            "refused: polygon 1 (`shed`): coordinates `8.5,47.5,high`: expected longitude, latitude and altitude with commas, and a blank between positions",
        ),
        (extruded("relativeToGround", "9").replace("<extrude>1</extrude>", ""), "zone, 3 corners"),
        (
            extruded("relativeToGround", "9").replace("<Polygon>", &format!("{data}<Polygon>")),
            "building of 7 m, 3 corners",
        ),
    ];
    assert_outcomes(outcome, "a.kml", &cases);
}

#[test]
fn boundaries_of_other_programs_are_recognised_or_refused() {
    let two = |first: &str, second: &str| collection(&[triangle(first), triangle(second)]);
    let cases = [
        (triangle("\"kind\":\"boundary\""), "boundary, 3 corners"),
        (triangle("\"Kind\":\" Boundary \""), "boundary, 3 corners"),
        (triangle("\"name\":\"AREA\""), "boundary, 3 corners"),
        (triangle("\"name\":\"boundary of the farm\""), "zone, 3 corners"),
        (triangle("\"kind\":\"boundary\",\"height\":12"), "boundary, 3 corners"),
        (triangle("\"kind\":\"fence\",\"name\":\"boundary\""), "zone, 3 corners"),
        (triangle("\"kind\":null,\"name\":\"boundary\""), "boundary, 3 corners"),
        (two("\"kind\":\"boundary\"", "\"name\":\"lake\""), "boundary, 3 corners | zone, 3 corners"),
        (
            two("\"kind\":\"boundary\"", "\"kind\":\"area\",\"name\":\"b\""),
            "refused: polygon 2 (`b`): a second boundary: expected one",
        ),
        (
            feature("\"kind\":\"boundary\"", "MultiPolygon", &format!("[[[{TRIANGLE}]],[[{HOLE}]]]")),
            "refused: polygon 2: a second boundary: expected one",
        ),
        (
            feature("\"kind\":\"boundary\"", "Polygon", &format!("[[{TRIANGLE}],[{HOLE}]]")),
            "refused: polygon 1: a hole: expected a polygon without holes",
        ),
        (
            feature("\"kind\":\"boundary\"", "LineString", &format!("[{TRIANGLE}]")),
            "refused: no polygons, only 1 × closed line: expected a polygon for each zone",
        ),
        (
            feature("\"kind\":\"boundary\"", "Polygon", "[[]]"),
            "refused: polygon 1: no corners: expected at least three",
        ),
    ];
    assert_outcomes(outcome, "a.geojson", &cases);
    let data = "<ExtendedData><Data name=\"kind\"><value>boundary</value></Data></ExtendedData>";
    let field = placemark("field", &polygon("", TUPLES));
    let cases = [
        (kml(&field.replace("<Polygon>", &format!("{data}<Polygon>"))), "boundary, 3 corners"),
        (kml(&field.replace("field", "boundary")), "boundary, 3 corners"),
        (kml(&format!("<Folder><name>boundary</name>{field}</Folder>")), "zone, 3 corners"),
    ];
    assert_outcomes(outcome, "a.kml", &cases);
}
