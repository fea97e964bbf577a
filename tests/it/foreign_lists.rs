//! Lists of foreign programs: what each input becomes, as the nodes that are taken and what is ignored, or the reason
//! why it is refused.

use std::fs;
use std::io::{Cursor, Write};

use skysink_lab::import::read;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::outcomes::assert_outcomes;

/// What `file` with these bytes becomes: its positions, further columns and what is ignored, or the refusal.
fn outcome(file: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(file);
    fs::write(&path, bytes).unwrap();
    match read(&path, None) {
        Ok(imported) => {
            let list = imported.to_csv([0.0; 2]);
            let rows = list.trim_end().replace('\n', " | ");
            let ignored: Vec<String> = imported.ignored.iter().map(|what| format!("; {what}")).collect();
            format!("{rows}{}", ignored.concat())
        }
        Err(refusal) => format!("refused: {}", refusal.message),
    }
}

#[test]
fn tables_of_other_programs_become_lists_or_say_why_not() {
    assert_outcomes(
        outcome,
        "a.csv",
        &[
            ("\u{feff}lat,lon\n47.5,8.5\n", "lat_deg,lon_deg | 47.5,8.5"),
            ("lat,lon\r\n47.5,8.5\r\n\r\n47.6,8.6\r\n\r\n", "lat_deg,lon_deg | 47.5,8.5 | 47.6,8.6"),
            ("lat,lon\r47.5,8.5\r47.6,8.6\r", "lat_deg,lon_deg | 47.5,8.5 | 47.6,8.6"),
            (" LAT ; LON ; Name \n 47,5 ; 8,5 ; well \n", "lat_deg,lon_deg,name | 47.5,8.5,well"),
            ("lat,lon,name\n47.5,8.5,\"post 1,\nnorth\"\n", "lat_deg,lon_deg,name | 47.5,8.5,\"post 1, | north\""),
            ("lat,lon,name\n47.5,8.5,\"say \"\"hi\"\"\"\n", "lat_deg,lon_deg,name | 47.5,8.5,\"say \"\"hi\"\"\""),
            ("lat,lon,name\n47.5,8.5,\"open\n", "lat_deg,lon_deg,name | 47.5,8.5,open"),
            ("x,y,z\n1,2,3\n4,5,6\n", "x_m,y_m | 1,2 | 4,5; column z"),
            ("lat,lon\n4.75e1,85e-1\n", "lat_deg,lon_deg | 47.5,8.5"),
            ("lat,lon\n47.5,180\n47.5,-180\n", "lat_deg,lon_deg | 47.5,180 | 47.5,-180"),
            ("lat,lon\n47.5,180.5\n", "refused: line 2: longitude 180.5: expected -180 to 180"),
            (
                "lat,lon\n8.5,147.5\n147.5,8.5\n",
                "refused: line 3: latitude 147.5: expected -90 to 90; are latitude and longitude swapped?",
            ),
            ("lat,lon\n47.5 N,8.5 E\n", "refused: line 2: lat = 47.5 N: expected a number"),
            ("lat,lon\n47°23'50\"N,8°32'40\"E\n", "refused: line 2: lat = 47°23'50\"N: expected a number"),
            ("lat,lon\n,\n47.5,8.5\n,\n", "lat_deg,lon_deg | 47.5,8.5"),
            (
                "lat,lon\n47.5,8.5,\n",
                "refused: line 2: 3 fields: expected 2, as in the header, and numbers with decimal points",
            ),
            ("lat,lon\nnan,inf\n", "refused: line 2: lat = nan: expected a number"),
            ("x,y\n\"1,234.5\",2\n", "refused: line 2: x = 1,234.5: expected a number with a decimal point"),
            ("lat,lon\n", "refused: no points: expected at least one sensor node"),
            ("", "refused: line 1: header ``: expected columns x and y [m], or lat and lon [°]"),
            ("\n\n", "refused: line 1: header ``: expected columns x and y [m], or lat and lon [°]"),
            (
                "47.5,8.5\n47.6,8.6\n",
                "refused: line 1: header `47.5,8.5`: expected columns x and y [m], or lat and lon [°]",
            ),
            (
                "# exported by a logger\nlat,lon\n47.5,8.5\n",
                "refused: line 1: header `# exported by a logger`: expected columns x and y [m], or lat and lon [°]",
            ),
            (
                "lat|lon\n47.5|8.5\n",
                "refused: line 1: header `lat|lon`: expected columns x and y [m], or lat and lon [°]",
            ),
            (
                "lat lon\n47.5 8.5\n",
                "refused: line 1: header `lat lon`: expected columns x and y [m], or lat and lon [°]",
            ),
            (
                "WKT,name\n\"POINT (8.5 47.5)\",a\n",
                "refused: line 1: header `WKT,name`: expected columns x and y [m], or lat and lon [°]",
            ),
            (
                "name,latitude\na,47.5\n",
                "refused: line 1: header `name,latitude`: expected columns x and y [m], or lat and lon [°]",
            ),
            ("lat,lon,LAT\n47.5,8.5,47.5\n", "refused: line 1: column `LAT`: expected lat_deg once"),
            (
                "lat,lon,weight,buffer,queue\n47.5,8.5,2,1000,10\n",
                "lat_deg,lon_deg,queue_bits,capacity_bits,weight | 47.5,8.5,10,1000,2",
            ),
            ("lat,lon,rate\n47.5,8.5,\n", "refused: line 2: sampling_bps = : expected a number"),
        ],
    );
}

