//! The derived figures of a scenario.

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use serde::Serialize;
use skysink_common::airspace::Polygon;
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::grid::Grid;
use skysink_common::sensors::{SensorList, Sensors};
use skysink_mission::MissionError;
use skysink_planner::bound::bounding_table;
use skysink_planner::bound::field_bits::FieldBits;
use skysink_planner::bound::links::BestLinks;
use skysink_planner::bound::paths::PathBound;
use skysink_planner::mission_table::MissionTable;
use skysink_planner::settings::{PlanningObjective, Settings};

use super::arrivals::ArrivalFigures;
use super::energy::EnergyFigures;
use super::flights::trial_flights;
use super::links::LinkFigures;
use super::motion::MotionFigures;
use super::quantity::{percent, scaled, short};
use super::radio::RadioFigures;
use super::track::FixedFlight;
use super::verdict::{Bounds, LossFree, Round};

/// Maximum number of SNs whose nearest neighbour is searched, approximately. In larger fields, every k-th SN is
/// sampled.
const MAX_SAMPLED: usize = 50_000;

/// The derived figures of a scenario with its sensor nodes (SNs).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// The strategy that the scenario names.
    pub strategy: String,
    /// What plans over many slots are made for; `None` for the least loss.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objective: Option<PlanningObjective>,
    /// Age up to which an SN is served in time [slots]; `None` without a limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deadline_slots: Option<u64>,
    /// Number of SNs, `N`.
    pub sensors: usize,
    /// Number of slots, `T`.
    pub slots: u64,
    /// Distance that a slot reaches in every direction [m], `V τ` without wind and acceleration (decisions D29, D31).
    pub reach_m: f64,
    /// What the slots demand of a vehicle, and what wind and errors do.
    pub motion: MotionFigures,
    /// Of each kind of UAVs `name`, `uavs`, `resource_blocks`, `altitude_m`, `reach_m`, `motion` and `energy`, in which
    /// they may differ; `reach_m` and `motion` beside it are of the first UAV. Absent if all are equal.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub kinds: Vec<KindFigures>,
    /// The flight that is fixed (`uav.track`); `None` if strategies fly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub track: Option<FixedFlight>,
    /// What battery and base allow; `None` if the UAV need not come back.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<EnergyFigures>,
    /// Communication radius `d_c` [m].
    pub comm_radius_m: f64,
    /// Anchor radius of `uts`, in which Algorithm 1 searches: the reach less `d_c` [m]; if that is not above 0, `uts`
    /// uses the reach.
    pub anchor_radius_m: f64,
    /// Mean distance of an SN to its nearest neighbour [m]; above 50 000 SNs over every k-th. `None` for a single SN.
    pub neighbour_m: Option<f64>,
    /// Links with the UAV straight above the SN.
    pub above: LinkFigures,
    /// Links at the horizontal distance `d_c`.
    pub rim: LinkFigures,
    /// Noise, and what fading and line of sight that stays do to the links.
    pub radio: RadioFigures,
    /// Slots to fill an empty buffer, `B / (s_i τ)`, over the SNs that sample; `None` if no SN samples.
    pub fill_slots: Option<FillSlots>,
    /// Smallest and largest buffer [bit]; `None` if all are equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buffers_bits: Option<[u32; 2]>,
    /// Least and greatest weight of an SN (decision D25); `None` if all are equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weights: Option<[f64; 2]>,
    /// Slots to serve every SN once.
    pub round: Round,
    /// Offered load: what all SNs sample in a slot, against what the radio carries.
    pub load: Load,
    /// Number of sampling SNs that cannot be reached before the end of the mission.
    pub unreachable: usize,
    /// Number of SNs outside of `area.boundary_m`; `None` if there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outside: Option<usize>,
    /// Number of SNs that zones leave no place to serve from; `None` without zones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hidden: Option<usize>,
    /// The labels of the first ones.
    #[serde(skip)]
    pub hidden_nodes: Vec<String>,
    /// Arrivals at random; `None` if they are constant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arrivals: Option<ArrivalFigures>,
    /// Whether a flight without loss exists: an `answer`, and what it is from. `tour`, `uts-wide` and `edf` are
    /// simulated for up to 5 000 SNs and 5 million SNs times slots; in larger fields the load alone decides.
    pub loss_free: LossFree,
}

