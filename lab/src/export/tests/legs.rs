//! Tests of how near legs come to obstacles, against numbers worked by hand and against points along each leg.

use super::*;
use crate::export::clearance::LegClearance;
use crate::export::duration::MissionEffort;
use crate::export::vehicle::MissionPart;

/// Points along a leg that are compared.
const POINTS: u32 = 20_000;

/// A run over 200 m × 200 m from `start` [m], whose altitude is that of the start, that serves in all of `places`.
fn flown(area: &str, start: [f64; 3], places: &[[f64; 3]]) -> RecordedRun {
    let text = format!(
        "name = \"a\"\nslots = {}\n[area]\nside_m = 200.0\n{area}\n[uav]\nstart_m = [{:?}, {:?}]\naltitude_m = {:?}\n",
        places.len(),
        start[0],
        start[1],
        start[2]
    );
    let scenario = Scenario::parse(&text, Path::new("a"), Overrides::default()).unwrap();
    let list = SensorList::parse("x_m,y_m\n1,1\n", Path::new("l"), &scenario).unwrap();
    let slot = |(place, number): (&[f64; 3], u64)| {
        ByUav::from_buf([RecordedSlot {
            slot: number,
            uav: UAV,
            position: Point3::from(*place),
            scheduled: vec![0],
            delivered_bits: 1,
            lost_bits: 0,
            queued_bits: 0,
            mode: Mode::Serve,
            refused: 0,
            energy_j: f64::INFINITY,
        }])
    };
    let slots: Vec<_> = places.iter().zip(1..).map(slot).collect();
    let uploads_bits = slots.iter().map(|_| ByUav::from_buf([vec![1]])).collect();
    RecordedRun { scenario, list, strategy: "uts".to_owned(), slots, uploads_bits }
}

fn zone(corners: &str) -> String {
    format!("[[area.no_fly]]\npolygon_m = {corners}\n")
}

fn building(height_m: f64, corners: &str) -> String {
    format!("[[area.building]]\nheight_m = {height_m:?}\npolygon_m = {corners}\n")
}

const HALL: &str = "[[50.0, 50.0], [150.0, 50.0], [150.0, 100.0], [50.0, 100.0]]";

/// A flight, and the least distances of its legs [m] to zones, buildings, the boundary and the ground, by hand.
struct Case {
    name: &'static str,
    area: String,
    start: [f64; 3],
    places: Vec<[f64; 3]>,
    zone_m: Option<f64>,
    building_m: Option<f64>,
    fence_m: f64,
    ground_m: f64,
    /// Legs within 2 m of any, and the number of legs.
    near: [usize; 2],
}

impl Case {
    /// A flight from `start` to `end` and back, at 20 m, 20 m from the boundary.
    fn new(name: &'static str, area: String, start: [f64; 2], end: [f64; 2]) -> Self {
        let [start, end] = [start, end].map(|[x_m, y_m]| [x_m, y_m, 20.0]);
        let [zone_m, building_m] = [None; 2];
        Self { name, area, start, places: vec![end], zone_m, building_m, fence_m: 20.0, ground_m: 20.0, near: [0, 2] }
    }
}

