//! The derived figures of a scenario.

use std::fmt;

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_planner::bound::field_bits::FieldBits;
use skysink_planner::bound::links::BestLinks;
use skysink_planner::horizon::path_bound::PathBound;
use skysink_planner::sensor_table::SensorTable;

use super::clusters::{largest_group, mean_neighbour_m};
use super::flights::fly;
use super::links::LinkFigures;
use super::quantity::{percent, scaled, short};
use super::verdict::{Bounds, LossFree, Round};

/// The derived figures of a scenario with its sensor nodes (SNs).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// The strategy that the scenario names.
    pub strategy: String,
    /// Number of SNs, `N`.
    pub sensors: usize,
    /// Number of slots, `T`.
    pub slots: u64,
    /// Maximum distance flown in a slot, `V τ` [m].
    pub reach_m: f64,
    /// `d_c` [m].
    pub comm_radius_m: f64,
    /// Radius in which `uts` searches anchors, `V τ − d_c` [m]. If this is not above 0, `uts` uses `V τ`.
    pub anchor_radius_m: f64,
    /// Size of the largest group of SNs connected by steps within the anchor radius of `uts`; `None` if unknown.
    pub uts_group: Option<usize>,
    /// The same for `uts-wide`, whose anchor radius is `V τ + d_c`.
    pub uts_wide_group: Option<usize>,
    /// Mean distance of an SN to its nearest neighbour [m]; `None` for a single SN.
    pub neighbour_m: Option<f64>,
    /// Links with the UAV directly above the SN.
    pub above: LinkFigures,
    /// Links at the horizontal distance `d_c`.
    pub rim: LinkFigures,
    /// Slots until empty buffers are full; `None` if no SN samples.
    pub fill_slots: Option<FillSlots>,
    /// Slots until every SN has been served once.
    pub round: Round,
    /// Offered load relative to the capacity of the radio.
    pub load: Load,
    /// Number of sampling SNs that cannot be reached before the end of the mission.
    pub unreachable: usize,
    /// Whether a flight without loss exists.
    pub loss_free: LossFree,
}

impl Figures {
    /// The figures of `scenario` with the SNs `list`.
    ///
    /// # Errors
    /// If `[planner]` is refused; never for a scenario that [`skysink_planner::settings::resolve`] returned.
    pub fn of(scenario: &Scenario, list: &SensorList) -> Result<Self, InputError> {
        let nodes = list.nodes();
        let table = SensorTable::new(scenario, &nodes);
        let (field, sampling) = FieldBits::new(scenario, &nodes, &list.queues_bits());
        let reach_m = scenario.reach_m();
        let comm_radius_m = scenario.link.comm_radius_m;
        let anchor_radius_m = reach_m - comm_radius_m;
        let step_m = if anchor_radius_m > 0.0 { anchor_radius_m } else { reach_m };
        let above = LinkFigures::at(scenario, &nodes, 0.0);
        let flights = fly(scenario, list)?;
        let links = BestLinks::new(scenario, &sampling);
        let bounds = Bounds { scenario, table: &table, field: &field, links, above, paths: PathBound::by_legs(&table) };
        Ok(Self {
            strategy: scenario.planner.strategy.clone(),
            sensors: nodes.len(),
            slots: scenario.slots,
            reach_m,
            comm_radius_m,
            anchor_radius_m,
            uts_group: largest_group(&table.positions, step_m),
            uts_wide_group: largest_group(&table.positions, reach_m + comm_radius_m),
            neighbour_m: mean_neighbour_m(&table.positions, &table.grid),
            above,
            rim: LinkFigures::at(scenario, &nodes, comm_radius_m),
            fill_slots: FillSlots::of(&field),
            round: bounds.round(flights.first().and_then(|tour| tour.round_slots)),
            load: Load::of(scenario, &nodes, &above),
            unreachable: field.sensors.iter().filter(|sensor| sensor.first_slot > field.slots).count(),
            loss_free: bounds.loss_free(&flights),
        })
    }
}

/// Slots until the empty buffers of the sampling SNs are full, `B / (s_i τ)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FillSlots {
    /// The minimum.
    pub least: f64,
    /// The mean.
    pub mean: f64,
    /// The maximum.
    pub most: f64,
}

impl FillSlots {
    fn of(field: &FieldBits) -> Option<Self> {
        let fills = || field.sensors.iter().map(|sensor| sensor.capacity_bits as f64 / sensor.mean_bits);
        (!field.sensors.is_empty()).then(|| Self {
            least: fills().fold(f64::INFINITY, f64::min),
            mean: fills().sum::<f64>() / field.sensors.len() as f64,
            most: fills().fold(0.0, f64::max),
        })
    }
}

