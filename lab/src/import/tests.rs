//! Lists of foreign programs: what each input becomes, as the nodes that are taken and what is ignored, or the reason
//! why it is refused.

use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::read;

/// What `file` with these bytes becomes: its positions, further columns and what is ignored, or the refusal.
fn outcome(file: &str, bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(file);
    fs::write(&path, bytes).unwrap();
    match read(&path) {
        Ok(imported) => {
            let list = imported.to_csv([0.0; 2]);
            let rows = list.trim_end().replace('\n', " | ");
            let ignored: Vec<String> = imported.ignored.iter().map(|what| format!("; {what}")).collect();
            format!("{rows}{}", ignored.concat())
        }
        Err(refusal) => format!("refused: {}", refusal.message),
    }
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

#[test]
fn a_file_of_an_unknown_format_is_refused() {
    assert!(read(Path::new("a.shp")).unwrap_err().to_string().contains("`.shp`: expected a file named .csv, .kml"));
}

#[test]
fn tables_of_other_programs_become_lists_or_say_why_not() {
    assert_outcomes("a.csv", &[
        ("\u{feff}lat,lon\n47.5,8.5\n", "?"),
        ("lat,lon\r\n47.5,8.5\r\n\r\n47.6,8.6\r\n\r\n", "?"),
        ("lat,lon\r47.5,8.5\r47.6,8.6\r", "?"),
        (" LAT ; LON ; Name \n 47,5 ; 8,5 ; well \n", "?"),
        ("lat,lon,name\n47.5,8.5,\"post 1,\nnorth\"\n", "?"),
        ("lat,lon,name\n47.5,8.5,\"say \"\"hi\"\"\"\n", "?"),
        ("lat,lon,name\n47.5,8.5,\"open\n", "?"),
        ("x,y,z\n1,2,3\n4,5,6\n", "?"),
        ("lat,lon\n4.75e1,85e-1\n", "?"),
        ("lat,lon\n47.5,180\n47.5,-180\n", "?"),
        ("lat,lon\n47.5,180.5\n", "?"),
        ("lat,lon\n8.5,147.5\n147.5,8.5\n", "?"),
        ("lat,lon\n47.5 N,8.5 E\n", "?"),
        ("lat,lon\n47°23'50\"N,8°32'40\"E\n", "?"),
        ("lat,lon\n,\n47.5,8.5\n,\n", "?"),
        ("lat,lon\n47.5,8.5,\n", "?"),
        ("lat,lon\nnan,inf\n", "?"),
        ("x,y\n\"1,234.5\",2\n", "?"),
        ("lat,lon\n", "?"),
        ("", "?"),
        ("\n\n", "?"),
        ("47.5,8.5\n47.6,8.6\n", "?"),
        ("# exported by a logger\nlat,lon\n47.5,8.5\n", "?"),
        ("lat|lon\n47.5|8.5\n", "?"),
        ("lat lon\n47.5 8.5\n", "?"),
        ("WKT,name\n\"POINT (8.5 47.5)\",a\n", "?"),
        ("name,latitude\na,47.5\n", "?"),
        ("lat,lon,LAT\n47.5,8.5,47.5\n", "?"),
        ("lat,lon,weight,buffer,queue\n47.5,8.5,2,1000,10\n", "?"),
        ("lat,lon,rate\n47.5,8.5,\n", "?"),
    ]);
    let unicode: Vec<u8> = "\u{feff}lat\tlon\tname\r\n47.5\t8.5\tWäldli\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let latin = b"lat,lon,name\n47.5,8.5,a\n47.5,8.5,W\xe4ldli\n".to_vec();
    let binary = b"PK\x03\x04\x14\x00\x06\x00\x08\x00\xff\xfe".to_vec();
    assert_outcomes("a.csv", &[(unicode, "?"), (latin, "?"), (binary, "?")]);
    assert_outcomes("A.CSV", &[("lat,lon\n47.5,8.5\n", "?")]);
}

#[test]
fn geojson_of_other_programs_becomes_a_list_or_says_why_not() {
    assert_outcomes("a.geojson", &[
        (r#"{"type":"Feature","id":7,"bbox":[8,47,9,48],"properties":null,"geometry":{"type":"Point","coordinates":[8.5,47.5]}}"#, "?"),
        (r#"{"type":"FeatureCollection","name":"wells","features":[{"type":"Feature","properties":{"Name":"a","rate":"50"},"geometry":{"type":"Point","coordinates":[8.5,47.5,400]}}]}"#, "?"),
        (r#"{"type":"FeatureCollection","features":[]}"#, "?"),
        (r#"{"type":"FeatureCollection","features":[{"type":"Feature","properties":{"name":"a"},"geometry":null}]}"#, "?"),
        (r#"{"type":"Point","coordinates":[]}"#, "?"),
        (r#"{"type":"Point","coordinates":[8.5]}"#, "?"),
        (r#"{"type":"Point","coordinates":["8.5","47.5"]}"#, "?"),
        (r#"{"type":"Point","coordinates":[8.5,47.5,400,1714550400]}"#, "?"),
        (r#"{"type":"Point","coordinates":[47.5,108.5]}"#, "?"),
        (r#"{"type":"Point","coordinates":[180,0]}"#, "?"),
        (r#"{"type":"Point","coordinates":[190,0]}"#, "?"),
        (r#"{"type":"Point","coordinates":[2600000.5,1200000.25]}"#, "?"),
        (r#"{"type":"MultiPoint","coordinates":[]}"#, "?"),
        (r#"{"type":"GeometryCollection","geometries":[{"type":"GeometryCollection","geometries":[{"type":"Point","coordinates":[8.5,47.5]}]}]}"#, "?"),
        (r#"{"type":"Polygon","coordinates":[[[8,47],[9,47],[9,48],[8,47]]]}"#, "?"),
        ("{\"type\":\"Point\",\"coordinates\":[8.5,47.5]}\n{\"type\":\"Point\",\"coordinates\":[8.6,47.6]}\n", "?"),
        (r#"[{"type":"Point","coordinates":[8.5,47.5]}]"#, "?"),
        (r#"{"type":"Topology","objects":{},"arcs":[]}"#, "?"),
        (r#"{"geometryType":"esriGeometryPoint","features":[{"attributes":{},"geometry":{"x":8.5,"y":47.5}}]}"#, "?"),
        (r#"{"type":"point","coordinates":[8.5,47.5]}"#, "?"),
        (r#"{"type":"Point","coordinates":[8.5,47.5],}"#, "?"),
        ("", "?"),
        (r#"{"type":"Feature","properties":{},"geometry":{"type":"Point","coordinates":[8.5,47.5],"crs":{"type":"name","properties":{"name":"EPSG:3857"}}}}"#, "?"),
    ]);
    let point = r#"{"type":"Feature","properties":{"name":"Wäldli"},"geometry":{"type":"Point","coordinates":[8.5,47.5]}}"#;
    let utf16: Vec<u8> = format!("\u{feff}{point}").encode_utf16().flat_map(u16::to_be_bytes).collect();
    let latin: Vec<u8> = point.chars().map(|character| character as u8).collect();
    assert_outcomes("a.JSON", &[(utf16, "?"), (latin, "?")]);
}

#[test]
fn gpx_of_other_programs_becomes_a_list_or_says_why_not() {
    let point = "<wpt lat=\"47.5\" lon=\"8.5\"/>";
    let cases = [
        (format!("\u{feff}<?xml version=\"1.0\"?>\r\n<gpx>\r\n{point}\r\n</gpx>\r\n"), "?"),
        (format!("<gpx>{}</gpx>", point.replace("/>", "><name><![CDATA[<b>A & B</b>]]></name><desc>x</desc></wpt>")), "?"),
        ("<gpx><rte><rtept lat=\"1\" lon=\"2\"/></rte><trk><name>lap</name><trkseg><trkpt lat=\"1\" lon=\"2\"/></trkseg></trk></gpx>".to_owned(), "?"),
        ("<gpx></gpx>".to_owned(), "?"),
        (format!("<gpx>{}</gpx>", point.replace("8.5", "180")), "?"),
        (format!("<gpx>{}</gpx>", point.replace("8.5", "181")), "?"),
        (format!("<gpx>{}</gpx>", point.replace("47.5", "47,5")), "?"),
        (format!("<gpx>{}</gpx>", point.replace("47.5", "")), "?"),
        (format!("<gpx>{}</gpx>", point.replace("lat", "Lat")), "?"),
        (format!("<gpx>{point}<WPT lat=\"1\" lon=\"2\"/></gpx>"), "?"),
        (format!("<gpx><metadata><name>m</name>{point}</metadata></gpx>"), "?"),
        (format!("<gpx>{point}<wpt lat=\"47.6\" lon=\"8.6\"><ele>12</ele></wpt></gpx>"), "?"),
        (format!("<GPX>{point}</GPX>"), "?"),
        ("<!DOCTYPE html><html><body>Not found</body></html>".to_owned(), "?"),
        (format!("<gpx>{point}"), "?"),
        ("lat,lon\n47.5,8.5\n".to_owned(), "?"),
        (format!("<gpx>{point}</gpx><gpx>{point}</gpx>"), "?"),
        (format!("<gpx>{}</gpx>", point.replace("/>", "><name>\u{7f}x</name></wpt>")), "?"),
    ];
    assert_outcomes("a.gpx", &cases);
    let utf16: Vec<u8> = format!("<?xml version=\"1.0\" encoding=\"UTF-16\"?><gpx>{point}</gpx>").encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_outcomes("a.GPX", &[(utf16, "?")]);
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
    let kml = |items: &str| format!("<?xml version=\"1.0\"?><kml xmlns=\"http://earth.google.com/kml/2.1\">{items}</kml>");
    let a = placemark("a", &point("8.5,47.5"));
    let cases = [
        (format!("\u{feff}{}", kml(&a).replace('>', ">\r\n")), "?"),
        (kml(&a).replace('<', "<kml:").replace("<kml:?", "<?").replace("<kml:/", "</kml:"), "?"),
        (kml(&format!("<Document><Folder><name>x</name><Folder><Folder>{a}</Folder></Folder></Folder></Document>")), "?"),
        (kml(&placemark("m", &format!("<MultiGeometry>{}{}</MultiGeometry>", point("8.5,47.5"), point("8.6,47.6,9")))), "?"),
        (kml(&placemark("<![CDATA[Pump <i>1</i>]]>", &point("\n\t8.5, 47.5, 0\n"))), "?"),
        (kml(&placemark("", &point("8.5,47.5"))), "?"),
        (kml("<Placemark/><Placemark><Point/></Placemark>"), "?"),
        (kml(&placemark("a", &point("47.5,98.5"))), "?"),
        (kml(&placemark("a", &point("181,0"))), "?"),
        (kml(&placemark("a", &point("8.5;47.5"))), "?"),
        (kml(&placemark("a", &point("8.5 47.5"))), "?"),
        (kml(&placemark("a", &point("8,5,47,5"))), "?"),
        (kml(&placemark("a", &point("8.5,47.5,1,2"))), "?"),
        (kml(&placemark("walk", "<gx:Track><when>2026</when><gx:coord>8.5 47.5 0</gx:coord></gx:Track>")), "?"),
        (kml(&placemark("net", "<LineString><coordinates>8.5,47.5 8.6,47.5 8.6,47.6 8.5,47.5</coordinates></LineString>")), "?"),
        (kml("<NetworkLink><name>live</name><Link><href>http://example.org/a.kml</href></Link></NetworkLink>"), "?"),
        (kml(""), "?"),
        (a.clone(), "?"),
        (kml(&a).replace("<Point>", "<point>").replace("</Point>", "</point>"), "?"),
        (kml(&placemark("a &amp; b &#8594; c", &point("8.5,47.5"))), "?"),
        (kml(&placemark("a & b", &point("8.5,47.5"))), "?"),
        (kml(&placemark("a", "<Point><altitudeMode>relativeToGround</altitudeMode><coordinates>8.5,47.5,30</coordinates></Point>")), "?"),
    ];
    assert_outcomes("a.kml", &cases);
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
    let utf16: Vec<u8> = "<kml><Placemark><Point><coordinates>8.5,47.5</coordinates></Point></Placemark></kml>".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let marked = [b"\xef\xbb\xbf", document].concat();
    let deflated = |files: &[(&str, &[u8])]| archive(files, CompressionMethod::Deflated);
    let whole = deflated(&[("doc.kml", document)]);
    let mut damaged = archive(&[("doc.kml", document)], CompressionMethod::Stored);
    let at = damaged.windows(3).position(|bytes| bytes == b"8.5").unwrap();
    damaged[at] = b'9';
    let cases = [
        (whole.clone(), "?"),
        (archive(&[("doc.kml", document)], CompressionMethod::Stored), "?"),
        (deflated(&[("images/", b""), ("images/icon.png", b"\x89PNG"), ("doc.kml", document)]), "?"),
        (deflated(&[("export/layers/Field.KML", document)]), "?"),
        (deflated(&[("__MACOSX/._doc.kml", b"\x00\x05\x16\x07"), ("doc.kml", document)]), "?"),
        (deflated(&[("files/other.kml", other), ("doc.kml", document)]), "?"),
        (deflated(&[("doc.kml", document), ("other.kml", other)]), "?"),
        (deflated(&[("doc.kml", &utf16)]), "?"),
        (deflated(&[("doc.kml", &marked)]), "?"),
        (deflated(&[("doc.kml", b"")]), "?"),
        (deflated(&[("doc.kml", b"<gpx/>")]), "?"),
        (deflated(&[("points.csv", b"lat,lon\n1,2\n")]), "?"),
        (deflated(&[]), "?"),
        (whole[..whole.len() / 2].to_vec(), "?"),
        (damaged, "?"),
        (Vec::new(), "?"),
        (document.to_vec(), "?"),
        (deflated(&[("inner.kmz", &whole)]), "?"),
    ];
    assert_outcomes("a.kmz", &cases);
}
