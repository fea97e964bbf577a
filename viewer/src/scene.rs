//! A mission as a scene: opened once, given every slot, closed.
//!
//! Where things go is decided in the neighbouring modules, one per part of the picture; how they are arranged on the
//! screen in [`crate::blueprint`].

use std::ops::RangeInclusive;

use skysink_common::message::{FlightReport, Plan, QueuesHeader, SensorNode, Totals};
use skysink_common::path::PathPoint;
use skysink_common::scenario::Scenario;

use crate::events::{self, Events, Level};
use crate::links::Links;
use crate::los::Los;
use crate::path::Path;
use crate::queues::Queues;
use crate::recording::{Recording, SceneError, Sinks};
use crate::sizes::Sizes;
use crate::takeover::Past;
use crate::uav::{self, Uav};
use crate::{blueprint, curves, legend, links};

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
    /// Where it leads, its own waypoint first; empty if that is not known.
    pub path: &'a [PathPoint],
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
    path: Path,
    links: Links,
    los: Option<Los>,
    events: Events,
    last_slot: u64,
    last_totals: Option<Totals>,
    missed_slots: u64,
    continued: Continued,
}

/// How far a recording was when it was continued; nothing if it was not.
#[derive(Debug, Clone, Copy, Default)]
struct Continued {
    /// The last slot that it had whole.
    whole: Option<u64>,
    /// The last slot of which it showed anything.
    seen: Option<u64>,
}

impl Scene {
    /// Opens the sinks, draws everything that stays, and takes over what a file to continue has of earlier slots. If
    /// there is such a file the recording keeps its name instead of `run_name`.
    ///
    /// # Errors
    /// If there is no sink, the file cannot be created, read or replaced, the port is taken, or the recording library
    /// refuses.
    pub fn open(
        sinks: &Sinks,
        scenario: &Scenario,
        sensors: &[SensorNode],
        run_name: &str,
        timing: Timing,
    ) -> Result<Self, SceneError> {
        let recording = Recording::open(sinks, run_name)?;
        let (stream, sizes) = (recording.stream(), Sizes::of(scenario, sensors.len()));
        blueprint::send(stream, recording.name(), &sizes, scenario, timing)?;
        let queues = Queues::open(stream, sensors, &sizes)?;
        let uav = Uav::open(stream, &sizes)?;
        let path = Path::open(stream, &sizes)?;
        let links = Links::open(stream, scenario, sensors, &sizes)?;
        let los = Los::open(stream, scenario, sensors, &sizes)?;
        let events = Events::open(stream)?;
        curves::open(stream)?;
        legend::log(stream, scenario, sensors.len(), &sizes, links.rates_bps())?;
        let scenario = scenario.clone();
        let (last_slot, last_totals, missed_slots, continued) = (0, None, 0, Continued::default());
        #[rustfmt::skip]
        let mut scene = Self {
            recording, scenario, queues, uav, path, links, los, events, last_slot, last_totals, missed_slots, continued,
        };
        scene.begin()?;
        Ok(scene)
    }

    /// Begins the log, or goes on with that of the recording before.
    fn begin(&mut self) -> Result<(), SceneError> {
        let past = self.recording.take_over()?;
        if !matches!(&past, Past::Recording(history) if history.started) {
            self.log_event(0, Level::Info, &events::start(&self.scenario, self.queues.count()))?;
        }
        match past {
            Past::Nothing => Ok(()),
            Past::NoRecording => self.log_event(0, Level::Warn, events::NOTHING_TO_CONTINUE),
            Past::Recording(history) => {
                self.path.resume(&history);
                let whole = history.last_whole(&self.every_slot());
                self.continued = Continued { whole, seen: history.last_seen() };
                self.last_slot = whole.unwrap_or(0);
                self.missed_slots = whole.map_or(0, |slot| history.missed_slots_at(slot));
                self.events.resume(&history);
                self.log_event(self.last_slot, Level::Warn, &events::continued(whole, history.spoilt))
            }
        }
    }

