//! Tests of the look-ahead alone: forecasts against recomputation, enumeration, and closed forms.

use std::path::Path;

use proptest::prelude::*;
use skysink_common::battery::BatteryState;
use skysink_common::belief::Belief;
use skysink_common::channel::Uplink;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, Mode, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::told::Heard;

use super::anneal::{Cooling, SearchSteps, anneal};
use super::carried_plan::CarriedPlan;
use super::collect::Collect;
use super::decoder::{Visit, serve};
use super::forecast::{FRESH, Forecast, ForecastStyle};
use super::gaps::Gaps;
use super::groups::PlannedStop;
use super::keys::HorizonKeys;
use super::loss::Loss;
use super::model::PlanModel;
use super::objective::Objective;
use super::other_visits::OtherVisits;
use super::sensor::SensorModel;
use super::start;
use super::window::PlanningWindow;
use crate::bound::paths::PathBound;
use crate::gap_costs::GapCosts;
use crate::mission_table::MissionTable;
use crate::neighbours::PlannedVisit;
use crate::operator_counts::OperatorCounts;
use crate::settings::{ObjectiveWeights, Rates};
use crate::strategy::tests::over;
use crate::strategy::{Setup, Timing, View};
use skysink_common::random::{Purpose, Streams};
use skysink_common::reported::ReportedQueues;

use skysink_common::stop::Stop;

/// SNs of gain −52 dB, B = 30 kbit, at `positions_m` [m] with their rates [bit/s], in an area of 400 m; d_c = 10 m,
/// V τ = 30 m.
pub(crate) fn model_of(positions_m: &[([f64; 2], f64)], blocks: u32, width_hz: f64) -> PlanModel {
    let text = format!(
        "name = 'x'\n[area]\nside_m = 400.0\n[link]\nbandwidth_hz = {width_hz:?}\nresource_blocks = {blocks}\n"
    );
    let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
    let sensor = |&([x_m, y_m], sampling_bps): &([f64; 2], f64)| SensorNode {
        x_m,
        y_m,
        gain: 10f64.powf(-5.2),
        sampling_bps,
        capacity_bits: 30_000,
        ..SensorNode::default()
    };
    let nodes: Vec<SensorNode> = positions_m.iter().map(sensor).collect();
    PlanModel::new::<Loss>(&scenario, &MissionTable::of(&scenario, &nodes), &GapCosts::LOSS, true, &Stop::default())
}

/// From (200, 200), with all queues at 10 kbit, to the mission's end after `slots`.
pub(crate) fn window_of(model: &PlanModel, slots: i32) -> PlanningWindow<Loss> {
    let levels = model.sensors.iter().map(|sensor| -10_000.0 / sensor.mean_bits).collect();
    PlanningWindow {
        start: Position::new(200.0, 200.0),
        levels,
        slots,
        beyond_slots: 0.0,
        flown_slots: 0,
        energy_j: f64::INFINITY,
        under_way: None,
    }
}

fn stops(forecast: &Forecast<Loss>) -> Vec<u32> {
    forecast.trace.legs.iter().map(|leg| leg.stop.disk).collect()
}

/// Loads the plan that stops in these disks.
fn load(forecast: &mut Forecast<Loss>, model: &PlanModel, disks: impl IntoIterator<Item = u32>) {
    forecast.load(model, disks.into_iter().map(PlannedStop::at));
}

/// Three to nine SNs, some of them close together, that fill within 8 to 150 slots.
fn models() -> impl Strategy<Value = PlanModel> {
    let sensor = ([100.0..300.0, 100.0..300.0], prop_oneof![Just(200.0), Just(900.0), 100.0..2_500.0]);
    let near = ([190.0..215.0, 190.0..215.0], Just(700.0));
    let sensors = prop::collection::vec(prop_oneof![2 => sensor, 1 => near], 3..10);
    // With more blocks than SNs, who is met does not depend on the queues.
    (sensors, prop_oneof![Just(5e6), Just(4e3)]).prop_map(|(sensors, width_hz)| model_of(&sensors, 12, width_hz))
}

#[test]
fn a_stop_takes_the_slots_to_the_rim_and_overflow_counts_to_the_end() {
    // 85 m away, 75 m to the rim: 3 slots. 10 kbit + 3 · 2000 bit fit; emptied at 3, full again at 18, 22 − 18 = 4
    // late.
    let model = model_of(&[([285.0, 200.0], 2_000.0)], 4, 5e6);
    let mut forecast = Forecast::new(&model, window_of(&model, 22));
    assert_eq!(forecast.cost, 24_000.0); // unserved: full at slot 10
    load(&mut forecast, &model, [0]);
    assert_eq!((forecast.cost, forecast.trace.legs[0].end), (8_000.0, 3));
}

