//! `planner.objective = "collect"`: plans that deliver most until the mission's end.

use std::path::Path;

use skysink_common::checkpoint::Checkpoint;
use skysink_common::message::Mode;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_planner::Planner;

use crate::support::{TestMission, scenario_of};

const COLUMNS: i64 = 5;
const ROWS: i64 = 4;
const SLOTS: usize = 9;

/// A grid of 5 × 4 cells of 10 m, with a base in its south-western cell; SNs that sample nothing and a narrow link.
fn small(strategy: &'static str, seed: u64) -> (Scenario, SensorList, Vec<([f64; 2], f64)>) {
    let text = format!(
        "slots = {SLOTS}\n[area]\nwidth_m = 50.0\nheight_m = 40.0\n[sensors]\nsampling_bps = 0.0\ncapacity_bits = 9000000\n\
         [uav]\naltitude_m = 5.0\nmax_speed_mps = 10.0\nmoves = 'grid'\nstart_m = [5.0, 5.0]\nmust_land = true\n[link]\n\
         bandwidth_hz = 1e6\ntx_power_w = 1e-5\ngain_db = -60.0\ncomm_radius_m = 100.0\ncomm_s = 1.0\nresource_blocks = 1\n\
         [planner]\nobjective = 'collect'\nhorizon.iterations = 400\noffline.steps = 160000\n"
    );
    let scenario = scenario_of(&text, strategy, seed);
    // Places and queues by a linear congruence.
    let mut state = seed * 7_919 + 13;
    let mut next = |count: u64| {
        state = (state * 1_103_515_245 + 12_345) % (1 << 31);
        (state >> 8) % count
    };
    let mut list = "x_m,y_m,queue_bits\n".to_owned();
    let mut field = Vec::new();
    for _ in 0..4 {
        let [x_m, y_m, bits] = [next(50), next(40), 1_000_000 + next(3_000_000)].map(|number| number as f64);
        list += &format!("{x_m},{y_m},{bits}\n");
        field.push(([x_m, y_m], bits));
    }
    let list = SensorList::parse(&list, Path::new("list.csv"), &scenario).unwrap();
    (scenario, list, field)
}

/// The most bits that any flight delivers from `cell` in `left` slots, landed: all sequences of moves are tried.
fn best_bits(field: &[([f64; 2], f64)], queues_bits: &mut [f64], cell: [i64; 2], left: usize) -> f64 {
    if left == 0 {
        return 0.0;
    }
    let mut best: f64 = 0.0;
    for [east, north] in [[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]] {
        let [x, y] = [cell[0] + east, cell[1] + north];
        if !(0..COLUMNS).contains(&x) || !(0..ROWS).contains(&y) || x + y > left as i64 - 1 {
            continue;
        }
        let at = [x, y].map(|index| 10.0 * index as f64 + 5.0);
        // γ = 10^−6 · 10^−5/10^−13 = 100 at 1 m, 1 MHz for 1 s.
        let carried_bits = |[x_m, y_m]: [f64; 2]| {
            let d2_m2 = (at[0] - x_m).powi(2) + (at[1] - y_m).powi(2) + 25.0;
            (1e6 * (1.0 + 100.0 / d2_m2).log2()).floor()
        };
        let uploads = field.iter().zip(queues_bits.iter()).map(|((place, _), bits)| carried_bits(*place).min(*bits));
        let (sensor, bits) = uploads.enumerate().reduce(|a, b| if b.1 > a.1 { b } else { a }).unwrap();
        queues_bits[sensor] -= bits;
        best = best.max(bits + best_bits(field, queues_bits, [x, y], left - 1));
        queues_bits[sensor] += bits;
    }
    best
}

