//! Upper bounds on the capacity of the link of a sensor node in a slot, over all positions of the UAV.
//!
//! A link is best from straight above at the lowest altitude: rates fall with the distance, and the probability of line
//! of sight is highest there. The draw of a random channel depends only on the seed, the slot and the sensor node, so
//! the capacity at the best position is known. A line of sight that stays depends on the position, and is assumed. By a
//! map of links the best is the highest node of its grid.

use skysink_common::channel::{Channel, ChannelModel, Uplink};
use skysink_common::random::Streams;
use skysink_common::scenario::{Scenario, UavKeys};
use skysink_common::sensors::Sensors;

use super::margins::RELATIVE_MARGIN;

/// Most draws that are evaluated; with more, the best draw is assumed.
const MOST_DRAWS: u64 = 20_000_000;

/// The best links of a mission.
#[derive(Debug, Clone)]
pub struct BestLinks {
    pub(crate) channel: Channel,
    streams: Streams,
    /// Sensor nodes (SNs) by their ids, with their gains, and the highest levels of a map.
    sensors: Vec<(u32, f64, f64)>,
    /// Of the kinds of UAVs.
    descents: Vec<Descent>,
    are_drawn: bool,
}

/// How low a UAV flies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Descent {
    /// Altitude before slot 1 [m].
    start_m: f64,
    /// Farthest descent in a slot [m]; 0 at a fixed altitude.
    slot_m: f64,
    lowest_m: f64,
}

impl Descent {
    fn of(uav: &UavKeys, slot_s: f64) -> Self {
        let climb = uav.climb();
        Self {
            start_m: uav.altitude_m,
            slot_m: climb.map_or(0.0, |climb| climb.max_climb_mps * slot_s),
            lowest_m: climb.map_or(uav.altitude_m, |climb| climb.min_altitude_m),
        }
    }
}

impl BestLinks {
    /// The links of the SNs that sample.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &Sensors) -> Self {
        Self::over(scenario, sensors, sensors.sampling_ids())
    }

    /// The links of the SNs `ids`.
    #[must_use]
    pub fn over(scenario: &Scenario, sensors: &Sensors, ids: impl Iterator<Item = u32>) -> Self {
        let channel = Channel::of(&scenario.link);
        let level =
            |id: u32| channel.map().map_or(f64::INFINITY, |model| model.map.highest_level(sensors.position(id)));
        let sensors: Vec<_> = ids.map(|id| (id, sensors.gains[id as usize], level(id))).collect();
        let mut descents: Vec<Descent> = scenario.uav_kinds().map(|uav| Descent::of(uav, scenario.slot_s)).collect();
        descents.dedup();
        let draws = (sensors.len() as u64).saturating_mul(scenario.slots);
        Self { channel, streams: Streams::new(scenario.seed), sensors, descents, are_drawn: draws <= MOST_DRAWS }
    }

    /// Whole bits that the link of the SN at `index` carries in `slot` at most.
    pub fn best_bits(&self, slot: u64, index: usize) -> u64 {
        let (id, gain, level) = self.sensors[index];
        let rate_bps = |descent: &Descent| {
            let uplink = Uplink { level, ..self.above(descent, slot, gain) };
            if self.are_drawn {
                self.channel.best_drawn_rate_bps(&uplink, &self.streams, slot, id)
            } else {
                self.channel.best_rate_bps(&uplink)
            }
        };
        let best_bps = self.descents.iter().map(rate_bps).fold(0.0, f64::max);
        self.channel.capacity_bits(best_bps * (1.0 + RELATIVE_MARGIN))
    }

    /// By slot: upper bound on the expected bits, before the draw, that any link carries of a queue of `queue_bits`.
    pub fn expected_bits(&self, queue_bits: u64) -> impl FnMut(u64) -> f64 {
        let carried_bits =
            move |rate_bps: f64| self.channel.capacity_bits(rate_bps * (1.0 + RELATIVE_MARGIN)).min(queue_bits) as f64;
        let highest_gain = self.sensors.iter().map(|(_, gain, _)| *gain).fold(0.0, f64::max);
        // In most slots the lowest altitude is that of the slot before.
        let mut last: Vec<Option<(Uplink, f64)>> = vec![None; self.descents.len()];
        move |slot| {
            let of_kind = |(descent, last): (&Descent, &mut Option<(Uplink, f64)>)| {
                let uplink = self.above(descent, slot, highest_gain);
                let known = last.filter(|(same, _)| *same == uplink);
                let mean_bits = || self.channel.best_mean_over_draws(&uplink, &carried_bits);
                let (_, bits) = *last.insert(known.unwrap_or_else(|| (uplink, mean_bits())));
                bits
            };
            self.descents.iter().zip(&mut last).map(of_kind).fold(0.0, f64::max)
        }
    }

    /// The uplink from straight above at the lowest altitude that a UAV can reach by the end of `slot`.
    fn above(&self, descent: &Descent, slot: u64, gain: f64) -> Uplink {
        let reached_m = descent.start_m - descent.slot_m * slot as f64;
        self.channel.uplink_at(gain, 0.0, reached_m.max(descent.lowest_m) * (1.0 - RELATIVE_MARGIN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    /// Where line of sight stays, a planner may know where it is: then a link carries what it carries in it.
    #[test]
    fn the_bound_assumes_a_permanent_line_of_sight() {
        let links = |keys: &str| {
            let text = format!("name = 'x'\n[link]\nmodel = 'probabilistic-los'\nenvironment = 'high-rise'\n{keys}");
            let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
            let nodes = skysink_common::sensors::SensorList::of(&scenario).unwrap().nodes();
            BestLinks::new(&scenario, &Sensors::of(&scenario, &nodes))
        };
        let [redrawn, frozen] = ["", "los_correlation_m = 9.0\n"].map(links);
        let link = frozen.channel.line_of_sight().unwrap();
        let seen_bits = frozen.channel.capacity_bits(link.los_rate_bps(0.0, 20.0));
        assert_eq!(frozen.expected_bits(u64::MAX)(1), seen_bits as f64);
        assert!(redrawn.expected_bits(u64::MAX)(1) < seen_bits as f64);
        let drawn: Vec<[u64; 2]> =
            (1..60).map(|slot| [&redrawn, &frozen].map(|links| links.best_bits(slot, 3))).collect();
        assert!(drawn.iter().all(|&[redrawn, frozen]| frozen == seen_bits && redrawn <= frozen), "{drawn:?}");
        assert!(drawn.iter().any(|&[redrawn, frozen]| redrawn < frozen), "{drawn:?}");
    }

    #[test]
    fn the_best_link_is_from_the_lowest_altitude_in_reach() {
        let text = "name = 'x'\nslots = 9\nslot_s = 2.0\n[uav]\naltitude = 'free'\naltitude_m = 60.0\nmin_altitude_m = 45.0\n\
                    max_climb_mps = 4.0\n[link]\nmodel = 'probabilistic-los'\nenvironment = 'urban'\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let links = BestLinks::new(&scenario, &Sensors::of(&scenario, &[]));
        for (slot, lowest_m) in [(0, 60.0), (1, 52.0), (2, 45.0), (3, 45.0)] {
            let above_m = links.above(&links.descents[0], slot, 1.0).z_m;
            // Never above it, so that rounding does not put the bound below a flown link.
            assert!(above_m <= lowest_m && above_m > lowest_m * (1.0 - 1e-8), "slot {slot}: {above_m} m");
        }
    }
}
