use super::*;

const UTM: &str = "PROJCS[\"WGS_1984_UTM_Zone_32N\",GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",\
    6378137.0,298.257223563]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],\
    PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"False_Easting\",500000.0],\
    PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",9.0],PARAMETER[\"Scale_Factor\",\
    0.9996],PARAMETER[\"Latitude_Of_Origin\",0.0],UNIT[\"Meter\",1.0]]";

const LONG_ISLAND_FEET: &str = "PROJCS[\"NAD_1983_StatePlane_New_York_Long_Island_FIPS_3104_Feet\",\
    GEOGCS[\"GCS_North_American_1983\",DATUM[\"D_North_American_1983\",SPHEROID[\"GRS_1980\",6378137.0,\
    298.257222101]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],\
    PROJECTION[\"Lambert_Conformal_Conic\"],PARAMETER[\"False_Easting\",984250.0],\
    PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",-74.0],\
    PARAMETER[\"Standard_Parallel_1\",41.0333333333333],PARAMETER[\"Standard_Parallel_2\",\
    40.6666666666667],PARAMETER[\"Latitude_Of_Origin\",40.1666666666667],UNIT[\"US survey foot\",\
    0.304800609601219]]";

const WEB: &str = "PROJCS[\"WGS_1984_Web_Mercator_Auxiliary_Sphere\",GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",\
    SPHEROID[\"WGS_1984\",6378137.0,298.257223563]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",\
    0.0174532925199433]],PROJECTION[\"Mercator_Auxiliary_Sphere\"],PARAMETER[\"False_Easting\",0.0],\
    PARAMETER[\"False_Northing\",0.0],PARAMETER[\"Central_Meridian\",0.0],\
    PARAMETER[\"Standard_Parallel_1\",0.0],PARAMETER[\"Auxiliary_Sphere_Type\",0.0],UNIT[\"Meter\",1.0]]";

/// LV95, whose datum has no shift in this text.
const SWISS: &str = "PROJCS[\"CH1903+_LV95\",GEOGCS[\"GCS_CH1903+\",DATUM[\"D_CH1903+\",SPHEROID[\"Bessel_1841\",\
    6377397.155,299.1528128]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]],\
    PROJECTION[\"Hotine_Oblique_Mercator_Azimuth_Center\"],PARAMETER[\"False_Easting\",2600000.0],\
    PARAMETER[\"False_Northing\",1200000.0],PARAMETER[\"Scale_Factor\",1.0],PARAMETER[\"Azimuth\",90.0],\
    PARAMETER[\"Longitude_Of_Center\",7.43958333333333],PARAMETER[\"Latitude_Of_Center\",\
    46.9524055555556],UNIT[\"Meter\",1.0]]";

const WGS84_DEGREES: &str = "GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",\
    6378137.0,298.257223563]],PRIMEM[\"Greenwich\",0.0],UNIT[\"Degree\",0.0174532925199433]]";

fn of_text(text: &str) -> ReferenceSystem {
    ReferenceSystem::of_text("a.prj", text).unwrap()
}

/// The distance [°] of what a position becomes from `expected`, the larger one of latitude and longitude.
fn error_deg(system: &ReferenceSystem, position: [f64; 2], expected: [f64; 2]) -> f64 {
    let found = system.on_earth().unwrap_or_else(|| panic!("{system}")).to_geodetic(position);
    let found = found.unwrap_or_else(|message| panic!("{system}: {message}"));
    found.iter().zip(expected).map(|(found, expected)| (found - expected).abs()).fold(0.0, f64::max)
}

/// 1 cm and 10 m of latitude [°].
const CENTIMETRE_DEG: f64 = 9e-8;
const METRES_DEG: f64 = 9e-5;

#[test]
fn positions_agree_with_another_library() {
    // pyproj 3.7 (PROJ 9): Transformer.from_crs(code, 4326, always_xy=True). Where it has a grid or better parameters
    // for the datum, within some metres.
    for (code, position, expected, error) in [
        ("EPSG:25832", [681_421.23, 5_777_697.61], [52.119_999_963, 11.650_000_031], CENTIMETRE_DEG),
        ("EPSG:32733", [500_000.0, 6_500_000.0], [-31.635_186_220, 15.0], CENTIMETRE_DEG),
        ("EPSG:2263", [987_000.0, 200_000.0], [40.715_630_071, -73.990_079_931], CENTIMETRE_DEG),
        ("EPSG:3857", [1_300_000.0, 6_800_000.0], [51.999_306_159, 11.678_098_694], CENTIMETRE_DEG),
        ("EPSG:2154", [652_000.0, 6_862_000.0], [48.856_248_141, 2.345_811_959], CENTIMETRE_DEG),
        ("EPSG:3035", [4_321_500.0, 3_210_500.0], [52.004_493_452, 10.007_281_079], CENTIMETRE_DEG),
        ("EPSG:2048", [50_000.0, 3_700_000.0], [-33.424_880_388, 18.462_384_469], CENTIMETRE_DEG),
        ("EPSG:2056", [2_600_100.5, 1_200_200.25], [46.952_884_058, 7.439_952_613], METRES_DEG),
        ("EPSG:31467", [3_513_000.0, 5_403_000.0], [48.764_381_393, 9.175_801_880], METRES_DEG),
        ("EPSG:27700", [530_000.0, 180_000.0], [51.503_990_828, -0.128_353_940], METRES_DEG),
        ("EPSG:28992", [121_500.0, 487_000.0], [52.369_856_937, 4.895_312_173], METRES_DEG),
        ("EPSG:5514", [-740_000.0, -1_040_000.0], [50.117_740_603, 14.454_431_599], METRES_DEG),
    ] {
        let system = ReferenceSystem::of_name(code).unwrap();
        let found = error_deg(&system, position, expected);
        assert!(found < error, "{code}: {found}° beside");
        assert_eq!(system.note().contains("exact to some metres"), error > CENTIMETRE_DEG, "{code}");
        assert!(system.is_map() && !system.is_wgs84());
    }
}

#[test]
fn texts_of_programs_are_the_systems_of_their_codes() {
    let expected = [52.119_999_963, 11.650_000_031];
    for text in [
        UTM.to_owned(),
        format!("\u{feff}{UTM}\r\n"),
        UTM.replace(',', ",\n  "),
        format!(
            "COMPD_CS[\"a + b\",{UTM},VERT_CS[\"b\",VERT_DATUM[\"b\",2005],UNIT[\"US survey foot\",0.3048006096]]]"
        ),
        format!("{UTM},VERTCS[\"EGM96\",VDATUM[\"EGM96\"],UNIT[\"Meter\",1.0]]"),
    ] {
        assert!(error_deg(&of_text(&text), [681_421.23, 5_777_697.61], expected) < CENTIMETRE_DEG, "{text}");
    }
    let feet = of_text(LONG_ISLAND_FEET);
    assert!(error_deg(&feet, [987_000.0, 200_000.0], [40.715_630_071, -73.990_079_931]) < CENTIMETRE_DEG);
    assert!((feet.on_earth().unwrap().unit_m() - 0.3048).abs() < 1e-6);
    let web = of_text(WEB);
    assert!(error_deg(&web, [1_300_000.0, 6_800_000.0], [51.999_306_159, 11.678_098_694]) < CENTIMETRE_DEG);
    let degrees = of_text(WGS84_DEGREES);
    assert!(degrees.is_wgs84() && !degrees.is_map());
    assert_eq!(degrees.to_string(), "a.prj says `GCS_WGS_1984`");
}

#[test]
fn a_datum_without_a_shift_is_refused_unless_its_code_is_known() {
    let unknown = of_text(SWISS);
    let Coordinates::Unknown(reason) = &unknown.coordinates else { panic!("{unknown}") };
    let refusal = unknown.refusal(reason);
    assert!(refusal.starts_with("a.prj says `CH1903+_LV95`: the shift of its datum to WGS84 is not known: expected"));
    assert!(refusal.contains("such as EPSG:25832 (--crs of `skysink new`)"), "{refusal}");
    let end = SWISS.rfind(']').unwrap();
    let known = of_text(&format!("{},AUTHORITY[\"EPSG\",\"2056\"]]", &SWISS[..end]));
    assert!(error_deg(&known, [2_600_100.5, 1_200_200.25], [46.952_884_058, 7.439_952_613]) < METRES_DEG);
    for text in ["Projection    UTM\nZone          32\n", "GEOGCS[\"", "PROJCS[\"a\",UNIT[\"m\",1]]", "\u{131}\u{250}"]
    {
        assert!(matches!(of_text(text).coordinates, Coordinates::Unknown(_)), "{text}");
    }
    assert!(ReferenceSystem::of_text("a.prj", " \n").is_none());
}

#[test]
fn planes_without_a_place_on_earth_are_in_metres() {
    for (text, reason) in [
        ("LOCAL_CS[\"site\",UNIT[\"German legal metre\",1.0000135965]]", None),
        ("ENGCRS[\"site\",CS[Cartesian,2],LENGTHUNIT[\"metre\",1]]", None),
        ("LOCAL_CS[\"site\",UNIT[\"Foot_US\",0.3048006]]", Some("its unit is `Foot_US`, 0.3048006 m")),
    ] {
        let Coordinates::Local(found) = of_text(text).coordinates else { panic!("{text}") };
        assert_eq!(found.err().as_deref(), reason, "{text}");
    }
}

#[test]
fn names_that_are_no_known_codes_are_refused_in_one_line() {
    for name in ["", "99999", "EPSG:", "EPSG:99999", "EPSG:1", "ESRI:102100", "UTM 32N", "EPSG:4978", "EPSG:26710"] {
        let refused = ReferenceSystem::of_name(name).unwrap_err();
        assert!(
            refused.starts_with(&format!("`{name}`: ")) && refused.contains("expected one whose shift"),
            "{refused}"
        );
    }
    for name in [
        "25832",
        "epsg:25832",
        " EPSG:25832 ",
        "urn:ogc:def:crs:EPSG::25832",
        "http://www.opengis.net/def/crs/EPSG/0/25832",
    ] {
        assert_eq!(ReferenceSystem::of_name(name).unwrap().to_string(), "EPSG:25832", "{name}");
    }
}

#[test]
fn positions_outside_of_a_map_are_refused() {
    let system = ReferenceSystem::of_name("EPSG:25832").unwrap();
    let system = system.on_earth().unwrap();
    let swapped = system.to_geodetic([5_777_687.0, 681_374.0]).unwrap_err();
    assert!(swapped.ends_with("east and north: is the northing first, or in feet?"), "{swapped}");
    for position in [[11.65, 52.12], [7e7, 7e7], [681_421.0, 5.8e8], [f64::NAN, 1e6], [f64::INFINITY, 1e6]] {
        assert!(system.to_geodetic(position).unwrap_err().contains(": expected "), "{position:?}");
    }
}
