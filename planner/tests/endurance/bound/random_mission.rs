//! Small random missions over every channel, altitude, gain and knowledge setting.

use std::path::Path;

use rand::{Rng, RngExt};
use skysink_common::channel::RateTable;
use skysink_common::random::{Purpose, Streams};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;

/// The same mission with the models of the channel that are off by default: fading, line of sight that stays, noise
/// that scales with the bandwidth, or a table.
pub fn with_models(seed: u64) -> String {
    let text = random_mission(seed);
    let is_los = text.contains("probabilistic-los");
    let fading = ["", "fading = 'rician'\nk_db = -inf\n", "fading = 'rician'\n"][(seed % 3) as usize];
    let frozen = if is_los && !seed.is_multiple_of(4) { "los_correlation_m = 20.0\n" } else { "" };
    let text = text.replacen("[link]\n", &format!("[link]\n{fading}{frozen}"), 1);
    if seed % 7 == 3 {
        let (others, link) = text.split_once("[link]\n").unwrap();
        let channel = ["model", "gain", "tx_power_w", "noise", "environment", "los", "fading", "k_db"];
        let is_of_all = |line: &&str| !channel.iter().any(|key| line.starts_with(key));
        let link: Vec<&str> = link.lines().filter(is_of_all).collect();
        return format!("{others}[link]\nmodel = 'table'\nfile = 'links.csv'\n{}\n", link.join("\n"));
    }
    // The power that noise_dbm = -109 has in 1 MHz.
    if seed.is_multiple_of(2) { text.replace("noise_dbm = -109.0", "noise_dbm_per_hz = -169.0") } else { text }
}

/// The scenario of a mission's text; a table has rates that rise and fall with distance and altitude, about those that
/// [`random_mission`] has.
pub fn random_scenario(text: &str, strategy: &'static str, seed: u64) -> Scenario {
    let rate_bps = number(text, "bandwidth_hz") * 20.0;
    let mut random = Streams::new(seed).stream(Purpose::TableDraw, 0, 0);
    let [distances_m, altitudes_m] = [vec![0.0, 3.0, 12.0, 50.0], vec![8.0, 25.0]];
    let probabilities = [vec![0.5], vec![0.1, 0.6, 0.9]][random.random_range(0..2)].clone();
    let mut rates_bps = Vec::new();
    for _ in 0..distances_m.len() * altitudes_m.len() {
        let mut quantiles_bps: Vec<f64> = probabilities.iter().map(|_| rate_bps * random.random::<f64>()).collect();
        quantiles_bps.sort_unstable_by(f64::total_cmp);
        rates_bps.extend(quantiles_bps);
    }
    let table = RateTable::new(distances_m, altitudes_m, probabilities, rates_bps).unwrap().shared();
    let overrides =
        Overrides { strategy: Some(strategy), seed: Some(seed), table: Some(table), ..Overrides::default() };
    Scenario::parse(&format!("name = 'case'\n{text}"), Path::new("case.toml"), overrides).unwrap()
}

/// The same mission with the models of the field and of the UAV that are off by default: own buffers, wind,
/// acceleration and position errors, each in every second mission.
pub fn in_a_real_world(seed: u64) -> String {
    let mut text = with_models(seed);
    let mut random = Streams::new(seed).stream(Purpose::Position, 3, 0);
    let mut uav = String::new();
    let speed_mps = number(&text, "max_speed_mps");
    if random.random() {
        let [east, north] = [(); 2].map(|()| random.random_range(-0.6..0.6) * speed_mps);
        uav += &format!("wind_mps = [{east:?}, {north:?}]\n");
    }
    if random.random() {
        uav +=
            &format!("acceleration_mps2 = {:?}\n", speed_mps / number(&text, "slot_s") * random.random_range(0.3..8.0));
    }
    if random.random() {
        uav += &format!("position_error_m = {:?}\n", random.random_range(0.1..20.0));
    }
    if random.random() {
        let capacity_bits = number(&text, "capacity_bits") as u32;
        let own = format!("capacity_bits = [{}, {}]", capacity_bits.div_ceil(4), capacity_bits * 4);
        text = text.replacen(&format!("capacity_bits = {capacity_bits}"), &own, 1);
    }
    text.replacen("[uav]\n", &format!("[uav]\n{uav}"), 1)
}

/// The list with weights of 1 to 10 in every second mission.
pub fn with_weights(list: &SensorList, scenario: &Scenario) -> SensorList {
    if scenario.seed.is_multiple_of(2) {
        return list.clone();
    }
    let csv = list.to_csv();
    let rows = csv.lines().enumerate().map(|(row, line)| match row {
        0 => format!("{line},weight\n"),
        row => format!("{line},{}\n", 1 + row * 7 % 10),
    });
    SensorList::parse(&rows.collect::<String>(), Path::new("weights.csv"), scenario).unwrap()
}

