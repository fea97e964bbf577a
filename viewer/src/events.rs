//! What happened, in words: the event log, and the lane of the UAV's state.

use rerun::{RecordingStream, RecordingStreamResult, StateChange, StateConfiguration, TextLog, TextLogLevel};
use skysink_common::message::{HoldReason, Mode, SolverOutcome, Totals};
use skysink_common::scenario::Scenario;

use crate::colour;
use crate::history::History;
use crate::scene::SlotView;

/// Entity of the event log.
pub const LOG: &str = "log/events";
/// Entity of the state lane.
pub const LANE: &str = "state/uav";
/// State of the lane where the viewer missed slots.
pub const GAP: &str = "gap";

/// How the log's line on the start begins.
pub(crate) const START: &str = "start of mission";
/// How its line on the first loss begins.
pub(crate) const FIRST_LOSS: &str = "first loss";

/// What the log says where there was a file to continue, but no recording in it.
pub(crate) const NOTHING_TO_CONTINUE: &str = "the file to continue held no recording, and was replaced";

/// How much an event matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// Good to know.
    Info,
    /// Something did not go as planned.
    Warn,
    /// Something failed.
    Error,
}

impl Level {
    fn name(self) -> &'static str {
        match self {
            Self::Info => TextLogLevel::INFO,
            Self::Warn => TextLogLevel::WARN,
            Self::Error => TextLogLevel::ERROR,
        }
    }
}

/// What the log and the lane have said so far.
#[derive(Debug, Default)]
pub struct Events {
    state: Option<&'static str>,
    lost: bool,
}

impl Events {
    /// Styles the lane.
    pub(crate) fn open(stream: &RecordingStream) -> RecordingStreamResult<Self> {
        let states = [
            (Mode::Serve.name(), colour::DELIVERY),
            (Mode::Transit.name(), colour::CLOCK),
            (Mode::Hold.name(), colour::LOSS),
            (GAP, colour::MISSED),
        ];
        let style = StateConfiguration::new()
            .with_values(states.map(|(name, _)| name))
            .with_colors(states.map(|(_, colour)| colour::color(colour)));
        stream.log_static(LANE, &style)?;
        Ok(Self::default())
    }

    /// Goes on where the log and the lane of a continued recording ended.
    pub(crate) fn resume(&mut self, history: &History) {
        let states = [Mode::Serve.name(), Mode::Transit.name(), Mode::Hold.name(), GAP];
        self.state = states.into_iter().find(|&state| history.state() == Some(state));
        self.lost = history.lost;
    }

    /// Logs what is worth telling of a slot, and its state where it changes.
    pub(crate) fn log_slot(&mut self, stream: &RecordingStream, view: &SlotView) -> RecordingStreamResult<()> {
        let flight = view.flight;
        if view.slot > 0 {
            self.enter(stream, Mode::of_code(flight.mode).name())?;
        }
        match HoldReason::of_code(flight.hold) {
            HoldReason::None => {}
            HoldReason::NoPlan => write(stream, Level::Warn, "hold: no plan in time")?,
            HoldReason::Waypoint => {
                write(stream, Level::Warn, "hold: waypoint not finite, out of reach, or outside the area")?;
            }
        }
        if flight.refused > 0 {
            let text = format!("{} of the plan's requests refused", flight.refused);
            write(stream, Level::Warn, &text)?;
        }
        if view.plan.is_some_and(|plan| SolverOutcome::of_code(plan.solver) == SolverOutcome::Fallback) {
            write(stream, Level::Warn, "waypoint by the geometric solver, as a fallback")?;
        }
        if !self.lost && view.header.totals.lost_bits > 0 {
            self.lost = true;
            let text = format!("{FIRST_LOSS}, {} bits: a storage is full", view.header.totals.lost_bits);
            write(stream, Level::Warn, &text)?;
        }
        Ok(())
    }

    /// Marks slots that the viewer did not get.
    pub(crate) fn log_missed(&mut self, stream: &RecordingStream, first: u64, last: u64) -> RecordingStreamResult<()> {
        self.enter(stream, GAP)?;
        let text = match last - first {
            0 => format!("slot {first} missed by the viewer\nThe mission went on."),
            _ => format!("slots {first} to {last} missed by the viewer\nThe mission went on."),
        };
        write(stream, Level::Warn, &text)
    }

    /// Says again that slots were missed, after what is known of some of them.
    pub(crate) fn log_gap(&mut self, stream: &RecordingStream) -> RecordingStreamResult<()> {
        self.state = None;
        self.enter(stream, GAP)
    }

    fn enter(&mut self, stream: &RecordingStream, state: &'static str) -> RecordingStreamResult<()> {
        if self.state == Some(state) {
            return Ok(());
        }
        self.state = Some(state);
        stream.log(LANE, &StateChange::single(state))
    }
}

/// Adds one line to the event log, at the time set before.
pub(crate) fn write(stream: &RecordingStream, level: Level, text: &str) -> RecordingStreamResult<()> {
    stream.log(LOG, &TextLog::new(text).with_level(level.name()))
}

/// What is flown.
pub(crate) fn start(scenario: &Scenario, count: usize) -> String {
    let Scenario { name, seed, slots, slot_s, .. } = scenario;
    let strategy = &scenario.planner.strategy;
    format!("{START} {name}\nstrategy {strategy}, seed {seed}, {count} sensor nodes, {slots} slots of {slot_s} s")
}

/// Where the log goes on after a restart of the viewer; `last_slot` is the last that the recording has whole.
pub(crate) fn continued(last_slot: Option<u64>, spoilt: u64) -> String {
    let place = last_slot.map_or("before its first slot".to_owned(), |slot| format!("after slot {slot}"));
    let spoilt = if spoilt == 0 { String::new() } else { format!("\n{spoilt} of its messages could not be read.") };
    format!("recording continued {place}: the viewer was restarted{spoilt}")
}

/// What came of it; without totals if no slot brought any.
pub(crate) fn end(scenario: &Scenario, last_slot: u64, totals: Option<&Totals>, missed_slots: u64) -> String {
    let missed = if missed_slots == 0 { String::new() } else { format!(", {missed_slots} slots missed by the viewer") };
    let totals = totals.map_or_else(String::new, |totals| {
        let Totals { initial_bits, sampled_bits, delivered_bits, lost_bits, queued_bits, .. } = totals;
        format!(
            "\n{initial_bits} bits at the start, {sampled_bits} sampled\n\
             {delivered_bits} delivered, {lost_bits} lost, {queued_bits} still queued"
        )
    });
    format!("end after slot {last_slot} of {}{missed}{totals}", scenario.slots)
}
