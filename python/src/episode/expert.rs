//! What built-in strategies would do in the present state of an episode, as experts for learners.

use std::collections::BTreeMap;
use std::process;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use nalgebra::{Point2, Point3, Vector2};
use pyo3::PyResult;
use skysink_common::checkpoint::Checkpoint as _;
use skysink_common::geometry::above;
use skysink_common::message::Plan;
use skysink_common::nodes::Answer;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_common::told::{Received, Sensed, Told};
use skysink_mission::Plant;
use skysink_mission::drive::Pilot as _;
use skysink_planner::FleetPlanner;
use skysink_planner::strategies::expected;
use skysink_planner::strategy::Registered;

use super::Episode;
use crate::errors::refused;
use crate::rules::Control;

/// How far an action ends from the waypoint of a plan, toward the SNs that it serves [m]: they stay in range although
/// actions have single precision.
const INWARD_M: f64 = 1e-3;

/// The plans of a strategy, and its state after them, or why there are none.
type Reply = Result<(ByUav<Plan>, Vec<u8>), String>;

/// The plans that are flown in a slot, with the queues [bit] and the answers before it.
#[derive(Clone)]
struct Flown {
    plans: ByUav<Plan>,
    queues_bits: Vec<u32>,
    answers: Vec<Answer>,
}

/// The strategies that were asked in an episode.
#[derive(Clone, Default)]
pub struct Experts {
    /// By name.
    asked: BTreeMap<String, Asked>,
    /// The last flown slot.
    flown: Option<Flown>,
}

/// A strategy after it was asked. A copy makes its planner anew, from the checkpoint.
struct Asked {
    /// The slot that it planned.
    slot: u64,
    plans: ByUav<Plan>,
    /// The checkpoint of its planner.
    state: Vec<u8>,
    worker: Option<Worker>,
}

impl Clone for Asked {
    fn clone(&self) -> Self {
        Self { plans: self.plans.clone(), state: self.state.clone(), worker: None, ..*self }
    }
}

/// A thread with a planner, which cannot move between threads.
struct Worker {
    /// The process that has the thread; a forked one has not.
    process: u32,
    questions: Sender<Question>,
}

/// A question for the plans of the next slot.
struct Question {
    plant: Plant,
    flown: Option<Flown>,
    stop: Stop,
    answer: Sender<Reply>,
}

impl Worker {
    /// Starts a planner of `scenario` from a checkpoint, or anew.
    fn start(scenario: Scenario, list: Arc<SensorList>, state: Option<Vec<u8>>) -> Self {
        let (questions, asked) = channel();
        thread::spawn(move || answer(&scenario, &list, state, &asked));
        Self { process: process::id(), questions }
    }
}

/// Answers questions until nobody can ask.
fn answer(scenario: &Scenario, list: &SensorList, state: Option<Vec<u8>>, asked: &Receiver<Question>) {
    let mut made: Option<FleetPlanner> = None;
    for Question { plant, flown, stop, answer } in asked {
        let mut plan = || {
            let planner = match &mut made {
                Some(planner) => planner,
                None => {
                    let mut planner = FleetPlanner::until(scenario, &list.nodes(), &stop).map_err(|e| e.to_string())?;
                    state.iter().try_for_each(|state| planner.restore(state)).map_err(|error| error.to_string())?;
                    made.insert(planner)
                }
            };
            planner.set_stop(&stop);
            if let Some(Flown { plans, queues_bits, answers }) = &flown {
                let slot = plant.slot() - 1;
                let told = Told::new(queues_bits, answers);
                planner.follow(&Sensed { slot, flights: &[], told, received: &Received::NOTHING }, plans);
            }
            let plans = planner.orders(&plant).expect("a planner plans every slot").plans();
            let mut state = Vec::new();
            planner.save(&mut state);
            Ok((plans.iter().flatten().map(|plan| Plan { plan_ns: 0, ..*plan }).collect(), state))
        };
        let _ = answer.send(plan());
    }
}

impl Experts {
    /// Takes in what is flown in the next slot.
    pub fn follow(&mut self, plant: &Plant, plans: &[Option<Plan>]) {
        self.flown = None;
        if !self.asked.is_empty() {
            let plans = plans.iter().copied().collect::<Option<_>>();
            let Told { queues_bits, answers } = plant.field().told();
            let flown = |plans| Flown { plans, queues_bits: queues_bits.to_vec(), answers: answers.to_vec() };
            self.flown = plans.map(flown);
        }
    }
}

impl Episode {
    /// The plans of the strategy `name` for the next slot.
    pub fn expert_plans(&mut self, name: &str, stop: &Stop) -> PyResult<ByUav<Plan>> {
        let slot = self.plant.slot() + 1;
        if let Some(asked) = self.experts.asked.get(name).filter(|asked| asked.slot == slot) {
            return Ok(asked.plans.clone());
        }
        if Registered::find(name).is_none() {
            return Err(refused(format!("strategy {name:?}: expected {}", expected(name))));
        }
        let before = self.experts.asked.remove(name);
        let flown = self.experts.flown.clone().filter(|_| before.is_some());
        let (state, worker) = before.map_or((None, None), |asked| (Some(asked.state), asked.worker));
        let worker = match worker.filter(|worker| worker.process == process::id()) {
            Some(worker) => worker,
            None => {
                let mut scenario = self.course.prepared(self.number)?;
                name.clone_into(&mut scenario.planner.strategy);
                Worker::start(scenario, Arc::clone(&self.list), state)
            }
        };
        let (answer, answered) = channel();
        let question = Question { plant: self.plant.clone(), flown, stop: stop.clone(), answer };
        worker.questions.send(question).map_err(|_| refused("the strategy has failed"))?;
        let answered = answered.recv().map_err(|_| refused("the strategy has failed"))?;
        let (plans, state) = answered.map_err(refused)?;
        stop.check().map_err(refused)?; // a search that was stopped may be incomplete
        let asked = Asked { slot, plans: plans.clone(), state, worker: Some(worker) };
        self.experts.asked.insert(name.to_owned(), asked);
        Ok(plans)
    }

    /// The actions of all UAVs that come closest to the plans of the strategy `name`, one after another.
    pub fn write_expert(&mut self, name: &str, stop: &Stop, into: &mut [f32]) -> PyResult<()> {
        let plans = self.expert_plans(name, stop)?;
        let size = into.len() / plans.len();
        for (uav, plan) in plans.iter().enumerate() {
            self.act_as(uav);
            let end = self.inward(plan);
            self.write_action(&end, &mut into[uav * size..][..size]);
        }
        Ok(())
    }

    /// The waypoint of a plan, moved toward the middle of the SNs that it serves by [`INWARD_M`].
    fn inward(&self, plan: &Plan) -> Point3<f64> {
        let waypoint = plan.waypoint();
        let served = plan.scheduled().iter().map(|&id| self.field.sensors.position(id).coords);
        let middle = Point2::from(served.sum::<Vector2<f64>>() / plan.scheduled().len().max(1) as f64);
        let inward = middle - waypoint.xy();
        if plan.scheduled().is_empty() || inward.norm() < INWARD_M {
            return waypoint;
        }
        above(&(waypoint.xy() + inward.normalize() * INWARD_M), waypoint.z)
    }

    /// The action that ends the slot closest to `waypoint`.
    fn write_action(&self, waypoint: &Point3<f64>, into: &mut [f32]) {
        let limits = self.field.limits;
        let uav = self.flight().position();
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