#[test]
fn a_stop_that_cannot_be_reached_in_time_is_left_out() {
    let model = model_of(&[([285.0, 200.0], 2_000.0), ([200.0, 285.0], 10.0)], 4, 5e6);
    let mut forecast = Forecast::new(&model, window_of(&model, 5));
    load(&mut forecast, &model, [0, 1]); // from the rim of SN 0 at least 3 slots to that of SN 1
    assert_eq!(stops(&forecast), [0]);
    start::extend(&model, &mut forecast);
    assert!(forecast.trace.legs.iter().all(|leg| leg.end <= 5));
    // 75 m to the rim of SN 0 take three slots.
    let stops_within = |slots: i32| {
        let mut forecast = Forecast::new(&model, window_of(&model, slots));
        load(&mut forecast, &model, [0]);
        stops(&forecast)
    };
    assert_eq!([2, 3].map(stops_within), [vec![], vec![0]]);
}

#[test]
fn sensor_nodes_too_close_together_for_the_blocks_are_grouped() {
    let cluster = |x_m: f64, rate_bps| (0..4).map(move |step| ([x_m + 3.0 * f64::from(step), 100.0], rate_bps));
    let sensors = |rate_bps| cluster(100.0, rate_bps).chain(cluster(118.0, rate_bps)).collect::<Vec<_>>();
    assert_eq!(model_of(&sensors(500.0), 4, 5e6).disks.len(), 8, "0.13 of 4 resource blocks are needed");
    let model = model_of(&sensors(9_000.0), 4, 5e6);
    let groups: Vec<_> = model.disks[8..].iter().map(|disk| disk.members.clone()).collect();
    assert!(
        groups.len() == 2 && groups.contains(&vec![0, 1, 2, 3]) && groups.contains(&vec![4, 5, 6, 7]),
        "{groups:?}"
    );
    assert!(model.disks[8..].iter().all(|stop| (stop.disk.radius_m - 5.5).abs() < 1e-9), "half of 9 m from 10 m");
}

/// What the visits of a plan cost, one after the other.
fn cost_of_visits<O: Objective<Style: ForecastStyle<O>>>(model: &PlanModel, forecast: &Forecast<O>) -> f64 {
    let mut cost = 0.0;
    let mut levels = forecast.window.levels.clone();
    for visit in &forecast.trace.visits {
        cost += serve::<O>(model, &mut levels[visit.sensor as usize], visit);
    }
    for (index, (level, begun)) in levels.iter().zip(&forecast.window.levels).enumerate() {
        let sensor = &model.sensors[index];
        let end = f64::from(forecast.window.slots);
        let beyond_slots = forecast.window.beyond_slots;
        let rest = model.rest::<O>(index, end, *level) - O::rest(sensor, *begun, 0.0);
        let beyond = match beyond_slots > 0.0 {
            true => O::beyond(sensor, model.level_at::<O>(index, end, *level), end, model.round_slots, beyond_slots),
            false => 0.0,
        };
        cost += (rest + beyond) * O::price(sensor);
    }
    cost
}

/// All plans of up to `most` stops, by their least loss [bit].
fn enumerated(model: &PlanModel, planning: &PlanningWindow<Loss>, most: usize) -> f64 {
    let mut forecast = Forecast::new(model, planning.clone());
    let mut least_bits = forecast.cost;
    let mut plans: Vec<Vec<u32>> = vec![Vec::new()];
    while let Some(plan) = plans.pop() {
        load(&mut forecast, model, plan.iter().copied());
        least_bits = least_bits.min(forecast.cost);
        if plan.len() < most && forecast.trace.legs.len() == plan.len() {
            plans.extend((0..model.disks.len() as u32).map(|stop| [&plan[..], &[stop]].concat()));
        }
    }
    least_bits
}

