//! A mission as it may go on: the field and the UAV, flown by a planner from what a view sees.
//!
//! What is not known is drawn: links, sight, arrivals, and where they are estimated queues and rates. The same number
//! of a draw gives the same draws to all planners. The slot itself is that of the mission, [`Field`] and [`Fleet`].

use std::ops::RangeInclusive;

use nalgebra::Point3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use skysink_common::arrivals::Arrivals;
use skysink_common::ledger::Ledger;
use skysink_common::message::{FlightReport, Mode, SensorNode};
use skysink_common::random::{Purpose, Streams, fraction};
use skysink_common::scenario::{Area, Coordination};
use skysink_common::sensors::Sensors;
use skysink_common::told::Received;
use skysink_field_sim::Field;
use skysink_flight_sim::Fleet;

use crate::planner::Planner;
use crate::rules::Duty;
use crate::strategy::{Decision, Setup, View};

/// What all simulations of a mission have in common.
#[derive(Debug)]
pub struct Simulator {
    area: Area,
    /// The lowest and the highest altitude [m].
    altitudes_m: RangeInclusive<f64>,
    fleet: Fleet,
    streams: Streams,
}

/// A mission that may follow a view, before it is flown.
#[derive(Debug, Clone)]
pub struct Drawn {
    fleet: Fleet,
    field: Field,
    slots: u64,
    /// The UAV before the first slot.
    begin: FlightReport,
}

impl Simulator {
    /// The simulator of the mission of a UAV that has its sensor nodes to itself, alone or as a part of the field, and
    /// keeps no distance from others; `None` of others, or of sensor nodes with features, whose state a view does not
    /// tell.
    #[must_use]
    pub fn of(setup: &Setup<'_>) -> Option<Self> {
        let Setup { scenario, table, .. } = *setup;
        let shares = setup.team.is_some() || scenario.uav.coordination == Some(Coordination::Independent);
        let is_alone = !shares && scenario.uav.uavs() == 1 && scenario.uav.separation_m.is_none();
        let is_plain = !table.sensors.may_refuse && table.sensors.sampling.lasting_slots().is_infinite();
        let are_finite =
            table.sensors.positions.iter().all(|position| position.iter().all(|metres| metres.is_finite()))
                && table.sensors.gains.iter().all(|gain| gain.is_finite());
        let altitude_m = scenario.uav.altitude_m;
        let altitudes_m =
            scenario.uav.climb().map_or(altitude_m..=altitude_m, |climb| climb.min_altitude_m..=climb.max_altitude_m);
        (is_alone && is_plain && are_finite).then(|| {
            // Links reach farther than waypoints with a margin.
            let mut flown = scenario.clone();
            flown.link.comm_radius_m += scenario.uav.waypoint_margin_m.unwrap_or(0.0);
            Self {
                area: scenario.area.clone(),
                altitudes_m,
                fleet: Fleet::new(&flown, &nodes_of(&table.sensors, scenario.slot_s)),
                streams: Streams::new(scenario.seed),
            }
        })
    }

    /// Whether a mission may go on from what `view` sees: a planner may be told anything.
    #[must_use]
    pub fn is_possible(&self, view: &View<'_>) -> bool {
        view.position.iter().all(|metres| metres.is_finite()) && view.battery.energy_j >= 0.0
    }

    /// The UAV as `view` sees it, within the area and the altitudes, from which errors may have led it.
    fn flight_at(&self, view: &View<'_>) -> FlightReport {
        let mode = if view.battery.is_charging { Mode::Charge } else { Mode::Hold };
        let position = Point3::new(
            view.position.x.clamp(0.0, self.area.width_m()),
            view.position.y.clamp(0.0, self.area.height_m()),
            view.position.z.clamp(*self.altitudes_m.start(), *self.altitudes_m.end()),
        );
        FlightReport { energy_j: view.battery.energy_j, ..FlightReport::at(position, mode) }
    }

    /// The draw number `draw` of what may follow `view` in the next `slots` slots.
    #[must_use]
    pub fn draw(&self, view: &View<'_>, draw: u32, slots: u64) -> Drawn {
        let mut random = self.streams.stream(Purpose::Comparison, view.slot, draw);
        let seed = random.next_u64();
        let sensors = &view.table.sensors;
        let (means_bits, queues_bits) = sensors.ids().map(|id| drawn_sensor(view, id, &mut random)).unzip();
        let arrivals = Arrivals::of(view.table.arrivals, None, Streams::new(seed), sensors.count(), slots);
        let sampling = sensors.sampling.with_means(means_bits).with_arrivals(arrivals);
        let mut fleet = self.fleet.redrawn(&view.table.channel, seed); // the link as plans take it
        let begin = self.flight_at(view);
        fleet.restore(&[begin]);
        Drawn { fleet, field: Field::over(Ledger::new(sampling, queues_bits), slots), slots, begin }
    }
}

impl Drawn {
    /// Flies it by `planner`, whose first decision is `first`; returns the weighted bits that are lost.
    #[must_use]
    pub fn fly(mut self, view: &View<'_>, planner: &mut Planner, first: Option<&Decision>) -> f64 {
        planner.begin_at(view);
        let mut flights = [self.begin];
        for number in 1..=self.slots {
            let slot = view.slot.saturating_add(number - 1);
            let position = flights[0].position();
            let plan = planner.plan_by(slot, position, self.field.told(), Duty::Mission, None, |strategy, view| {
                if number == 1 { first.cloned() } else { strategy.plan(view) }
            });
            self.fleet.step(slot, |_| Some(&plan), &mut flights);
            self.field.step(number, &flights).expect("flight-sim serves only known sensor nodes");
            if view.heard.links.is_some() {
                planner.receive(&Received { links: self.fleet.hear(slot, &flights).into() }, 0, Some);
            }
            planner.observe(slot, &flights[0], self.field.told());
        }
        view.table.sensors.weights.sum(self.field.lost_bits().map(|bits| bits as f64))
    }
}

