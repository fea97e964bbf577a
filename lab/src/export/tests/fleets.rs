//! Tests of the distances between the missions of a fleet in time.

use super::*;
use crate::export::duration::TimedPosition;
use crate::export::separation;
use skysink_common::geometry::Position;

/// A run of UAVs that fly from their starts [m] to these places [m], one in each slot.
fn fleet(more: &str, starts: &[[f64; 2]], places: &[&[[f64; 2]]]) -> RecordedRun {
    let slots = places[0].len();
    let count = starts.len();
    let text = format!(
        "name = \"a\"\nslots = {slots}\n[area]\nside_m = 1e4\n[uav]\nmax_speed_mps = 10.0\nacceleration_mps2 = 2.5\n\
         count = {count}\nstarts_m = {starts:?}\n{more}"
    );
    let scenario = Scenario::parse(&text, Path::new("a"), Overrides::default()).unwrap();
    let list = SensorList::parse("x_m,y_m\n1,1\n2,2\n", Path::new("l"), &scenario).unwrap();
    let slot = |index: usize| -> ByUav<RecordedSlot> {
        let of_uav = |uav: usize| RecordedSlot {
            slot: index as u64 + 1,
            uav,
            position: Point3::new(places[uav][index][0], places[uav][index][1], 20.0),
            scheduled: vec![uav as u32],
            delivered_bits: 1,
            lost_bits: 0,
            queued_bits: 0,
            mode: Mode::Serve,
            refused: 0,
            energy_j: f64::INFINITY,
        };
        (0..count).map(of_uav).collect()
    };
    let uploads_bits = (0..slots).map(|_| (0..count).map(|_| vec![1]).collect()).collect();
    RecordedRun { scenario, list, strategy: "uts".to_owned(), slots: (0..slots).map(slot).collect(), uploads_bits }
}

fn missions(run: &RecordedRun) -> Vec<VehicleMission> {
    let uavs = 0..run.scenario.uav.uavs();
    uavs.map(|uav| plan(&GeodeticTrack::new(run, uav, EQUATOR).unwrap(), &forever()).unwrap()).collect()
}

/// Where a UAV is at a time [m]; `None` on the ground.
fn place(nodes: &[TimedPosition], time_s: f64) -> Option<Position> {
    let after = nodes.iter().position(|node| node.time_s >= time_s)?;
    let before = nodes.get(after.checked_sub(1)?)?;
    let fraction = (time_s - before.time_s) / (nodes[after].time_s - before.time_s);
    Some(before.at + (nodes[after].at - before.at) * fraction)
}

/// The least distance of two UAVs in the air, at times a tenth of a second apart [m].
fn sampled_m(missions: &[VehicleMission], delays_s: &[f64]) -> f64 {
    let mut least_m = f64::INFINITY;
    for step in 0..100_000 {
        let time_s = f64::from(step) * 0.1;
        let places =
            missions.iter().zip(delays_s).map(|(mission, delay_s)| place(&mission.parts[0].timeline, time_s - delay_s));
        let places: Vec<Position> = places.flatten().collect();
        for (index, first) in places.iter().enumerate() {
            least_m = places[..index].iter().map(|second| (first - second).norm()).fold(least_m, f64::min);
        }
    }
    least_m
}

/// The delays of the starts that the lines say [s].
fn delays_s(lines: &[String], uavs: usize) -> Vec<f64> {
    let said = lines.iter().find_map(|line| line.strip_prefix("start ")).expect("delays");
    let mut delays_s = vec![0.0; uavs];
    for part in said.split(", ") {
        let words: Vec<&str> = part.split(' ').collect();
        delays_s[words[1].parse::<usize>().unwrap()] = words[3].parse().unwrap();
    }
    delays_s
}