#[test]
fn annealing_finds_the_optimum_of_small_instances() {
    let mut found_bits = 0.0;
    let mut best_bits = 0.0;
    for seed in 1..=12 {
        let mut random = Streams::new(seed).stream(Purpose::Position, 0, 0);
        let mut draw = || f64::from(rand::Rng::next_u32(&mut random)) / 4_294_967_296.0;
        let sensors: Vec<_> =
            (0..4).map(|_| ([140.0 + 120.0 * draw(), 140.0 + 120.0 * draw()], 1_000.0 + 2_000.0 * draw())).collect();
        let mut model = model_of(&sensors, 2, 5e6);
        let planning = window_of(&model, 16);
        let least_bits = enumerated(&model, &planning, 6);
        assert!(planning.least(&model) <= least_bits, "seed {seed}");
        let mut forecast = Forecast::new(&model, planning);
        start::begin(&model, &mut forecast);
        let mut random = Streams::new(seed).stream(Purpose::Horizon, 1, 0);
        let mut lowest_bits = forecast.cost;
        for far_bits in [3_000.0, 1_000.0, 300.0, 0.0] {
            let mut counts = [OperatorCounts::default(); 5];
            let mut search =
                SearchSteps { is_over: &|| false, random: &mut random, counts: &mut counts, patience: u64::MAX };
            anneal(&mut model, &mut forecast, Cooling::Everywhere(far_bits), 2_000, &mut search, None);
            lowest_bits = lowest_bits.min(forecast.cost);
        }
        // Plans of more than six stops may lose even less.
        assert!(lowest_bits <= 1.1 * least_bits, "seed {seed}: {lowest_bits} against {least_bits}");
        found_bits += lowest_bits;
        best_bits += least_bits;
    }
    assert!(found_bits <= 1.01 * best_bits, "{found_bits} against {best_bits}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn an_attempted_change_loses_as_much_as_the_changed_plan(
        model in models(), drawn in prop::collection::vec(any::<prop::sample::Index>(), 1..150),
        changes in prop::collection::vec((any::<[prop::sample::Index; 4]>(), any::<bool>(), 0usize..4), 1..12),
    ) {
        let planning = window_of(&model, 100_000);
        let stop = |index: &prop::sample::Index| index.index(model.disks.len()) as u32;
        let mut forecast = Forecast::new(&model, planning.clone());
        load(&mut forecast, &model, drawn.iter().map(stop));
        for (indices, kept, moved) in changes {
            let plan = stops(&forecast);
            let [a, b] = [indices[0].index(plan.len() + 1), indices[1].index(plan.len() + 1)];
            let from = a.min(b);
            let to = a.max(b);
            let mut inserted = vec![(PlannedStop::at(stop(&indices[2])), FRESH); moved];
            if kept {
                inserted.extend((from..to).map(|leg| (PlannedStop::at(plan[leg]), leg as u32)));
                let turn = indices[3].index(inserted.len() + 1);
                inserted.rotate_left(turn);
            }
            let changed: Vec<u32> = plan[..from].iter().copied()
                .chain(inserted.iter().map(|(stop, _)| stop.disk)).chain(plan[to..].iter().copied()).collect();
            let cost = forecast.attempt(&model, from, to, &inserted);
            let mut flown = Forecast::new(&model, planning.clone());
            load(&mut flown, &model, changed.iter().copied());
            prop_assert!((cost - flown.cost).abs() <= 1e-9 * flown.cost.max(1.0));
            if indices[3].index(2) == 0 && !changed.is_empty() {
                forecast.accept(&model, cost);
                prop_assert_eq!(&forecast.trace.legs, &flown.trace.legs);
                prop_assert_eq!(&forecast.trace.visits, &flown.trace.visits);
            }
        }
    }

    #[test]
    fn an_attempted_change_of_a_sum_of_costs_costs_as_much_as_the_changed_plan(
        model in models(), drawn in prop::collection::vec(any::<prop::sample::Index>(), 1..60),
        weights in prop::sample::select(vec![[0.0, 1.0, 0.0, 0.0], [1.0, 40.0, 0.0, 900.0], [0.0, 0.0, 1e-6, 0.0]]),
        changes in prop::collection::vec((any::<[prop::sample::Index; 3]>(), any::<bool>()), 1..12),
    ) {
        let [loss, age, peak_age, deadline] = weights;
        let weights = ObjectiveWeights { loss, age, peak_age, deadline, expiry: 0.0 };
        let costs = GapCosts::new(&weights, 1.0, Some(20));
        let mut model = model;
        for sensor in &mut model.sensors {
            sensor.costs = costs;
        }
        let queues_bits = vec![10_000; model.sensors.len()];
        let planning = PlanningWindow::<Gaps>::new(&model, [200.0, 200.0].into(), &queues_bits, f64::from, 3_000, 0);
        let stop = |index: &prop::sample::Index| PlannedStop::at(index.index(model.disks.len()) as u32);
        let mut forecast = Forecast::new(&model, planning.clone());
        forecast.load(&model, drawn.iter().map(stop));
        for (indices, is_kept) in changes {
            let plan = forecast.stops();
            let [a, b] = [indices[0].index(plan.len() + 1), indices[1].index(plan.len() + 1)];
            let [from, to] = [a.min(b), a.max(b)];
            let inserted = [(stop(&indices[2]), FRESH)];
            let changed = plan[..from].iter().copied().chain([inserted[0].0]).chain(plan[to..].iter().copied());
            let mut flown = Forecast::new(&model, planning.clone());
            flown.load(&model, changed);
            let cost = forecast.attempt(&model, from, to, &inserted);
            prop_assert!((cost - flown.cost).abs() <= 1e-9 * flown.cost.max(1.0), "{} against {}", cost, flown.cost);
            prop_assert!(cost >= planning.least(&model) - 1e-9 * cost.abs(), "below the bound");
            if is_kept {
                forecast.accept(&model, cost);
                let alone = cost_of_visits(&model, &forecast);
                prop_assert!((cost - alone).abs() <= 1e-9 * alone.max(1.0), "{} of visits that cost {}", cost, alone);
            }
        }
    }

    /// Also of more sensors than can be served, of uncertain queues, and where many stops move by many slots.
    #[test]
    fn changed_plans_lose_what_their_visits_do(
        model in models(), drawn in prop::collection::vec(any::<prop::sample::Index>(), 40..200), slots in 60i32..400,
        rates in prop::sample::select(vec![0.125, 1.0, 8.0]), is_nearly_full: bool,
        (half_slots, noise_slots2, rate_half_fraction) in prop::sample::select(
            vec![(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (5.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.2), (3.0, 0.5, 0.1)]
        ),
        beyond_slots in prop::sample::select(vec![0.0, 60.0]),
        changes in prop::collection::vec((any::<[prop::sample::Index; 3]>(), 0usize..40, 0usize..3), 1..20),
    ) {
        let mut model = model;
        for sensor in &mut model.sensors {
            *sensor = SensorModel {
                mean_bits: rates * sensor.mean_bits,
                cost_bits: rates * sensor.cost_bits,
                fill_slots: sensor.fill_slots / rates,
                initial_half_slots: half_slots,
                noise_slots2,
                rate_half_fraction,
                ..*sensor
            };
        }
        let mut planning = PlanningWindow { beyond_slots, ..window_of(&model, slots) };
        if is_nearly_full {
            planning.levels = model.sensors.iter().map(|sensor| -0.9 * sensor.fill_slots).collect();
        }
        let stop = |index: &prop::sample::Index| index.index(model.disks.len()) as u32;
        let mut forecast = Forecast::new(&model, planning);
        load(&mut forecast, &model, drawn.iter().map(stop));
        for (indices, removed, fresh) in changes {
            let stops = forecast.trace.legs.len();
            let from = indices[0].index(stops + 1);
            let inserted = vec![(PlannedStop::at(stop(&indices[1])), FRESH); fresh * (1 + removed / 8)];
            let cost = forecast.attempt(&model, from, (from + removed).min(stops), &inserted);
            if indices[2].index(2) == 0 {
                forecast.accept(&model, cost);
                let lost_bits = cost_of_visits(&model, &forecast);
                prop_assert!((lost_bits - cost).abs() <= 1e-9 * lost_bits.max(1.0), "{lost_bits} {cost}");
            }
        }
    }

    #[test]
    fn no_plan_beats_the_bound(
        model in models(), drawn in prop::collection::vec(any::<prop::sample::Index>(), 1..60), slots in 1i32..80,
    ) {
        let planning = window_of(&model, slots);
        let mut forecast = Forecast::new(&model, planning.clone());
        let bound_bits = planning.least(&model);
        prop_assert!(bound_bits <= forecast.cost + 1e-6);
        load(&mut forecast, &model, drawn.iter().map(|index| index.index(model.disks.len()) as u32));
        prop_assert!(bound_bits <= forecast.cost + 1e-6);
        start::extend(&model, &mut forecast);
        prop_assert!(bound_bits <= forecast.cost + 1e-6, "{} > {}", bound_bits, forecast.cost);
    }

    #[test]
    fn no_plan_serves_more_than_the_paths_allow(
        model in models(), drawn in prop::collection::vec(any::<prop::sample::Index>(), 1..40), window in 1i32..20,
    ) {
        let mut forecast = Forecast::new(&model, window_of(&model, 100));
        load(&mut forecast, &model, drawn.iter().map(|index| index.index(model.disks.len()) as u32));
        let most = PathBound::new(&model.table).most(window as u64);
        for slot in 0..100 {
            let within = |visit: &&Visit| (slot + 1..=slot + window).contains(&visit.slot);
            let mut served: Vec<u32> =
                forecast.trace.visits.iter().filter(within).map(|visit| visit.sensor).collect();
            served.sort_unstable();
            served.dedup();
            prop_assert!(served.len() <= most, "{} of {} after slot {}", served.len(), most, slot);
        }
    }
}

#[test]
fn the_flight_in_overload_matches_the_prediction_in_every_slot() {
    // 60 SNs in 55 m × 55 m that fill within 37.5 slots, served 4 at a time: 15 slots a round would do, but for the
    // links.
    let mut random = Streams::new(7).stream(Purpose::Position, 0, 0);
    let mut draw = || 200.0 + 55.0 * f64::from(rand::Rng::next_u32(&mut random)) / 4_294_967_296.0;
    let sensors: Vec<_> = (0..60).map(|_| ([draw(), draw()], 3_000.0)).collect();
    let model = model_of(&sensors, 4, 5e6);
    let mut forecast = Forecast::new(&model, window_of(&model, 80));
    start::begin(&model, &mut forecast);
    let first = forecast.trace.clone();
    let predicted_bits = forecast.cost;
    let legs = first.legs.iter().filter(|leg| leg.end == 1).count();
    // After the first slot a queue that has overflowed is seen as a full one.
    let mut empty = forecast.window.levels.clone();
    let mut lost_bits = 0.0;
    for visit in first.visits.iter().filter(|visit| visit.slot == 1) {
        lost_bits += serve::<Loss>(&model, &mut empty[visit.sensor as usize], visit);
    }
    for (empty, sensor) in empty.iter_mut().zip(&model.sensors) {
        lost_bits += (1.0 - *empty - sensor.fill_slots).max(0.0) * sensor.mean_bits;
        *empty = (*empty - 1.0).max(-sensor.fill_slots);
    }
    let start = first.legs[legs - 1].at;
    let mut next = Forecast::new(&model, PlanningWindow { start, levels: empty, ..window_of(&model, 79) });
    load(&mut next, &model, first.legs[legs..].iter().map(|leg| leg.stop.disk));
    assert!((lost_bits + next.cost - predicted_bits).abs() < 1e-6, "{predicted_bits} against {}", next.cost);
}

#[test]
fn the_overflow_of_an_uncertain_queue_is_its_mean() {
    let model = model_of(&[([200.0, 200.0], 1_000.0)], 1, 5e6); // full in 30 slots
    let mean = |sensor: &SensorModel, slot: f64, empty: f64| {
        let initial_half_slots = if empty <= 0.0 { sensor.initial_half_slots } else { 0.0 };
        let left_slots = if empty <= 0.0 { sensor.left_slots } else { 0.0 };
        let half = sensor.rate_half_fraction * (slot - empty - left_slots) + initial_half_slots;
        let draws = (0..10_000).map(|draw| half * ((f64::from(draw) + 0.5) / 5_000.0 - 1.0));
        draws.map(|more| (slot - empty - sensor.fill_slots + more).max(0.0)).sum::<f64>() / 10_000.0
    };
    for (initial_half_slots, rate_half_fraction, left_slots) in
        [(0.0, 0.0, 0.0), (8.0, 0.0, 0.0), (0.0, 0.25, 0.0), (0.0, 0.25, 6.0), (8.0, 0.25, 6.0)]
    {
        let sensor = SensorModel { initial_half_slots, rate_half_fraction, left_slots, ..model.sensors[0] };
        // From a queue of 10 slots, from an empty one that was not visited, and since a visit.
        for (slot, empty) in
            [(5.0, -10.0), (14.0, -10.0), (20.0, -10.0), (26.0, -10.0), (60.0, -10.0), (26.0, 0.0), (42.0, 9.0)]
        {
            let found = sensor.overflow_slots(slot, empty);
            let expected = mean(&sensor, slot, empty);
            assert!((found - expected).abs() < 1e-3, "{sensor:?} from {empty} to {slot}: {found} against {expected}");
        }
    }
}

#[test]
fn overflow_before_the_window_is_not_counted_as_loss() {
    let mut model = model_of(&[([200.0, 200.0], 1_000.0)], 1, 5e6);
    model.sensors[0].initial_half_slots = 8.0;
    // 2 slots before it is full, give or take 8; 40 slots late for sure by the end.
    let planning = PlanningWindow { levels: vec![-28.0], ..window_of(&model, 42) };
    let sunk_bits = (6.0f64 * 6.0 / 32.0) * 1_000.0;
    assert!((Forecast::new(&model, planning).cost - (40_000.0 - sunk_bits)).abs() < 1e-6);
}

#[test]
fn capacities_with_a_free_altitude_equal_those_of_the_best_fixed_one() {
    let text = "name = 'x'\n[uav]\naltitude = 'free'\n[link]\nmodel = 'probabilistic-los'\nenvironment = 'high-rise'\n\
                bandwidth_hz = 5e3\ncomm_radius_m = 60.0\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let sensor = SensorNode { x_m: 50.0, y_m: 50.0, sampling_bps: 1.0, capacity_bits: 30_000, ..SensorNode::default() };
    let model = PlanModel::new::<Loss>(
        &scenario,
        &MissionTable::of(&scenario, &[sensor]),
        &GapCosts::LOSS,
        true,
        &Stop::default(),
    );
    let channel = &model.table.channel;
    let climb = scenario.uav.climb().unwrap();
    let range_m = climb.max_altitude_m - climb.min_altitude_m;
    let los = channel.line_of_sight().unwrap();
    // No more than the buffer of 30 kbit counts, in line of sight or not.
    let carried = |d2_m2: f64, z_m: f64| {
        let rates_bps = [los.los_rate_bps(d2_m2, z_m), los.nlos_rate_bps(d2_m2, z_m)];
        let [seen, hidden] = rates_bps.map(|rate_bps| channel.capacity_bits(rate_bps).min(30_000) as f64);
        let probability = los.los_probability(&Uplink::at(1.0, d2_m2, z_m));
        hidden + probability * (seen - hidden)
    };
    let explains = |level: &u32| {
        let z_m = climb.min_altitude_m + range_m * f64::from(*level) / 16.0;
        // Entries are 56.25 m² apart; in between, the nearest counts.
        let asked_m2 = [(0.0, 0.0), (880.0, 900.0), (900.0, 900.0), (920.0, 900.0), (3_590.0, 3_600.0)];
        asked_m2.iter().all(|&(d2_m2, entry_m2)| model.capacity::<Loss>(0, d2_m2, true) == carried(entry_m2, z_m))
    };
    assert!((0..=16).any(|level| explains(&level)));
}

#[test]
fn the_planned_altitude_is_higher_where_the_nearest_sensors_are_farther() {
    let text = "name = 'x'\n[uav]\naltitude = 'free'\n[link]\nmodel = 'probabilistic-los'\nenvironment = 'high-rise'\n\
                bandwidth_hz = 5e3\ncomm_radius_m = 60.0\nresource_blocks = 4\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let [apart, together, alone] = [[40.0, 0.0], [3.0, 0.0], [0.0, 90.0]].map(|[side_m, from_m]| {
        let sensor = |[x, y]: [f64; 2]| SensorNode {
            x_m: 5.0 + (side_m + from_m) * x,
            y_m: 5.0 + (side_m + from_m) * y,
            sampling_bps: 1.0,
            capacity_bits: 30_000,
            ..SensorNode::default()
        };
        let sensors = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(sensor);
        let table = MissionTable::of(&scenario, &sensors);
        let model = PlanModel::new::<Loss>(&scenario, &table, &GapCosts::LOSS, true, &Stop::default());
        [0.0, 3_600.0].map(|d2_m2| model.capacity::<Loss>(0, d2_m2, true))
    });
    assert!(apart[0] < together[0] && apart[1] > together[1], "above it, at the rim: {apart:?}, {together:?}");
    assert!(apart[0] < alone[0] && apart[1] > alone[1], "above it, at the rim: {apart:?}, {alone:?}");
}