/// The value of a key.
fn number(text: &str, key: &str) -> f64 {
    let value = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = ")).unwrap();
    value.parse().unwrap()
}

/// The lines of a mission with 1 to 8 sensor nodes and 5 to 60 slots, as seed `seed` draws it.
pub fn random_mission(seed: u64) -> String {
    let mut random = Streams::new(seed).stream(Purpose::Position, 1, 0);
    let mut one_of = |choices: &[f64]| choices[(random.next_u32() as usize) % choices.len()];
    let slot_s = one_of(&[1.0, 0.5, 0.37, 2.0]);
    let capacity_bits = one_of(&[3.0, 17.0, 100.0, 1_000.0, 30_000.0]);
    // Rates with which a buffer fills within some slots; s τ is a fraction.
    let lowest_bps = capacity_bits / (slot_s * one_of(&[2.0, 5.0, 11.0, 30.0, 200.0]));
    let highest_bps = lowest_bps * one_of(&[1.0, 1.0, 1.7, 10.0]);
    let queue_bits = [0.0, capacity_bits * one_of(&[0.0, 0.5, 2.0])];
    let side_m = one_of(&[20.0, 60.0, 150.0, 400.0]);
    let altitude_m = one_of(&[10.0, 20.0, 40.0]);
    let comm_s = slot_s * one_of(&[0.1, 0.5, 1.0]);
    // Links that carry from a hundredth of a buffer to many buffers, at about 10 bit/s/Hz.
    let bandwidth_hz = capacity_bits / (comm_s * 10.0) * one_of(&[0.01, 0.1, 0.3, 1.0, 3.0, 100.0]);
    let channel = one_of(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]) as usize;
    let los = |curve: &str| format!("model = 'probabilistic-los'\ntx_power_w = 0.1\nnoise_dbm = -109.0\n{curve}");
    let link = match channel {
        0 => "gain_db = [-60.0, -50.0]".to_owned(),
        1 => "gain = 'per-slot'\ngain_db = [-90.0, -50.0]".to_owned(),
        2 => "gain = 'per-slot'".to_owned(),
        3 => los("environment = 'suburban'"),
        4 => los("environment = 'urban'"),
        5 => los("environment = 'dense-urban'"),
        6 => los("environment = 'high-rise'"),
        _ => los("los = { b1 = -0.4568, b2 = 0.047, b3 = -0.63, b4 = 1.63 }"),
    };
    let altitude = match one_of(&[0.0, 1.0]) {
        1.0 if channel > 2 => {
            format!("altitude = 'free'\nmin_altitude_m = 5.0\nmax_climb_mps = {}", one_of(&[1.0, 9.0]))
        }
        _ => "altitude = 'fixed'".to_owned(),
    };
    let knowledge = match one_of(&[0.0, 1.0, 2.0]) {
        0.0 => "knowledge = 'oracle'",
        1.0 => "knowledge = 'estimated'",
        _ => "knowledge = 'estimated'\nrates = 'learnt'",
    };
    let mean_s = slot_s * one_of(&[1.0, 3.0, 12.0]);
    let arrivals = match one_of(&[0.0, 0.0, 1.0, 2.0]) {
        0.0 => String::new(),
        1.0 => format!("model = 'poisson'\npacket_bits = {}", one_of(&[1.0, 7.0, 200.0])),
        _ => format!("model = 'on-off'\non_s = {mean_s:?}\noff_s = {:?}", slot_s * one_of(&[1.0, 4.0])),
    };
    let arrivals = if arrivals.is_empty() { arrivals } else { format!("[sensors.arrivals]\n{arrivals}\n") };
    let [count, slots, blocks] = [(1, 8), (5, 60), (1, 4)].map(|(least, most)| random.random_range(least..=most));
    let [start_x_m, start_y_m] = [(); 2].map(|()| random.random::<f64>() * side_m);
    let speed_mps = [3.0, 12.0, 30.0, 60.0][random.random_range(0..4)] / slot_s;
    let radius_m = [2.0, 10.0, 30.0, 70.0][random.random_range(0..4)];
    format!(
        "slots = {slots}\nslot_s = {slot_s}\n[area]\nside_m = {side_m}\n[sensors]\ncount = {count}\n\
         capacity_bits = {capacity_bits}\nsampling_bps = [{lowest_bps:?}, {highest_bps:?}]\n\
         initial_queue_mean_bits = {queue_bits:?}\n{arrivals}[uav]\nmax_speed_mps = {speed_mps:?}\naltitude_m = {altitude_m:?}\n\
         start_m = [{start_x_m:?}, {start_y_m:?}]\n{altitude}\n[link]\ncomm_radius_m = {radius_m:?}\n\
         comm_s = {comm_s:?}\nbandwidth_hz = {bandwidth_hz:?}\nresource_blocks = {blocks}\n{link}\n[planner]\n{knowledge}\n\
         horizon.iterations = 40\noffline.steps = 2000\n"
    )
}
