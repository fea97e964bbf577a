//! `skysink new`: what it writes can be checked and flown, and what it refuses leaves nothing.

use crate::support::Place;

#[test]
fn a_new_scenario_is_the_papers_mission() {
    let place = Place::new();
    let printed = place.run_ok(&["new", "city"]).stdout;
    assert!(printed.contains("city/city.toml: 200 sensor nodes in 100 m × 100 m\n"), "{printed}");
    let checked = place.run_ok(&["check", "city/city.toml"]);
    assert!(checked.stderr.lines().all(|line| line.contains("no copter flies V τ")), "{checked:?}");
    place.flight("city/city").out("mine").simulate();
    place.write("letter.toml", "name = \"city\"\n");
    place.flight("letter").out("letter").simulate();
    place.assert_same_trace("mine", "letter");
}

#[test]
fn existing_files_are_replaced_only_with_force() {
    let place = Place::new();
    place.run_ok(&["new", "city"]);
    place.write("city/city.toml", "mine");
    let refused = place.run(&["new", "city"]);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.stderr.contains("city/city.toml: it exists") && refused.stderr.contains("--force"), "{refused:?}");
    assert_eq!(place.read("city/city.toml"), "mine");
    place.run_ok(&["new", "city", "--force"]);
    assert!(place.read("city/city.toml").contains("name = \"city\""));
    place.run_ok(&["new", "city", "--out", "elsewhere/deep"]);
    assert!(place.path("elsewhere/deep/city.toml").is_file());
}

#[test]
fn a_name_invalid_for_a_folder_is_refused() {
    let place = Place::new();
    for name in ["../x", "a b", "", "a\"b"] {
        place.run_refused(&["new", name], "expected 1 to 100 of");
    }
    assert_eq!(std::fs::read_dir(place.path(".")).unwrap().count(), 0);
}

#[cfg(feature = "lab")]
mod imports {
    use skysink_common::geometry::Position;
    use skysink_common::scenario::{Area, Overrides, Scenario};
    use skysink_common::sensors::SensorList;

    use super::*;
    use crate::support::scenarios;

    fn read(place: &Place, name: &str) -> Scenario {
        scenarios::read(&place.path(name), Overrides::default())
    }