#[test]
fn groups_are_served_where_their_links_carry_most() {
    let text = "name = 'x'\n[uav]\naltitude = 'free'\n[link]\nmodel = 'probabilistic-los'\nenvironment = 'high-rise'\n\
                bandwidth_hz = 5e3\ncomm_radius_m = 60.0\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let sensors: Vec<SensorNode> = (0u16..40)
        .map(|i| SensorNode {
            x_m: f64::from(i * 13 % 40) * 0.5 + 30.0,
            y_m: f64::from(i * 7 % 40) * 0.5 + 30.0,
            sampling_bps: 1e3,
            capacity_bits: 30_000,
            ..SensorNode::default()
        })
        .collect();
    let mission = MissionTable::of(&scenario, &sensors);
    let mut model = PlanModel::new::<Loss>(&scenario, &mission, &GapCosts::LOSS, true, &Stop::default());
    assert_eq!(model.disks.len(), sensors.len(), "no groups where visits empty no buffer, and less carry far off");
    model.group::<Loss>(1, &Stop::default());
    let groups = &model.disks[sensors.len()..];
    assert!(groups.iter().any(|group| group.members.len() > 1), "some are near enough");
    for group in groups {
        for &member in &group.members {
            let farthest_m = (model.table.sensors.position(member) - group.disk.centre).norm() + group.disk.radius_m;
            let [there, best] = [farthest_m.powi(2), 0.0].map(|d2_m2| model.capacity::<Loss>(member, d2_m2, true));
            assert!(there >= 0.8 * best, "{there} of {best} at {farthest_m} m");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(25))]

    #[test]
    fn groups_contain_every_sensor_once_and_in_range_of_one_point(
        sensors in prop::collection::vec(([150.0..200.0, 150.0..200.0], Just(500.0)), 2..40), blocks in 2u32..6,
    ) {
        let mut model = model_of(&sensors, blocks, 5e6);
        model.disks.truncate(sensors.len());
        model.group::<Loss>(1, &Stop::default());
        let groups = &model.disks[sensors.len()..];
        let mut members: Vec<u32> = groups.iter().flat_map(|group| group.members.iter().copied()).collect();
        members.sort_unstable();
        prop_assert!(members.is_empty() || (0..sensors.len() as u32).eq(members));
        for group in groups {
            prop_assert!(group.members.len() <= blocks as usize && group.disk.radius_m >= 0.0);
            for &member in &group.members {
                let away_m = (model.table.sensors.positions[member as usize] - group.disk.centre).norm();
                prop_assert!(away_m <= model.table.limits.comm_radius_m - group.disk.radius_m + 1e-9);
            }
        }
    }
}

