//! Tests of the ground and of missions over hills.

use super::*;

/// Hills of 60 m, told by an SN in each square of 100 m.
pub(super) fn hills(x_m: f64, y_m: f64) -> f64 {
    200.0 + 60.0 * (x_m / 150.0).sin() * (y_m / 130.0).cos()
}

pub(super) fn hilly_list() -> String {
    let cells = (0..10).flat_map(|column| (0..4).map(move |row| (100.0 * f64::from(column), 100.0 * f64::from(row))));
    let rows: String = cells.map(|(x_m, y_m)| format!("{x_m},{y_m},{}\n", hills(x_m, y_m))).collect();
    format!("x_m,y_m,ground_m\n{rows}")
}

#[test]
fn altitudes_above_home_or_sea_level_clear_every_leg() {
    let steps: Vec<_> = std::iter::repeat_n((27.0, Some(1)), 30).collect();
    let run = run_in("", &hilly_list(), &steps);
    let at = |altitude| mission(&run, &VehicleMissionOptions { altitude, ..forever() });
    assert_eq!(at(None).reference, AltitudeReference::Relative, "the default of PX4, which refuses that frame");
    let terrain = mission(&run, &VehicleMissionOptions { autopilot: Some(Autopilot::Ardupilot), ..forever() });
    assert_eq!(terrain.reference, AltitudeReference::Terrain, "the default of ArduPilot over hills");
    assert!(waypoints(&terrain.parts[0].items).iter().all(|(_, altitude_m, _)| *altitude_m == 20.0));
    for reference in [AltitudeReference::Relative, AltitudeReference::Msl] {
        let items = at(Some(reference)).parts.remove(0).items;
        let VehicleItem::TakeOff { altitude_m: take_off_m, .. } = items[0] else { panic!("{items:?}") };
        let level_m = if reference == AltitudeReference::Relative { hills(0.0, 0.0) } else { 0.0 };
        let first = (Point2::origin(), take_off_m + hills(0.0, 0.0), 0.0);
        let rest = waypoints(&items).into_iter().map(|(at, altitude_m, hold_s)| (at, altitude_m + level_m, hold_s));
        let nodes: Vec<_> = std::iter::once(first).chain(rest).collect();
        for pair in nodes.windows(2) {
            for step in 0..=50 {
                let fraction = f64::from(step) / 50.0;
                let at = pair[0].0 + (pair[1].0 - pair[0].0) * fraction;
                let clearance_m = pair[0].1 + (pair[1].1 - pair[0].1) * fraction - hills(at.x, at.y);
                assert!((20.0 - 1e-9..200.0).contains(&clearance_m), "{reference:?} {at}: {clearance_m} m");
            }
        }
    }
    let flat = super::run(&steps);
    let message = refusal(&flat, &VehicleMissionOptions { altitude: Some(AltitudeReference::Msl), ..forever() });
    assert!(message.contains("--altitude msl: expected a sensor list with the column ground_m"), "{message}");
    assert_eq!(mission(&flat, &forever()).reference, AltitudeReference::Relative);
}

/// SNs on a slope of 20 % from 400 m east of home on, whose ground is as high as theirs.
#[test]
fn a_known_ground_at_home_keeps_a_relative_mission_low() {
    let steps: Vec<_> = std::iter::repeat_n((27.0, Some(1)), 15).collect();
    let run = run_in("", "x_m,y_m,ground_m\n400,0,100\n500,0,120\n400,9,100\n500,9,120\n", &steps);
    let at = |home_ground| {
        let altitude = Some(AltitudeReference::Relative);
        mission(&run, &VehicleMissionOptions { altitude, home_ground, ..forever() })
    };
    let said = |mission: &VehicleMission| warned(&run, mission, None);
    let guessed = at(None);
    // With 25 %, home is at 0 to 200 m: 20 m above the highest are 220 m above the lowest.
    assert!(guessed.home_ground_m.unwrap().abs() < 1e-9);
    assert!((220.0..221.0).contains(&guessed.parts[0].highest_m.unwrap()), "{:?}", guessed.parts[0].highest_m);
    assert!(said(&guessed).contains("m above the ground, more than 120 m: give --home-ground"), "{}", said(&guessed));
    let known = at(Some(100.0));
    assert_eq!(known.home_ground_m, Some(100.0));
    assert!(known.parts[0].highest_m.unwrap() < 120.0 && !said(&known).contains("above the ground"));
}

