//! All drawn parts of a mission; each part has its own module.

use std::sync::Arc;

use re_sdk_types::archetypes::TextDocument;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::estimate::{BYTES_PER_SENSOR, Rates, SavedEstimate};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::belief::BeliefMaps;
use crate::canvas::Canvas;
use crate::curves::Curves;
use crate::events::Events;
use crate::geo::GeoMap;
use crate::history::{SensorHistory, Sums};
use crate::layer::LayerSetup;
use crate::layers::{self, Layers};
use crate::links::Links;
use crate::maps::{MapFrame, Maps};
use crate::names::SensorNames;
use crate::path::Path;
use crate::queues::{Fill, QueueShapes};
use crate::readout::Readout;
use crate::recording::{Recording, SceneError};
use crate::sizes::Sizes;
use crate::slot::SlotView;
use crate::status::status;
use crate::uav::UavShape;
use crate::{cameras, events, legend, link_map, uav, zones};

/// The drawing state of a mission.
pub(crate) struct Picture {
    pub(crate) canvas: Canvas,
    queues: QueueShapes,
    uavs: Vec<UavShape>,
    path: Path,
    links: Links,
    layers: Layers,
    events: Events,
    curves: Curves,
    history: SensorHistory,
    maps: Option<Maps>,
    geo: Option<GeoMap>,
    belief: Option<BeliefMaps>,
    names: SensorNames,
    pub(crate) readout: Readout,
    sizes: Sizes,
}

/// Maximum size of the estimate without its sensor nodes [byte].
const BELIEF_BYTES: usize = 64;

/// Maximum size of the saved state for `count` sensor nodes [byte].
pub(crate) fn state_room(count: usize) -> usize {
    Sums::room(count) + BELIEF_BYTES + BYTES_PER_SENSOR * count
}

impl Picture {
    /// Logs all static entities.
    pub(crate) fn open(
        canvas: Canvas,
        scenario: &Scenario,
        sensors: &Arc<Sensors>,
        sizes: &Sizes,
        recording: &Recording,
    ) -> Result<Self, SceneError> {
        let part = recording.part;
        let names = SensorNames::of(scenario, sensors.count());
        let queues = QueueShapes::open(&canvas, sensors, sizes, &names)?;
        let open = |uav: usize| UavShape::open(&canvas, sizes, uav);
        let uavs = (0..scenario.uav.uavs()).map(open).collect::<Result<_, _>>()?;
        let path = Path::open(&canvas, sizes, scenario.uav.uavs(), part)?;
        let links = Links::open(&canvas, scenario, sensors, sizes)?;
        let layers = Layers::open(&canvas, LayerSetup { scenario, sensors, sizes })?;
        let events = Events::open(&canvas, recording, scenario.base.is_some(), scenario.uav.uavs())?;
        let curves = Curves::open(&canvas, scenario, sensors.sampling.is_drawn())?;
        legend::log_scales(&canvas, scenario, links.rates_bps.as_ref())?;
        legend::log_area(&canvas, sizes)?;
        cameras::log(&canvas, sizes)?;
        legend::log_text_above(&canvas, scenario, sizes)?;
        uav::log_labels_above(&canvas, scenario.uav.uavs())?;
        legend::log_base(&canvas, scenario)?;
        zones::log_zones(&canvas, scenario)?;
        zones::log_shadows(&canvas, scenario, sensors)?;
        link_map::log_best(&canvas, scenario, sensors)?;
        let history = SensorHistory::new(scenario, sensors);
        let readout = Readout::of(scenario);
        Ok(Self {
            canvas,
            queues,
            uavs,
            path,
            links,
            layers,
            events,
            curves,
            history,
            maps: None,
            geo: None,
            belief: None,
            names,
            readout,
            sizes: *sizes,
        })
    }

    /// Adds maps and the legend to the scene. `estimated` is how the UAV knows the rates if it has to estimate the
    /// queues.
    pub(crate) fn with_maps(
        mut self,
        scenario: &Scenario,
        sensors: &Arc<Sensors>,
        sizes: &Sizes,
        estimated: Option<Rates>,
    ) -> Result<Self, SceneError> {
        let rows = layers::legend(scenario);
        legend::log_page(&self.canvas, scenario, sensors.count(), sizes, estimated, &rows)?;
        layers::log_pages(&self.canvas, scenario)?;
        link_map::log_each(&self.canvas, scenario, sensors)?;
        self.geo = GeoMap::open(&self.canvas, scenario, sensors, &self.names)?;
        let frame = MapFrame::of(sensors, sizes, &self.names);
        self.maps = Some(Maps::open(&self.canvas, scenario, &frame, &self.history)?);
        let belief = |rates| BeliefMaps::open(&self.canvas, scenario, sensors, rates, &frame);
        self.belief = estimated.map(belief).transpose()?;
        Ok(self)
    }