#[test]
fn learnt_rates_replace_the_prior() {
    let text =
        "name = 'x'\n[sensors]\nsampling_bps = [0.0, 200.0]\n[planner]\nknowledge = 'estimated'\nrates = 'learnt'\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let sensor = |x_m: f64| SensorNode { x_m, y_m: 50.0, gain: 1e-5, capacity_bits: 30_000, ..SensorNode::default() };
    let sensors = [30.0, 60.0, 90.0].map(sensor); // what they sample is not looked at
    let field = over(scenario.clone(), sensors.to_vec());
    let table = &field.table;
    let mut belief = Belief::new(&scenario, &table.sensors, Some(Rates::Learnt));
    let setup = Setup { belief: &belief, ..field.setup() };
    let mut horizon = CarriedPlan::<Loss>::new(&setup, HorizonKeys::of(0));
    let believed = |horizon: &mut CarriedPlan<Loss>, belief: &mut Belief, slot: u64| {
        let position = scenario.start();
        let belief = belief.at(slot - 1, &table.sensors, &[0; 3]);
        let stop = &Stop::default();
        horizon.update_sensors(&View {
            slot,
            position,
            battery: BatteryState::default(),
            belief,
            table,
            timing: Timing::Free,
            heard: &Heard::NOTHING,
            neighbours: None,
            stop,
        });
        horizon.model.sensors.iter().map(|sensor| (sensor.mean_bits, sensor.fill_slots)).collect::<Vec<_>>()
    };
    assert_eq!(believed(&mut horizon, &mut belief, 1), [(100.0, 300.0); 3]);
    // SNs 0 and 2 are served in slots 1 and 12: in the 10 slots between them come 2 500 bit, and nothing.
    let mut flight = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
    flight.served = 2;
    flight.links[0].sensor = 0;
    flight.links[1].sensor = 2;
    let unreported = ReportedQueues::default();
    belief.advance(1, &[flight], &unreported, &[500, 0, 7]);
    let serving_nobody = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
    (2..12).for_each(|slot| belief.advance(slot, &[serving_nobody], &unreported, &[0; 3]));
    let reported = belief.reported(12, [0, 2], &[3_000, 0, 7]);
    belief.advance(12, &[flight], &reported, &[0, 0, 7]);
    assert_eq!(believed(&mut horizon, &mut belief, 13), [(250.0, 120.0), (100.0, 300.0), (1e-3, 3e7)]);
}