#[test]
fn plans_deliver_nearly_the_optimum() {
    let mut flown_bits = 0.0;
    let mut most_bits = 0.0;
    for seed in 1..=6 {
        for strategy in ["horizon", "offline"] {
            let (scenario, list, field) = small(strategy, seed);
            let mut queues_bits: Vec<f64> = field.iter().map(|(_, bits)| *bits).collect();
            let best = best_bits(&field, &mut queues_bits, [0, 0], SLOTS);
            let mut mission = TestMission::over(&scenario, &list);
            mission.by_ref().for_each(drop);
            let end = mission.last_flight().position();
            assert!((end.x - 5.0).hypot(end.y - 5.0) < 1e-6, "{strategy}, seed {seed}: ends at {end}");
            let delivered = mission.plant().field().totals().delivered_bits as f64;
            assert!(delivered <= best + SLOTS as f64, "{strategy}, seed {seed}: {delivered} above {best}");
            assert!(delivered >= 0.97 * best, "{strategy}, seed {seed}: {delivered} of {best}");
            flown_bits += delivered;
            most_bits += best;
        }
    }
    assert!(flown_bits > 0.995 * most_bits, "{flown_bits} of {most_bits}");
}

/// In the open, with more SNs than resource blocks, what they sample, weights, and a charger.
const OPEN: &str = "slots = 150\n[area]\nside_m = 300.0\n[sensors]\ncount = 30\nsampling_bps = [0.0, 200.0]\n\
                    [link]\nresource_blocks = 2\n[base]\ncharge_w = 500.0\n[uav.battery]\ncapacity_j = 15000.0\n[planner]\n\
                    objective = 'collect'\nhorizon.iterations = 40\noffline.steps = 40000\n";

/// Buffers that fill in one to two slots, and queues that are empty at first, in a slot or more of flight.
#[test]
fn plans_fetch_what_is_sampled_on_the_way() {
    let of_field = |capacity_bits: u32, bps: u32| {
        format!(
            "slots = 60\n[sensors]\ncount = 3\ncapacity_bits = {capacity_bits}\nsampling_bps = {bps}\n\
             initial_queue_mean_bits = 0.0\n[link]\ncomm_radius_m = 12.0\n[planner]\nobjective = 'collect'\n\
             horizon.iterations = 20\noffline.steps = 20000\n"
        )
    };
    for (field, strategy) in [of_field(1_000, 1_000), of_field(1_000, 600), of_field(30_000, 100)]
        .iter()
        .flat_map(|field| [(field, "horizon"), (field, "offline")])
    {
        let delivered = |strategy| {
            let mut mission = TestMission::new(&scenario_of(field, strategy, 2));
            mission.by_ref().for_each(drop);
            mission.plant().field().totals().delivered_bits as f64
        };
        let [own, tour] = [delivered(strategy), delivered("tour")];
        assert!(own > 0.6 * tour && own > 0.0, "{strategy}: {own}, tour {tour}, {field}");
    }
}

#[test]
fn a_restarted_planner_continues_its_plan() {
    for strategy in ["horizon", "offline"] {
        for knowledge in ["oracle", "estimated"] {
            let scenario = scenario_of(&format!("{OPEN}knowledge = '{knowledge}'\n"), strategy, 3);
            let [mut one, mut other] = [0; 2].map(|_| TestMission::new(&scenario));
            let mut charged = 0;
            for slot in 1..=scenario.slots {
                if slot % 7 == 0 {
                    other.restart();
                }
                assert_eq!(format!("{:?}", one.advance()), format!("{:?}", other.advance()), "{strategy}, {slot}");
                charged += u64::from(one.last_flight().flown_mode() == Mode::Charge);
                assert_eq!(one.last_flight().refused, 0, "{strategy}, {slot}");
            }
            assert!(charged > 0, "{strategy}");
        }
    }
}

#[test]
fn collect_delivers_more_than_horizon_where_nothing_is_sampled() {
    // Nothing can be lost, so the look-ahead for the loss has nothing to plan.
    let text = "slots = 40\n[area]\nside_m = 300.0\n[sensors]\ncount = 30\nsampling_bps = 0.0\n[planner]\n\
                horizon.iterations = 100\nobjective = ";
    let delivered = |objective: &str| {
        let mut mission = TestMission::new(&scenario_of(&format!("{text}'{objective}'\n"), "horizon", 2));
        mission.by_ref().for_each(drop);
        mission.plant().field().totals().delivered_bits
    };
    let [loss, collect] = ["loss", "collect"].map(delivered);
    assert!(collect as f64 > 1.2 * loss as f64, "{collect} {loss}");
}

