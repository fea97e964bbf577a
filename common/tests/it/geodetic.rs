//! Sensor lists in latitude and longitude: refusals, and positions on the area.

use std::path::Path;

use proptest::prelude::*;
use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::scenario::{Origin, Overrides, Scenario};
use skysink_common::sensors::SensorList;

fn parse(text: &str) -> Result<Scenario, InputError> {
    Scenario::parse(text, Path::new("folder/city.toml"), Overrides::default())
}

/// A square area of `side_m` with the given south-west corner.
fn area_at(lat_deg: f64, lon_deg: f64, side_m: f64) -> Scenario {
    let corner = format!("origin_lat_deg = {lat_deg:?}\norigin_lon_deg = {lon_deg:?}\n");
    parse(&format!("name = \"x\"\n[area]\nside_m = {side_m:?}\n{corner}")).unwrap()
}

fn read(text: &str, scenario: &Scenario) -> Result<SensorList, InputError> {
    SensorList::parse(text, Path::new("l.csv"), scenario)
}

fn refusal(text: &str, scenario: &Scenario) -> String {
    read(text, scenario).unwrap_err().to_string()
}

/// The position of one point on the area.
fn project(lat_deg: f64, lon_deg: f64, scenario: &Scenario) -> Position {
    read(&format!("lat_deg,lon_deg\n{lat_deg},{lon_deg}\n"), scenario).unwrap().sensors()[0].position
}

#[test]
fn an_origin_off_the_earth_or_half_an_origin_is_refused() {
    let cases = [
        ("origin_lat_deg = 90.1\norigin_lon_deg = 0.0", "area.origin_lat_deg = 90.1: expected a latitude, -90 to 90"),
        ("origin_lat_deg = nan\norigin_lon_deg = 0.0", "area.origin_lat_deg = nan: expected a latitude, -90 to 90"),
        (
            "origin_lat_deg = 0.0\norigin_lon_deg = -181.0",
            "area.origin_lon_deg = -181.0: expected a longitude, -180 to 180",
        ),
        ("origin_lat_deg = 0.0\norigin_lon_deg = inf", "area.origin_lon_deg = inf: expected a longitude, -180 to 180"),
        ("origin_lat_deg = 1.5", "area.origin_lat_deg = 1.5: expected origin_lat_deg and origin_lon_deg together"),
        ("origin_lon_deg = 1.5", "area.origin_lon_deg = 1.5: expected origin_lat_deg and origin_lon_deg together"),
    ];
    for (keys, expected) in cases {
        let refusal = parse(&format!("name = \"city\"\n[area]\n{keys}\n")).unwrap_err().to_string();
        assert_eq!(refusal, format!("scenario folder/city.toml: {expected}"));
    }
}

#[test]
fn a_list_without_an_origin_or_in_two_frames_is_refused() {
    let without_origin = parse("name = \"x\"\n").unwrap();
    let with_origin = area_at(41.65, -87.81, 100.0);
    let origin = "expected area.origin_lat_deg and area.origin_lon_deg in the scenario";
    let columns = "expected x_m,y_m or lat_deg,lon_deg, not both, and optionally queue_bits,gain_db,sampling_bps,capacity_bits,weight,capacity_j,harvest_w,ground_m,name";
    let cases = [
        (&without_origin, "lat_deg,lon_deg", origin),
        (&with_origin, "x_m,y_m,lat_deg,lon_deg", columns),
        (&with_origin, "x_m,lon_deg", columns),
        (&with_origin, "lat_deg,x_m,y_m", columns),
        (&with_origin, "lat_deg,queue_bits", columns),
    ];
    for (scenario, header, expected) in cases {
        let expected = format!("sensor list l.csv: line 1: header `{header}`: {expected}");
        assert_eq!(refusal(&format!("{header}\n1,2,3,4\n"), scenario), expected);
    }
}