/// The figures of a kind of UAVs, a table of `[[uav.each]]`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KindFigures {
    /// The table, and the drone that it names, such as `uav.each[1], m350`.
    pub name: String,
    /// Number of its UAVs.
    pub uavs: usize,
    /// Resource blocks of each.
    pub resource_blocks: usize,
    /// Distance that a slot reaches in every direction [m].
    pub reach_m: f64,
    /// Altitude before slot 1 [m].
    pub altitude_m: f64,
    /// What the slots demand of a vehicle, and what wind and errors do.
    pub motion: MotionFigures,
    /// What battery and base allow; `None` if the UAVs need not come back.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<EnergyFigures>,
}

impl KindFigures {
    /// Of all kinds of a scenario; none if all UAVs are equal.
    fn of(scenario: &Scenario, sensors: &Sensors) -> Vec<Self> {
        let named = scenario.kinds().enumerate().filter_map(|(index, kind)| Some((scenario.kind_name(index)?, kind)));
        let figures = |(name, kind): (String, Cow<'_, Scenario>)| Self {
            name,
            uavs: kind.uav.uavs(),
            resource_blocks: kind.link.resource_blocks,
            reach_m: kind.reach_m(),
            altitude_m: kind.uav.altitude_m,
            motion: MotionFigures { crowded: None, ..MotionFigures::of(&kind) },
            energy: EnergyFigures::of(&kind, sensors),
        };
        named.map(figures).collect()
    }
}

/// Most sensor nodes that a warning names.
const MOST_NAMED: usize = 5;

impl Figures {
    /// The figures of `scenario` with the SNs `list`.
    pub fn of(scenario: &Scenario, list: &SensorList) -> Result<Self, MissionError> {
        let nodes = list.nodes();
        let sensors = Arc::new(list.sensors_of(scenario));
        let table = bounding_table(scenario, Arc::clone(&sensors));
        let others: Vec<MissionTable> =
            scenario.kinds().skip(1).map(|kind| MissionTable::new(&kind, Arc::clone(&sensors))).collect();
        let is_reachable = |id: u32| table.is_reachable(id) || others.iter().any(|other| other.is_reachable(id));
        let field = FieldBits::new(scenario, &sensors, &list.queues_bits());
        let reach_m = scenario.reach_m();
        let comm_radius_m = scenario.link.comm_radius_m;
        let above = LinkFigures::at(scenario, &nodes, 0.0);
        let rim = LinkFigures::at(scenario, &nodes, comm_radius_m);
        let flights = trial_flights(scenario, list)?;
        let links = BestLinks::new(scenario, &sensors);
        let uavs = scenario.uav.uavs();
        let bounds = Bounds { table: &table, uavs, field: &field, links, above, paths: PathBound::by_legs(&table) };
        Ok(Self {
            strategy: scenario.planner.strategy.clone(),
            objective: Some(Settings::of(scenario)?.objective).filter(|objective| !objective.is_loss()),
            deadline_slots: scenario.deadline_slots(),
            sensors: nodes.len(),
            slots: scenario.slots,
            reach_m,
            motion: MotionFigures::of(scenario),
            track: FixedFlight::of(scenario),
            energy: EnergyFigures::of(scenario, &sensors).filter(|_| scenario.fleet.is_none()),
            kinds: KindFigures::of(scenario, &sensors),
            comm_radius_m,
            anchor_radius_m: reach_m - comm_radius_m,
            neighbour_m: mean_neighbour_m(&table.sensors.positions, &table.sensors.grid),
            above,
            rim,
            radio: RadioFigures::of(scenario, &nodes, &rim),
            fill_slots: FillSlots::of(&field),
            buffers_bits: range(nodes.iter().map(|node| node.capacity_bits)),
            weights: range(nodes.iter().map(|node| node.weight)),
            round: bounds.round(flights.first().and_then(|tour| tour.round_slots)),
            load: Load::of(field.blocks, &sensors, &above),
            outside: scenario.area.border().and_then(|border| outside(&border, &table.sensors.positions)),
            hidden: (!table.airspace.is_open()).then(|| sensors.ids().filter(|&id| !is_reachable(id)).count()),
            hidden_nodes: {
                let hidden = sensors.ids().filter(|&id| !is_reachable(id));
                hidden.take(MOST_NAMED).map(|id| list.label(id as usize)).collect()
            },
            unreachable: field.sensors.iter().filter(|sensor| sensor.first_slot > Some(scenario.slots)).count(),
            arrivals: ArrivalFigures::of(scenario, list),
            loss_free: bounds.loss_free(&flights),
        })
    }
}