#[test]
fn a_uav_with_position_errors_continues_to_the_next_stop() {
    for strategy in ["horizon", "offline"] {
        let text = "slots = 60\n[area]\nside_m = 200.0\n[sensors]\ncount = 8\nsampling_bps = 0.0\n[planner]\n\
                    objective = 'collect'\nhorizon.iterations = 20\noffline.steps = 20000\n[uav]\nposition_error_m = ";
        let delivered = |sigma_m: &str| {
            let mut mission = TestMission::new(&scenario_of(&format!("{text}{sigma_m}\n"), strategy, 2));
            mission.by_ref().for_each(drop);
            mission.plant().field().totals().delivered_bits as f64
        };
        let [exact, beside] = ["0.0", "1.0"].map(delivered);
        assert!(beside > 0.8 * exact && exact > 0.0, "{strategy}: {beside} {exact}");
    }
}

#[test]
fn the_path_contains_the_stops_and_the_return() {
    let (scenario, list, _) = small("horizon", 1);
    let mut mission = TestMission::over(&scenario, &list);
    mission.advance();
    let path = mission.planner.path(0);
    assert!(path.len() > 1 && (path[path.len() - 1].xy() - nalgebra::Point2::new(5.0, 5.0)).norm() < 1e-9, "{path:?}");
}

#[test]
fn saved_plans_of_another_field_are_refused() {
    let scenario = scenario_of(OPEN, "horizon", 3);
    let mut mission = TestMission::new(&scenario);
    mission.advance();
    let saved = mission.saved();
    let fewer = scenario_of(&OPEN.replace("count = 30", "count = 1"), "horizon", 3);
    let mut other = TestMission::new(&fewer);
    assert!(other.planner.restore(&saved).is_err());
    let mut same = Planner::new(&scenario, &mission.nodes).unwrap();
    assert!(same.restore(&saved[..saved.len() - 1]).is_err() && same.restore(&saved).is_ok());
}

#[test]
fn collect_delivers_more_than_horizon_where_sensor_nodes_sample() {
    for strategy in ["horizon", "offline"] {
        let mut sums = [0; 2];
        for seed in 1..=3 {
            let delivered = |objective: &str| {
                let text = format!(
                    "slots = 150\n[area]\nside_m = 400.0\n[sensors]\ncount = 60\nsampling_bps = 150.0\n[base]\n\
                     [uav]\nmust_land = true\n[planner]\nobjective = '{objective}'\nhorizon.iterations = 60\n\
                     offline.steps = 60000\n"
                );
                let mut mission = TestMission::new(&scenario_of(&text, strategy, seed));
                mission.by_ref().for_each(drop);
                mission.plant().field().totals().delivered_bits
            };
            let [collect, loss] = ["collect", "loss"].map(delivered);
            // It may begin with the plan of least loss, and not find a better one.
            assert!(collect >= loss, "{strategy}, seed {seed}: {collect} and {loss} bits");
            sums = [sums[0] + collect, sums[1] + loss];
        }
        assert!(sums[0] > sums[1], "{strategy}: {sums:?} bits");
    }
}

/// What became of the proposals of a search is counted, by operator, and a restart counts on.
#[test]
fn operators_count_what_they_proposed_and_what_became_of_it() {
    for (objective, operators) in [("loss", 5), ("collect", 6)] {
        let text = format!(
            "slots = 20\n[sensors]\nsampling_bps = 3000.0\n[planner]\nobjective = '{objective}'\nhorizon.iterations = 40\n"
        );
        let scenario = scenario_of(&text, "horizon", 3);
        let mut mission = TestMission::new(&scenario);
        let mut restarted = TestMission::new(&scenario);
        mission.by_ref().take(20).for_each(drop);
        restarted.by_ref().take(7).for_each(drop);
        restarted.restart();
        restarted.by_ref().take(13).for_each(drop);
        let counts = mission.planner.counts();
        assert_eq!((counts.len(), &counts), (operators, &restarted.planner.counts()));
        for (name, counts) in counts {
            let left = counts.proposed - counts.void;
            assert!(counts.proposed > 0 && counts.improved <= counts.accepted && counts.accepted <= left, "{name}");
            assert!(objective == "collect" || counts.void == 0, "{name} of the loss finds no change");
        }
    }
    let mut none = TestMission::new(&scenario_of("slots = 3\n", "gfs", 1));
    none.by_ref().take(3).for_each(drop);
    assert!(none.planner.counts().is_empty());
}
