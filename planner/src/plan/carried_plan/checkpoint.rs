//! The checkpoint of a look-ahead, from which a restarted planner resumes.

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};

use super::{CarriedPlan, PlanState};
use crate::operator_counts::OperatorCounts;
use crate::plan::groups::PlannedStop;
use crate::plan::objective::Objective;

/// The checkpoint of a look-ahead. Stops are disks and hovers; points, by their numbers, are positions [m] and sensors.
#[derive(Serialize, Deserialize)]
struct Saved {
    stops: Vec<(u32, u16)>,
    points: Vec<([f64; 2], u32)>,
    temperature: f64,
    has_begun: bool,
    advanced: u64,
    is_under_way: bool,
    vain_searches: u32,
    waypoint: Option<[f64; 2]>,
    counts: Vec<OperatorCounts>,
    served: Vec<u32>,
}

impl<O: Objective> Checkpoint for CarriedPlan<O> {
    fn save(&self, bytes: &mut Vec<u8>) {
        let PlanState { stops, temperature, has_begun, advanced, is_under_way, vain_searches, waypoint } = &self.plan;
        let points = self.model.disks.iter().filter(|_| O::HOVERS);
        let saved = Saved {
            stops: stops.iter().map(|stop| (stop.disk, stop.hovers)).collect(),
            points: points.map(|point| (point.disk.centre.into(), point.members[0])).collect(),
            temperature: *temperature,
            has_begun: *has_begun,
            advanced: *advanced,
            is_under_way: *is_under_way,
            vain_searches: *vain_searches,
            waypoint: waypoint.map(Into::into),
            counts: self.counts.clone(),
            served: self.served.clone(),
        };
        encode(&saved, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let saved: Saved = decode(bytes)?;
        CheckpointError::ensure((0.0..=1.0).contains(&saved.temperature), "a temperature from 0 to 1")?;
        let disks = if O::HOVERS { saved.points.len() } else { self.model.disks.len() };
        CheckpointError::ensure(saved.stops.iter().all(|(disk, _)| (*disk as usize) < disks), "stops of this field")?;
        let is_point = |point: &[f64; 2]| point.iter().all(|coordinate_m| coordinate_m.is_finite());
        let is_known =
            |(point, sensor): &([f64; 2], u32)| (*sensor as usize) < self.model.sensors.len() && is_point(point);
        CheckpointError::ensure(saved.points.iter().all(is_known), "points of this field")?;
        CheckpointError::ensure(saved.waypoint.iter().all(is_point), "a waypoint")?;
        CheckpointError::ensure(saved.counts.len() == self.counts.len(), "the operators of this objective")?;
        CheckpointError::ensure(saved.served.len() == self.served.len(), "a service of each sensor node")?;
        if O::HOVERS {
            self.model.disks.clear();
            saved.points.iter().for_each(|(point, sensor)| _ = self.model.add_point(*sensor, (*point).into(), 0));
        }
        (self.counts, self.served) = (saved.counts, saved.served);
        self.plan = PlanState {
            stops: saved.stops.into_iter().map(|(disk, hovers)| PlannedStop { disk, hovers }).collect(),
            temperature: saved.temperature,
            has_begun: saved.has_begun,
            advanced: saved.advanced,
            is_under_way: saved.is_under_way,
            vain_searches: saved.vain_searches,
            waypoint: saved.waypoint.map(Into::into),
        };
        Ok(())
    }
}