/// What the sensor node `id` samples in the mean of a slot, and its queue, as they may be [bit].
fn drawn_sensor(view: &View<'_>, id: u32, random: &mut ChaCha8Rng) -> (f64, u32) {
    let mean_bits = view.belief.mean_bits(id);
    let capacity_bits = view.table.sensors.sampler(id).capacity_bits;
    if !view.belief.belief.is_estimated() {
        return (mean_bits, view.belief.queues_bits[id as usize].min(capacity_bits)); // a planner may be told of more
    }
    let mut spread = || 2.0 * fraction(random) - 1.0;
    let known = view.belief.uncertainty(id);
    let rate = known.rate * spread();
    let half_bits = known.initial_bits.hypot(3f64.sqrt() * known.arrivals_bits);
    let queue_bits = known.unbounded_bits + rate * known.since_contact_bits + half_bits * spread();
    (mean_bits * (1.0 + rate), queue_bits.clamp(0.0, capacity_bits.into()) as u32)
}

/// The sensor nodes as they are published, in slots of `slot_s` [s].
fn nodes_of(sensors: &Sensors, slot_s: f64) -> Vec<SensorNode> {
    let node = |id: u32| {
        let position = sensors.position(id);
        let sampler = sensors.sampler(id);
        SensorNode {
            x_m: position.x,
            y_m: position.y,
            gain: sensors.gains[id as usize],
            sampling_bps: sampler.mean_bits / slot_s,
            capacity_bits: sampler.capacity_bits,
            weight: sensors.weights.of(id as usize),
            ..SensorNode::default()
        }
    };
    sensors.ids().map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings;
    use crate::strategies::gfs;
    use crate::strategy::OwnedSetup;
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;
    use std::path::Path;

    /// A mission of 40 slots with losses, and these keys.
    fn mission(keys: &str) -> (OwnedSetup, SensorList) {
        let text = format!("name = 'x'\nslots = 40\n[sensors]\nsampling_bps = [50.0, 900.0]\n{keys}");
        let overrides = Overrides { strategy: Some("gfs"), ..Overrides::default() };
        let scenario = Scenario::parse(&text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        (OwnedSetup::new(scenario, &list.nodes()).unwrap(), list)
    }

    /// What greedy flights lose in the draw number `draw` of all slots [bit].
    fn simulated(owned: &OwnedSetup, list: &SensorList, draw: u32) -> f64 {
        let setup = owned.setup();
        let queues_bits = list.queues_bits();
        let view = View::at_start(&setup, &queues_bits, &owned.stop);
        let mut planner = Planner::with(&setup, (gfs::STRATEGY.make)(&setup));
        let first = (gfs::STRATEGY.make)(&setup).plan(&view);
        Simulator::of(&setup).unwrap().draw(&view, draw, 40).fly(&view, &mut planner, first.as_ref())
    }

    #[test]
    fn where_all_is_known_a_simulated_mission_is_the_mission() {
        let (owned, list) = mission("");
        let scenario = owned.scenario.clone();
        let last = skysink_mission::Mission::new(&scenario, &list).unwrap().last().unwrap();
        let lost_bits = last.header.totals.lost_bits;
        assert!(lost_bits > 0, "nothing to compare");
        assert_eq!([0, 1].map(|draw| simulated(&owned, &list, draw)), [lost_bits as f64; 2]);
    }

    #[test]
    fn draws_differ_by_number_alone() {
        for keys in [
            "arrivals = { model = 'on-off' }\n",
            "[link]\ngain = 'per-slot'\ngain_db = [-100.0, -60.0]\nbandwidth_hz = 2e3\n",
        ] {
            let (owned, list) = mission(keys);
            let draws = [0, 1, 0].map(|draw| simulated(&owned, &list, draw));
            assert!(draws[0] == draws[2] && draws[0] != draws[1], "{draws:?}");
        }
    }

    #[test]
    fn links_are_those_that_plans_reckon_with() {
        let narrow = "[link]\nbandwidth_hz = 5e3\n";
        let [as_is, as_taken] = ["", "[planner.link]\nsnr_offset_db = -20.0\n"].map(|keys| {
            let (owned, list) = mission(&format!("{narrow}{keys}"));
            simulated(&owned, &list, 0)
        });
        assert!(as_taken > as_is, "{as_taken} and {as_is}");
    }

    #[test]
    fn what_a_view_does_not_tell_is_not_simulated() {
        let is_simulated = |keys: &str| {
            let (owned, list) = mission(keys);
            let alone = OwnedSetup::new(owned.scenario.of_uav(0), &list.nodes()).unwrap();
            Simulator::of(&alone.setup()).is_some()
        };
        for keys in ["", "[uav]\ncount = 2\n"] {
            assert!(is_simulated(keys), "{keys}: its part of the field is its own");
        }
        let near = "[uav]\ncount = 2\nseparation_m = 3.0\n";
        for keys in [near, "[uav]\ncount = 2\ncoordination = 'independent'\n", "expiry_s = 20.0\n"] {
            assert!(!is_simulated(keys), "{keys}");
        }
    }
}
