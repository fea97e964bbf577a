//! Line of sight that stays (decision D28): one Gaussian field over the positions of both ends of a link, drawn once
//! for a mission. A UAV that hovers keeps what it sees, and two sensor nodes side by side share it. So does the
//! residual of a map that stays (decision D32).
//!
//! The field is a sum of random cosines. Its correlation is `e^{−d/l}` in the displacement `d` of either end: wave
//! vectors are multivariate Cauchy, `z/(|w| l)` with `z` and `w` standard normal.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector2, Vector3};

use super::model::{ChannelModel, Draw, Uplink};
use super::{Channel, MapChannel};
use crate::geometry::Position;
use crate::random::{Purpose, Streams, fraction, normal_cdf, normal_pair};

/// Number of cosines.
const WAVES: u32 = 128;

/// The channel of a mission with its draws: all of its slots, sensor nodes and positions.
#[derive(Debug, Clone)]
pub struct DrawnChannel {
    channel: Channel,
    streams: Streams,
    waves: Vec<Wave>,
}

#[derive(Debug, Clone, Copy)]
struct Wave {
    of_sensor: Vector2<f64>,
    of_uav: Vector3<f64>,
    phase: f64,
}

impl DrawnChannel {
    /// The draws of `channel` from the streams of a mission.
    #[must_use]
    pub fn new(channel: Channel, streams: Streams) -> Self {
        let sight_m = channel.line_of_sight().and_then(|model| model.correlation_m);
        let frozen_m = sight_m
            .or_else(|| channel.map().filter(|model| model.residual_db > 0.0).and_then(|model| model.residual_m));
        let waves = frozen_m.map_or_else(Vec::new, |correlation_m| {
            (0..WAVES).map(|wave| Wave::draw(&streams, wave, correlation_m)).collect()
        });
        Self { channel, streams, waves }
    }

    /// The law of the draws.
    pub fn law(&self) -> &Channel {
        &self.channel
    }

    /// The `uplink` of the sensor node `id` at the position `sensor` to the UAV at `uav`, in `slot`.
    pub fn draw(&self, uplink: &Uplink, sensor: &Position, uav: &Point3<f64>, slot: u64, id: u32) -> Draw {
        match &self.channel {
            _ if self.waves.is_empty() => self.channel.draw(uplink, &self.streams, slot, id),
            Channel::LineOfSight(model) => model.draw_at(uplink, self.level(sensor, uav), &self.streams, slot, id),
            Channel::Map(model) => model.draw_at(uplink, self.map_residual(model, sensor, uav, slot, id)),
            _ => self.channel.draw(uplink, &self.streams, slot, id),
        }
    }

    /// The residual of a map: that of the field, if it stays; standard normal over the missions, or the slots.
    pub(super) fn map_residual(
        &self,
        model: &MapChannel,
        sensor: &Position,
        uav: &Point3<f64>,
        slot: u64,
        id: u32,
    ) -> f64 {
        if self.waves.is_empty() { model.slot_residual(&self.streams, slot, id) } else { self.field(sensor, uav) }
    }

    /// `Φ` of the field: uniform from 0 to 1 over the missions.
    fn level(&self, sensor: &Position, uav: &Point3<f64>) -> f64 {
        normal_cdf(self.field(sensor, uav))
    }

    /// The Gaussian field: standard normal over the missions.
    fn field(&self, sensor: &Position, uav: &Point3<f64>) -> f64 {
        let of = |wave: &Wave| (wave.of_sensor.dot(&sensor.coords) + wave.of_uav.dot(&uav.coords) + wave.phase).cos();
        let sum: f64 = self.waves.iter().map(of).sum();
        sum * (2.0 / f64::from(WAVES)).sqrt()
    }
}

