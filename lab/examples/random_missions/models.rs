//! The models that are off by default (decisions D24 to D29 and D31), one or two of them added to a random mission.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::generator::RandomMission;

/// What can be added.
const MODELS: [fn(&mut RandomMission, &mut ChaCha8Rng); 9] = [
    arrivals,
    arrivals,
    |mission, random| {
        let capacity_bits = mission.number("capacity_bits");
        // No less than the buffer of the scenario, so that every queue fits.
        mission.add_column("capacity_bits", |_| (capacity_bits * 4.0_f64.powf(random.random())).round());
    },
    |mission, random| mission.add_column("weight", |_| 10.0_f64.powf(random.random())),
    |mission, random| {
        mission.remove("noise_dbm = -109.0\n");
        mission.add("link", &format!("noise_dbm_per_hz = {:?}\n", [-174.0, -160.0, -145.0][random.random_range(0..3)]));
    },
    |mission, random| {
        let k_db = ["-inf", "0.0", "10.0"][random.random_range(0..3)];
        mission.add("link", &format!("fading = \"rician\"\nk_db = {k_db}\n"));
        mission.is_hidden = true;
    },
    |mission, random| {
        if mission.scenario.contains("probabilistic-los") {
            mission.add("link", &format!("los_correlation_m = {:?}\n", 5.0 * 20.0_f64.powf(random.random())));
        } else {
            arrivals(mission, random);
        }
    },
    |mission, random| {
        let speed_mps = mission.number("max_speed_mps") * 0.8 * random.random::<f64>();
        let (north, east) = (TAU * random.random::<f64>()).sin_cos();
        mission.add("uav", &format!("wind_mps = [{:?}, {:?}]\n", east * speed_mps, north * speed_mps));
    },
    |mission, random| {
        if random.random() {
            // The reach falls to a quarter at least.
            let briefest = mission.number("max_speed_mps") / mission.number("slot_s");
            let acceleration_mps2 = briefest * 10.0_f64.powf(random.random());
            mission.add("uav", &format!("acceleration_mps2 = {acceleration_mps2:?}\n"));
        } else {
            mission.add("uav", &format!("position_error_m = {:?}\n", 0.3 * 60.0_f64.powf(random.random())));
            mission.is_hidden = true;
        }
    },
];

/// Packets of one bit to a tenth of a buffer, or on and off for some slots.
fn arrivals(mission: &mut RandomMission, random: &mut ChaCha8Rng) {
    if mission.scenario.contains("[sensors.arrivals]") {
        return;
    }
    let slot_s = mission.number("slot_s");
    let capacity_bits = mission.number("capacity_bits");
    let mut mean_s = || slot_s * 30.0_f64.powf(random.random());
    let on_s = mean_s();
    let off_s = mean_s();
    let packet_bits = (capacity_bits / 10.0).powf(random.random()) as u32;
    let law = if random.random() {
        format!("model = \"poisson\"\npacket_bits = {packet_bits}\n")
    } else {
        format!("model = \"on-off\"\non_s = {on_s:?}\noff_s = {off_s:?}\n")
    };
    mission.scenario = mission.scenario.replacen("[uav]\n", &format!("[sensors.arrivals]\n{law}[uav]\n"), 1);
    mission.is_hidden = true;
}

impl RandomMission {
    /// The same mission with one or two models, as its number draws them.
    pub fn with_models(mut self, number: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(!number);
        let first = random.random_range(0..MODELS.len());
        MODELS[first](&mut self, &mut random);
        let second = random.random_range(0..MODELS.len());
        if random.random() && second != first {
            MODELS[second](&mut self, &mut random);
        }
        self
    }

    /// Adds lines to a table of the scenario.
    fn add(&mut self, table: &str, lines: &str) {
        self.scenario = self.scenario.replacen(&format!("[{table}]\n"), &format!("[{table}]\n{lines}"), 1);
    }

    fn remove(&mut self, line: &str) {
        self.scenario = self.scenario.replace(line, "");
    }

    /// The value of a key.
    fn number(&self, key: &str) -> f64 {
        let mut values = self.scenario.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix(" = "));
        values.next().and_then(|value| value.parse().ok()).expect("a number")
    }

    /// Adds a column to the sensor list, by its rows.
    fn add_column(&mut self, name: &str, mut value: impl FnMut(&str) -> f64) {
        let (header, rows) = self.sensors.split_once('\n').expect("a header");
        let rows: String = rows.lines().map(|row| format!("{row},{}\n", value(row))).collect();
        self.sensors = format!("{header},{name}\n{rows}");
    }
}
