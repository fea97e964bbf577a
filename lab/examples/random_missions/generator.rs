//! Random missions of every kind: sizes, fields, channels, loads and knowledge.

use std::fmt::Write;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use skysink_common::interpolation::interpolate;

/// A mission as its two files.
pub struct RandomMission {
    /// The scenario file, without a strategy.
    pub scenario: String,
    /// The sensor list, `sensors.csv`.
    pub sensors: String,
    /// Whether links are drawn in every slot, or queues or rates are unknown to the planner.
    pub is_hidden: bool,
}

/// Channel of a mission.
#[derive(Clone, Copy, PartialEq)]
enum Channel {
    Static,
    PerSlot,
    LineOfSight { is_free: bool },
}

/// Draws missions by their number. Quantities that are unknown to the planner also depend on the draw.
pub struct Generator {
    number: u64,
    random: ChaCha8Rng,
}

/// The knowledge of the planner.
#[derive(Clone, Copy, PartialEq)]
enum Knowledge {
    All,
    RatesOnly,
    Neither,
}

impl Generator {
    pub fn new(number: u64) -> Self {
        Self { number, random: ChaCha8Rng::seed_from_u64(number) }
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        interpolate(low, high, self.random.random())
    }

    fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        self.uniform(low.ln(), high.ln()).exp()
    }

    fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.random.random_range(0..choices.len())]
    }

    /// A mission of 5 to 400 SNs over 30 to 2 000 m.
    pub fn mission(&mut self, draw: u64) -> RandomMission {
        let seed = self.number * 1_000 + draw;
        let count = self.log_uniform(5.0, 400.0) as usize;
        let side_m = self.log_uniform(30.0, 2_000.0).round();
        let slots = self.one_of(&[20, 40, 80, 120, 200]);
        let slot_s = self.one_of(&[0.5, 1.0, 2.0]);
        let reach_m = self.uniform(5.0, 60.0);
        let comm_radius_m = self.log_uniform(5.0, 100.0);
        let altitude_m = self.one_of(&[20.0, 50.0, 100.0]);
        let blocks = self.random.random_range(1..=8);
        let capacity_bits = self.one_of(&[1_000u32, 30_000, 300_000]);
        let channel = self.one_of(&[
            Channel::Static,
            Channel::PerSlot,
            Channel::LineOfSight { is_free: false },
            Channel::LineOfSight { is_free: true },
        ]);
        let fill_slots = self.log_uniform(5.0, 400.0);
        let least_bps = f64::from(capacity_bits) / (fill_slots * slot_s);
        let most_bps = if self.random.random::<bool>() { least_bps } else { least_bps * self.uniform(1.0, 10.0) };
        let initial_bits = self.one_of(&[[0.0, 0.0], [0.33, 0.33], [0.0, 0.66], [0.0, 1.0]]);
        let initial_bits = initial_bits.map(|fraction| fraction * f64::from(capacity_bits));
        // A visit from above carries this fraction of a buffer.
        let carried = self.log_uniform(0.03, 30.0);
        let efficiency = if matches!(channel, Channel::LineOfSight { .. }) { 10.0 } else { 13.0 };
        let comm_s = slot_s * 0.1;
        let bandwidth_hz = carried * f64::from(capacity_bits) / (efficiency * comm_s);
        let start_m = self.one_of(&[[0.5, 0.5], [0.0, 0.0], [0.9, 0.2]]).map(|fraction| fraction * side_m);
        let knowledge = self.one_of(&[Knowledge::All, Knowledge::All, Knowledge::RatesOnly, Knowledge::Neither]);
        let mut text = format!(
            "name = \"random\"\nseed = {seed}\nslots = {slots}\nslot_s = {slot_s:?}\n[area]\nside_m = {side_m:?}\n\
             [sensors]\nfile = \"sensors.csv\"\ncapacity_bits = {capacity_bits}\nsampling_bps = [{least_bps:?}, \
             {most_bps:?}]\ninitial_queue_mean_bits = {initial_bits:?}\n[uav]\naltitude_m = {altitude_m:?}\n\
             max_speed_mps = {:?}\nendurance_s = 1e6\nstart_m = {start_m:?}\n",
            reach_m / slot_s
        );
        if channel == (Channel::LineOfSight { is_free: true }) {
            text += "altitude = \"free\"\nmin_altitude_m = 20.0\nmax_altitude_m = 120.0\nmax_climb_mps = 5.0\n";
        }
        write!(
            text,
            "[link]\nbandwidth_hz = {bandwidth_hz:?}\ncomm_radius_m = {comm_radius_m:?}\ncomm_s = {comm_s:?}\n\
             resource_blocks = {blocks}\n"
        )
        .expect("memory takes everything");
        match channel {
            Channel::Static => {}
            Channel::PerSlot => {
                let least_db = self.one_of(&[-55.0, -70.0]);
                write!(text, "gain = \"per-slot\"\ngain_db = [{least_db:?}, -50.0]\n").expect("memory");
            }
            Channel::LineOfSight { .. } => {
                let environment = self.one_of(&["suburban", "urban", "dense-urban", "high-rise"]);
                write!(text, "model = \"probabilistic-los\"\nenvironment = \"{environment}\"\ntx_power_w = 0.1\n")
                    .expect("memory");
                text += "noise_dbm = -109.0\n";
            }
        }
        text += match knowledge {
            Knowledge::All => "[planner]\n",
            Knowledge::RatesOnly => "[planner]\nknowledge = \"estimated\"\n",
            Knowledge::Neither => "[planner]\nknowledge = \"estimated\"\nrates = \"learnt\"\n",
        };
        let rates_bps = [least_bps, most_bps];
        let queues_bits = initial_bits.map(|bits| bits.min(capacity_bits.into()));
        let hidden = (draw > 0).then(|| (knowledge, ChaCha8Rng::seed_from_u64(seed)));
        let sensors = self.sensors(count, side_m, rates_bps, queues_bits, hidden);
        RandomMission { scenario: text, sensors, is_hidden: channel != Channel::Static || knowledge != Knowledge::All }
    }

    /// The sensor list: uniform over the area, in clusters, or along a line. Unknown quantities depend on the draw.
    fn sensors(
        &mut self,
        count: usize,
        side_m: f64,
        rates_bps: [f64; 2],
        queues_bits: [f64; 2],
        mut hidden: Option<(Knowledge, ChaCha8Rng)>,
    ) -> String {
        let layout = self.random.random_range(0..3);
        let clusters: Vec<[f64; 2]> =
            (0..=count / 20).map(|_| [self.uniform(0.0, side_m), self.uniform(0.0, side_m)]).collect();
        let spread = Normal::new(0.0, side_m / 15.0).expect("a width above 0");
        let two_rates = self.random.random::<bool>();
        let mut csv = "x_m,y_m,queue_bits,gain_db,sampling_bps\n".to_owned();
        for _ in 0..count {
            let [x_m, y_m] = match layout {
                0 => [self.uniform(0.0, side_m), self.uniform(0.0, side_m)],
                1 => {
                    let [x_m, y_m] = self.one_of(&clusters);
                    [x_m + spread.sample(&mut self.random), y_m + spread.sample(&mut self.random)]
                }
                _ => {
                    let along_m = self.uniform(0.0, side_m);
                    [along_m, along_m + spread.sample(&mut self.random) / 4.0]
                }
            };
            let mut queue_bits = queue(&mut self.random, queues_bits);
            let gain_db = self.uniform(-55.0, -50.0);
            let mut rate_bps = rate(&mut self.random, rates_bps, two_rates);
            if let Some((knowledge, random)) = &mut hidden {
                if *knowledge != Knowledge::All {
                    queue_bits = queue(random, queues_bits);
                }
                if *knowledge == Knowledge::Neither {
                    rate_bps = rate(random, rates_bps, two_rates);
                }
            }
            let [x_m, y_m] = [x_m, y_m].map(|coordinate: f64| coordinate.clamp(0.0, side_m));
            writeln!(csv, "{x_m},{y_m},{queue_bits},{gain_db},{rate_bps}").expect("memory takes everything");
        }
        csv
    }
}

fn queue(random: &mut ChaCha8Rng, [low_bits, high_bits]: [f64; 2]) -> u32 {
    interpolate(low_bits, high_bits, random.random()) as u32
}

fn rate(random: &mut ChaCha8Rng, [low_bps, high_bps]: [f64; 2], two_rates: bool) -> f64 {
    if two_rates {
        return if random.random_range(0..8) == 0 { high_bps } else { low_bps };
    }
    interpolate(low_bps, high_bps.max(low_bps.next_up()), random.random())
}

impl RandomMission {
    /// Writes the mission into a folder, for `skysink simulate`.
    pub fn write(&self, folder: &Path) -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        std::fs::write(folder.join("scenario.toml"), &self.scenario)?;
        std::fs::write(folder.join("sensors.csv"), &self.sensors)
    }
}