impl Wave {
    fn draw(streams: &Streams, wave: u32, correlation_m: f64) -> Self {
        let mut random = streams.stream(Purpose::FrozenLineOfSight, 0, wave);
        let [[x, y], [of_sensor, of_uav], [u, v], [w, _]] = std::array::from_fn(|_| normal_pair(&mut random));
        let [of_sensor, of_uav] = [of_sensor, of_uav].map(|scale| 1.0 / (scale.abs() * correlation_m));
        Self {
            of_sensor: Vector2::new(x, y) * of_sensor,
            of_uav: Vector3::new(u, v, w) * of_uav,
            phase: TAU * fraction(&mut random),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Overrides, Scenario};
    use std::path::Path;

    /// Urban line of sight that stays over 50 m.
    fn channel() -> Channel {
        let text = "name = 'x'\n[link]\nmodel = 'probabilistic-los'\nlos_correlation_m = 50.0\n";
        Channel::of(&Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap().link)
    }

    fn drawn(seed: u64) -> DrawnChannel {
        DrawnChannel::new(channel(), Streams::new(seed))
    }

    /// The value of the Gaussian field.
    fn field(drawn: &DrawnChannel, sensor: [f64; 2], uav: [f64; 3]) -> f64 {
        drawn.field(&Position::from(sensor), &Point3::from(uav))
    }

    #[test]
    fn the_normal_distribution_function_is_exact() {
        for (x, expected) in [(0.0, 0.5), (1.0, 0.841_344_746_068_543), (-1.96, 0.024_997_895_148_220), (9.0, 1.0)] {
            assert!((normal_cdf(x) - expected).abs() < 1e-13, "{x}: {}", normal_cdf(x));
        }
    }

    /// A million levels of 10 000 missions, each at 100 places far apart: uniform by Kolmogorov's test at 0.1 %.
    #[test]
    fn levels_are_uniform_over_missions() {
        let mut levels = Vec::new();
        for seed in 0..10_000 {
            let drawn = drawn(seed);
            for place in 0..100 {
                let [x_m, y_m] = [f64::from(place % 10), f64::from(place / 10)].map(|step| 5_000.0 * step);
                let uav = Point3::new(900.0 - x_m, 800.0 + 3.0 * y_m, 60.0);
                levels.push(drawn.level(&Position::new(x_m, y_m), &uav));
            }
        }
        levels.sort_unstable_by(f64::total_cmp);
        let count = levels.len() as f64;
        let farthest = levels.iter().zip(1..).map(|(level, rank)| (level - f64::from(rank) / count).abs());
        let farthest = farthest.fold(0.0, f64::max);
        assert!(farthest < 1.95e-3, "{farthest}");
    }

    #[test]
    fn the_correlation_falls_exponentially_with_the_displacement_of_either_end() {
        const MISSIONS: u64 = 10_000;
        let here = ([10.0, 20.0], [30.0, -5.0, 40.0]);
        // (SN, UAV, the sum of both displacements [m])
        let others = [
            ([10.0, 20.0], [30.0, -5.0, 40.0], 0.0),
            ([40.0, 60.0], [30.0, -5.0, 40.0], 50.0), // 30 and 40 m
            ([10.0, 20.0], [36.0, 3.0, 40.0], 10.0),  // 6 and 8 m
            ([10.0, 20.0], [30.0, -5.0, 140.0], 100.0),
            ([25.0, 20.0], [30.0, 20.0, 40.0], 40.0), // 15 m and 25 m
        ];
        let mut sums = [0.0; 5];
        for seed in 0..MISSIONS {
            let drawn = drawn(seed);
            let value = field(&drawn, here.0, here.1);
            for (sum, (sensor, uav, _)) in sums.iter_mut().zip(others) {
                *sum += value * field(&drawn, sensor, uav);
            }
        }
        for (sum, (_, _, displaced_m)) in sums.iter().zip(others) {
            let found = sum / MISSIONS as f64;
            let expected = (-displaced_m / 50.0f64).exp();
            assert!((found - expected).abs() < 0.04, "{displaced_m} m: {found}, not {expected}");
        }
    }

    #[test]
    fn frozen_links_keep_the_line_of_sight_frequency_and_their_state() {
        let sensor = Position::new(0.0, 0.0);
        let uav = Point3::new(40.0, 30.0, 30.0);
        let uplink = Uplink::new(1.0, &sensor, &uav);
        let probability = channel().line_of_sight().unwrap().los_probability(&uplink);
        let mut seen = 0;
        for seed in 0..5_000 {
            let drawn = drawn(seed);
            let first = drawn.draw(&uplink, &sensor, &uav, 1, 0).line_of_sight;
            seen += u32::from(first);
            for (slot, id) in [(2, 0), (700, 0), (3, 8)] {
                assert_eq!(drawn.draw(&uplink, &sensor, &uav, slot, id).line_of_sight, first, "seed {seed}");
            }
            let best_bps = channel().best_drawn_rate_bps(&uplink, &Streams::new(seed), 1, 0);
            assert!(drawn.draw(&uplink, &sensor, &uav, 1, 0).rate_bps <= best_bps);
        }
        assert!((f64::from(seen) / 5_000.0 - probability).abs() < 0.02, "{seen} of 5 000, {probability}");
    }

    #[test]
    fn draws_are_independent_per_slot_without_the_correlation_key() {
        let text = "name = 'x'\n[link]\nmodel = 'probabilistic-los'\nlos_correlation_m = 0.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let channel = Channel::of(&scenario.link);
        let drawn = DrawnChannel::new(channel.clone(), Streams::new(4));
        let sensor = Position::new(0.0, 0.0);
        let uav = Point3::new(40.0, 0.0, 30.0);
        let uplink = Uplink::new(1.0, &sensor, &uav);
        for slot in 1..200 {
            assert_eq!(drawn.draw(&uplink, &sensor, &uav, slot, 3), channel.draw(&uplink, &Streams::new(4), slot, 3));
        }
    }
}
