//! What is drawn of a mission: each part of the picture by a module of its own.

use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::events::Events;
use crate::files::Part;
use crate::links::Links;
use crate::los::Los;
use crate::path::Path;
use crate::queues::{Fill, Queues};
use crate::recording::SceneError;
use crate::sizes::Sizes;
use crate::slot::SlotView;
use crate::uav::UavShape;
use crate::{curves, legend};

/// A mission's picture under way.
pub(crate) struct Picture {
    canvas: Canvas,
    queues: Queues,
    uav: UavShape,
    path: Path,
    links: Links,
    los: Option<Los>,
    events: Events,
}

impl Picture {
    /// Draws everything that stays.
    pub(crate) fn open(
        canvas: Canvas,
        scenario: &Scenario,
        sensors: &[SensorNode],
        sizes: &Sizes,
        part: Part,
    ) -> Result<Self, SceneError> {
        let queues = Queues::open(&canvas, sensors, sizes)?;
        let uav = UavShape::open(&canvas, sizes)?;
        let path = Path::open(&canvas, sizes, part)?;
        let links = Links::open(&canvas, scenario, sensors, sizes)?;
        let los = Los::open(&canvas, scenario, sensors, sizes, part)?;
        let events = Events::open(&canvas, part)?;
        curves::open(&canvas)?;
        legend::log(&canvas, scenario, sensors.len(), sizes, links.rates_bps.as_ref())?;
        Ok(Self { canvas, queues, uav, path, links, los, events })
    }

    /// Draws a slot, at the time that the recording is set to, and returns how full the queues are; `missed_slots` were
    /// missed before.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or the recording library refuses.
    pub(crate) fn log_slot(&mut self, view: &SlotView, missed_slots: u64) -> Result<Fill, SceneError> {
        let found = view.queues_bits.len();
        let expected = self.queues.count();
        if found != expected {
            return Err(SceneError::Queues { slot: view.slot, found, expected });
        }
        let canvas = &self.canvas;
        let fill = self.queues.log_slot(canvas, view.queues_bits)?;
        self.uav.log_slot(canvas, view)?;
        self.path.log(canvas, view.path)?;
        self.links.log_circles(canvas, view.plan)?;
        self.links.log_links(canvas, Some(view.flight))?;
        if let Some(los) = &mut self.los {
            los.log_slot(canvas, view.flight)?;
        }
        self.events.log_slot(canvas, view)?;
        curves::log_slot(canvas, view, fill, missed_slots)?;
        Ok(fill)
    }

    /// Marks slots that the viewer did not get: an event, a gap in the lane, and what the slot before had drawn is
    /// cleared.
    pub(crate) fn log_missed(&mut self, first: u64, last: u64) -> Result<(), SceneError> {
        let canvas = &self.canvas;
        self.uav.log_missed(canvas)?;
        self.path.log(canvas, &[])?;
        self.links.log_circles(canvas, None)?;
        self.links.log_links(canvas, None)?;
        if let Some(los) = &mut self.los {
            los.log_missed(canvas)?;
        }
        Ok(self.events.log_missed(canvas, first, last)?)
    }
}