    /// Updates the state with a slot, and logs its events at the current time of the recording.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or rerun fails.
    pub(crate) fn observe(&mut self, view: &SlotView) -> Result<(), SceneError> {
        let found = view.told.queues_bits.len();
        let expected = self.queues.count();
        if found != expected {
            return Err(SceneError::Queues { slot: view.slot, found, expected });
        }
        let belief = self.belief.iter_mut();
        belief.for_each(|belief| belief.observe(&self.history, view.slot, view.told, view.flights));
        self.history.add(view.slot, view.told, view.flights.iter().map(|flight| flight.position().xy()));
        self.history.credit(view.flights);
        self.uavs.iter_mut().zip(view.uavs()).for_each(|(uav, row)| uav.observe(row.flight));
        self.geo.iter_mut().for_each(|geo| geo.observe(view.flights));
        Ok(self.events.log_slot(&self.canvas, view)?)
    }

    /// Draws the last observed slot, and returns the fill of the queues. `missed_slots` is the number of missed slots
    /// so far.
    ///
    /// # Errors
    /// If rerun fails.
    pub(crate) fn draw(&mut self, view: &SlotView, missed_slots: u64) -> Result<Fill, SceneError> {
        let canvas = &self.canvas;
        let queues_bits = &self.history.sums.queues_bits;
        self.belief.iter_mut().try_for_each(|belief| belief.draw(canvas, view.slot, queues_bits))?;
        let fill = self.queues.log_slot(canvas, &self.history, &view.header.totals)?;
        let ground = view.flight().position().xy();
        self.maps.iter_mut().try_for_each(|maps| maps.log_slot(canvas, view.slot, &self.history, ground))?;
        let mut labels = Vec::new();
        for (uav, row) in self.uavs.iter_mut().zip(view.uavs()) {
            let label = self.readout.label(row.uav, view.slot, row.flight, uav.flown_m());
            uav.draw(canvas, row.flight, row.plan, &label)?;
            labels.push(label);
        }
        let places = view.flights.iter().map(|flight| self.sizes.on_map(&flight.position().xy()));
        uav::show_labels_above(canvas, places, &labels)?;
        self.geo.iter_mut().try_for_each(|geo| geo.draw(canvas))?;
        self.path.log(canvas, view.uavs().map(|row| row.path))?;
        self.links.log_circles(canvas, view.plan())?;
        self.links.log_links(canvas, view.flights)?;
        self.layers.log_slot(canvas, view)?;
        let status = status(view, &self.history, &self.names, &self.readout.clock(view.slot));
        canvas.show(events::STATUS, &TextDocument::from_markdown(status))?;
        self.curves.log_slot(canvas, view, fill, missed_slots, self.history.sampled_now_bits())?;
        Ok(fill)
    }

    /// Marks missed slots: logs an event and a gap in the state lane, and clears outdated entities.
    pub(crate) fn log_missed(&mut self, first: u64, last: u64) -> Result<(), SceneError> {
        let canvas = &self.canvas;
        self.uavs.iter_mut().try_for_each(|uav| uav.log_missed(canvas))?;
        self.geo.iter_mut().try_for_each(|geo| geo.log_flown(canvas))?;
        self.path.log(canvas, std::iter::empty())?;
        self.links.log_circles(canvas, None)?;
        self.links.log_links(canvas, &[])?;
        self.layers.log_missed(canvas)?;
        Ok(self.events.log_missed(canvas, first, last)?)
    }
}

impl Checkpoint for Picture {
    /// Saves the sums and the estimate, if there is one.
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&(&self.history.sums, self.belief.as_ref().and_then(BeliefMaps::saved)), bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (sums, belief): (Sums, Option<SavedEstimate>) = decode(bytes)?;
        CheckpointError::ensure(belief.is_none() || self.belief.is_some(), "a belief only where queues are estimated")?;
        let mut history = self.history.clone();
        history.restore(sums)?;
        if let (Some(known), Some(saved), Some(slot)) = (&mut self.belief, belief, history.sums.slot) {
            known.restore(slot, saved)?;
        }
        self.history = history;
        Ok(())
    }
}
