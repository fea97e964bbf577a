//! Zones of a file: they are what the same polygons in the scenario are, in the scenario's own plane.

use std::fs;
use std::path::Path;

use skysink_common::geodata::projection::Projection;
use skysink_common::scenario::{Overrides, Scenario};
use tempfile::TempDir;

const ORIGIN: &str = "side_m = 1000.0\norigin_lat_deg = 52.5\norigin_lon_deg = 13.4\n";

fn feature(properties: &str, corners: &str) -> String {
    format!(
        "{{\"type\":\"Feature\",\"properties\":{{{properties}}},\"geometry\":{{\"type\":\"Polygon\",\"coordinates\":[[{corners}]]}}}}"
    )
}

const AIRFIELD: &str = "[13.405,52.503],[13.407,52.503],[13.407,52.505],[13.405,52.503]";
const TOWER: &str = "[13.409,52.504],[13.411,52.504],[13.410,52.506],[13.409,52.504]";
const BORDER: &str = "[13.401,52.501],[13.413,52.501],[13.413,52.508],[13.401,52.508],[13.401,52.501]";

/// A folder with a file of these features.
fn folder(features: &[String]) -> TempDir {
    let folder = TempDir::new().unwrap();
    let text = format!("{{\"type\":\"FeatureCollection\",\"features\":[{}]}}", features.join(","));
    fs::write(folder.path().join("zones.geojson"), text).unwrap();
    folder
}

fn parse(folder: &Path, area: &str) -> Result<Scenario, String> {
    let text = format!("name = 'a'\n[area]\n{area}");
    Scenario::parse(&text, &folder.join("a.toml"), Overrides::default()).map_err(|error| error.to_string())
}

#[test]
fn a_zone_file_equals_its_inline_polygons() {
    let features = [feature("", AIRFIELD), feature("\"height\":30.5", TOWER), feature("\"kind\":\"boundary\"", BORDER)];
    let folder = folder(&features);
    let own = "{ polygon_m = [[900, 900], [950, 900], [950, 950]] }";
    let read = parse(folder.path(), &format!("{ORIGIN}no_fly = [{own}, {{ file = 'zones.geojson' }}]")).unwrap();

    let projection = Projection::at(read.area.origin().unwrap());
    let corners = |text: &str| {
        let numbers: Vec<f64> = text.split(['[', ']', ',']).filter_map(|number| number.parse().ok()).collect();
        let (pairs, _) = numbers.as_chunks::<2>();
        let corner = |&[lon_deg, lat_deg]: &[f64; 2]| {
            let at = projection.project(lat_deg, lon_deg).unwrap();
            format!("[{:.3}, {:.3}]", at.x, at.y)
        };
        format!("[{}]", pairs[..pairs.len() - 1].iter().map(corner).collect::<Vec<_>>().join(", "))
    };
    let [airfield, tower, border] = [AIRFIELD, TOWER, BORDER].map(corners);
    let inline = format!(
        "{ORIGIN}boundary_m = {border}\nno_fly = [{own}, {{ polygon_m = {airfield} }}]\n\
         building = [{{ polygon_m = {tower}, height_m = 30.5 }}]"
    );
    let inline = parse(folder.path(), &inline).unwrap();
    assert_eq!(read.area, inline.area);
    assert_eq!(read.hash(), inline.hash());
    assert_eq!(read.to_toml(), inline.to_toml());
}

/// A run folder holds the corners, and needs the file no more.
#[test]
fn a_copied_run_needs_no_zone_file() {
    let folder = folder(&[feature("", AIRFIELD)]);
    let read = parse(folder.path(), &format!("{ORIGIN}no_fly = [{{ file = 'zones.geojson' }}]")).unwrap();
    let copy = read.to_toml_with_list("sensors.csv");
    assert!(!copy.contains("zones.geojson"), "{copy}");
    let elsewhere = TempDir::new().unwrap();
    let flown = Scenario::parse(&copy, &elsewhere.path().join("scenario.toml"), Overrides::default()).unwrap();
    assert_eq!(flown.hash(), read.hash());
}

#[test]
fn an_invalid_zone_file_is_refused_by_name() {
    let zones = folder(&[feature("", AIRFIELD), feature("\"kind\":\"area\"", BORDER)]);
    let crossed =
        folder(&[feature("", "[13.401,52.501],[13.405,52.505],[13.401,52.505],[13.405,52.501],[13.401,52.501]")]);
    let far = folder(&[feature("", "[-166,-52],[-166.001,-52],[-166,-52.001],[-166,-52]")]);
    let boundary = "boundary_m = [[0, 0], [900, 0], [900, 900]]";
    for (folder, area, expected) in [
        (
            &zones,
            "side_m = 100.0\nno_fly = [{ file = 'zones.geojson' }]".to_owned(),
            "area.no_fly[0].file = \"zones.geojson\": expected area.origin_lat_deg and",
        ),
        (&zones, format!("{ORIGIN}no_fly = [{{}}]"), "area.no_fly[0] = {}: expected polygon_m"),
        (
            &zones,
            format!("{ORIGIN}no_fly = [{{ file = 'zones.geojson', polygon_m = [[1, 1], [9, 1], [9, 9]] }}]"),
            ": expected polygon_m, the corners of a zone [m], or file",
        ),
        (&zones, format!("{ORIGIN}no_fly = [{{ file = 'none.kml' }}]"), "none.kml: No such file"),
        (
            &zones,
            format!("{ORIGIN}no_fly = [{{ file = 'a.shp' }}]"),
            "a.shp: `.shp`: expected a file named .kml, .kmz, .geojson, .json",
        ),
        (&zones, format!("{ORIGIN}no_fly = [{{ file = 7 }}]"), "area.no_fly[0].file"),
        (
            &zones,
            format!("{ORIGIN}{boundary}\nno_fly = [{{ file = 'zones.geojson' }}]"),
            "zones.geojson: polygon 2: a second boundary",
        ),
        (&crossed, format!("{ORIGIN}no_fly = [{{ file = 'zones.geojson' }}]"), "zones.geojson: polygon 1: expected"),
        (
            &far,
            format!("{ORIGIN}no_fly = [{{ file = 'zones.geojson' }}]"),
            "polygon 1: latitude -52, longitude -166: expected a position within the horizon",
        ),
    ] {
        let error = parse(folder.path(), &area).unwrap_err();
        assert!(error.contains(expected) && !error.contains('\n'), "{error}");
    }
}
