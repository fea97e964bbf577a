//! What built-in strategies would do in the present state of an episode, as experts for learners.

use std::collections::BTreeMap;

use nalgebra::Point3;
use pyo3::PyResult;
use skysink_common::checkpoint::Checkpoint as _;
use skysink_common::message::Plan;
use skysink_common::slot_record::{ByUav, Plans};
use skysink_common::stop::Stop;
use skysink_mission::Plant;
use skysink_mission::drive::Pilot as _;
use skysink_planner::FleetPlanner;
use skysink_planner::strategies::expected;
use skysink_planner::strategy::Registered;

use crate::episode::Episode;
use crate::errors::refused;
use crate::rules::Control;

/// The strategies that were asked in an episode.
#[derive(Clone, Default)]
pub struct Experts {
    /// By name.
    asked: BTreeMap<String, Asked>,
    /// The plans of the last flown slot, with the queues before it [bit].
    flown: Option<(ByUav<Plan>, Vec<u32>)>,
}

/// A strategy after it was asked.
#[derive(Clone)]
struct Asked {
    /// The slot that it planned.
    slot: u64,
    plans: ByUav<Plan>,
    /// The checkpoint of its planner.
    state: Vec<u8>,
}

impl Experts {
    /// Takes in what is flown in the next slot.
    pub fn follow(&mut self, plant: &Plant, plans: &[Option<Plan>]) {
        self.flown = None;
        if !self.asked.is_empty() && plant.field().belief().is_estimated() {
            let plans = plans.iter().copied().collect::<Option<_>>();
            self.flown = plans.map(|plans| (plans, plant.field().told_bits().into_owned()));
        }
    }
}

impl Episode {
    /// The plans of the strategy `name` for the next slot.
    pub fn expert_plans(&mut self, name: &str, stop: &Stop) -> PyResult<Plans> {
        let slot = self.plant.slot() + 1;
        let asked = self.experts.asked.get(name);
        if let Some(asked) = asked.filter(|asked| asked.slot == slot) {
            return Ok(asked.plans.iter().copied().map(Some).collect());
        }
        if Registered::find(name).is_none() {
            return Err(refused(format!("strategy {name:?}: expected {}", expected(name))));
        }
        let mut scenario = self.scenario()?;
        name.clone_into(&mut scenario.planner.strategy);
        let mut planner = FleetPlanner::until(&scenario, &self.list.nodes(), stop).map_err(refused)?;
        if let Some(asked) = asked {
            planner.restore(&asked.state).map_err(refused)?;
            if let Some((plans, queues_bits)) = &self.experts.flown {
                planner.follow(slot - 1, plans, queues_bits);
            }
        }
        let planned = planner.plans(&self.plant).expect("a planner plans every slot");
        stop.check().map_err(refused)?; // a search that was stopped may be incomplete
        let plans = planned.iter().flatten().map(|plan| Plan { plan_ns: 0, ..*plan }).collect();
        let mut state = Vec::new();
        planner.save(&mut state);
        self.experts.asked.insert(name.to_owned(), Asked { slot, plans, state });
        Ok(planned)
    }

    /// The actions of all UAVs that come closest to the plans of the strategy `name`, one after another.
    pub fn write_expert(&mut self, name: &str, stop: &Stop, into: &mut [f32]) -> PyResult<()> {
        let plans = self.expert_plans(name, stop)?;
        let size = into.len() / plans.len();
        for (uav, plan) in plans.iter().flatten().enumerate() {
            self.uav = uav;
            self.write_action(&plan.waypoint(), &mut into[uav * size..][..size]);
        }
        Ok(())
    }

    /// The action that ends the slot closest to `waypoint`.
    fn write_action(&self, waypoint: &Point3<f64>, into: &mut [f32]) {
        let (limits, uav) = (self.field.limits, self.flight().position());
        let height_m = limits.max_altitude_m - limits.min_altitude_m;
        let action = match self.control() {
            Control::Displacement => {
                let step = waypoint - uav;
                [step.x / limits.reach_m, step.y / limits.reach_m, step.z / limits.climb_m]
            }
            Control::Waypoint => [
                waypoint.x / limits.width_m,
                waypoint.y / limits.height_m,
                (waypoint.z - limits.min_altitude_m) / height_m,
            ],
            Control::Sensor => {
                let ends = self.choices().into_iter().map(|id| self.end_toward(id));
                let distances = ends.map(|end| (end.xy() - waypoint.xy()).norm_squared());
                let nearest = distances.enumerate().min_by(|one, other| one.1.total_cmp(&other.1));
                [nearest.map_or(0, |(choice, _)| choice) as f64, 0.0, 0.0]
            }
        };
        into.iter_mut().zip(action).for_each(|(into, component)| *into = component as f32);
    }
}
