//! The missions of this process in recordings for rerun.

use skysink_common::message::{PathPoint, Plan};
use skysink_common::slot_record::{Plans, SlotRecord};
use skysink_mission::drive::Observer;
use skysink_mission::{MissionError, Plant};
use skysink_viewer::{SceneError, SlotView};

use crate::error::Error;

/// Hands the views of all slots, from slot 0 on, to a recording. They contain no wall-clock times, so that equal
/// missions give equal recordings.
pub struct SlotViews<F>(pub F);

impl<F: FnMut(&SlotView) -> Result<(), SceneError>> SlotViews<F> {
    fn show(&mut self, plant: &Plant, plans: &[Option<Plan>], paths: &[PathPoint]) -> Result<(), MissionError> {
        let header = plant.header();
        let plans: Plans = plans.iter().map(|plan| plan.map(|plan| Plan { plan_ns: 0, ..plan })).collect();
        let view = SlotView {
            slot: plant.slot(),
            told: plant.field().told(),
            header: &header,
            plans: &plans,
            paths,
            flights: plant.flights(),
            heard: &plant.heard_links(),
            features: Some(plant.field().features()),
            slots_per_s: None,
            plan_ms: None,
        };
        Ok((self.0)(&view).map_err(Error::from)?)
    }
}

impl<F: FnMut(&SlotView) -> Result<(), SceneError>> Observer for SlotViews<F> {
    fn begin(&mut self, plant: &Plant) -> Result<(), MissionError> {
        self.show(plant, &[], &[])
    }

    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        let paths: Vec<PathPoint> = record.uavs().flat_map(|row| row.path).copied().collect();
        self.show(plant, record.plans(), &paths)
    }
}