#[test]
fn visits_of_other_uavs_empty_their_sensors() {
    // Full in 30 and 100 slots, empty at the beginning; another UAV serves the first in slots 20, 40 and 90.
    let mut model = model_of(&[([200.0, 200.0], 1_000.0), ([240.0, 200.0], 300.0)], 1, 5e6);
    let visit = |slot: u64| PlannedVisit { slot, sensor: 0, bits: f64::INFINITY };
    model.others = OtherVisits::of(&[5, 26, 46, 96].map(visit), &model.ids, &model.sensors, 7);
    let until = |model: &PlanModel, sensor, slot, empty| {
        (model.rest::<Loss>(sensor, slot, empty), model.level_at::<Loss>(sensor, slot, empty))
    };
    assert_eq!(until(&model, 0, 30.0, 0.0), (0.0, 20.0));
    assert_eq!(until(&model, 0, 89.0, 0.0), (19.0, 40.0), "40 to 89 less 30");
    assert_eq!(until(&model, 0, 95.0, 0.0), (20.0, 90.0), "40 to 90 less 30");
    assert_eq!(until(&model, 0, 89.0, 50.0), (9.0, 50.0), "a visit of its own in between");
    assert_eq!(until(&model, 1, 110.0, 0.0), (10.0, 0.0));
    let little = [PlannedVisit { bits: 14_000.0, ..visit(20) }, PlannedVisit { bits: 15_000.0, ..visit(30) }];
    let counted = OtherVisits::of(&little, &model.ids, &model.sensors, 1);
    model.others = counted;
    assert_eq!(until(&model, 0, 29.0, 0.0), (0.0, 0.0), "less than half of the buffer");
    assert_eq!(until(&model, 0, 30.0, 0.0), (0.0, 30.0));
    model.others = OtherVisits::of(&[5, 26, 46, 96].map(visit), &model.ids, &model.sensors, 7);
    assert_eq!([39.0, 40.0].map(|slot| model.level_at::<Loss>(0, slot, 30.0)), [30.0, 40.0]);
}