#[test]
fn a_point_off_the_earth_or_outside_the_area_is_refused_with_its_line_and_values() {
    let scenario = area_at(41.65, -87.81, 1000.0);
    let cases = [
        ("90.5,-87.81", "lat_deg = 90.5: expected a latitude, -90 to 90"),
        ("NaN,-87.81", "lat_deg = NaN: expected a latitude, -90 to 90"),
        ("41.65,180.5", "lon_deg = 180.5: expected a longitude, -180 to 180"),
        ("41.65,inf", "lon_deg = inf: expected a longitude, -180 to 180"),
        ("41.65,west", "lon_deg = west: expected a longitude, -180 to 180"),
        // Latitude and longitude exchanged: a common mistake.
        (
            "-87.81,41.65",
            "lat_deg = -87.81, lon_deg = 41.65: on the far side of the Earth: expected a position in the area, \
                          [0, 1000] × [0, 1000]",
        ),
        // The antipode of the origin, straight below it.
        (
            "-41.65,92.19",
            "lat_deg = -41.65, lon_deg = 92.19: on the far side of the Earth: expected a position in the \
                          area, [0, 1000] × [0, 1000]",
        ),
        (
            "41.64,-87.82",
            "lat_deg = 41.64, lon_deg = -87.82: -833.161 m east and -1110.616 m north of the origin: expected a \
                          position in the area, [0, 1000] × [0, 1000]",
        ),
    ];
    for (row, expected) in cases {
        let refusal = refusal(&format!("lat_deg,lon_deg\n41.651,-87.8\n{row}\n"), &scenario);
        assert_eq!(refusal, format!("sensor list l.csv: line 3: {expected}"));
    }
}

#[test]
fn a_hundredth_of_a_degree_north_matches_the_meridian_arc() {
    // The radius of the meridian is M = a (1 − e²) / (1 − e² sin² φ)^1.5 with a = 6378137 m, e² = 0.00669437999.
    // Equator: M = 6335439.327 m, times 0.01° = 1.745329252e-4 rad: 1105.743 m.
    assert!((project(0.01, 0.0, &area_at(0.0, 0.0, 2000.0)).y - 1105.743).abs() < 0.0005);
    // 45.005°, the middle: sin² φ = 0.50008727; M = 6335439.327 / (1 − 0.003347774)^1.5 = 6367387.41 m: 1111.319 m.
    assert!((project(45.01, 7.0, &area_at(45.0, 7.0, 2000.0)).y - 1111.319).abs() < 0.0005);
}

#[test]
fn a_degree_north_of_the_equator_matches_the_closed_form() {
    // On the equator north is the Earth's axis: y = N (1 − e²) sin 1° with N = a / sqrt(1 − e² sin² 1°) = 6378143.503
    // m, 1 − e² = 0.99330562 and sin 1° = 0.0174524064: 110568.775 m. The arc is 110574.389 m, of which the plane loses
    // 6 m.
    let position = project(1.0, 0.0, &area_at(0.0, 0.0, 2e5));
    assert!((position.y - 110_568.775).abs() < 0.001 && position.x.abs() < 1e-6, "{position}");
}

#[test]
fn a_hundredth_of_a_degree_east_at_60_degrees_is_half_the_equatorial_arc() {
    // East is N cos φ sin Δλ. At 60°, N = a / sqrt(1 − 0.75 e²) = 6394209.174 m, cos φ = 1/2, sin 0.01° =
    // 1.745329243e-4: 558.000 m. Due east at the same latitude the parallel curves to the north, by x² tan φ / 2N =
    // 0.042 m.
    let position = project(60.0, 10.01, &area_at(60.0, 10.0, 2000.0));
    assert!((position.x - 558.000).abs() < 0.0005 && (position.y - 0.042).abs() < 0.0005, "{position}");
    // At the equator N = a: 1113.195 m.
    assert!((project(0.0, 10.01, &area_at(0.0, 10.0, 2000.0)).x - 1113.195).abs() < 0.0005);
}

#[test]
fn the_origin_and_its_meridian_map_to_the_border_of_the_area() {
    for (lat_deg, lon_deg) in [(0.0, 0.0), (41.65, -87.81), (-33.9, 151.2), (64.1, -180.0), (-90.0, 30.0)] {
        let scenario = area_at(lat_deg, lon_deg, 1e5);
        let corner = project(lat_deg, lon_deg, &scenario);
        assert!(corner.x == 0.0 && corner.y == 0.0, "{lat_deg} {lon_deg}: {corner}");
        let north = project(lat_deg + 0.5, lon_deg, &scenario);
        assert!(north.x.abs() < 1e-6 && (55_000.0..56_000.0).contains(&north.y), "{lat_deg} {lon_deg}: {north}");
    }
}