fn cases() -> Vec<Case> {
    let square = "[[80.0, 80.0], [199.0, 80.0], [199.0, 199.0], [80.0, 199.0]]";
    let corner = vec![[80.0, 80.0, 20.0], [190.0, 70.0, 20.0]]; // and back the same way
    let bay = "[[50.0, 50.0], [150.0, 50.0], [150.0, 150.0], [140.0, 150.0], [140.0, 60.0], [60.0, 60.0], \
               [60.0, 150.0], [50.0, 150.0]]";
    let angle = "[[20.0, 20.0], [180.0, 20.0], [180.0, 30.0], [30.0, 30.0], [30.0, 180.0], [20.0, 180.0]]";
    let beside = "[[154.0, 150.0], [160.0, 150.0], [160.0, 156.0], [154.0, 156.0]]";
    let pond = "[[100.0, 31.2], [102.0, 31.2], [102.0, 33.2], [100.0, 33.2]]";
    let boundary = "boundary_m = [[0.0, 0.0], [200.0, 0.0], [200.0, 80.0], [80.0, 80.0], [80.0, 200.0], [0.0, 200.0]]";
    let house = "[[40.0, 50.0], [60.0, 50.0], [60.0, 100.0], [40.0, 100.0]]";
    let around = |name, area| Case {
        places: corner.clone(),
        fence_m: 10.0,
        near: [4, 4],
        ..Case::new(name, area, [70.0, 190.0], [0.0; 2])
    };
    vec![
        Case { zone_m: Some(0.0), ..around("past the corner of a zone", zone(square)) },
        Case { zone_m: Some(1.5), near: [2, 2], ..Case::new("along a zone", zone(HALL), [20.0, 48.5], [180.0, 48.5]) },
        Case { zone_m: Some(3.0), ..Case::new("towards a zone", zone(HALL), [100.0, 20.0], [100.0, 47.0]) },
        // The line x + y = 80 m, and the corner (50, 50).
        Case {
            zone_m: Some(20.0 / 2.0_f64.sqrt()),
            ..Case::new("across a corner", zone(HALL), [20.0, 60.0], [60.0, 20.0])
        },
        Case {
            zone_m: Some(1.2),
            near: [2, 2],
            ..Case::new("past a pond, far from both ends", zone(pond), [20.0, 30.0], [180.0, 30.0])
        },
        Case { zone_m: Some(3.0), fence_m: 30.0, ..Case::new("into a bay", zone(bay), [100.0, 170.0], [100.0, 63.0]) },
        Case {
            zone_m: Some(4.0),
            fence_m: 50.0,
            ..Case::new("in the box of a far zone", zone(angle) + &zone(beside), [100.0, 100.0], [150.0, 150.0])
        },
        Case { building_m: Some(5.0), ..Case::new("past a tower", building(50.0, HALL), [20.0, 45.0], [180.0, 45.0]) },
        Case {
            building_m: Some(0.5),
            near: [2, 2],
            ..Case::new("over a roof", building(19.5, HALL), [20.0, 75.0], [180.0, 75.0])
        },
        // 3 m beside and 4 m above.
        Case { building_m: Some(5.0), ..Case::new("beside a roof", building(16.0, HALL), [20.0, 47.0], [180.0, 47.0]) },
        // A climb of 1 in 5 from (10, 12), in x and z, past the eaves at (40, 10): (30 · 0.2 + 2)/√1.04.
        Case {
            start: [10.0, 75.0, 12.0],
            places: vec![[110.0, 75.0, 32.0]],
            building_m: Some(8.0 / 1.04_f64.sqrt()),
            fence_m: 10.0,
            ground_m: 12.0,
            ..Case::new("a climb over a roof", building(10.0, house), [0.0; 2], [0.0; 2])
        },
        Case {
            start: [10.0, 75.0, 30.0],
            places: vec![[50.0, 75.0, 12.0]],
            building_m: Some(2.0),
            fence_m: 10.0,
            ground_m: 12.0,
            ..Case::new("a descent to above a roof", building(10.0, house), [0.0; 2], [0.0; 2])
        },
        Case { fence_m: 0.0, ..around("past the corner of a boundary", boundary.to_owned()) },
        Case {
            fence_m: -3.0,
            near: [2, 2],
            ..Case::new("out of the area", String::new(), [100.0, 50.0], [100.0, -3.0])
        },
        Case {
            fence_m: 0.0,
            near: [2, 2],
            ..Case::new("from a home on the boundary", String::new(), [0.0, 100.0], [50.0, 100.0])
        },
        Case {
            start: [50.0, 50.0, 1.5],
            places: vec![[100.0, 50.0, 1.5]],
            fence_m: 50.0,
            ground_m: 1.5,
            near: [2, 2],
            ..Case::new("near the ground", String::new(), [0.0; 2], [0.0; 2])
        },
    ]
}