proptest! {
    /// The loss of a plan that was changed beside the visits of others is that of all its visits, one after the other.
    #[test]
    fn changed_plans_of_a_fleet_have_the_loss_of_their_visits(
        stops in prop::collection::vec(0u32..6, 1..40),
        visits in prop::collection::vec((1u64..120, 0u32..6), 1..30),
        changes in prop::collection::vec((0usize..40, 0usize..3, prop::collection::vec(0u32..6, 0..3)), 1..12),
    ) {
        let positions: Vec<([f64; 2], f64)> =
            (0..6).map(|index| ([160.0 + 17.0 * f64::from(index), 200.0 + f64::from(index * 37 % 50)], 700.0)).collect();
        let mut model = model_of(&positions, 4, 5e6);
        let visits: Vec<PlannedVisit> =
            visits.into_iter().map(|(slot, sensor)| PlannedVisit { slot, sensor, bits: f64::INFINITY }).collect();
        model.others = OtherVisits::of(&visits, &model.ids, &model.sensors, 1);
        let mut forecast = Forecast::new(&model, window_of(&model, 120));
        load(&mut forecast, &model, stops);
        for (at, removed, inserted) in changes {
            let legs = forecast.trace.legs.len();
            let from = at.min(legs);
            let to = (from + removed).min(legs);
            let inserted: Vec<_> = inserted.into_iter().map(|stop| (PlannedStop::at(stop), FRESH)).collect();
            let cost = forecast.attempt(&model, from, to, &inserted);
            forecast.accept(&model, cost);
            let lost_bits = cost_of_visits(&model, &forecast);
            prop_assert!((lost_bits - cost).abs() <= 1e-9 * lost_bits.max(1.0), "{lost_bits} {cost}");
        }
    }
}