impl fmt::Display for FillSlots {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [least, mean, most] = [self.least, self.mean, self.most].map(short);
        if least == most { formatter.write_str(&least) } else { write!(formatter, "{least} to {most}, mean {mean}") }
    }
}

/// The offered load per slot relative to the maximum that the radio carries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Load {
    /// Sampled per slot, `Σ s_i τ` [bit].
    pub offered_bits: f64,
    /// Maximum upload per slot [bit]: all visits from directly above, over the strongest link, at most full buffers.
    pub carried_bits: f64,
    /// `offered_bits / carried_bits`; `None` if the radio carries nothing.
    pub fraction: Option<f64>,
    /// Visits per slot, `min(n, N)`.
    pub visits: usize,
}

impl Load {
    fn of(scenario: &Scenario, nodes: &[SensorNode], above: &LinkFigures) -> Self {
        let offered_bits = nodes.iter().map(|node| node.sampling_bps * scenario.slot_s).sum();
        let visits = scenario.link.resource_blocks.min(nodes.len());
        let visit_bits = above.visit_bits[1].min(scenario.sensors.capacity_bits.into());
        let carried_bits = visits as f64 * visit_bits as f64;
        let fraction = (carried_bits > 0.0).then_some(offered_bits / carried_bits);
        Self { offered_bits, carried_bits, fraction, visits }
    }
}

impl fmt::Display for Load {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let offered = scaled(self.offered_bits, "bit");
        let visits = if self.visits == 1 { "1 visit".to_owned() } else { format!("{} visits", self.visits) };
        match self.fraction {
            Some(fraction) => write!(formatter, "{offered} per slot, {} of {visits}", percent(fraction)),
            None => write!(formatter, "{offered} per slot; {visits} carry nothing"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use skysink_common::scenario::Overrides;

    /// The figures of a scenario with these keys and the SNs of `list`.
    fn figures(keys: &str, list: &str) -> Figures {
        let path = Path::new("a.toml");
        let text = format!("name = 'a'\n{keys}");
        let scenario = Scenario::parse(&text, path, Overrides::default()).unwrap();
        let scenario = skysink_planner::settings::resolve(scenario).unwrap();
        Figures::of(&scenario, &SensorList::parse(list, path, &scenario).unwrap()).unwrap()
    }

    #[test]
    fn distances_are_those_of_the_scenario() {
        // 30 m/s · 0.5 s = 15 m; 15 − 10 = 5 m, 15 + 10 = 25 m. Steps of 4 m and 20 m.
        let found = figures("slot_s = 0.5\n", "x_m,y_m\n0,0\n4,0\n24,0\n");
        assert_eq!((found.reach_m, found.comm_radius_m, found.anchor_radius_m), (15.0, 10.0, 5.0));
        assert_eq!((found.uts_group, found.uts_wide_group), (Some(2), Some(3)));
        assert_eq!(found.neighbour_m, Some(28.0 / 3.0)); // 4, 4, 20
        // 8 m/s: V τ ≤ d_c, so that anchors lie within 8 m.
        let slow = figures("[uav]\nmax_speed_mps = 8.0\n", "x_m,y_m\n0,0\n7,0\n24,0\n");
        assert_eq!((slow.anchor_radius_m, slow.uts_group), (-2.0, Some(2)));
    }

    #[test]
    fn buffers_fill_by_their_rates_and_load_is_their_sum() {
        // 30 000 bit at 100, 50 and 300 bit/s: 300, 600 and 100 slots, mean 333.3. 450 bit of 3 · 30 000.
        let found = figures("", "x_m,y_m,sampling_bps\n1,1,100\n2,2,50\n3,3,300\n");
        let fill = found.fill_slots.unwrap();
        assert_eq!((fill.least, fill.most, fill.to_string()), (100.0, 600.0, "100 to 600, mean 333".to_owned()));
        assert_eq!((found.load.offered_bits, found.load.carried_bits), (450.0, 90_000.0));
        assert_eq!(found.load.to_string(), "450 bit per slot, 0.5 % of 3 visits");
        let silent = figures("", "x_m,y_m,sampling_bps\n1,1,0\n");
        assert_eq!((silent.fill_slots, silent.load.fraction), (None, Some(0.0)));
    }

    #[test]
    fn sensor_nodes_that_are_too_far_away_are_counted() {
        // 3 slots of 30 m from (500, 500), and d_c = 10 m: within 100 m.
        let keys = "slots = 3\n[area]\nside_m = 1000.0\n";
        assert_eq!(figures(keys, "x_m,y_m\n500,599\n500,602\n500,500\n").unreachable, 1);
    }
}