#[test]
fn an_area_may_cross_the_date_line() {
    let scenario = area_at(-17.0, 179.99, 5000.0);
    let east = project(-16.99, -179.99, &scenario);
    let west = project(-16.99, 179.99, &scenario);
    // 0.02° at 16.99° S: N cos φ sin Δλ = 6379960.6 m × 0.9563558 × 3.4906584e-4 = 2129.829 m.
    assert!((east.x - west.x - 2129.83).abs() < 0.01, "{east} {west}");
}

/// East and north by an independent formula: through the reduced latitude, in the meridian plane of the origin.
fn by_reduced_latitude(lat_deg: f64, lon_deg: f64, origin: Origin) -> Position {
    const A_M: f64 = 6_378_137.0;
    const B_M: f64 = A_M * (1.0 - 1.0 / 298.257_223_563);
    let axes = |lat_deg: f64| {
        let reduced = (B_M / A_M * lat_deg.to_radians().tan()).atan();
        [A_M * reduced.cos(), B_M * reduced.sin()]
    };
    let [radius_m, z_m] = axes(lat_deg);
    let [origin_radius_m, origin_z_m] = axes(origin.lat_deg);
    let longitude = (lon_deg - origin.lon_deg).to_radians();
    let outward_m = radius_m * longitude.cos() - origin_radius_m;
    let polar_m = z_m - origin_z_m;
    let (sin, cos) = origin.lat_deg.to_radians().sin_cos();
    Position::new(radius_m * longitude.sin(), polar_m * cos - outward_m * sin)
}

proptest! {
    #[test]
    fn projection_agrees_with_an_independent_formula_and_is_written_as_flown(
        (lat0_deg, lon0_deg) in (-75.0f64..75.0, -180.0f64..=180.0),
        offsets_deg in prop::collection::vec((0.05f64..0.5, 0.01f64..0.5), 1..20),
    ) {
        let scenario = area_at(lat0_deg, lon0_deg, 2e5);
        let wrap = |lon_deg: f64| if lon_deg > 180.0 { lon_deg - 360.0 } else { lon_deg };
        let points: Vec<_> = offsets_deg.iter().map(|(north, east)| (lat0_deg + north, wrap(lon0_deg + east))).collect();
        let rows: String = points.iter().map(|(lat_deg, lon_deg)| format!("{lon_deg},-52,{lat_deg}\n")).collect();
        let list = read(&format!("lon_deg,gain_db,lat_deg\n{rows}"), &scenario).unwrap();
        prop_assert_eq!(list.sensors().len(), points.len());
        for (sensor, (lat_deg, lon_deg)) in list.sensors().iter().zip(points) {
            let expected = by_reduced_latitude(lat_deg, lon_deg, scenario.area.origin().unwrap());
            prop_assert!((sensor.position - expected).norm() < 1e-6, "{} {expected}", sensor.position);
        }
        // In the run folder the list is in metres, and the scenario has its origin: the same mission.
        let resolved = parse(&scenario.to_toml_with_list("sensors.csv")).unwrap();
        prop_assert_eq!(resolved.area.origin(), scenario.area.origin());
        prop_assert_eq!(resolved.hash(), scenario.hash());
        prop_assert_eq!(resolved.to_toml_with_list("sensors.csv"), scenario.to_toml_with_list("sensors.csv"));
        prop_assert!(list.to_csv().starts_with("x_m,y_m,queue_bits,"));
        prop_assert_eq!(read(&list.to_csv(), &resolved).unwrap(), list);
    }

    #[test]
    fn no_degrees_make_the_reader_panic(lat_deg: f64, lon_deg: f64, lat in -90.0f64..=90.0, lon in -180.0f64..=180.0) {
        let scenario = area_at(lat, lon, 100.0);
        let _ = read(&format!("lat_deg,lon_deg\n{lat_deg},{lon_deg}\n"), &scenario);
        let _ = read(&format!("lat_deg,lon_deg\n{lon},{lat}\n"), &scenario);
    }
}

#[test]
fn an_origin_is_written_only_if_given() {
    let without_origin = parse("name = \"x\"\n").unwrap();
    let with_origin = area_at(-33.9, 151.2, 100.0);
    assert!(!without_origin.to_toml().contains("origin"));
    assert!(with_origin.to_toml().contains("origin_lat_deg = -33.9\norigin_lon_deg = 151.2\n"));
    // An origin is allowed with a list in metres, too.
    assert_eq!(read("x_m,y_m\n1,2\n", &with_origin).unwrap().sensors()[0].position, Position::new(1.0, 2.0));
}
