//! A mission as a scene: opened once, given every slot, closed.
//!
//! Where things go is decided in the neighbouring modules, one per part of the picture; how they are arranged on the
//! screen in [`crate::blueprint`].

use std::ops::RangeInclusive;

use skysink_common::message::{FlightReport, Plan, QueuesHeader, SensorNode, Totals};
use skysink_common::scenario::Scenario;

use crate::events::{self, Events, Level};
use crate::links::Links;
use crate::los::Los;
use crate::queues::Queues;
use crate::recording::{Recording, SceneError, Sinks};
use crate::sizes::Sizes;
use crate::uav::Uav;
use crate::{blueprint, curves, legend};

/// Whether somebody measures the wall clock, so that its curves get a place on the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// Slots come with their plan latency and pace.
    Measured,
    /// They do not, and equal missions make equal recordings.
    Unmeasured,
}

/// Everything that is known of one slot; slot 0 is the state before the first and has no plan.
#[derive(Debug, Clone, Copy)]
pub struct SlotView<'a> {
    /// The slot.
    pub slot: u64,
    /// Queue [bit] of every sensor node after it.
    pub queues_bits: &'a [u32],
    /// Bits of the slot and since the start.
    pub header: &'a QueuesHeader,
    /// The plan, if one was there in time.
    pub plan: Option<&'a Plan>,
    /// What was flown and served.
    pub flight: &'a FlightReport,
    /// Slots per second of wall time, if measured.
    pub slots_per_s: Option<f64>,
    /// Wall time of planning the slot [ms], if measured.
    pub plan_ms: Option<f64>,
}

/// A recording under way.
pub struct Scene {
    recording: Recording,
    scenario: Scenario,
    queues: Queues,
    uav: Uav,
    links: Links,
    los: Option<Los>,
    events: Events,
    last_slot: u64,
    last_totals: Totals,
    missed_slots: u64,
}

impl Scene {
    /// Opens the sinks and draws everything that stays.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, the port is taken, or the recording library refuses.
    pub fn open(
        sinks: &Sinks,
        scenario: &Scenario,
        sensors: &[SensorNode],
        run_name: &str,
        timing: Timing,
    ) -> Result<Self, SceneError> {
        let recording = Recording::open(sinks, run_name)?;
        let (stream, sizes) = (recording.stream(), Sizes::of(scenario, sensors.len()));
        blueprint::send(stream, run_name, &sizes, scenario, timing)?;
        let queues = Queues::open(stream, sensors, &sizes)?;
        let uav = Uav::open(stream, &sizes)?;
        let links = Links::open(stream, scenario, sensors, &sizes)?;
        let los = Los::open(stream, scenario, sensors, &sizes)?;
        let events = Events::open(stream)?;
        curves::open(stream)?;
        legend::log(stream, scenario, sensors.len(), &sizes, links.rates_bps())?;
        let scenario = scenario.clone();
        let (last_slot, last_totals, missed_slots) = (0, Totals::default(), 0);
        let scene = Self { recording, scenario, queues, uav, links, los, events, last_slot, last_totals, missed_slots };
        scene.log_event(0, Level::Info, &events::start(&scene.scenario, sensors.len()))?;
        Ok(scene)
    }

    /// Address to open in a viewer, if the scene is served live.
    #[must_use]
    pub fn live_url(&self) -> Option<String> {
        self.recording.live_url()
    }

    /// Adds a slot. Slots come in ascending order, and none that was reported as missed.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or the recording library refuses.
    pub fn log_slot(&mut self, view: &SlotView) -> Result<(), SceneError> {
        let (slot, found, expected) = (view.slot, view.queues_bits.len(), self.queues.count());
        if found != expected {
            return Err(SceneError::Queues { slot, found, expected });
        }
        self.recording.set_slot(slot, self.scenario.slot_s);
        let stream = self.recording.stream();
        let fill = self.queues.log_slot(stream, view.queues_bits)?;
        self.uav.log_slot(stream, view)?;
        self.links.log_slot(stream, view)?;
        if let Some(los) = &mut self.los {
            los.log_slot(stream, view.flight)?;
        }
        self.events.log_slot(stream, view)?;
        curves::log_slot(stream, view, fill, self.missed_slots)?;
        (self.last_slot, self.last_totals) = (slot, view.header.totals);
        Ok(())
    }

    /// Marks slots that the viewer did not get: an event, a gap in the lane, and nothing left of the slot before that
    /// would look like one of theirs. The next slot's curve of missed slots counts them.
    ///
    /// # Errors
    /// If the recording library refuses.
    pub fn log_missed(&mut self, slots: RangeInclusive<u64>) -> Result<(), SceneError> {
        if slots.is_empty() {
            return Ok(());
        }
        let (first, last) = slots.into_inner();
        self.missed_slots += last - first + 1;
        self.recording.set_slot(first, self.scenario.slot_s);
        let stream = self.recording.stream();
        self.uav.log_missed(stream)?;
        self.links.log_missed(stream)?;
        if let Some(los) = &mut self.los {
            los.log_missed(stream)?;
        }
        self.events.log_missed(stream, first, last)?;
        self.last_slot = self.last_slot.max(last);
        Ok(())
    }

    /// Adds a line to the event log.
    ///
    /// # Errors
    /// If the recording library refuses.
    pub fn log_event(&self, slot: u64, level: Level, text: &str) -> Result<(), SceneError> {
        self.recording.set_slot(slot, self.scenario.slot_s);
        Ok(events::write(self.recording.stream(), level, text)?)
    }

    /// Adds the mission's totals to the event log and ends the recording.
    ///
    /// # Errors
    /// If something could not be written, now or earlier.
    pub fn close(self) -> Result<(), SceneError> {
        let text = events::end(&self.scenario, self.last_slot, &self.last_totals, self.missed_slots);
        self.log_event(self.last_slot, Level::Info, &text)?;
        self.recording.close()
    }
}
