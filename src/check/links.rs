//! The bits that one visit uploads, over the weakest and the strongest link.

use std::f64::consts::TAU;

use serde::Serialize;
use skysink_common::channel::{Channel, ChannelModel};
use skysink_common::geometry::{Position, above};
use skysink_common::interpolation::interpolate;
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

/// Directions in which the links of a map are looked at.
const TURNS: u32 = 16;

/// Number of altitude steps that are compared if the UAV can change its altitude.
const LEVELS: u32 = 16;

/// The uplinks of the weakest and the strongest sensor node (SN) at one horizontal distance: expected rates, at the
/// best altitude.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LinkFigures {
    /// Rates of the weakest and the strongest link [bit/s]: expected values, at the best of 17 altitudes if it is free.
    pub rates_bps: [f64; 2],
    /// Bits per visit, `floor(r τ_c)`.
    pub visit_bits: [u64; 2],
    /// Minimum and maximum number of visits that empty a full buffer: the smallest over the strongest link, the largest
    /// over the weakest; `None` if the link carries nothing.
    pub visits: [Option<u64>; 2],
}

impl LinkFigures {
    /// The uplinks at the horizontal distance `distance_m` [m].
    pub fn at(scenario: &Scenario, nodes: &[SensorNode], distance_m: f64) -> Self {
        let channel = Channel::of(&scenario.link.planned());
        let rates_bps = match channel.map() {
            Some(_) => by_place(scenario, &channel, nodes, distance_m),
            None => gains(&channel, nodes).map(|gain| best_rate_bps(scenario, &channel, gain, distance_m * distance_m)),
        };
        let visit_bits = rates_bps.map(|rate_bps| channel.capacity_bits(rate_bps));
        let buffers_bits = || nodes.iter().map(|node| u64::from(node.capacity_bits));
        let buffer_bits = [buffers_bits().max().unwrap_or(0), buffers_bits().min().unwrap_or(0)];
        let visits = |link: usize| (visit_bits[link] > 0).then(|| buffer_bits[link].div_ceil(visit_bits[link]));
        let [weak, strong] = [visits(0), visits(1)];
        Self { rates_bps, visit_bits, visits: [strong, weak] }
    }
}

/// The lowest and the highest gain: of the SNs, or of the range from which they are drawn in every slot.
fn gains(channel: &Channel, nodes: &[SensorNode]) -> [f64; 2] {
    channel.drawn_gains().unwrap_or_else(|| {
        let lowest = nodes.iter().map(|node| node.gain).fold(f64::INFINITY, f64::min);
        [lowest, nodes.iter().map(|node| node.gain).fold(0.0, f64::max)]
    })
}

/// The lowest and the highest expected rate [bit/s] of a map at the horizontal distance `distance_m` [m] from the SNs,
/// in any direction.
fn by_place(scenario: &Scenario, channel: &Channel, nodes: &[SensorNode], distance_m: f64) -> [f64; 2] {
    let rate_bps = |node: &SensorNode, turn: u32| {
        let (sin, cos) = (TAU * f64::from(turn) / f64::from(TURNS)).sin_cos();
        let sensor = Position::new(node.x_m, node.y_m);
        let at = Position::new(node.x_m + distance_m * cos, node.y_m + distance_m * sin);
        channel.expected_rate_bps(&channel.uplink(node.gain, &sensor, &above(&at, scenario.uav.altitude_m)))
    };
    let rates_bps = || {
        nodes.iter().flat_map(|node| (0..TURNS).map(move |turn| (node, turn))).map(|(node, turn)| rate_bps(node, turn))
    };
    [rates_bps().fold(f64::INFINITY, f64::min), rates_bps().fold(0.0, f64::max)]
}

/// The expected rate [bit/s] at the squared horizontal distance `d2_m2` [m²], at the best of several allowed altitudes.
fn best_rate_bps(scenario: &Scenario, channel: &Channel, gain: f64, d2_m2: f64) -> f64 {
    let uav = &scenario.uav;
    let [low_m, high_m] = uav.climb().map_or([uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m]);
    let z_m = |level: u32| interpolate(low_m, high_m, f64::from(level) / f64::from(LEVELS));
    let rate_bps = |level: u32| channel.expected_rate_bps(&channel.uplink_at(gain, d2_m2, z_m(level)));
    (0..=LEVELS).map(rate_bps).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use skysink_common::scenario::Overrides;
    use skysink_common::units::ratio_of_db;

    /// Uplinks of two SNs with the gains −55 dB and −50 dB.
    fn figures(keys: &str, distance_m: f64) -> LinkFigures {
        let text = format!("name = 'a'\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        let node = |gain_db| SensorNode { gain: ratio_of_db(gain_db), capacity_bits: 30_000, ..SensorNode::default() };
        LinkFigures::at(&scenario, &[node(-50.0), node(-55.0)], distance_m)
    }

    #[test]
    fn a_visit_carries_the_bits_of_the_closed_form() {
        // p/σ² = 0.05 W/10^−13 W = 5·10^11. −55 dB: γ = 3.16228e6 · 0.5 = 1.58114e6; above, x = 400 m²:
        // log2(1 + 3952.85) = 11.94906; 5 MHz · 11.94906 = 59.745 Mbit/s. −50 dB: γ = 5·10^6, log2(12501) = 13.60976:
        // 68.049 Mbit/s. In τ_c = 0.1 s 5.97 Mbit and 6.80 Mbit: one visit empties 30 kbit.
        let above = figures("", 0.0);
        assert!((above.rates_bps[0] / 59.745e6 - 1.0).abs() < 1e-4, "{above:?}");
        assert!((above.rates_bps[1] / 68.049e6 - 1.0).abs() < 1e-4, "{above:?}");
        assert_eq!(above.visits, [Some(1); 2]);
        assert!(figures("", 10.0).rates_bps[0] < above.rates_bps[0]);
    }

    #[test]
    fn a_narrow_link_takes_several_visits() {
        // A thousandth of the bandwidth: 5 974 bit and 6 804 bit a visit; 30 000/6 804 = 4.4, 30 000/5 974 = 5.02.
        let above = figures("[link]\nbandwidth_hz = 5e3\n", 0.0);
        assert_eq!((above.visit_bits, above.visits), ([5_974, 6_804], [Some(5), Some(6)]));
        let dead = figures("[link]\nbandwidth_hz = 1e-3\n", 0.0);
        assert_eq!((dead.visit_bits, dead.visits), ([0; 2], [None; 2]));
    }

    #[test]
    fn a_free_altitude_is_chosen_for_each_distance() {
        let keys =
            |altitude: &str| format!("[uav]\naltitude_m = 100.0\n{altitude}[link]\nmodel = 'probabilistic-los'\n");
        let fixed = figures(&keys(""), 0.0).rates_bps;
        let free = figures(&keys("altitude = 'free'\n"), 0.0).rates_bps; // descends to 20 m
        assert!(free[0] > fixed[0], "{free:?} {fixed:?}");
    }
}