#[test]
fn ground_heights_between_sensor_nodes_stay_within_their_bounds() {
    let run = run_in("", &hilly_list(), &[(1.0, None)]);
    let ground = Ground::of(&run.list).unwrap();
    for x in 0..90 {
        for y in 0..30 {
            let at = Point2::new(10.0 * f64::from(x), 10.0 * f64::from(y));
            let truth_m = hills(at.x, at.y);
            let slack_m = if x % 10 == 0 && y % 10 == 0 { 1e-9 } else { 0.0 };
            let low_m = ground.lowest_m(&at) - slack_m;
            let high_m = ground.highest_m(&at) + slack_m;
            assert!(low_m <= truth_m && truth_m <= high_m, "{at}: {low_m} to {high_m}, {truth_m}");
        }
    }
}

/// The ground in metres of a list of `x_m,y_m,ground_m`.
fn ground(rows: &str) -> Ground {
    Ground::of(&run_in("", &format!("x_m,y_m,ground_m\n{rows}"), &[(1.0, None)]).list).unwrap()
}

#[test]
fn clustered_sensor_nodes_all_contribute_ground_heights() {
    let ground = ground("100,100,400\n103,100,425\n100,100,412\n500,100,410\n");
    for (x_m, truth_m) in [(100.0, 412.0), (103.0, 425.0), (500.0, 410.0)] {
        assert!(ground.highest_m(&Point2::new(x_m, 100.0)) >= truth_m, "at {x_m} m");
    }
    assert!(ground.lowest_m(&Point2::new(100.0, 100.0)) <= 400.0);
    assert!(ground.highest_between_m(&Point2::new(50.0, 100.0), &Point2::new(150.0, 100.0)) >= 425.0);
}

/// Two groups of ten, 400 m and 700 m high and some 800 m apart: the slope is that between them.
#[test]
fn slopes_between_groups_of_sensor_nodes_are_interpolated() {
    let group = |x_m: f64, ground_m: f64| -> String {
        (0..10).map(|row| format!("{x_m},{},{ground_m}\n", 100.0 + 10.0 * f64::from(row))).collect()
    };
    let ground = ground(&(group(100.0, 400.0) + &group(900.0, 700.0)));
    for step in 0..=80 {
        let x_m = 100.0 + 10.0 * f64::from(step);
        let truth_m = 400.0 + 300.0 * f64::from(step) / 80.0;
        let at = Point2::new(x_m, 145.0);
        assert!(ground.highest_m(&at) >= truth_m && ground.lowest_m(&at) <= truth_m, "{x_m} m: {truth_m} m");
    }
}

/// The ground between the last two SNs may be as high as the steepest slope, 0.5 · 1.25, lets it rise over 100 m.
#[test]
fn a_return_over_hills_clears_the_ground_between_sensor_nodes() {
    let list = "x_m,y_m,ground_m\n0,0,0\n10,0,5\n100,0,0\n300,0,0\n";
    let run = run_in("", list, &[(300.0, Some(1))]);
    for altitude in [AltitudeReference::Terrain, AltitudeReference::Relative] {
        let is_terrain = altitude == AltitudeReference::Terrain;
        let said = lines(&run, &VehicleMissionOptions { altitude: Some(altitude), ..forever() }).join("\n");
        assert!(said.contains("to 85 m above home or more"), "20 m + 62.5 m and half a step of 5 m: {said}");
        assert_eq!(said.contains("(planned: 1 s), without climbs and descents along the ground"), is_terrain, "{said}");
    }
}