#[test]
fn the_least_distance_of_legs_is_that_by_hand() {
    for case in cases() {
        let run = flown(&case.area, case.start, &case.places);
        let mission = mission(&run, &forever());
        let found = clearance(&run, &mission, Some(0.0));
        let fence = found.fence.unwrap();
        for (what, found, expected_m) in [
            ("zone", found.zones, case.zone_m),
            ("building", found.buildings, case.building_m),
            ("fence", Some(fence), Some(case.fence_m)),
            ("ground", Some(found.ground), Some(case.ground_m)),
        ] {
            let away_m = found.map(|found| found.least_m);
            let is_right = match (away_m, expected_m) {
                (Some(away_m), Some(expected_m)) => (away_m - expected_m).abs() < 1e-5,
                (away_m, expected_m) => away_m == expected_m,
            };
            assert!(is_right, "{}: {away_m:?} m to the {what}, expected {expected_m:?}", case.name);
        }
        let near = [found.zones, found.buildings, Some(fence), Some(found.ground)];
        let near = near.iter().flatten().map(|clearance| clearance.near).max().unwrap();
        assert_eq!([near, found.legs], case.near, "{}", case.name);
    }
}

/// Distance of a point to an edge [m].
fn to_edge_m(at: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let [along_x_m, along_y_m] = [b[0] - a[0], b[1] - a[1]];
    let dot = (at[0] - a[0]) * along_x_m + (at[1] - a[1]) * along_y_m;
    let fraction = (dot / (along_x_m * along_x_m + along_y_m * along_y_m)).clamp(0.0, 1.0);
    (at[0] - a[0] - fraction * along_x_m).hypot(at[1] - a[1] - fraction * along_y_m)
}

/// Distance of a point to a polygon [m], 0 inside, by the angles under which its edges are seen.
fn to_polygon_m(at: [f64; 2], corners: &[[f64; 2]]) -> f64 {
    let edges = || (0..corners.len()).map(|index| [corners[index], corners[(index + 1) % corners.len()]]);
    let seen_rad = |[a, b]: [[f64; 2]; 2]| {
        let [u, v] = [a, b].map(|corner| [corner[0] - at[0], corner[1] - at[1]]);
        (u[0] * v[1] - u[1] * v[0]).atan2(u[0] * v[0] + u[1] * v[1])
    };
    let is_inside = edges().map(seen_rad).sum::<f64>().abs() > 3.0;
    if is_inside { 0.0 } else { edges().map(|edge| to_edge_m(at, edge)).fold(f64::INFINITY, f64::min) }
}

/// The least distance of points along a leg to a body over this polygon, up to `top_m` [m].
fn sampled_m([from, to]: [Point3<f64>; 2], corners: &[[f64; 2]], top_m: f64) -> f64 {
    let at = |step: u32| from + (to - from) * (f64::from(step) / f64::from(POINTS));
    let distance_m = |at: Point3<f64>| to_polygon_m([at.x, at.y], corners).hypot((at.z - top_m).max(0.0));
    (0..=POINTS).map(|step| distance_m(at(step))).fold(f64::INFINITY, f64::min)
}