/// Two UAVs that change places on a line, at once: they meet in its middle.
#[test]
fn uavs_that_meet_are_refused_with_the_delays_that_keep_them_apart() {
    let run = fleet("separation_m = 30.0\n", &[[0.0, 50.0], [400.0, 50.0]], &[&[[400.0, 50.0]], &[[0.0, 50.0]]]);
    let missions = missions(&run);
    let nearest = separation::nearest(&missions, &[0.0, 0.0]).unwrap();
    assert!(nearest.distance_m < 1e-9 && nearest.uavs == [0, 1], "{nearest:?}");
    let refusal = separation::lines(&run.scenario, &missions, false).unwrap_err().to_string();
    assert!(refusal.contains("UAV 0 and UAV 1 come within 0.0 m of each other"), "{refusal}");
    assert!(refusal.contains("at (200.0 m, 50.0 m), less than uav.separation_m = 30: pass --stagger"), "{refusal}");
    let lines = separation::lines(&run.scenario, &missions, true).unwrap();
    let delays_s = delays_s(&lines, 2);
    assert!(refusal.ends_with(&format!("to start UAV 1 after {} s", delays_s[1])), "{refusal}, {lines:?}");
    assert!(sampled_m(&missions, &delays_s) >= 30.0, "{lines:?}");
    assert!(delays_s[1] > 0.0 && sampled_m(&missions, &[0.0, delays_s[1] - 5.0]) < 30.5, "no shorter: {lines:?}");
}

#[test]
fn uavs_of_one_home_start_when_that_before_has_landed() {
    let home = [50.0, 50.0];
    let run = fleet("separation_m = 5.0\n", &[home; 3], &[&[[90.0, 50.0]], &[[50.0, 90.0]], &[[90.0, 90.0]]]);
    let missions = missions(&run);
    let delays_s = delays_s(&separation::lines(&run.scenario, &missions, true).unwrap(), 3);
    let durations_s: Vec<f64> = missions.iter().map(|mission| mission.parts[0].effort.duration_s).collect();
    assert!(
        delays_s[1] >= durations_s[0] && delays_s[2] >= delays_s[1] + durations_s[1],
        "{delays_s:?}, {durations_s:?}"
    );
}

#[test]
fn distances_of_a_fleet_are_said() {
    let apart = [[0.0, 0.0], [0.0, 100.0]];
    let places: &[&[[f64; 2]]] = &[&[[500.0, 0.0]], &[[500.0, 100.0]]];
    for (more, expected) in [("", "UAVs stay 100.0 m apart"), ("separation_m = 99.0\n", "UAVs stay 100.0 m apart")] {
        let run = fleet(more, &apart, places);
        let said = separation::lines(&run.scenario, &missions(&run), false).unwrap().join("\n");
        assert!(said.contains(expected) && said.contains("2 missions that do not know of each other"), "{said}");
    }
    let run = fleet("", &apart, places);
    let text = separation::lines(&run.scenario, &missions(&run), true).unwrap_err().to_string();
    assert!(text.contains("--stagger: expected uav.separation_m"), "{text}");
    let alone = super::run(&[(30.0, Some(1))]);
    let missions = [mission(&alone, &forever())];
    assert_eq!(separation::lines(&alone.scenario, &missions, false).unwrap(), Vec::<String>::new());
    let text = separation::lines(&alone.scenario, &missions, true).unwrap_err().to_string();
    assert!(text.contains("--stagger: expected several UAVs"), "{text}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_nearest_approach_agrees_with_points_in_time(
        starts in prop::array::uniform2(prop::array::uniform2(0.0..300.0_f64)),
        first in prop::collection::vec(prop::array::uniform2(0.0..300.0_f64), 4),
        second in prop::collection::vec(prop::array::uniform2(0.0..300.0_f64), 4),
        delay_s in 0.0..60.0_f64,
    ) {
        let run = fleet("", &starts, &[&first, &second]);
        let missions = missions(&run);
        let nearest = separation::nearest(&missions, &[0.0, delay_s]).unwrap();
        let sampled_m = sampled_m(&missions, &[0.0, delay_s]);
        // Two UAVs at 10 m/s come at most 2 m nearer to each other in a tenth of a second.
        prop_assert!((-1e-6..2.0).contains(&(sampled_m - nearest.distance_m)), "{nearest:?}, by times {sampled_m} m");
    }
}