/// Number of positions outside of the closed polygon `border`; `None` if there are none.
fn outside(border: &Polygon, positions: &[Position]) -> Option<usize> {
    let count = positions.iter().filter(|position| border.forbids(position, 0.0)).count();
    (count > 0).then_some(count)
}

/// The least and the greatest of numbers that differ.
fn range<T: PartialOrd + Copy>(numbers: impl Iterator<Item = T>) -> Option<[T; 2]> {
    let widen = |[least, greatest]: [T; 2], [one, _]: [T; 2]| {
        [if one < least { one } else { least }, if one > greatest { one } else { greatest }]
    };
    numbers.map(|number| [number; 2]).reduce(widen).filter(|[least, greatest]| least < greatest)
}

/// Mean distance [m] of an SN to its nearest neighbour; `None` for a single SN.
fn mean_neighbour_m(positions: &[Position], grid: &Grid) -> Option<f64> {
    if positions.len() < 2 {
        return None;
    }
    let stride = positions.len().div_ceil(MAX_SAMPLED);
    let sampled = (0u32..).zip(positions).step_by(stride);
    let distances_m = sampled.filter_map(|(id, position)| {
        let near = grid.nearest(position, 2);
        let other = near.into_iter().find(|&other| other != id)?;
        Some((position - positions[other as usize]).norm())
    });
    Some(distances_m.sum::<f64>() / positions.len().div_ceil(stride) as f64)
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
        let fills = || field.sensors.iter().map(|sensor| sensor.sampler.fill_slots());
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
    /// Visits per slot, `min(U n, N)`.
    pub visits: usize,
}

impl Load {
    fn of(blocks: usize, sensors: &Sensors, above: &LinkFigures) -> Self {
        let offered_bits = sensors.ids().map(|id| sensors.sampler(id).mean_bits).sum();
        let visits = blocks.min(sensors.count());
        let buffers_bits = sensors.ids().map(|id| u64::from(sensors.sampler(id).capacity_bits));
        let most_buffer_bits = buffers_bits.max().unwrap_or(0);
        let visit_bits = above.visit_bits[1].min(most_buffer_bits);
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
        // 30 m/s · 0.5 s = 15 m; 15 − 10 = 5 m.
        let found = figures("slot_s = 0.5\n", "x_m,y_m\n0,0\n4,0\n24,0\n");
        assert_eq!((found.reach_m, found.comm_radius_m, found.anchor_radius_m), (15.0, 10.0, 5.0));
        assert_eq!(found.neighbour_m, Some(28.0 / 3.0)); // 4, 4, 20
    }

    fn row(xs_m: &[f64]) -> Vec<Position> {
        xs_m.iter().map(|&x_m| Position::new(x_m, 0.0)).collect()
    }

    #[test]
    fn the_nearest_neighbour_is_a_different_sensor_node() {
        // 0 to 3: 3 m; 3 to 0: 3 m; 10 to 3: 7 m; mean 13/3 m.
        let positions = row(&[0.0, 3.0, 10.0]);
        let mean_m = mean_neighbour_m(&positions, &Grid::new(&positions, 5.0)).unwrap();
        assert!((mean_m - 13.0 / 3.0).abs() < 1e-12, "{mean_m}");
        let twins = row(&[4.0, 4.0]);
        assert_eq!(mean_neighbour_m(&twins, &Grid::new(&twins, 5.0)), Some(0.0));
        assert_eq!(mean_neighbour_m(&twins[..1], &Grid::new(&twins[..1], 5.0)), None);
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
    fn sensor_nodes_outside_of_the_boundary_are_counted_and_hidden_beyond_the_radius() {
        let keys = "[area]\nside_m = 100.0\nboundary_m = [[20, 20], [80, 20], [80, 80], [20, 80]]\n";
        // Within it, on its edge, 9 m and 11 m outside of it, with d_c = 10 m.
        let figures = figures(keys, "x_m,y_m\n50,50\n80,50\n89,50\n50,9\n");
        assert_eq!((figures.outside, figures.hidden), (Some(2), Some(1)));
        assert_eq!(figures.hidden_nodes, ["SN 3"]);
    }

    #[test]
    fn sensor_nodes_out_of_reach_are_counted() {
        // 3 slots of 30 m from (500, 500), and d_c = 10 m: within 100 m.
        let keys = "slots = 3\n[area]\nside_m = 1000.0\n";
        assert_eq!(figures(keys, "x_m,y_m\n500,599\n500,602\n500,500\n").unreachable, 1);
    }
}
