//! A mission as a scene: opened once, given every slot, closed.
//!
//! Each part of the picture is drawn by a module of its own; [`crate::layout`] arranges them on the screen.

use std::ops::RangeInclusive;

use re_sdk::ApplicationId;
use re_sdk_types::components::TextLogLevel;
use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::estimate::Rates;
use skysink_common::message::{SensorNode, Totals};
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::files::Part;
use crate::picture::{self, Picture};
use crate::recording::{Recording, SceneError, Sinks};
use crate::rhythm::Rhythm;
use crate::sizes::Sizes;
use crate::slot::{SlotView, WallClock};
use crate::{events, layout, legend};

/// The application id of a mission's recordings.
fn application(scenario: &Scenario) -> ApplicationId {
    let name = format!("skysink-{}-{}", scenario.name, scenario.planner.strategy);
    // rerun warns of other characters, and replaces them.
    ApplicationId::new_or_unknown(name.replace(|letter: char| !letter.is_ascii_alphanumeric(), "-"))
}

/// A recording under way.
pub struct Scene {
    recording: Recording,
    canvas: Canvas,
    scenario: Scenario,
    picture: Picture,
    /// Which slots are drawn.
    rhythm: Rhythm,
    last_slot: Option<u64>,
    last_totals: Option<Totals>,
    /// Slots missed since the file began.
    missed_slots: u64,
}

impl Scene {
    /// Opens the sinks and draws everything that stays. If the file continues a recording, that keeps its name instead
    /// of `run_name`. `estimated` is what the UAV knows of the sampling rates where it has to estimate the queues, and
    /// none where it sees them.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, the port is taken, or the recording library refuses.
    pub fn open(
        sinks: &Sinks,
        scenario: &Scenario,
        sensors: &[SensorNode],
        run_name: &str,
        clock: WallClock,
        estimated: Option<Rates>,
    ) -> Result<Self, SceneError> {
        let recording = Recording::open(sinks, &application(scenario), run_name)?;
        let canvas = Canvas::whole(&recording.stream);
        let sizes = Sizes::of(scenario, sensors.len());
        layout::send(&recording, &sizes, scenario, clock, estimated)?;
        let picture = Picture::open(canvas.clone(), scenario, sensors, &sizes, &recording)?;
        let picture = picture.with_maps(scenario, sensors, &sizes, estimated)?;
        legend::log_facts(&recording.stream, scenario, sensors.len())?;
        let rhythm = Rhythm::every(recording.every.get(), scenario.slots);
        let scene = Self {
            recording,
            canvas,
            scenario: scenario.clone(),
            picture,
            rhythm,
            last_slot: None,
            last_totals: None,
            missed_slots: 0,
        };
        if scene.recording.part == Part::First {
            scene.log_event(0, TextLogLevel::INFO, &events::start(&scene.scenario, sensors.len()))?;
        }
        Ok(scene)
    }

    /// The port on 127.0.0.1 where a live viewer may connect.
    #[must_use]
    pub fn port(&self) -> Option<u16> {
        self.recording.port
    }

    /// Adds a slot. Slots come in ascending order, and none that was reported as missed.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or the recording library refuses.
    pub fn log_slot(&mut self, view: &SlotView) -> Result<(), SceneError> {
        self.recording.set_slot(view.slot, self.scenario.slot_s);
        self.picture.observe(view)?;
        if self.rhythm.is_due(view.slot) {
            self.picture.draw(view, self.missed_slots)?;
        }
        self.last_slot = Some(view.slot);
        self.last_totals = Some(view.header.totals);
        self.recording.end_slot(view.queues_bits.len());
        Ok(())
    }

    /// Most bytes that a scene of so many sensor nodes saves.
    #[must_use]
    pub fn state_room(count: usize) -> usize {
        picture::state_room(count)
    }

    /// Marks slots that the viewer did not get: an event, a gap in the lane, and what the slot before had drawn is
    /// cleared. The next slot's curve of missed slots counts them.
    ///
    /// # Errors
    /// If the recording library refuses.
    pub fn log_missed(&mut self, slots: RangeInclusive<u64>) -> Result<(), SceneError> {
        let (first, last) = slots.into_inner();
        self.missed_slots += last - first + 1;
        self.last_slot = Some(last);
        self.rhythm.restart(); // what is cleared is drawn again in the next slot that is seen
        self.recording.set_slot(first, self.scenario.slot_s);
        self.picture.log_missed(first, last)
    }

    /// Adds a line to the event log; `level` is one of [`TextLogLevel`].
    ///
    /// # Errors
    /// If the recording library refuses.
    pub fn log_event(&self, slot: u64, level: &'static str, text: &str) -> Result<(), SceneError> {
        self.recording.set_slot(slot, self.scenario.slot_s);
        Ok(events::write(&self.canvas, level, text)?)
    }

    /// Adds the mission's totals to the event log and ends the recording.
    ///
    /// # Errors
    /// If something could not be written, now or earlier.
    pub fn close(self) -> Result<(), SceneError> {
        if let Some(slot) = self.last_slot {
            let text = events::end(&self.scenario, slot, self.last_totals.as_ref(), self.missed_slots);
            self.log_event(slot, TextLogLevel::INFO, &text)?;
        }
        self.recording.close()
    }
}

impl Checkpoint for Scene {
    /// What the sums so far are, and what the UAV was told, so that the scene of a later file continues them.
    fn save(&self, bytes: &mut Vec<u8>) {
        self.picture.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.picture.restore(bytes)
    }
}