    /// A boundary, a building and a zone, as GeoJSON; about 1 km by 1 km.
    const ZONES: &str = r#"{"type":"FeatureCollection","features":[
        {"type":"Feature","properties":{"kind":"boundary"},"geometry":{"type":"Polygon","coordinates":
            [[[13.400,52.500],[13.415,52.500],[13.415,52.509],[13.400,52.509],[13.400,52.500]]]}},
        {"type":"Feature","properties":{"building":"yes","height":"30.5"},"geometry":{"type":"Polygon","coordinates":
            [[[13.404,52.503],[13.406,52.503],[13.406,52.505],[13.404,52.503]]]}},
        {"type":"Feature","properties":null,"geometry":{"type":"MultiPolygon","coordinates":
            [[[[13.409,52.504],[13.411,52.504],[13.410,52.506],[13.409,52.504]]]]}}]}"#;

    /// The same as KML.
    fn zones_kml() -> String {
        let placemark = |name: &str, extrude: &str, corners: &str| {
            format!(
                "<Placemark><name>{name}</name><Polygon>{extrude}<outerBoundaryIs><LinearRing><coordinates>{corners}\
                 </coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
            )
        };
        let corners = [
            "13.400,52.500 13.415,52.500 13.415,52.509 13.400,52.509 13.400,52.500",
            "13.404,52.503,30.5 13.406,52.503,30.5 13.406,52.505,30.5 13.404,52.503,30.5",
            "13.409,52.504 13.411,52.504 13.410,52.506 13.409,52.504",
        ];
        format!(
            "<kml><Document><Folder>{}{}</Folder>{}</Document></kml>",
            placemark("boundary", "", corners[0]),
            placemark("tower", "<extrude>1</extrude>", corners[1]),
            placemark("airfield", "", corners[2])
        )
    }

    /// Zones lie where the sensor nodes of the same coordinates lie, from either format, with and without sensor nodes.
    #[test]
    fn zones_become_keys_of_the_area() {
        let place = Place::new();
        place.write("zones.geojson", ZONES);
        place.write("zones.kml", &zones_kml());
        // On corners of the building and of the zone.
        place.write("nodes.csv", "lat,lon\n52.505,13.406\n52.506,13.410\n");
        for zones in ["zones.geojson", "zones.kml"] {
            for sensors in [&["--sensors", "nodes.csv"][..], &[]] {
                let printed = place.run_ok(&[&["new", "city", "--force", "--zones", zones], sensors].concat()).stdout;
                let count = if sensors.is_empty() { 200 } else { 2 };
                assert!(printed.contains(&format!("{count} sensor nodes in ")), "{printed}");
                let scenario = read(&place, "city/city.toml");
                let area = &scenario.area;
                let [building] = &area.building.as_ref().unwrap()[..] else { panic!("one building") };
                let [zone] = &area.no_fly.as_ref().unwrap()[..] else { panic!("one zone") };
                assert_eq!((building.height_m, building.polygon_m.len(), zone.corners().len()), (30.5, 3, 3));
                // One of 0.015° of longitude at 52.5° north is 1 018 m, 0.009° of latitude 1 001 m.
                let border = area.boundary_m.as_ref().unwrap();
                let side_m = |axis: usize| {
                    let along = border.iter().map(|corner| corner[axis]);
                    along.clone().fold(0.0, f64::max) - along.fold(f64::INFINITY, f64::min)
                };
                assert!((side_m(0) - 1018.0).abs() < 2.0 && (side_m(1) - 1001.0).abs() < 2.0, "{border:?}");
                if count == 2 {
                    let list = SensorList::of(&scenario).unwrap();
                    for (sensor, corner) in list.sensors().iter().zip([building.polygon_m[2], zone.corners()[2]]) {
                        let away_m = (sensor.position - Position::from(corner)).norm();
                        assert!(away_m < 2e-3, "{away_m} m between {} and {corner:?}", sensor.position);
                    }
                }
                place.run_ok(&["simulate", "city/city.toml", "--set", "slots=5", "--out", "run", "--force"]);
            }
        }
        // A scenario that names the file is the same, and so is its flight; the run needs the file no more.
        let text = place.read("city/city.toml");
        let named = text[..text.find("\n[[area.").unwrap()].lines().filter(|line| !line.starts_with("boundary_m"));
        let named = named.collect::<Vec<_>>().join("\n") + "\n[[area.no_fly]]\nfile = \"zones.geojson\"\n";
        place.write("named.toml", &named);
        assert_eq!(read(&place, "named.toml").hash(), read(&place, "city/city.toml").hash());
        place.run_ok(&["simulate", "named.toml", "--set", "slots=5", "--out", "named"]);
        place.write("zones.geojson", "");
        place.run_ok(&["report", "named"]);
        place.run_refused(&["simulate", "named.toml"], "zones zones.geojson: ");
        // What is exported comes back: the boundary of the area, and what is flown around.
        place.run_ok(&["simulate", "city/city.toml", "--set", "slots=5", "--out", "run", "--force"]);
        for format in ["geojson", "kml"] {
            let file = format!("back.{format}");
            place.run_ok(&["export", "run", "--format", format, "--out", &file]);
            place.run_ok(&["new", "back", "--force", "--zones", &file]);
            let [first, back] = ["city/city.toml", "back/back.toml"].map(|name| read(&place, name).area);
            assert_eq!(back.no_fly.as_ref().map_or(0, Vec::len), 1, "{format}");
            let heights_m =
                |area: &Area| area.building.iter().flatten().map(|building| building.height_m).collect::<Vec<_>>();
            assert_eq!((heights_m(&first), heights_m(&back)), (vec![30.5], vec![30.5]), "{format}");
            let [first, back] = [first, back].map(|area| area.boundary_m.unwrap());
            assert_eq!(first.len(), back.len());
        }
    }

    #[test]
    fn invalid_zones_are_refused() {
        let place = Place::new();
        place.write("plane.csv", "x,y\n1,2\n3,4\n");
        place.write("zones.geojson", ZONES);
        place.write("points.geojson", "{\"type\":\"Point\",\"coordinates\":[1,2]}");
        place.write("crossed.geojson", &ZONES.replacen("[13.415,52.509]", "[13.405,52.495]", 1));
        place.run_refused(&["new", "a", "--zones", "points.geojson"], "no polygons: expected at least one zone");
        place.run_refused(&["new", "a", "--zones", "zones.gpx"], "`.gpx`: expected a file named .kml, .geojson, .json");
        place.run_refused(&["new", "a", "--zones", "none.kml"], "none.kml");
        place.run_refused(&["new", "a", "--zones", "crossed.geojson"], "without crossings");
        let expected = "positions in metres: expected latitudes and longitudes";
        place.run_refused(&["new", "a", "--zones", "zones.geojson", "--sensors", "plane.csv"], expected);
        assert!(!place.path("a").exists());
    }

    /// A PNG picture of 6 × 6 pixels, made for this test, with red R, green G, yellow Y, blue B and white W:
    ///
    /// ```text
    /// ......
    /// RRR.GG
    /// R.R.YG
    /// RRR...
    /// BB....
    /// ....WB
    /// ```
    const PICTURE: [&str; 3] = [
        "89504e470d0a1a0a0000000d49484452000000060000000608020000006fae781f0000001f49444154",
        "78da6360c004ff61089d03217fff4412fd8f4d2b0ef0ff3f481a00e44512e4e228ef340000000049",
        "454e44ae426082",
    ];

    fn picture() -> Vec<u8> {
        let digits = PICTURE.concat();
        (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap()).collect()
    }

    #[test]
    fn a_picture_becomes_zones_buildings_and_a_base() {
        let place = Place::new();
        std::fs::write(place.path("map.png"), picture()).unwrap();
        place.write("nodes.csv", "x,y\n5,55\n35,5\n");
        place.run_ok(&["new", "city", "--map", "map.png", "--cell-m", "10", "--sensors", "nodes.csv"]);
        let scenario = read(&place, "city/city.toml");
        assert_eq!([scenario.area.width_m(), scenario.area.height_m()], [60.0, 60.0]);
        assert_eq!(SensorList::of(&scenario).unwrap().sensors()[0].position, Position::new(5.0, 55.0));
        // From the blue pixel that is nearest to the middle of the picture.
        assert_eq!(scenario.uav.start_m, Some([15.0, 15.0]));
        let base = scenario.landing_base().unwrap();
        let airspace = scenario.airspace_without_ways();
        let heights_m: Vec<f64> = scenario.area.building.iter().flatten().map(|building| building.height_m).collect();
        assert_eq!(heights_m, [scenario.uav.altitude_m]);
        for (row, pixels) in ["......", "RRR.GG", "R.R.YG", "RRR...", "BB....", "....WB"].into_iter().enumerate() {
            for (column, pixel) in pixels.bytes().enumerate() {
                let at = Position::new(10.0 * column as f64 + 5.0, 55.0 - 10.0 * row as f64);
                assert_eq!(airspace.contains(&at), !b"RY".contains(&pixel), "{at}");
                assert_eq!(base.contains(&at), pixel == b'B', "{at}");
                let plan = &scenario.area.building.as_ref().unwrap()[0].polygon_m;
                let building = skysink_common::airspace::Polygon::of(plan, false).unwrap();
                assert_eq!(building.encloses(&at), b"GY".contains(&pixel), "{at}");
            }
        }
        place.run_ok(&[
            "simulate",
            "city/city.toml",
            "--set",
            "uav.must_land=true",
            "--set",
            "slots=9",
            "--out",
            "run",
        ]);
    }

    #[test]
    fn invalid_maps_are_refused() {
        let place = Place::new();
        place.write("nodes.csv", "lat,lon\n52.505,13.406\n");
        place.write("text.png", "no picture");
        std::fs::write(place.path("map.png"), picture()).unwrap();
        let refused = |arguments: &[&str], expected: &str| {
            place.run_refused(&[&["new", "a", "--map"], arguments].concat(), expected);
        };
        refused(&["text.png", "--cell-m", "10"], "text.png: ");
        refused(&["none.png", "--cell-m", "10"], "none.png");
        refused(&[".", "--cell-m", "10"], "it is a folder");
        refused(&["map.png", "--cell-m", "10", "--sensors", "nodes.csv"], "positions in degrees: expected metres");
        for (arguments, expected) in [(&["--cell-m", "0"][..], "expected metres, 0.001 to 1000000"), (&[], "--cell-m")]
        {
            let ended = place.run(&[&["new", "a", "--map", "map.png"], arguments].concat());
            assert_eq!(ended.code, Some(2), "{ended:?}");
            assert!(ended.stderr.contains(expected), "{ended:?}");
        }
        assert!(!place.path("a").exists());
    }

    const POINTS: &[(&str, &str)] = &[
        ("a.csv", "Colour,Longitude,LAT\na,13.40,52.50\nb,13.41,52.51\n"),
        ("a.geojson", "\u{feff}{\"type\":\"MultiPoint\",\"coordinates\":[[13.40,52.50],[13.41,52.51]]}"),
        (
            "a.gpx",
            "<gpx version=\"1.1\" creator=\"a\"><wpt lat=\"52.50\" lon=\"13.40\"/><wpt lat=\"52.51\" lon=\"13.41\"/></gpx>",
        ),
        (
            "a.kml",
            "<kml><Document><Placemark><Point><coordinates>13.40,52.50</coordinates></Point></Placemark><Placemark>\
             <Point><coordinates>13.41,52.51,30</coordinates></Point></Placemark></Document></kml>",
        ),
    ];

    #[test]
    fn every_format_gives_the_same_valid_list() {
        let place = Place::new();
        for (file, text) in POINTS {
            place.write(file, text);
            place.run_ok(&["new", "city", "--sensors", file, "--force"]);
            assert_eq!(place.read("city/sensors.csv"), "lat_deg,lon_deg\n52.5,13.4\n52.51,13.41\n", "{file}");
            // A hundredth of a degree: 1 113 m to the north, cos 52.5° of that, 678 m, to the east; and two margins.
            let checked = place.run_ok(&["check", "city/city.toml"]).stdout;
            let side = |key: &str| -> f64 {
                let line = checked.lines().find(|line| line.starts_with(key)).unwrap();
                line.rsplit(' ').next().unwrap().parse().unwrap()
            };
            assert!((side("width_m") - 699.0).abs() < 5.0 && (side("height_m") - 1133.0).abs() < 5.0, "{checked}");
            place.flight("city/city").force().simulate();
        }
    }

    #[test]
    fn rates_and_names_of_every_format_reach_results_and_exports() {
        let place = Place::new();
        let feature = |name: &str, rate: &str, lon: &str| {
            format!(
                "{{\"type\":\"Feature\",\"properties\":{{\"name\":\"{name}\",\"rate\":{rate},\"owner\":1}},\
                 \"geometry\":{{\"type\":\"Point\",\"coordinates\":[{lon},52.50,80]}}}}"
            )
        };
        let placemark = |name: &str, rate: &str, lon: &str| {
            format!(
                "<Placemark><name>{name}</name><ExtendedData><Data name=\"rate\"><value>{rate}</value></Data>\
                 </ExtendedData><Point><coordinates>{lon},52.50</coordinates></Point></Placemark>"
            )
        };
        let features = [feature("soil-07", "50", "13.40"), feature("soil, dry", "25.5", "13.401")].join(",");
        let placemarks = [placemark("soil-07", "50", "13.40"), placemark("soil, dry", "25.5", "13.401")].concat();
        place.write("a.geojson", &format!("{{\"type\":\"FeatureCollection\",\"features\":[{features}]}}"));
        place.write("a.kml", &format!("<kml><Document>{placemarks}</Document></kml>"));
        place.write("a.csv", "name,rate,lat,lon\nsoil-07,50,52.50,13.40\n\"soil, dry\",25.5,52.50,13.401\n");
        for file in ["a.csv", "a.kml", "a.geojson"] {
            let printed = place.run_ok(&["new", "city", "--sensors", file, "--force"]).stdout;
            let ignored = printed.lines().filter(|line| line.starts_with("ignored: ")).collect::<Vec<_>>();
            let is_high = file == "a.geojson";
            assert_eq!(ignored, if is_high { vec!["ignored: properties owner"] } else { vec![] }, "{file}");
            let list = "lat_deg,lon_deg,sampling_bps,name\n52.5,13.4,50,soil-07\n52.5,13.401,25.5,\"soil, dry\"\n";
            let high = list.replace(",name", ",ground_m,name").replace("50,", "50,80,").replace("25.5,", "25.5,80,");
            assert_eq!(place.read("city/sensors.csv"), if is_high { &high } else { list }, "{file}");
        }
        place.flight("city/city").strategy("tour").set("slots", "40").out("run").simulate();
        place.run_ok(&["report", "run", "--sensors"]);
        let results = place.read("run/sensors_out.csv");
        let names: Vec<&str> = results.lines().map(|line| line.splitn(13, ',').nth(12).unwrap()).collect();
        assert_eq!(names, ["name", "soil-07", "\"soil, dry\""]);
        assert!(place.read("run/sensors.csv").starts_with("x_m,y_m,queue_bits,gain_db,sampling_bps,ground_m,name\n"));
        for format in ["kml", "gpx", "geojson"] {
            place.run_ok(&["export", "run", "--format", format]);
            let text = place.read(&format!("run.{format}"));
            assert!(
                text.contains("soil-07") && text.contains("soil, dry") && !text.contains("SN 0"),
                "{format}: {text}"
            );
        }
        place.flight("city/city").out("again").simulate();
        place.run_ok(&["compare", "run", "again", "--no-record"]);
    }

    #[test]
    fn positions_in_metres_are_kept_unless_far_from_the_origin() {
        let place = Place::new();
        place.write("near.csv", "y,x,sampling_bps\n2,1,50\n80,90,60\n");
        place.run_ok(&["new", "near", "--sensors", "near.csv"]);
        assert_eq!(place.read("near/sensors.csv"), "x_m,y_m,sampling_bps\n1,2,50\n90,80,60\n");
        place.write("utm.csv", "easting,northing\n500100,-20\n500200,40\n");
        place.run_ok(&["new", "utm", "--sensors", "utm.csv"]);
        assert_eq!(place.read("utm/sensors.csv"), "x_m,y_m\n10,10\n110,70\n");
        assert!(place.read("utm/utm.toml").contains("translated by -500090 m and 30 m"));
    }

    #[test]
    fn distant_positions_on_the_southern_hemisphere_lie_in_the_area() {
        let place = Place::new();
        place.write("a.csv", "lat,lon\n-33.9,18.4\n-33.9,18.9\n-33.85,18.45\n");
        place.run_ok(&["new", "cape", "--sensors", "a.csv"]);
        place.run_ok(&["check", "cape/cape.toml"]);
    }

    #[test]
    fn positions_on_both_sides_of_the_180th_meridian_are_one_field() {
        let place = Place::new();
        // Taveuni, Fiji: 0.02 degrees of longitude at 16.8° south are 2 132 m, with margins a bit more than 2 152 m.
        place.write("a.csv", "lat,lon\n-16.8,179.99\n-16.79,-179.99\n");
        let printed = place.run_ok(&["new", "fiji", "--sensors", "a.csv"]).stdout;
        assert!(printed.contains("2 sensor nodes in 2153 m × 1127 m"), "{printed}");
        place.flight("fiji/fiji").simulate();
        // The margin alone lies west of it.
        place.write("b.csv", "lat,lon\n10,-179.99999\n10,-179.99\n");
        place.run_ok(&["new", "east", "--sensors", "b.csv"]);
        assert!(place.read("east/east.toml").contains("origin_lon_deg = 179.99"), "{}", place.read("east/east.toml"));
        place.run_ok(&["check", "east/east.toml"]);
    }

    #[test]
    fn features_without_a_point_are_counted() {
        let place = Place::new();
        let feature = |geometry: &str| format!("{{\"type\":\"Feature\",\"properties\":null,\"geometry\":{geometry}}}");
        let point = "{\"type\":\"Point\",\"coordinates\":[13.40,52.50]}";
        let features = [feature("null"), feature(point), feature("null")].join(",");
        place.write("a.geojson", &format!("{{\"type\":\"FeatureCollection\",\"features\":[{features}]}}"));
        let placemark = "<Placemark><name>a</name></Placemark>";
        let point = "<Placemark><Point><coordinates>13.40,52.50</coordinates></Point></Placemark>";
        place.write("a.kml", &format!("<kml><Document>{placemark}{point}{placemark}</Document></kml>"));
        let point = "<wpt lat=\"52.50\" lon=\"13.40\"/>";
        place.write("a.gpx", &format!("<gpx version=\"1.1\" creator=\"a\">{point}<rte/><trk/></gpx>"));
        for file in ["a.geojson", "a.kml", "a.gpx"] {
            let printed = place.run_ok(&["new", "city", "--sensors", file, "--force"]).stdout;
            assert!(
                printed.contains("ignored: 2 lines, polygons or other items without a point\n"),
                "{file}: {printed}"
            );
        }
    }

    #[test]
    fn bad_positions_are_refused_in_one_line_without_files() {
        let place = Place::new();
        for (file, text, says) in [
            ("a.csv", "x,y\n1,2\n3,four\n", "sensor positions a.csv: line 3: y = four: expected a number"),
            ("a.csv", "x,z\n1,2\n", "line 1: header `x,z`: expected columns x and y [m], or lat and lon [°]"),
            ("a.csv", "x,y\n", "no points: expected at least one sensor node"),
            ("a.csv", "x,y,queue\n1,2,40000\n", "sensor list a.csv: line 2: queue_bits = 40000"),
            ("a.csv", "lat,lon\n0,0\n10,100\n", "a.csv: line 3: lat_deg = 10, lon_deg = 100"),
            ("a.csv", "x,y,queue\n\n\n1,2,3\n\n1,2,40000\n", "a.csv: line 6: queue_bits = 40000"),
            ("a.json", "{\"type\":\"MultiPoint\",\"coordinates\":[[0,0],[100,10]]}", "a.json: point 2: lat_deg = 10"),
            ("a.kml", "<kml", "expected a KML file"),
            ("a.gpx", "<gpx/>", "a.gpx"),
            ("a.json", "[1, 2]", "expected GeoJSON"),
            ("a.shp", "x", "`.shp`: expected a file named .csv"),
        ] {
            place.write(file, text);
            place.run_refused(&["new", "bad", "--sensors", file], says);
            assert!(!place.path("bad").exists());
        }
    }
}
