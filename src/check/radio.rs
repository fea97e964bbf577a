//! What noise, fading, buildings, a line of sight that stays and a table of rates do to the links.

use std::f64::consts::TAU;

use serde::Serialize;
use skysink_common::channel::{Buildings, Channel, ChannelModel, LinkMap, RateTable};
use skysink_common::geometry::{Position, above};
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;
use skysink_common::units::dbm_of_watts;

use super::links::LinkFigures;
use super::quantity::{percent, scaled, short};

/// Density of thermal noise at 290 K [dBm/Hz].
const THERMAL_DBM_PER_HZ: f64 = -174.0;

/// Noise of a fixed power that is farther above thermal noise than this [dB] was hardly meant for this bandwidth.
const HIGH_DB: f64 = 20.0;

/// The noise, and the models of the channel that are off by default.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RadioFigures {
    /// Noise power in the bandwidth of a link [dBm].
    pub noise_dbm: f64,
    /// Noise power relative to thermal noise, -174 dBm/Hz [dB].
    pub above_thermal_db: f64,
    /// Bandwidth of a link [Hz].
    pub bandwidth_hz: f64,
    /// Whether the noise power is the same for any bandwidth (`noise_dbm`).
    pub is_fixed: bool,
    /// Factor K of fading [dB]; `None` without fading, and for −∞ in JSON.
    pub k_db: Option<f64>,
    /// Mean rate of the weakest SN at the distance d_c relative to the one without fading; `None` without fading.
    pub faded: Option<f64>,
    /// Correlation distance of a line of sight that stays [m]; `None` if it is redrawn.
    pub los_correlation_m: Option<f64>,
    /// Fraction of the positions in range of an SN, over flyable ground, that have line of sight to it among buildings;
    /// `None` with other channels.
    pub in_sight: Option<f64>,
    /// The grid of the table from which the rates are, whatever the noise; `None` with other channels.
    pub table: Option<TableFigures>,
    /// Grids and points of a map of links; absent with other channels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<[usize; 2]>,
}

/// The grid of a table of rates, and what the mission needs of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TableFigures {
    /// The least and the greatest distance [m].
    pub distances_m: [f64; 2],
    /// The least and the greatest altitude [m].
    pub altitudes_m: [f64; 2],
    /// Number of probabilities; 1 for rates that are not at random.
    pub probabilities: usize,
    /// Whether links may be longer than the greatest distance, or the UAV fly outside the altitudes.
    pub is_exceeded: bool,
}

impl TableFigures {
    fn of(scenario: &Scenario, table: &RateTable) -> Self {
        let [distances_m, altitudes_m, probabilities] = table.axes();
        let ends = |values: &[f64]| [values[0], values[values.len() - 1]];
        let uav = &scenario.uav;
        let flown_m = uav.climb().map_or([uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m]);
        let [lowest_m, highest_m] = ends(altitudes_m);
        Self {
            distances_m: ends(distances_m),
            altitudes_m: ends(altitudes_m),
            probabilities: probabilities.len(),
            is_exceeded: scenario.link.comm_radius_m > ends(distances_m)[1]
                || flown_m[0] < lowest_m
                || flown_m[1] > highest_m,
        }
    }

    fn rows(&self) -> [Option<(&'static str, String)>; 2] {
        let range = |[low, high]: [f64; 2]| match low == high {
            true => short(low),
            false => format!("{} to {}", short(low), short(high)),
        };
        let law = if self.probabilities > 1 { "at random" } else { "not at random" };
        let [far, up] = [range(self.distances_m), range(self.altitudes_m)];
        let grid = format!("of a table: {far} m away, {up} m up, {law}");
        [
            Some(("rates", grid)),
            self.is_exceeded.then(|| ("", "constant beyond it, where the mission reaches".to_owned())),
        ]
    }
}

impl RadioFigures {
    /// The figures of `scenario`, whose links at the distance d_c are `rim`.
    pub fn of(scenario: &Scenario, nodes: &[SensorNode], rim: &LinkFigures) -> Self {
        let link = &scenario.link;
        let channel = Channel::of(link);
        let noise_dbm = dbm_of_watts(link.noise_w());
        let mut steady = scenario.clone();
        steady.link.fading = None;
        let of_steady = |figures: LinkFigures| rim.rates_bps[0] / figures.rates_bps[0];
        Self {
            noise_dbm,
            above_thermal_db: noise_dbm - THERMAL_DBM_PER_HZ - 10.0 * link.bandwidth_hz.log10(),
            bandwidth_hz: link.bandwidth_hz,
            is_fixed: link.noise_dbm_per_hz.is_none(),
            k_db: channel.fading().and(link.k_db),
            faded: channel.fading().map(|_| of_steady(LinkFigures::at(&steady, nodes, link.comm_radius_m))),
            los_correlation_m: channel.line_of_sight().and_then(|model| model.correlation_m),
            in_sight: channel.buildings().map(|buildings| in_sight(scenario, nodes, buildings)),
            table: link.table.as_ref().map(|table| TableFigures::of(scenario, table)),
            map: link.map.as_deref().map(LinkMap::size),
        }
    }

