//! Random small missions of fleets whose UAVs differ, with the keys of each UAV alone beside them: no UAV exceeds its
//! own reach, altitudes, battery or blocks, no flight loses less than a bound, and what is restored goes on the same.

use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skysink_common::battery::Battery;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::message::{HoldReason, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{Plans, SlotRecord};
use skysink_common::stop::Stop;
use skysink_mission::drive::plan_next;
use skysink_mission::{Mission, Plant};
use skysink_planner::bound::mission_bound;
use skysink_planner::{FleetPlanner, settings};

/// Strategies, with their odds.
const STRATEGIES: [&str; 9] = ["uts", "gfs", "edf", "mes", "tour", "horizon", "horizon", "max-weight", "uts-wide"];

/// Slack of a comparison of floats.
const SLACK: f64 = 1e-7;

/// A mission of a fleet.
struct RandomFleet {
    /// The scenario of the fleet.
    fleet: Scenario,
    /// By UAV: a scenario with its keys alone, written without `[[uav.each]]`.
    alone: Vec<Scenario>,
    text: String,
}

/// The keys of a kind of UAVs, a line each.
struct Kind {
    lines: Vec<String>,
    blocks: Option<u32>,
    count: usize,
}

impl RandomFleet {
    /// The fleet of a number.
    fn of(number: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(number);
        let strategy = STRATEGIES[random.random_range(0..STRATEGIES.len())];
        let side_m: f64 = random.random_range(80.0..300.0_f64).round();
        let slots = random.random_range(15..50);
        let is_free = random.random_range(0..4) == 0;
        let must_land = random.random_range(0..3) == 0;
        let has_batteries = random.random_range(0..3) == 0;
        let mission = mission(&mut random, number, side_m, slots, is_free);
        let kinds: Vec<Kind> = (0..random.random_range(1..=4))
            .map(|_| kind(&mut random, side_m, slots, is_free, must_land, has_batteries))
            .collect();
        let mut of_all = format!("must_land = {must_land}\n");
        let coordination = ["partition", "sequential", "independent"][random.random_range(0..3)];
        writeln!(of_all, "coordination = '{coordination}'").unwrap();
        // A UAV that makes way for others may come home late.
        if random.random_range(0..4) == 0 && !must_land && !has_batteries {
            of_all += "separation_m = 4.0\n";
        }
        let shared = "max_speed_mps = 17.0\nendurance_s = 1000.0\naltitude_m = 45.0\n";
        let mut text = format!("{mission}[uav]\n{of_all}{shared}");
        let mut alone = Vec::new();
        for Kind { lines, blocks, count } in &kinds {
            writeln!(text, "[[uav.each]]\ncount = {count}\n{}", lines.join("\n")).unwrap();
            blocks.iter().for_each(|blocks| writeln!(text, "resource_blocks = {blocks}").unwrap());
            let is_own = |line: &&str| !lines.iter().any(|own| own.split(' ').next() == line.split(' ').next());
            let others: Vec<&str> = shared.lines().filter(is_own).collect();
            let blocks = blocks.map_or_else(String::new, |blocks| format!("[link]\nresource_blocks = {blocks}\n"));
            let own = lines.join("\n");
            // The mission has its `[link]` at its end.
            let mission = mission.replace("[link]\n", &if blocks.is_empty() { "[link]\n".to_owned() } else { blocks });
            let own = format!("{mission}[uav]\nmust_land = {must_land}\n{}\n{own}\n", others.join("\n"));
            alone.extend(std::iter::repeat_n(own, *count));
        }
        Self {
            fleet: parse(&text, strategy),
            alone: alone.iter().map(|text| parse_alone(text, strategy)).collect(),
            text: format!("# {strategy}\n{text}"),
        }
    }

    /// Flies it, and checks every slot.
    fn check(&self) {
        let Self { fleet, alone, text } = self;
        let list = SensorList::of(fleet).unwrap();
        let records: Vec<SlotRecord> = Mission::new(fleet, &list).unwrap().collect();
        assert_eq!((records.len() as u64, records[0].flights().len()), (fleet.slots, alone.len()), "{text}");
        let mut positions: Vec<_> = fleet.starts().collect();
        let mut energies_j: Vec<f64> = alone.iter().map(|own| Battery::of(own).initial_j).collect();
        for record in &records {
            for (uav, flight) in record.flights().iter().enumerate() {
                let own = &alone[uav];
                let at = format!("UAV {uav}, slot {}: {flight:?}\n{text}", record.slot());
                let (from, to) = (positions[uav], flight.position());
                assert!(own.reaches(&from.xy(), &to.xy()), "{from}: {at}");
                let [lowest_m, highest_m] = own.altitudes_m(from.z);
                assert!((lowest_m - SLACK..=highest_m + SLACK).contains(&to.z), "{at}");
                assert!(flight.served as usize <= own.link.resource_blocks, "{at}");
                let is_refused = [HoldReason::Waypoint, HoldReason::Zone, HoldReason::Base].map(|hold| hold as u32);
                assert!(!is_refused.contains(&flight.hold), "{at}");
                let battery = Battery::of(own);
                assert_eq!(battery.is_endless(), flight.energy_j == f64::INFINITY, "{at}");
                assert!(flight.energy_j <= battery.capacity_j && flight.flown_mode() != Mode::Down, "{at}");
                if flight.flown_mode() != Mode::Charge {
                    let left_j = battery.flown_j(energies_j[uav], &from, &to);
                    let is_left = left_j == flight.energy_j || (left_j - flight.energy_j).abs() < SLACK * left_j.abs();
                    assert!(is_left, "{left_j}: {at}");
                }
                let is_over = own.must_land() && record.slot() >= own.slots;
                let base = fleet.landing_base();
                assert!(!is_over || base.is_some_and(|base| base.contains(&to.xy())), "{at}");
                positions[uav] = to;
                energies_j[uav] = flight.energy_j;
            }
        }
        let lost_bits = records.last().unwrap().header.totals.lost_bits;
        let bound = mission_bound(fleet, &list.sensors_of(fleet), &list.queues_bits(), u64::MAX);
        assert!(bound.loss_bits <= lost_bits, "{} {lost_bits}\n{text}", bound.loss_bits);
        self.check_restored(&list, &records);
    }

    /// Restores plant and planner after a slot, with the scenario as it is written, and flies the rest.
    fn check_restored(&self, list: &SensorList, records: &[SlotRecord]) {
        let written = Scenario::parse(&self.fleet.to_toml(), Path::new("written.toml"), Overrides::default()).unwrap();
        let mut mission = Mission::new(&self.fleet, list).unwrap();
        let last = 1 + records.len() * 2 / 5;
        (0..last).for_each(|_| drop(mission.next().unwrap()));
        let mut plant = Plant::new(&written, list);
        plant.restore(&saved(mission.plant())).unwrap();
        let mut planner = FleetPlanner::until(&written, &list.nodes(), &Stop::default()).unwrap();
        planner.restore(&saved(&mission.planner)).unwrap();
        for record in &records[last..] {
            let plans: Plans = plan_next(&mut planner, &plant).into_iter().map(Some).collect();
            let again = plant.step(&plans);
            let is_same = again.flights() == record.flights() && again.header == record.header;
            assert!(is_same, "restored after slot {last}, slot {}\n{}", record.slot(), self.text);
        }
    }
}

/// The mission but for `[uav]`.
fn mission(random: &mut ChaCha8Rng, number: u64, side_m: f64, slots: u32, is_free: bool) -> String {
    let mut text = format!(
        "name = 'random'\nseed = {number}\nslots = {slots}\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = {}\n\
         sampling_bps = [100.0, {:?}]\n[planner]\nhorizon.iterations = 15\n[base]\nradius_m = 6.0\ncharge_w = 300.0\n",
        random.random_range(3..40),
        random.random_range(200.0..2_000.0_f64).round()
    );
    if random.random_range(0..3) == 0 {
        let [low_m, high_m] = [0.2, 0.35].map(|part: f64| (part * side_m).round());
        write!(
            text,
            "[[area.building]]\npolygon_m = [[{low_m}, {low_m}], [{high_m}, {low_m}], [{high_m}, {high_m}]]\n\
             height_m = {}.0\n",
            random.random_range(15..70)
        )
        .unwrap();
    }
    text + if is_free { "[link]\nmodel = 'probabilistic-los'\n" } else { "[link]\n" }
}

/// Keys of a kind.
fn kind(random: &mut ChaCha8Rng, side_m: f64, slots: u32, is_free: bool, must_land: bool, has_batteries: bool) -> Kind {
    let mut lines = Vec::new();
    let mut is = |one_in: u32| random.random_range(0..one_in) == 0;
    let [is_fast, accelerates, is_high, climbs, is_own, ends] = [2, 3, 2, 2, 3, 2].map(&mut is);
    let mut line = |key: &str, value: f64| lines.push(format!("{key} = {value:?}"));
    if is_fast {
        line("max_speed_mps", random.random_range(8.0..30.0_f64).round());
    }
    if accelerates {
        line("acceleration_mps2", random.random_range(20.0..60.0_f64).round());
    }
    if is_high {
        line("altitude_m", random.random_range(25.0..80.0_f64).round());
    }
    if ends && must_land {
        line("endurance_s", random.random_range(f64::from(slots) * 0.7..f64::from(slots)).ceil());
    }
    if has_batteries && is_own {
        line("battery.capacity_j", random.random_range(20e3..60e3_f64).round());
    }
    if is_free && climbs {
        lines.push("altitude = 'free'".to_owned());
        lines.push(format!("max_climb_mps = {}.0", random.random_range(1..6)));
    }
    // The base is where the first starts: near to its centre, so that all come home.
    let near_m = |random: &mut ChaCha8Rng| (side_m / 2.0 + random.random_range(-4.0..4.0_f64)).round();
    if random.random_range(0..2) == 0 {
        let [x_m, y_m] = [near_m(random), near_m(random)];
        lines.push(format!("start_m = [{x_m:?}, {y_m:?}]"));
    }
    let blocks = (random.random_range(0..2) == 0).then(|| random.random_range(1..6));
    Kind { lines, blocks, count: random.random_range(1..=2) }
}

fn parse(text: &str, strategy: &'static str) -> Scenario {
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let parsed = Scenario::parse(text, Path::new("random.toml"), overrides).and_then(settings::resolve);
    parsed.unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// The scenario of one UAV, which flies as long as its endurance.
fn parse_alone(text: &str, strategy: &'static str) -> Scenario {
    let endurance_s = text.lines().find_map(|line| line.strip_prefix("endurance_s = "));
    let mut table: toml::Table = text.parse().unwrap();
    let endurance_s: f64 = endurance_s.unwrap().parse().unwrap();
    let slots = table["slots"].as_integer().unwrap().min(endurance_s as i64);
    table.insert("slots".to_owned(), slots.into());
    parse(&toml::to_string(&table).unwrap(), strategy)
}

fn saved(state: &impl Checkpoint) -> Vec<u8> {
    let mut bytes = Vec::new();
    state.save(&mut bytes);
    bytes
}

/// Checks the fleets of these numbers.
pub fn check_all(numbers: Range<u64>) {
    let threads = std::thread::available_parallelism().map_or(1, |threads| threads.get());
    std::thread::scope(|scope| {
        for first in 0..threads {
            let own = numbers.clone().skip(first).step_by(threads);
            scope.spawn(move || own.for_each(|number| RandomFleet::of(number).check()));
        }
    });
}