/// SNs at `positions_m` [m] that hold 30 kbit at most and sample `sampling_bps` [bit/s], over a link that takes slots
/// to empty them; `keys` are those of the UAV.
pub(crate) fn points_model(positions_m: &[[f64; 2]], sampling_bps: f64, keys: &str) -> PlanModel {
    let text = format!(
        "name = 'x'\n[area]\nside_m = 400.0\n[link]\nbandwidth_hz = 2000.0\nresource_blocks = 2\n[uav]\n{keys}"
    );
    let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
    let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode {
        x_m,
        y_m,
        gain: 10f64.powf(-5.2),
        sampling_bps,
        capacity_bits: 30_000,
        ..SensorNode::default()
    };
    let nodes: Vec<SensorNode> = positions_m.iter().map(sensor).collect();
    PlanModel::new::<Collect>(&scenario, &MissionTable::of(&scenario, &nodes), &GapCosts::LOSS, false, &Stop::default())
}

proptest! {
    /// Where plans hover, too, a changed plan costs what it costs from scratch.
    #[test]
    fn an_attempted_change_delivers_as_much_as_the_changed_plan(
        positions in prop::collection::vec([150.0..250.0, 150.0..250.0], 2..8),
        drawn in prop::collection::vec((any::<prop::sample::Index>(), [-8.0..8.0, -8.0..8.0], 0u16..6), 1..20),
        changes in prop::collection::vec((any::<[prop::sample::Index; 3]>(), any::<bool>()), 1..10),
    ) {
        let mut model = points_model(&positions, 100.0, "");
        let queues_bits = vec![20_000; positions.len()];
        let window = PlanningWindow::<Collect>::new(&model, Position::new(200.0, 200.0), &queues_bits, |_| 0.0, 60, 0);
        let stops: Vec<PlannedStop> = drawn.iter().map(|(index, [x_m, y_m], hovers)| {
            let sensor = index.index(positions.len());
            let at = Position::new(positions[sensor][0] + x_m, positions[sensor][1] + y_m);
            model.add_point(sensor as u32, at, *hovers)
        }).collect();
        let mut forecast = Forecast::new(&model, window.clone());
        forecast.load(&model, stops.iter().copied());
        for (indices, is_kept) in changes {
            let plan = forecast.stops();
            let [a, b] = [indices[0].index(plan.len() + 1), indices[1].index(plan.len() + 1)];
            let [from, to] = [a.min(b), a.max(b)];
            let inserted = [(stops[indices[2].index(stops.len())], FRESH)];
            let changed = plan[..from].iter().copied().chain([inserted[0].0]).chain(plan[to..].iter().copied());
            let mut flown = Forecast::new(&model, window.clone());
            flown.load(&model, changed);
            let cost = forecast.attempt(&model, from, to, &inserted);
            prop_assert!((cost - flown.cost).abs() <= 1e-6, "{} against {}", cost, flown.cost);
            if is_kept {
                forecast.accept(&model, cost);
                prop_assert_eq!(&forecast.trace.legs, &flown.trace.legs);
                prop_assert_eq!(&forecast.trace.visits, &flown.trace.visits);
            }
        }
    }
}