/// A mission of a single leg.
fn single(leg: [Point3<f64>; 2]) -> VehicleMission {
    let effort = MissionEffort::default();
    let part = MissionPart { items: Vec::new(), path: leg.to_vec(), effort, timeline: Vec::new(), highest_m: None };
    let reference = AltitudeReference::Relative;
    VehicleMission {
        parts: vec![part],
        reference,
        home_ground_m: None,
        return_m: None,
        flown: Vec::new(),
        stops: Vec::new(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// A star of random radii, as a zone, a building and a boundary, and a leg anywhere, level or not.
    #[test]
    fn the_least_distance_of_a_leg_agrees_with_points_along_it(
        radii_m in prop::collection::vec(8.0..60.0_f64, 3..9),
        top_m in 5.0..40.0_f64,
        ends in prop::array::uniform2(prop::array::uniform3(2.0..198.0_f64)),
        is_level in any::<bool>(),
    ) {
        let corner = |(index, radius_m): (usize, &f64)| {
            let angle_rad = std::f64::consts::TAU * index as f64 / radii_m.len() as f64;
            [100.0 + radius_m * angle_rad.cos(), 100.0 + radius_m * angle_rad.sin()]
        };
        let corners: Vec<[f64; 2]> = radii_m.iter().enumerate().map(corner).collect();
        let area = zone(&format!("{corners:?}")) + &building(top_m, &format!("{corners:?}"));
        let mut leg = ends.map(|[x_m, y_m, z_m]| Point3::new(x_m, y_m, z_m / 4.0));
        if is_level {
            leg[1].z = leg[0].z;
        }
        let run = flown(&area, [1.0, 1.0, 20.0], &[[2.0, 1.0, 20.0]]);
        let found = MissionClearance::of(&track(&run), &single(leg), None, 2.0);
        let slack_m = (leg[1] - leg[0]).norm() / f64::from(POINTS) + 1e-9;
        for (found, top_m) in [(found.zones, f64::INFINITY), (found.buildings, top_m)] {
            let LegClearance { least_m, .. } = found.unwrap();
            let sampled_m = sampled_m(leg, &corners, top_m);
            prop_assert!((-1e-6..slack_m).contains(&(sampled_m - least_m)), "{least_m} m, by points {sampled_m} m");
        }
    }
}

#[test]
fn what_legs_come_near_to_is_said_with_the_remedy() {
    let square = "[[80.0, 80.0], [199.0, 80.0], [199.0, 199.0], [80.0, 199.0]]";
    let corner = [[80.0, 80.0, 20.0], [190.0, 70.0, 20.0]];
    let run = flown(&zone(square), [70.0, 190.0, 20.0], &corner);
    let passing = mission(&run, &forever());
    let said = warned(&run, &passing, Some(0.0));
    assert!(said.contains("4 of 4 legs pass within 2 m of a zone, 0.0 m at least: "), "{said}");
    assert!(!said.contains("geofence"), "{said}");
    let line = lines(&run, &forever()).into_iter().find(|line| line.contains("least distance"));
    assert_eq!(line.as_deref(), Some("least distance of 4 legs: 20.0 m to the ground, 0.0 m to a zone"));

    let home = flown("", [0.5, 100.0, 20.0], &[[50.0, 100.0, 20.0]]);
    let from_home = mission(&home, &forever());
    let said = warned(&home, &from_home, Some(0.0));
    assert!(said.contains("home is 0.5 m from the geofence"), "{said}");
    assert!(said.contains("2 of 2 legs lead out of the geofence or pass within 2 m of it, 0.5 m at least"), "{said}");
    let wider = warned(&home, &from_home, Some(1.5));
    assert!(!wider.contains("geofence"), "a fence 2 m away is not near: {wider}");
    assert!(!warned(&home, &from_home, None).contains("geofence"));

    let outside = flown("", [100.0, 50.0, 20.0], &[[100.0, -3.0, 20.0]]);
    let no_margin = MissionClearance::of(
        &track(&outside),
        &mission(&outside, &forever()),
        Some(&fence::border(&outside.scenario.area, 0.0)),
        0.0,
    );
    assert_eq!(no_margin.fence, Some(LegClearance { least_m: -3.0, near: 2 }), "without a margin, too");
}

/// A boundary of four corners and twelve ponds of ten; a building that is flown over is not in the file.
#[test]
fn the_corners_of_all_polygons_of_a_geofence_count() {
    let pond = |number: u32| {
        let corner = |index: u32| {
            let angle_rad = std::f64::consts::TAU * f64::from(index) / 10.0;
            [20.0 + 14.0 * f64::from(number) + 5.0 * angle_rad.cos(), 150.0 + 5.0 * angle_rad.sin()]
        };
        zone(&format!("{:?}", (0..10).map(corner).collect::<Vec<_>>()))
    };
    let said = |ponds: u32, more: &str| {
        let area: String = (0..ponds).map(pond).collect::<String>() + more;
        let run = flown(&area, [50.0, 50.0, 20.0], &[[100.0, 50.0, 20.0]]);
        warned(&run, &mission(&run, &forever()), Some(0.0))
    };
    assert!(
        said(12, "").contains("a geofence of 124 corners in 13 polygons: many vehicles take 60"),
        "{}",
        said(12, "")
    );
    let square = "[[80.0, 80.0], [99.0, 80.0], [99.0, 99.0], [80.0, 99.0]]";
    assert!(said(6, &building(30.0, square)).contains("a geofence of 68 corners in 8 polygons"));
    assert!(said(6, &building(10.0, square)).contains("a geofence of 64 corners in 7 polygons"));
    assert!(!said(5, "").contains("corners"));
}