    /// Name and value of each figure that applies.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        if let Some(table) = self.table {
            return table.rows().into_iter().flatten().collect();
        }
        if let Some([grids, points]) = self.map {
            return vec![("rates", format!("of a map: {grids} grids, {points} points"))];
        }
        let noise = format!(
            "{:.1} dBm, thermal + {:.1} dB in {}",
            self.noise_dbm,
            self.above_thermal_db,
            scaled(self.bandwidth_hz, "Hz")
        );
        let mut rows = vec![("noise", noise)];
        if self.is_fixed && self.above_thermal_db > HIGH_DB {
            rows.push(("", "fixed; noise_dbm_per_hz follows W".to_owned()));
        }
        if let (Some(k_db), Some(faded)) = (self.k_db, self.faded) {
            let law = if k_db.is_finite() { format!("K = {} dB", short(k_db)) } else { "Rayleigh".to_owned() };
            rows.push(("fading", format!("{law}: {} of the mean rate at d_c", percent(faded))));
        }
        if let Some(correlation_m) = self.los_correlation_m {
            rows.push(("line of sight", format!("stays, correlated over {}", scaled(correlation_m, "m"))));
        }
        if let Some(in_sight) = self.in_sight {
            rows.push(("line of sight", format!("from {} of the places in range of an SN", percent(in_sight))));
        }
        rows
    }
}

/// Sensor nodes whose surroundings are looked at.
const LOOKED_AT: usize = 1_000;

/// Rings of places about a sensor node, and places on each.
const RINGS: [u32; 2] = [4, 16];