    /// Entities that every slot has.
    fn every_slot(&self) -> Vec<String> {
        let plain = uav::EVERY_SLOT.into_iter().chain(links::EVERY_SLOT).chain(curves::EVERY_SLOT);
        let path = self.path.every_slot().iter().copied();
        let plain = plain.chain(self.queues.every_slot()).chain(path).map(str::to_owned);
        plain.chain(self.los.iter().flat_map(|_| Los::every_slot())).collect()
    }

    /// The last slot that a continued recording has whole; the next one is either logged or missed.
    #[must_use]
    pub fn continued_after(&self) -> Option<u64> {
        self.continued.whole
    }

    /// Slots missed so far, those of a continued recording included.
    #[must_use]
    pub fn missed_slots(&self) -> u64 {
        self.missed_slots
    }

    /// Address to open in a viewer, if the scene is served live.
    #[must_use]
    pub fn live_url(&self) -> Option<String> {
        self.recording.live_url()
    }

    /// Adds a slot. Slots come in ascending order, and none that was reported as missed. A slot that a continued
    /// recording has whole stays as it is.
    ///
    /// # Errors
    /// If the slot does not fit the sensor list, or the recording library refuses.
    pub fn log_slot(&mut self, view: &SlotView) -> Result<(), SceneError> {
        let (slot, found, expected) = (view.slot, view.queues_bits.len(), self.queues.count());
        if found != expected {
            return Err(SceneError::Queues { slot, found, expected });
        }
        (self.last_slot, self.last_totals) = (slot.max(self.last_slot), Some(view.header.totals));
        if self.continued.whole.is_some_and(|whole| slot <= whole) {
            return Ok(());
        }
        self.recording.set_slot(slot, self.scenario.slot_s);
        let stream = self.recording.stream();
        let fill = self.queues.log_slot(stream, view.queues_bits)?;
        self.uav.log_slot(stream, view)?;
        self.path.log_slot(stream, view.path)?;
        self.links.log_slot(stream, view)?;
        if let Some(los) = &mut self.los {
            los.log_slot(stream, view.flight)?;
        }
        self.events.log_slot(stream, view)?;
        Ok(curves::log_slot(stream, view, fill, self.missed_slots)?)
    }

    /// Marks slots that the viewer did not get: an event, a gap in the lane, and nothing left of the slot before that
    /// would look like one of theirs. The next slot's curve of missed slots counts them. Slots that a continued
    /// recording has whole are not missed.
    ///
    /// # Errors
    /// If the recording library refuses.
    pub fn log_missed(&mut self, slots: RangeInclusive<u64>) -> Result<(), SceneError> {
        let (first, last) = slots.into_inner();
        let first = self.continued.whole.map_or(first, |whole| first.max(whole + 1));
        if first > last {
            return Ok(());
        }
        self.missed_slots += last - first + 1;
        self.last_slot = self.last_slot.max(last);
        self.log_nothing(first)?;
        self.events.log_missed(self.recording.stream(), first, last)?;
        match self.continued.seen {
            Some(seen) if (first..last).contains(&seen) => {
                self.log_nothing(seen + 1)?;
                Ok(self.events.log_gap(self.recording.stream())?)
            }
            _ => Ok(()),
        }
    }

    /// Takes away from `slot` on what was only true in a slot.
    fn log_nothing(&mut self, slot: u64) -> Result<(), SceneError> {
        self.recording.set_slot(slot, self.scenario.slot_s);
        let stream = self.recording.stream();
        self.uav.log_missed(stream)?;
        self.path.log_missed(stream)?;
        self.links.log_missed(stream)?;
        if let Some(los) = &mut self.los {
            los.log_missed(stream)?;
        }
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
        let text = events::end(&self.scenario, self.last_slot, self.last_totals.as_ref(), self.missed_slots);
        self.log_event(self.last_slot, Level::Info, &text)?;
        self.recording.close()
    }
}