#[test]
fn encodings_of_tables_are_told_apart() {
    let unicode: Vec<u8> =
        "\u{feff}lat\tlon\tname\r\n47.5\t8.5\tWäldli\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let latin = b"lat,lon,name\n47.5,8.5,a\n47.5,8.5,W\xe4ldli\n".to_vec();
    let binary = b"PK\x03\x04\x14\x00\x06\x00\x08\x00\xff\xfe".to_vec();
    assert_outcomes(
        outcome,
        "a.csv",
        &[
            (unicode, "lat_deg,lon_deg,name | 47.5,8.5,Wäldli"),
            (latin, "refused: line 3: expected UTF-8 text"),
            (binary, "refused: line 1: expected UTF-8 text"),
        ],
    );
    assert_outcomes(outcome, "A.CSV", &[("lat,lon\n47.5,8.5\n", "lat_deg,lon_deg | 47.5,8.5")]);
}

#[test]
fn geojson_of_other_programs_becomes_a_list_or_says_why_not() {
    assert_outcomes(
        outcome,
        "a.geojson",
        &[
            (
                r#"{"type":"Feature","id":7,"bbox":[8,47,9,48],"properties":null,"geometry":{"type":"Point","coordinates":[8.5,47.5]}}"#,
                "lat_deg,lon_deg | 47.5,8.5",
            ),
            (
                r#"{"type":"FeatureCollection","name":"wells","features":[{"type":"Feature","properties":{"Name":"a","rate":"50"},"geometry":{"type":"Point","coordinates":[8.5,47.5,400]}}]}"#,
                "lat_deg,lon_deg,sampling_bps,name | 47.5,8.5,50,a; heights of 1 of 1 points; altitudes of the ground, for flights over hills, belong into ground_m",
            ),
            (r#"{"type":"FeatureCollection","features":[]}"#, "refused: no points: expected at least one sensor node"),
            (
                r#"{"type":"FeatureCollection","features":[{"type":"Feature","properties":{"name":"a"},"geometry":null}]}"#,
                "refused: no points, only 1 × feature without geometry (`a`): expected at least one sensor node",
            ),
            (
                r#"{"type":"Point","coordinates":[]}"#,
                "refused: point 1: coordinates []: expected longitude and latitude",
            ),
            (
                r#"{"type":"Point","coordinates":[8.5]}"#,
                "refused: point 1: coordinates [8.5]: expected longitude and latitude",
            ),
            (
                r#"{"type":"Point","coordinates":["8.5","47.5"]}"#,
                "refused: point 1: coordinates [\"8.5\",\"47.5\"]: expected longitude and latitude",
            ),
            (
                r#"{"type":"Point","coordinates":[8.5,47.5,400,1714550400]}"#,
                "refused: point 1: a position of 4 numbers: expected longitude, latitude, altitude",
            ),
            (
                r#"{"type":"Point","coordinates":[47.5,108.5]}"#,
                "refused: point 1: latitude 108.5: expected -90 to 90; are latitude and longitude swapped?",
            ),
            (r#"{"type":"Point","coordinates":[180,0]}"#, "lat_deg,lon_deg | 0,180"),
            (r#"{"type":"Point","coordinates":[190,0]}"#, "refused: point 1: longitude 190: expected -180 to 180"),
            (
                r#"{"type":"Point","coordinates":[2600000.5,1200000.25]}"#,
                "refused: point 1: latitude 1200000.25: expected -90 to 90; no degrees of WGS84 (EPSG:4326), but metres of a projection such as UTM (--crs of `skysink new`)?",
            ),
            (
                r#"{"type":"MultiPoint","coordinates":[]}"#,
                "refused: no points, only 1 × feature without geometry: expected at least one sensor node",
            ),
            (
                r#"{"type":"GeometryCollection","geometries":[{"type":"GeometryCollection","geometries":[{"type":"Point","coordinates":[8.5,47.5]}]}]}"#,
                "lat_deg,lon_deg | 47.5,8.5",
            ),
            (
                r#"{"type":"Polygon","coordinates":[[[8,47],[9,47],[9,48],[8,47]]]}"#,
                "refused: no points, only 1 × polygon: expected at least one sensor node",
            ),
            (
                "{\"type\":\"Point\",\"coordinates\":[8.5,47.5]}\n{\"type\":\"Point\",\"coordinates\":[8.6,47.6]}\n",
                "refused: Error while deserializing GeoJSON: trailing characters at line 2 column 1: expected GeoJSON",
            ),
            (
                r#"[{"type":"Point","coordinates":[8.5,47.5]}]"#,
                "refused: Error while deserializing GeoJSON: invalid type: sequence, expected GeoJson object at line 1 column 0: expected GeoJSON",
            ),
            (
                r#"{"type":"Topology","objects":{},"arcs":[]}"#,
                "refused: Error while deserializing GeoJSON: unknown variant `Topology`, expected one of `Feature`, `FeatureCollection`, `Point`, `LineString`, `Polygon`, `MultiPoint`, `MultiLineString`, `MultiPolygon`, `GeometryCollection` at line 1 column 18: expected GeoJSON",
            ),
            (
                r#"{"geometryType":"esriGeometryPoint","features":[{"attributes":{},"geometry":{"x":8.5,"y":47.5}}]}"#,
                "refused: Error while deserializing GeoJSON: missing field `type` at line 1 column 94: expected GeoJSON",
            ),
            (
                r#"{"type":"point","coordinates":[8.5,47.5]}"#,
                "refused: Error while deserializing GeoJSON: unknown variant `point`, expected one of `Feature`, `FeatureCollection`, `Point`, `LineString`, `Polygon`, `MultiPoint`, `MultiLineString`, `MultiPolygon`, `GeometryCollection` at line 1 column 15: expected GeoJSON",
            ),
            (
                r#"{"type":"Point","coordinates":[8.5,47.5],}"#,
                "refused: Error while deserializing GeoJSON: trailing comma at line 1 column 42: expected GeoJSON",
            ),
            (
                "",
                "refused: Error while deserializing GeoJSON: EOF while parsing a value at line 1 column 0: expected GeoJSON",
            ),
            (
                r#"{"type":"Feature","properties":{},"geometry":{"type":"Point","coordinates":[8.5,47.5],"crs":{"type":"name","properties":{"name":"EPSG:3857"}}}}"#,
                "refused: crs EPSG:3857 of a part: expected EPSG:4326, that of the file",
            ),
            (
                r#"{"type":"MultiPoint","crs":{"type":"name","properties":{"name":"EPSG:32733"}},"coordinates":[[500000,6500000],[500000,6500100,12]]}"#,
                "lat_deg,lon_deg | -31.63518622,15 | -31.634283987,15; heights of 1 of 2 points; altitudes of the ground, for flights over hills, belong into ground_m",
            ),
            (
                r#"{"type":"Point","crs":{"type":"name","properties":{"name":"EPSG:26710"}},"coordinates":[500000,4500000]}"#,
                "refused: crs `EPSG:26710`: the shift of its datum to WGS84 is not known: expected one whose shift to WGS84 is known, such as EPSG:25832 (--crs of `skysink new`), or latitudes and longitudes (ogr2ogr -t_srs EPSG:4326, or QGIS)",
            ),
            (
                r#"{"type":"Feature","properties":{"name":"a","ground_ft":1000,"alt":300},"geometry":{"type":"Point","coordinates":[8.5,47.5]}}"#,
                "lat_deg,lon_deg,ground_m,name | 47.5,8.5,304.8,a; properties alt; heights of 1 of 1 points; altitudes of the ground, for flights over hills, belong into ground_m",
            ),
        ],
    );
}

#[test]
fn encodings_of_geojson_and_gpx_are_told_apart() {
    let point =
        r#"{"type":"Feature","properties":{"name":"Wäldli"},"geometry":{"type":"Point","coordinates":[8.5,47.5]}}"#;
    let utf16: Vec<u8> = format!("\u{feff}{point}").encode_utf16().flat_map(u16::to_be_bytes).collect();
    let latin: Vec<u8> = point.chars().map(|character| character as u8).collect();
    assert_outcomes(
        outcome,
        "a.JSON",
        &[(utf16, "lat_deg,lon_deg,name | 47.5,8.5,Wäldli"), (latin, "refused: line 1: expected UTF-8 text")],
    );
    let gpx: Vec<u8> = "<?xml version=\"1.0\" encoding=\"UTF-16\"?><gpx><wpt lat=\"47.5\" lon=\"8.5\"/></gpx>"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    assert_outcomes(outcome, "a.GPX", &[(gpx, "lat_deg,lon_deg | 47.5,8.5")]);
}

#[test]
fn gpx_of_other_programs_becomes_a_list_or_says_why_not() {
    let point = "<wpt lat=\"47.5\" lon=\"8.5\"/>";
    let cases = [
        (format!("\u{feff}<?xml version=\"1.0\"?>\r\n<gpx>\r\n{point}\r\n</gpx>\r\n"), "lat_deg,lon_deg | 47.5,8.5"),
        (format!("<gpx>{}</gpx>", point.replace("/>", "><name><![CDATA[<b>A & B</b>]]></name><desc>x</desc></wpt>")), "lat_deg,lon_deg,name | 47.5,8.5,<b>A & B</b>"),
        ("<gpx><rte><rtept lat=\"1\" lon=\"2\"/></rte><trk><name>lap</name><trkseg><trkpt lat=\"1\" lon=\"2\"/></trkseg></trk></gpx>".to_owned(), "refused: no points, only 1 × route, 1 × track (`lap`): expected at least one sensor node"),
        ("<gpx></gpx>".to_owned(), "refused: no points: expected at least one sensor node"),
        (format!("<gpx>{}</gpx>", point.replace("8.5", "180")), "lat_deg,lon_deg | 47.5,180"),
        (format!("<gpx>{}</gpx>", point.replace("8.5", "181")), "refused: point 1: longitude 181: expected -180 to 180"),
        (format!("<gpx>{}</gpx>", point.replace("47.5", "47,5")), "refused: point 1: lat = 47,5: expected a number"),
        (format!("<gpx>{}</gpx>", point.replace("47.5", "")), "refused: point 1: no attribute lat: expected lat and lon"),
        (format!("<gpx>{}</gpx>", point.replace("lat", "Lat")), "refused: point 1: no attribute lat: expected lat and lon"),
        (format!("<gpx><metadata><name>m</name>{point}</metadata></gpx>"), "refused: no points: expected at least one sensor node"),
        (format!("<gpx>{point}<wpt lat=\"47.6\" lon=\"8.6\"><ele>12</ele></wpt></gpx>"), "lat_deg,lon_deg | 47.5,8.5 | 47.6,8.6; heights of 1 of 2 points; altitudes of the ground, for flights over hills, belong into ground_m"),
        (format!("<GPX>{point}</GPX>"), "refused: `GPX`: expected a GPX file"),
        ("<!DOCTYPE html><html><body>Not found</body></html>".to_owned(), "refused: `html`: expected a GPX file"),
        (format!("<gpx>{point}"), "refused: it ends within an element: expected a complete GPX file"),
        ("lat,lon\n47.5,8.5\n".to_owned(), "refused: no element: expected a GPX file"),
        (format!("<gpx>{point}</gpx><gpx>{point}</gpx>"), "refused: `gpx` after the outermost element: expected a GPX file"),
        (format!("<gpx>{}</gpx>", point.replace("/>", "><name>\u{7f}x</name></wpt>")), "refused: point 1: name = \\u007fx: U+007F, a control character: expected at most 100 characters, on one line"),
    ];
    assert_outcomes(outcome, "a.gpx", &cases);
}

/// A placemark of this name with a geometry.
fn placemark(name: &str, geometry: &str) -> String {
    format!("<Placemark><name>{name}</name>{geometry}</Placemark>")
}

fn point(coordinates: &str) -> String {
    format!("<Point><coordinates>{coordinates}</coordinates></Point>")
}

#[test]
fn kml_of_other_programs_becomes_a_list_or_says_why_not() {
    let kml =
        |items: &str| format!("<?xml version=\"1.0\"?><kml xmlns=\"http://earth.google.com/kml/2.1\">{items}</kml>");
    let a = placemark("a", &point("8.5,47.5"));
    let cases = [
        (format!("\u{feff}{}", kml(&a).replace('>', ">\r\n")), "lat_deg,lon_deg,name | 47.5,8.5,a"),
        (
            kml(&a).replace('<', "<kml:").replace("<kml:?", "<?").replace("<kml:/", "</kml:"),
            "lat_deg,lon_deg,name | 47.5,8.5,a",
        ),
        (
            kml(&format!("<Document><Folder><name>x</name><Folder><Folder>{a}</Folder></Folder></Folder></Document>")),
            "lat_deg,lon_deg,name | 47.5,8.5,a",
        ),
        (
            kml(&placemark(
                "m",
                &format!("<MultiGeometry>{}{}</MultiGeometry>", point("8.5,47.5"), point("8.6,47.6,9")),
            )),
            "lat_deg,lon_deg,name | 47.5,8.5,m | 47.6,8.6,m; heights of 1 of 2 points; altitudes of the ground, for flights over hills, belong into ground_m",
        ),
        (
            kml(&placemark("<![CDATA[Pump <i>1</i>]]>", &point("\n\t8.5, 47.5, 0\n"))),
            "lat_deg,lon_deg,name | 47.5,8.5,Pump <i>1</i>",
        ),
        (kml(&placemark("", &point("8.5,47.5"))), "lat_deg,lon_deg | 47.5,8.5"),
        (kml("<Placemark/><Placemark><Point/></Placemark>"), "refused: point 1: no coordinates: expected a position"),
        (
            kml(&placemark("a", &point("47.5,98.5"))),
            "refused: point 1 (`a`): latitude 98.5: expected -90 to 90; are latitude and longitude swapped?",
        ),
        (kml(&placemark("a", &point("181,0"))), "refused: point 1 (`a`): longitude 181: expected -180 to 180"),
        (
            kml(&placemark("a", &point("8.5;47.5"))),
            "refused: point 1 (`a`): coordinates `8.5;47.5`: expected longitude, latitude and altitude with commas, and a blank between positions",
        ),
        (
            kml(&placemark("a", &point("8.5 47.5"))),
            "refused: point 1 (`a`): coordinates `8.5`: expected longitude, latitude and altitude with commas, and a blank between positions",
        ),
        (
            kml(&placemark("a", &point("8,5,47,5"))),
            "refused: point 1 (`a`): coordinates `8,5,47,5`: 4 numbers: expected longitude, latitude and altitude with commas, and a blank between positions",
        ),
        (
            kml(&placemark("a", &point("8.5,47.5,1,2"))),
            "refused: point 1 (`a`): coordinates `8.5,47.5,1,2`: 4 numbers: expected longitude, latitude and altitude with commas, and a blank between positions",
        ),
        (
            kml(&placemark("walk", "<gx:Track><when>2026</when><gx:coord>8.5 47.5 0</gx:coord></gx:Track>")),
            "refused: no points, only 1 × track (`walk`): expected at least one sensor node",
        ),
        (
            kml(&placemark(
                "net",
                "<LineString><coordinates>8.5,47.5 8.6,47.5 8.6,47.6 8.5,47.5</coordinates></LineString>",
            )),
            "refused: no points, only 1 × closed line (`net`): expected at least one sensor node",
        ),
        (
            kml("<NetworkLink><name>live</name><Link><href>http://example.org/a.kml</href></Link></NetworkLink>"),
            "refused: no points, only 1 × link (`live: http://example.org/a.kml`): expected at least one sensor node",
        ),
        (kml(""), "refused: no points: expected at least one sensor node"),
        (a.clone(), "lat_deg,lon_deg,name | 47.5,8.5,a"),
        (
            kml(&a).replace("<Point>", "<point>").replace("</Point>", "</point>"),
            "refused: no points, only 1 × placemark without a position (`a`): expected at least one sensor node",
        ),
        (kml(&placemark("a &amp; b &#8594; c", &point("8.5,47.5"))), "lat_deg,lon_deg,name | 47.5,8.5,a & b → c"),
        (
            kml(&placemark("a & b", &point("8.5,47.5"))),
            "refused: ill-formed document: entity or character reference not closed: `;` not found before end of input: expected a KML file",
        ),
        (
            kml(&placemark(
                "a",
                "<Point><altitudeMode>relativeToGround</altitudeMode><coordinates>8.5,47.5,30</coordinates></Point>",
            )),
            "lat_deg,lon_deg,name | 47.5,8.5,a; heights of 1 of 1 points; altitudes of the ground, for flights over hills, belong into ground_m",
        ),
        (
            kml(&format!("{}{}", placemark("a", &point("8.5,47.5,0")), placemark("b", &point("8.6,47.6,0")))),
            "lat_deg,lon_deg,name | 47.5,8.5,a | 47.6,8.6,b",
        ),
        (
            kml(&format!("{a}<NetworkLink><Url><href>east.kml</href></Url></NetworkLink>")),
            "lat_deg,lon_deg,name | 47.5,8.5,a; 1 × link (`east.kml`)",
        ),
    ];
    assert_outcomes(outcome, "a.kml", &cases);
}

/// An archive of files by name and content, with this compression.
fn archive(files: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in files {
        archive.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
        archive.write_all(content).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

#[test]
fn archives_of_other_programs_become_lists_or_say_why_not() {
    let document = format!("<kml>{}</kml>", placemark("a", &point("8.5,47.5")));
    let document = document.as_bytes();
    let other = format!("<kml>{}</kml>", placemark("other", &point("9.5,48.5")));
    let other = other.as_bytes();
    let utf16: Vec<u8> = "<kml><Placemark><Point><coordinates>8.5,47.5</coordinates></Point></Placemark></kml>"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let marked = [b"\xef\xbb\xbf", document].concat();
    let deflated = |files: &[(&str, &[u8])]| archive(files, CompressionMethod::Deflated);
    let whole = deflated(&[("doc.kml", document)]);
    let mut damaged = archive(&[("doc.kml", document)], CompressionMethod::Stored);
    let at = damaged.windows(3).position(|bytes| bytes == b"8.5").unwrap();
    damaged[at] = b'9';
    let cases = [
        (whole.clone(), "lat_deg,lon_deg,name | 47.5,8.5,a"),
        (archive(&[("doc.kml", document)], CompressionMethod::Stored), "lat_deg,lon_deg,name | 47.5,8.5,a"),
        (
            deflated(&[("images/", b""), ("images/icon.png", b"\x89PNG"), ("doc.kml", document)]),
            "lat_deg,lon_deg,name | 47.5,8.5,a",
        ),
        (deflated(&[("export/layers/Field.KML", document)]), "lat_deg,lon_deg,name | 47.5,8.5,a"),
        (
            deflated(&[("__MACOSX/._doc.kml", b"\x00\x05\x16\x07"), ("doc.kml", document)]),
            "lat_deg,lon_deg,name | 47.5,8.5,a",
        ),
        (
            deflated(&[("files/other.kml", other), ("doc.kml", document)]),
            "lat_deg,lon_deg,name | 47.5,8.5,a; 1 × document (`files/other.kml`)",
        ),
        (
            deflated(&[("field.kml", document), ("other.kml", other), ("a/more.KMZ", b"")]),
            "lat_deg,lon_deg,name | 47.5,8.5,a; 2 × document (`other.kml`, `a/more.KMZ`)",
        ),
        (deflated(&[("doc.kml", &utf16)]), "lat_deg,lon_deg | 47.5,8.5"),
        (deflated(&[("doc.kml", &marked)]), "lat_deg,lon_deg,name | 47.5,8.5,a"),
        (deflated(&[("doc.kml", b"")]), "refused: no element: expected a KML file"),
        (deflated(&[("doc.kml", b"<gpx/>")]), "refused: `gpx`: expected a KML file"),
        (
            deflated(&[("points.csv", b"lat,lon\n1,2\n")]),
            "refused: no KML file in it: expected a KMZ file, a zip archive with a KML file",
        ),
        (deflated(&[]), "refused: no KML file in it: expected a KMZ file, a zip archive with a KML file"),
        (
            whole[..whole.len() / 2].to_vec(),
            "refused: invalid Zip archive: Could not find EOCD: expected a KMZ file, a zip archive with a KML file",
        ),
        (damaged, "refused: Invalid checksum: expected a KMZ file, a zip archive with a KML file"),
        (
            Vec::new(),
            "refused: invalid Zip archive: Could not find EOCD: expected a KMZ file, a zip archive with a KML file",
        ),
        (
            document.to_vec(),
            "refused: invalid Zip archive: Could not find EOCD: expected a KMZ file, a zip archive with a KML file",
        ),
        (
            deflated(&[("inner.kmz", &whole)]),
            "refused: no KML file in it: expected a KMZ file, a zip archive with a KML file",
        ),
    ];
    assert_outcomes(outcome, "a.kmz", &cases);
}
