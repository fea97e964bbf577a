//! The actions of an environment, and what the UAV plans by them.

use nalgebra::Point3;
use numpy::{AllowTypeChange, PyArrayLike1, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use skysink_common::geometry::{Position, above, within};
use skysink_common::message::{MAX_SERVED, SolverOutcome};
use skysink_common::slot_record::Plans;
use skysink_common::told::Told;
use skysink_planner::strategy::Decision;

use crate::episode::Episode;
use crate::errors::refused;
use crate::rules::{Control, Kind};

/// The action of one episode.
pub fn one(episode: &Episode, action: &Bound<'_, PyAny>) -> PyResult<Vec<f32>> {
    let size = episode.action_size();
    if episode.control() == Control::Sensor {
        return Ok(vec![chosen(action.extract()?, size)?]);
    }
    let components = action.extract::<PyArrayLike1<'_, f32, AllowTypeChange>>()?.as_array().to_vec();
    if components.len() != size || components.iter().any(|component| !component.is_finite()) {
        return Err(refused(format!("action {components:?}: expected {size} finite numbers, {}", episode.range())));
    }
    Ok(components)
}

/// Reads those of all UAVs of these episodes, which the caller may change again, one after another.
pub fn read(episodes: &[Episode], actions: &Bound<'_, PyAny>, into: &mut Vec<f32>) -> PyResult<()> {
    let size = episodes[0].action_size();
    into.clear();
    if episodes[0].control() == Control::Sensor {
        let actions = actions.extract::<PyReadonlyArrayDyn<'_, i64>>()?;
        let actions = actions.as_array();
        expect(actions.shape(), &shape(episodes, &[]))?;
        for &choice in actions {
            into.push(chosen(choice, size)?);
        }
        return Ok(());
    }
    let actions = actions.extract::<PyReadonlyArrayDyn<'_, f32>>()?;
    let actions = actions.as_array();
    expect(actions.shape(), &shape(episodes, &[size]))?;
    if let Some(component) = actions.iter().find(|component| !component.is_finite()) {
        let range = episodes[0].range();
        return Err(refused(format!("action {component}: expected finite numbers, {range}")));
    }
    into.extend(actions);
    Ok(())
}

/// The shape of an array that has `rest` for each UAV of these episodes.
pub fn shape(episodes: &[Episode], rest: &[usize]) -> Vec<usize> {
    let kind = episodes[0].rules().kind;
    let count = (kind != Kind::One).then_some(episodes.len());
    let uavs = (kind == Kind::Agents).then(|| episodes[0].plant.flights().len());
    count.into_iter().chain(uavs).chain(rest.iter().copied()).collect()
}

/// The plans of all UAVs of `episode`, which is number `index`, by the actions of all episodes.
pub fn plans(actions: &[f32], index: usize, episode: &mut Episode) -> Plans {
    let uavs = episode.plant.flights().len();
    let width = episode.action_width();
    let mut plans = Plans::new();
    episode.begin_plans();
    for (uav, action) in actions[index * uavs * width..].chunks(width).take(uavs).enumerate() {
        episode.act_as(uav);
        let decision = episode.decision(action);
        plans.push(Some(episode.ruled_beside(decision)));
    }
    plans
}

/// The choice of a sensor node out of `size`, at most 10^7: in single precision, it is exact.
fn chosen(number: i64, size: usize) -> PyResult<f32> {
    if usize::try_from(number).is_ok_and(|choice| choice < size) {
        return Ok(number as f32);
    }
    Err(refused(format!("action {number}: expected 0 to {}", size - 1)))
}

/// Refuses actions of another shape.
fn expect(shape: &[usize], expected: &[usize]) -> PyResult<()> {
    if shape != expected {
        return Err(refused(format!("actions of shape {shape:?}: expected {expected:?}")));
    }
    Ok(())
}

impl Episode {
    pub fn control(&self) -> Control {
        self.rules().control
    }

    /// Number of coordinates of a displacement or waypoint: 3 if the altitude is free, else 2.
    pub fn axes(&self) -> usize {
        if self.field.limits.climb_m > 0.0 { 3 } else { 2 }
    }

    /// Number of coordinates of an action, or of sensor nodes to choose from.
    pub fn action_size(&self) -> usize {
        match self.control() {
            Control::Sensor => self.observed().nearest.unwrap_or(self.field.count()),
            Control::Displacement | Control::Waypoint => self.axes(),
        }
    }

    /// Numbers that hold an action.
    pub fn action_width(&self) -> usize {
        if self.control() == Control::Sensor { 1 } else { self.axes() }
    }

    pub fn range(&self) -> &'static str {
        if self.control() == Control::Waypoint { "0 to 1" } else { "-1 to 1" }
    }

    /// Whether each sensor node to choose from is within the reach of one slot; all are true if none is.
    pub fn action_mask(&self) -> Vec<bool> {
        let choices = self.choices();
        let mut mask: Vec<bool> = choices.iter().map(|&id| self.reaches(id)).collect();
        if self.field.home.way().is_none() && self.field.airspace.is_open() {
            return some(mask);
        }
        let returns: Vec<bool> = choices.iter().map(|&id| self.returns_from(id)).collect();
        mask.iter_mut().zip(&returns).for_each(|(is_reached, returns)| *is_reached &= returns);
        if mask.contains(&true) { mask } else { some(returns) }
    }

    /// The decision by an action. A displacement or waypoint serves the fullest queues in range.
    pub fn decision(&self, action: &[f32]) -> Decision {
        let waypoint = match self.control() {
            Control::Sensor => return self.choose(action[0] as usize),
            Control::Waypoint => self.waypoint(action),
            Control::Displacement => self.displaced(action),
        };
        let known = self.plant.field().known_answers();
        decided(waypoint, &self.field.fullest(&waypoint, Told::new(self.plant.field().believed_bits(), &known)))
    }

    /// The waypoint of a displacement as a fraction of the reach of a slot.
    fn displaced(&self, action: &[f32]) -> Point3<f64> {
        let limits = self.field.limits;
        let uav = self.flight().position();
        let step = Position::new(action[0].into(), action[1].into()).coords;
        let step = step / step.norm().max(1.0) * limits.reach_m;
        let z_m = action.get(2).map_or(uav.z, |&climb| {
            let climb_m = f64::from(climb).clamp(-1.0, 1.0) * limits.climb_m;
            (uav.z + climb_m).clamp(limits.min_altitude_m, limits.max_altitude_m)
        });
        let ground = self.field.clamp_to_area(&(uav.xy() + step));
        above(&self.field.airspace.last_free(&uav.xy(), &ground, [limits.min_altitude_m; 2]), z_m)
    }

    /// The waypoint as fractions of the area and of the altitudes, moved into reach.
    fn waypoint(&self, action: &[f32]) -> Point3<f64> {
        let limits = self.field.limits;
        let uav = self.flight().position();
        let goal = Position::new(f64::from(action[0]) * limits.width_m, f64::from(action[1]) * limits.height_m);
        let ground = self.field.motion.toward(&uav.xy(), &self.field.clamp_to_area(&goal));
        let z_m = action.get(2).map_or(uav.z, |&fraction| {
            let range_m = limits.max_altitude_m - limits.min_altitude_m;
            let goal_m = limits.min_altitude_m + f64::from(fraction).clamp(0.0, 1.0) * range_m;
            goal_m.clamp(uav.z - limits.climb_m, uav.z + limits.climb_m)
        });
        above(&self.field.clamp_to_area(&ground), z_m)
    }

    /// The sensor nodes to choose from.
    pub fn choices(&self) -> Vec<u32> {
        self.observed().nearest.map_or_else(|| self.field.sensors.ids().collect(), |count| self.nearest(count))
    }

    /// Where a slot toward a sensor node ends.
    pub fn end_toward(&self, id: u32) -> Point3<f64> {
        let uav = self.flight().position();
        let ground = self.field.motion.toward(&uav.xy(), self.field.sensors.position(id));
        above(&self.field.clamp_to_area(&ground), uav.z)
    }

    /// The flight toward a sensor node, which is served if it is then in range, with the fullest others.
    fn choose(&self, choice: usize) -> Decision {
        let limits = self.field.limits;
        let id = self.observed().nearest.map_or(choice as u32, |count| self.nearest(count)[choice]);
        let goal = self.field.sensors.position(id);
        let waypoint = self.end_toward(id);
        let known = self.plant.field().known_answers();
        let told = Told::new(self.plant.field().believed_bits(), &known);
        let mut served = self.field.fullest(&waypoint, told);
        let most = (limits.resource_blocks as usize).min(MAX_SERVED);
        let is_in_range = within(goal, &waypoint.xy(), limits.comm_radius_m);
        if is_in_range && told.answer(id).sends() && !served.contains(&id) {
            if served.len() == most {
                let value = |id: u32| self.field.value(id, told.queues_bits[id as usize]);
                let emptiest = (0..most).rev().min_by_key(|&at| value(served[at]));
                emptiest.map(|at| served.remove(at));
            }
            served.push(id);
            served.sort_unstable();
        }
        decided(waypoint, &served)
    }
}

/// The decision to fly to `waypoint` [m] and serve these sensor nodes.
fn decided(waypoint: Point3<f64>, ids: &[u32]) -> Decision {
    Decision { waypoint, schedule: ids.iter().copied().collect(), outcome: SolverOutcome::Rule, winner: None }
}

/// The mask, or one of all if it has none.
fn some(mut mask: Vec<bool>) -> Vec<bool> {
    if !mask.contains(&true) {
        mask.fill(true);
    }
    mask
}
