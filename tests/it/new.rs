//! `skysink new`: what it writes can be checked and flown, and what it refuses leaves nothing.

use expect_test::expect_file;

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
fn invalid_names_are_refused_and_files_are_replaced_only_with_force() {
    Place::new().assert_transcript(&expect_file!["transcripts/new.txt"]);
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
            placemark("tower", "<extrude>1</extrude><altitudeMode>relativeToGround</altitudeMode>", corners[1]),
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
        place.run_ok(&["export", "run", "--format", "geojson", "--out", "back.geojson"]);
        place.run_ok(&["new", "back", "--force", "--zones", "back.geojson"]);
        let [first, back] = ["city/city.toml", "back/back.toml"].map(|name| read(&place, name).area);
        assert_eq!(back.no_fly.as_ref().map_or(0, Vec::len), 1);
        let heights_m =
            |area: &Area| area.building.iter().flatten().map(|building| building.height_m).collect::<Vec<_>>();
        assert_eq!((heights_m(&first), heights_m(&back)), (vec![30.5], vec![30.5]));
        let [first, back] = [first, back].map(|area| area.boundary_m.unwrap());
        assert_eq!(first.len(), back.len());
    }

    #[test]
    fn invalid_zones_are_refused() {
        let place = Place::new();
        place.write("zones.geojson", ZONES);
        place.assert_transcript(&expect_file!["transcripts/zones.txt"]);
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
                "{{\"type\":\"Feature\",\"properties\":{{\"name\":\"{name}\",\"rate\":{rate},\"owner\":1,\
                 \"ground_m\":80}},\"geometry\":{{\"type\":\"Point\",\"coordinates\":[{lon},52.50]}}}}"
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
        place.run_ok(&["export", "run", "--format", "geojson"]);
        let text = place.read("run.geojson");
        assert!(text.contains("soil-07") && text.contains("soil, dry") && !text.contains("SN 0"), "{text}");
        place.flight("city/city").out("again").simulate();
        place.run_ok(&["compare", "run", "again", "--no-record"]);
    }

    /// Metres are kept unless they are far from the origin. Taveuni, Fiji: 0.02 degrees of longitude at 16.8° south are
    /// 2 132 m, with margins a bit more than 2 152 m. Features without a point are counted.
    #[test]
    fn positions_become_fields_that_can_be_checked() {
        Place::new().assert_transcript(&expect_file!["transcripts/points.txt"]);
    }

    /// `sh poly FILE PROPERTIES CORNERS` writes a polygon as GeoJSON; a UAV starts in the middle of the area.
    const POLY: &str = r#"
        printf '{"type":"Feature","properties":{%s},"geometry":{"type":"Polygon","coordinates":[[[%s]]]}}' \
            "$2" "$(echo "$3" | sed 's/ /],[/g')" > $1"#;

    /// What other programs write becomes the field that was meant, or a line says what is odd, with its file and place.
    #[test]
    fn implausible_places_are_refused_or_said() {
        let place = Place::new();
        place.write("poly", POLY);
        place.write("nodes.csv", "lat,lon,name\n47.3972,8.5452,n1\n47.3988,8.5478,n2\n47.3990,8.5452,n3\n");
        place.write("utm32.prj", UTM);
        place.write("map.csv", MAP);
        place.write("map.geojson", MAP_ZONE);
        place.assert_transcript(&expect_file!["transcripts/places.txt"]);
    }

    /// What QGIS writes beside a table in UTM 32.
    const UTM: &str = "PROJCS[\"WGS_1984_UTM_Zone_32N\",GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\
                       \"WGS_1984\",6378137.0,298.257223563]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",\
                       0.0174532925199433]],PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"False_Easting\",500000.0],\
                       PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",9.0],PARAMETER[\
                       \"Scale_Factor\",0.9996],PARAMETER[\"Latitude_Of_Origin\",0.0],UNIT[\"Meter\",1.0]]";

    /// The corners of a field in UTM 32, [`CORNERS`] in WGS84 by PROJ 9, and a zone around its middle.
    const MAP: &str = "POINT_X,POINT_Y,name\n681421.23,5777697.61,west\n682447.96,5777735.23,east\n681384.67,\
                       5778698.38,north\n682411.19,5778735.99,ne\n";
    const CORNERS: [[f64; 2]; 4] = [[52.12, 11.65], [52.12, 11.665], [52.129, 11.65], [52.129, 11.665]];
    const MAP_ZONE: &str = "{\"type\":\"Polygon\",\"coordinates\":[[[682000,5778300],[682100,5778300],[682100,5778400],\
                            [682000,5778300]]]}";

    /// Sensor nodes and zones in metres of a map are exported within 2 cm of their latitude and longitude, whether an
    /// option, a `.prj` or a member `crs` names the system.
    #[test]
    fn metres_of_a_map_are_exported_where_they_lie() {
        let place = Place::new();
        place.write("map.csv", MAP);
        place.write("map.geojson", MAP_ZONE);
        place.write("named.csv", MAP);
        place.write("named.prj", UTM);
        let points = MAP.lines().skip(1).map(|line| {
            let [x, y] = [0, 1].map(|column| line.split(',').nth(column).unwrap());
            format!("[{x},{y}]")
        });
        let points = points.collect::<Vec<_>>().join(",");
        let crs = "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::25832\"}}";
        place.write("own.geojson", &format!("{{\"type\":\"MultiPoint\",{crs},\"coordinates\":[{points}]}}"));
        for (list, option) in [
            ("map.csv", &["--crs", "EPSG:25832", "--zones", "map.geojson"][..]),
            ("named.csv", &["--start", "681900,5778200"]),
            ("own.geojson", &["--crs", "EPSG:25832", "--zones", "map.geojson"]),
        ] {
            place.run_ok(&[&["new", "utm", "--force", "--sensors", list], option].concat());
            let run = ["simulate", "utm/utm.toml", "--force", "--strategy", "tour", "--set", "slots=9", "--out", "run"];
            place.run_ok(&run);
            place.run_ok(&["export", "run", "--force", "--format", "geojson"]);
            let exported: serde_json::Value = serde_json::from_str(&place.read("run.geojson")).unwrap();
            let nodes = exported["features"].as_array().unwrap().iter();
            let nodes = nodes.filter(|feature| feature["properties"]["kind"] == "sensor node");
            let nodes: Vec<[f64; 2]> =
                nodes.map(|node| [1, 0].map(|axis| node["geometry"]["coordinates"][axis].as_f64().unwrap())).collect();
            assert_eq!(nodes.len(), 4);
            for (found, expected) in nodes.iter().zip(CORNERS) {
                let north_m = (found[0] - expected[0]) * 111_260.0;
                let east_m = (found[1] - expected[1]) * 111_320.0 * expected[0].to_radians().cos();
                assert!(north_m.hypot(east_m) < 0.02, "{list}: {found:?} is {north_m} m, {east_m} m from {expected:?}");
            }
        }
    }

    /// A flight that is exported comes back as its sensor nodes, in GeoJSON.
    #[test]
    fn exported_sensor_nodes_come_back() {
        let place = Place::new();
        place.write("nodes.csv", "lat,lon,name\n-16.501,180,post & pier\n-16.5,-179.999,\n");
        place.run_ok(&["new", "city", "--sensors", "nodes.csv"]);
        place.run_ok(&["simulate", "city/city.toml", "--strategy", "tour", "--set", "slots=9", "--out", "run"]);
        place.run_ok(&["export", "run", "--format", "geojson"]);
        place.run_ok(&["new", "back", "--force", "--sensors", "run.geojson"]);
        let [first, back] = ["city/city.toml", "back/back.toml"].map(|name| {
            let list = SensorList::of(&read(&place, name)).unwrap();
            let places: Vec<Position> = list.sensors().iter().map(|sensor| sensor.position).collect();
            (places, [0, 1].map(|id| list.label(id)))
        });
        assert_eq!((first.0.len(), back.0.len(), &first.1), (2, 2, &back.1));
        let moved_m = (first.0[1] - first.0[0] - (back.0[1] - back.0[0])).norm();
        assert!(moved_m < 1e-3, "{moved_m} m");
        place.run_ok(&["export", "run", "--format", "csv"]);
        place.run_refused(
            &["new", "back", "--force", "--sensors", "run.csv"],
            "columns slot and scheduled, of a flight",
        );
    }

    /// A KML document in a KMZ archive, deflated, and in UTF-16.
    #[test]
    fn archives_and_encodings_of_xml_are_read() {
        let place = Place::new();
        let document = "<?xml version=\"1.0\" encoding=\"utf-16\"?><kml><Placemark><name>Wäldli</name><Point>\
                        <coordinates>8.5456,47.3977</coordinates></Point></Placemark></kml>";
        let utf16: Vec<u8> = document.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        archive.start_file("files/photo.png", zip::write::SimpleFileOptions::default()).unwrap();
        archive.start_file("doc.kml", zip::write::SimpleFileOptions::default()).unwrap();
        std::io::Write::write_all(&mut archive, document.as_bytes()).unwrap();
        std::fs::write(place.path("a.kmz"), archive.finish().unwrap().into_inner()).unwrap();
        std::fs::write(place.path("a.kml"), utf16).unwrap();
        for file in ["a.kmz", "a.kml"] {
            place.run_ok(&["new", "a", "--force", "--sensors", file]);
            assert_eq!(place.read("a/sensors.csv"), "lat_deg,lon_deg,name\n47.3977,8.5456,Wäldli\n", "{file}");
        }
        std::fs::write(place.path("b.kmz"), document).unwrap();
        place.run_refused(&["new", "b", "--sensors", "b.kmz"], "expected a KMZ file, a zip archive with a KML file");
    }

    #[test]
    fn invalid_positions_are_refused_without_files() {
        Place::new().assert_transcript(&expect_file!["transcripts/positions.txt"]);
    }
}