/// Fraction of the places in range of the sensor nodes that see them, at the altitude of the start; 0 without such
/// places.
fn in_sight(scenario: &Scenario, nodes: &[SensorNode], buildings: &Buildings) -> f64 {
    let airspace = scenario.airspace_without_ways();
    let [rings, steps] = RINGS;
    let mut places = 0u32;
    let mut seen = 0u32;
    for node in nodes.iter().step_by(nodes.len().div_ceil(LOOKED_AT).max(1)) {
        let sensor = Position::new(node.x_m, node.y_m);
        for place in 0..rings * steps {
            // Each place stands for the same area.
            let away_m = scenario.link.comm_radius_m * ((f64::from(place / steps) + 0.5) / f64::from(rings)).sqrt();
            let (sine, cosine) = (f64::from(place) * TAU / f64::from(steps)).sin_cos();
            let ground = Position::new(sensor.x + away_m * cosine, sensor.y + away_m * sine);
            if airspace.contains(&ground) {
                places += 1;
                seen += u32::from(buildings.sees(&sensor, &above(&ground, scenario.uav.altitude_m)));
            }
        }
    }
    f64::from(seen) / f64::from(places.max(1))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use skysink_common::scenario::Overrides;
    use skysink_common::units::ratio_of_db;

    fn rows(link: &str) -> Vec<(&'static str, String)> {
        let text = format!("name = 'a'\n[link]\n{link}");
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        let nodes = [SensorNode { gain: ratio_of_db(-55.0), ..SensorNode::default() }];
        RadioFigures::of(&scenario, &nodes, &LinkFigures::at(&scenario, &nodes, 10.0)).rows()
    }

    #[test]
    fn the_noise_is_compared_with_thermal_noise() {
        // −174 + 10 log10(5e3) = −137.01 dBm; −100 dBm is 37.01 dB above it.
        let fixed = rows("bandwidth_hz = 5e3\n");
        assert_eq!(fixed[0], ("noise", "-100.0 dBm, thermal + 37.0 dB in 5 kHz".to_owned()));
        assert!(fixed[1].1.contains("noise_dbm_per_hz"), "{fixed:?}");
        // −174 + 7 + 36.99 = −130.01 dBm
        let density = "-130.0 dBm, thermal + 7.0 dB in 5 kHz";
        assert_eq!(rows("bandwidth_hz = 5e3\nnoise_dbm_per_hz = -167.0\n"), [("noise", density.to_owned())]);
        assert_eq!(rows("")[0].1, "-100.0 dBm, thermal + 7.0 dB in 5 MHz");
    }

    #[test]
    fn buildings_leave_a_fraction_of_the_range_in_sight() {
        let rows = |building: &str| rows(&format!("model = 'buildings'\n[area]\n{building}"));
        assert_eq!(
            rows("").last().unwrap(),
            &("line of sight", "from 100 % of the places in range of an SN".to_owned())
        );
        // The SN stands in the corner (0, 0). A wall to its north-east leaves nothing behind it, where the UAV flies
        // low.
        let wall =
            "building = [{ polygon_m = [[0.0, 3.0], [100.0, 3.0], [100.0, 3.1], [0.0, 3.1]], height_m = 19.0 }]\n";
        let behind: f64 = rows(wall).last().unwrap().1["from ".len()..].split(' ').next().unwrap().parse().unwrap();
        assert!((20.0..60.0).contains(&behind), "{behind} %");
    }

    #[test]
    fn a_channel_table_is_described_with_its_extent() {
        let table = |distances_m, altitudes_m: Vec<f64>| {
            let rates_bps = vec![7.0; altitudes_m.len() * 4];
            Some(RateTable::new(distances_m, altitudes_m, vec![0.1, 0.9], rates_bps).unwrap().shared())
        };
        let rows = |table, link: &str| {
            let text = format!("name = 'a'\n[link]\nmodel = 'table'\nfile = 'links.csv'\n{link}");
            let overrides = Overrides { table, ..Overrides::default() };
            let scenario = Scenario::parse(&text, Path::new("a.toml"), overrides).unwrap();
            let nodes = [SensorNode::default()];
            RadioFigures::of(&scenario, &nodes, &LinkFigures::at(&scenario, &nodes, 10.0)).rows()
        };
        let covered = "of a table: 0 to 10 m away, 20 m up, at random";
        assert_eq!(rows(table(vec![0.0, 10.0], vec![20.0]), ""), [("rates", covered.to_owned())]);
        let beyond = ("", "constant beyond it, where the mission reaches".to_owned());
        assert_eq!(rows(table(vec![0.0, 10.0], vec![20.0]), "comm_radius_m = 11.0\n")[1], beyond);
        assert_eq!(rows(table(vec![0.0, 10.0], vec![21.0, 30.0]), "")[1], beyond);
    }

    #[test]
    fn fading_is_described_with_its_mean_rate_and_frozen_sight_with_its_distance() {
        // γ = 1.58e6/500 = 3162: log2 = 11.627; less 0.8327 bit of Rayleigh: 10.796, 92.9 %.
        let rayleigh = "Rayleigh: 92.9 % of the mean rate at d_c";
        assert_eq!(rows("fading = 'rician'\nk_db = -inf\n")[1], ("fading", rayleigh.to_owned()));
        // K = 10: E[ln g] = ln(10/11) + E1(10) = −0.0953, 0.1375 bit, 98.8 %.
        assert!(rows("fading = 'rician'\n")[1].1.starts_with("K = 10 dB: 98.8 %"));
        let frozen = rows("model = 'probabilistic-los'\nlos_correlation_m = 50.0\n");
        assert_eq!(frozen[1], ("line of sight", "stays, correlated over 50 m".to_owned()));
        assert_eq!(rows("model = 'probabilistic-los'\nlos_correlation_m = 0.0\n").len(), 1);
    }
}
