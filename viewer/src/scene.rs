//! The recording of a mission: opened once, fed with every slot, closed.
//!
//! Each drawn part has its own module; [`crate::layout`] arranges the views.

use std::ops::RangeInclusive;
use std::sync::Arc;

use re_sdk::ApplicationId;
use re_sdk_types::archetypes::TextDocument;
use re_sdk_types::components::TextLogLevel;
use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::estimate::Rates;
use skysink_common::message::Totals;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use crate::canvas::Canvas;
use crate::files::Part;
use crate::picture::{self, Picture};
use crate::recording::{Recording, SceneError, Sinks};
use crate::rhythm::Rhythm;
use crate::sizes::Sizes;
use crate::slot::{SlotView, WallClock};
use crate::{events, layout, legend, status};

/// The application id of the recordings of a mission.
fn application(scenario: &Scenario) -> ApplicationId {
    let name = format!("skysink-{}-{}", scenario.name, scenario.planner.strategy);
    // rerun replaces other characters, with a warning.
    ApplicationId::new_or_unknown(name.replace(|letter: char| !letter.is_ascii_alphanumeric(), "-"))
}

/// The recording of a mission.
pub struct Scene {
    recording: Recording,
    scenario: Scenario,
    picture: Picture,
    /// Decides which slots are drawn.
    rhythm: Rhythm,
    last_slot: Option<u64>,
    last_totals: Option<Totals>,
    /// Slots missed since the start of the file.
    missed_slots: u64,
}

impl Scene {
    /// Opens the sinks and logs all static entities. A file that continues a recording keeps its name instead of
    /// `run_name`. `estimated` is how the UAV knows the sampling rates if it has to estimate the queues; `None` if it
    /// observes them.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, the port is in use, or rerun fails.
    pub fn open(
        sinks: &Sinks,
        scenario: &Scenario,
        sensors: &Arc<Sensors>,
        run_name: &str,
        clock: WallClock,
        estimated: Option<Rates>,
    ) -> Result<Self, SceneError> {
        let recording = Recording::open(sinks, &application(scenario), run_name)?;
        let sizes = Sizes::of(scenario, sensors.count());
        layout::send(&recording, &sizes, scenario, sensors.count(), clock, estimated)?;
        let picture = Picture::open(Canvas::whole(&recording.stream), scenario, sensors, &sizes, &recording)?;
        let picture = picture.with_maps(scenario, sensors, &sizes, estimated)?;
        legend::log_facts(&recording.stream, scenario, sensors.count())?;
        let rhythm = Rhythm::every(recording.every.get(), scenario.slots);
        let scene = Self {
            recording,
            scenario: scenario.clone(),
            picture,
            rhythm,
            last_slot: None,
            last_totals: None,
            missed_slots: 0,
        };
        if scene.recording.part == Part::First {
            scene.log_event(0, TextLogLevel::INFO, &events::start(&scene.scenario, sensors.count()))?;
        }
        Ok(scene)
    }

    /// The port on 127.0.0.1 for live viewers.
    pub fn port(&self) -> Option<u16> {
        self.recording.port
    }

    /// Adds a slot. Slots must ascend, and exclude those reported as missed.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or rerun fails.
    pub fn log_slot(&mut self, view: &SlotView) -> Result<(), SceneError> {
        self.recording.set_slot(view.slot, self.scenario.slot_s);
        self.picture.observe(view)?;
        if self.rhythm.is_due(view.slot) {
            self.picture.draw(view, self.missed_slots)?;
        }
        self.last_slot = Some(view.slot);
        self.last_totals = Some(view.header.totals);
        if self.recording.is_batch_due(view.told.queues_bits.len()) {
            self.log_newest(view.slot)?;
            self.recording.send_batch();
        }
        Ok(())
    }

    /// Maximum size of the saved state for `count` sensor nodes [byte].
    #[must_use]
    pub fn state_room(count: usize) -> usize {
        picture::state_room(count)
    }

    /// Marks missed slots: logs an event and a gap in the state lane, and clears outdated entities. The next slot adds
    /// them to the curve of missed slots.
    ///
    /// # Errors
    /// If rerun fails.
    pub fn log_missed(&mut self, slots: RangeInclusive<u64>) -> Result<(), SceneError> {
        let (first, last) = slots.into_inner();
        self.missed_slots += last - first + 1;
        self.last_slot = Some(last);
        self.rhythm.restart(); // the next slot draws the cleared entities again
        self.recording.set_slot(first, self.scenario.slot_s);
        self.picture.log_missed(first, last)
    }

    /// Adds a line to the event log; `level` is one of [`TextLogLevel`].
    ///
    /// # Errors
    /// If rerun fails.
    pub fn log_event(&self, slot: u64, level: &'static str, text: &str) -> Result<(), SceneError> {
        self.recording.set_slot(slot, self.scenario.slot_s);
        Ok(events::write(&self.picture.canvas, level, text)?)
    }

    /// Adds the mission's totals to the event log and ends the recording.
    ///
    /// # Errors
    /// If data could not be written, now or earlier.
    pub fn close(self) -> Result<(), SceneError> {
        if let Some(slot) = self.last_slot {
            let text = events::end(&self.scenario, slot, self.last_totals.as_ref(), self.missed_slots);
            self.log_event(slot, TextLogLevel::INFO, &text)?;
            self.log_newest(slot)?;
        }
        self.recording.close()
    }

    /// Tells live viewers the newest slot.
    fn log_newest(&self, slot: u64) -> Result<(), SceneError> {
        if self.recording.port.is_none() {
            return Ok(());
        }
        let text = status::newest(slot, self.scenario.slots, &self.picture.readout.clock(slot));
        Ok(self.picture.canvas.log_static(events::NEWEST, &TextDocument::from_markdown(text))?)
    }
}

impl Checkpoint for Scene {
    /// Saves the sums and the estimate, so that a later file continues them.
    fn save(&self, bytes: &mut Vec<u8>) {
        self.picture.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.picture.restore(bytes)
    }
}
