//! The event log, the state lane of the UAV, and the status text.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Scalars, StateChange, StateConfiguration, TextLog};
use re_sdk_types::components::{MarkerShape, TextLogLevel};
use skysink_common::message::{HoldReason, Mode, SolverOutcome, Totals};
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::UavSlot;

use crate::canvas::Canvas;
use crate::colour::{self, Rgb};
use crate::files::Part;
use crate::recording::Recording;
use crate::shapes::point_style;
use crate::slot::SlotView;

/// Entity of the event log.
pub const LOG: &str = "log/events";
/// Entity of the state lane.
pub const LANE: &str = "state/uav";
/// Root of the state lanes of the UAVs from number 1 on.
pub const FLEET_LANES: &str = "state/uavs";
/// Root of the states as points of a plot, one entity per state. In the live view, a plot follows the mission; a state
/// lane does not.
pub const STATES: &str = "metrics/state";
/// The status text.
pub const STATUS: &str = "status";
/// The newest slot of a running mission, static, so that it is shown wherever the time cursor is.
pub const NEWEST: &str = "status/newest";
/// State of the lane for slots that the viewer has missed.
pub const GAP: &str = "gap";

/// The first line of a later file of the recording.
const CONTINUED: &str = "recording continued in a new file: the viewer was restarted
\
                         Up to ten seconds of earlier slots may be missing.";

/// The modes of a UAV; with a base, those of energy and landing, too.
fn modes(has_base: bool) -> impl Iterator<Item = Mode> {
    let needs_base = |mode: &Mode| matches!(mode, Mode::Charge | Mode::Return | Mode::Down);
    (0..).map_while(Mode::from_repr).filter(move |mode| has_base || !needs_base(mode))
}

/// The states of the lane.
pub(crate) fn states(has_base: bool) -> impl Iterator<Item = &'static str> {
    modes(has_base).map(Into::into).chain([GAP])
}

/// The state of the event log.
#[derive(Debug)]
pub(crate) struct Events {
    /// A line to log with the first slot.
    due: Option<&'static str>,
    /// The state of each UAV.
    states: Vec<Option<&'static str>>,
    /// Whether bits were lost up to the last slot; `None` before the first.
    is_lossy: Option<bool>,
    /// Whether the states are also points of a plot.
    is_live: bool,
}

impl Events {
    /// Styles the lanes.
    pub(crate) fn open(
        canvas: &Canvas,
        recording: &Recording,
        has_base: bool,
        uavs: usize,
    ) -> RecordingStreamResult<Self> {
        let colours: Vec<Rgb> = modes(has_base).map(|mode| look_of(mode).0).chain([colour::MISSED]).collect();
        let style = StateConfiguration::new().with_values(states(has_base)).with_colors(colours.iter().copied());
        for uav in 0..uavs {
            canvas.log_static(lane_of(uav), &style)?;
        }
        for (name, colour) in states(has_base).zip(colours) {
            canvas.log_static(format!("{STATES}/{name}"), &point_style(name, colour, MarkerShape::Square, 4.0))?;
        }
        let due = (recording.part == Part::Later).then_some(CONTINUED);
        Ok(Self { due, states: vec![None; uavs], is_lossy: None, is_live: recording.port.is_some() })
    }

    /// Logs the events of a slot, and the states of the UAVs that have changed.
    pub(crate) fn log_slot(&mut self, canvas: &Canvas, view: &SlotView) -> RecordingStreamResult<()> {
        self.log_due(canvas)?;
        for UavSlot { uav, plan, flight, .. } in view.uavs() {
            if view.slot > 0 {
                self.enter(canvas, uav, flight.flown_mode().into())?;
            }
            let warn = |text: &str| match view.flights.len() {
                1 => write(canvas, TextLogLevel::WARN, text),
                _ => write(canvas, TextLogLevel::WARN, &format!("UAV {uav}: {text}")),
            };
            match HoldReason::from_repr(flight.hold).unwrap_or_default() {
                HoldReason::None => {}
                HoldReason::NoPlan => warn("hold: no plan in time")?,
                HoldReason::Unknown => warn("hold: the vehicle is not heard, or not believed to be where it says")?,
                HoldReason::Base => warn("hold: to charge, but not in the base")?,
                HoldReason::Pad => warn("landed: all pads of the site are taken")?,
                HoldReason::Separation => warn("hold: too near to another UAV")?,
                HoldReason::Zone => warn("hold: a zone or a building in the way")?,
                HoldReason::Waypoint => warn("hold: waypoint not finite, out of reach, or outside the area")?,
            }
            if flight.refused > 0 {
                warn(&format!("{} of the plan's requests refused", flight.refused))?;
            }
            if plan.is_some_and(|plan| plan.solver == SolverOutcome::Fallback as u32) {
                warn("waypoint by the geometric solver, as a fallback")?;
            }
        }
        if self.is_live && view.slot > 0 {
            let mode = view.flight().flown_mode();
            let name: &'static str = mode.into();
            canvas.append(format!("{STATES}/{name}"), &Scalars::single(look_of(mode).1))?;
        }
        let totals = &view.header.totals;
        // In a later file, an earlier file contains the first loss if there was one before this slot.
        let was_lossy = self.is_lossy.unwrap_or(totals.lost_bits > view.header.lost_bits);
        self.is_lossy = Some(totals.lost_bits > 0);
        if !was_lossy && totals.lost_bits > 0 {
            write(canvas, TextLogLevel::WARN, &format!("first loss, {} bits: a buffer is full", totals.lost_bits))?;
        }
        Ok(())
    }

    /// Marks slots that the viewer has missed.
    pub(crate) fn log_missed(&mut self, canvas: &Canvas, first: u64, last: u64) -> RecordingStreamResult<()> {
        self.log_due(canvas)?;
        for uav in 0..self.states.len() {
            self.enter(canvas, uav, GAP)?;
        }
        if self.is_live {
            canvas.append(format!("{STATES}/{GAP}"), &Scalars::single(0.0))?;
        }
        let text = match last - first {
            0 => format!("slot {first} missed by the viewer\nThe mission continued."),
            _ => format!("slots {first} to {last} missed by the viewer\nThe mission continued."),
        };
        write(canvas, TextLogLevel::WARN, &text)
    }

    fn log_due(&mut self, canvas: &Canvas) -> RecordingStreamResult<()> {
        self.due.take().map_or(Ok(()), |text| write(canvas, TextLogLevel::WARN, text))
    }

    fn enter(&mut self, canvas: &Canvas, uav: usize, state: &'static str) -> RecordingStreamResult<()> {
        if self.states[uav] == Some(state) {
            return Ok(());
        }
        self.states[uav] = Some(state);
        canvas.append(lane_of(uav), &StateChange::single(state))
    }
}

/// The state lane of a UAV.
fn lane_of(uav: usize) -> String {
    if uav == 0 { LANE.to_owned() } else { format!("{FLEET_LANES}/{uav}") }
}

/// Colour of a state, and its height in the plot of states; that of a gap is 0.
fn look_of(mode: Mode) -> (Rgb, f64) {
    match mode {
        Mode::Down => (colour::LOSS, -1.0),
        Mode::Hold => (colour::HOLD, 1.0),
        Mode::Transit => (colour::TRANSIT, 2.0),
        Mode::EnRoute => (colour::EN_ROUTE, 2.0),
        Mode::Fly => (colour::FLY, 3.0),
        Mode::Serve => (colour::DELIVERY, 4.0),
        Mode::Charge => (colour::CHARGE, 5.0),
        Mode::Return => (colour::RETURN, 6.0),
    }
}

/// Adds one line to the event log, at the current time of the recording; `level` is one of [`TextLogLevel`].
pub(crate) fn write(canvas: &Canvas, level: &'static str, text: &str) -> RecordingStreamResult<()> {
    canvas.append(LOG, &TextLog::new(text).with_level(level))
}

/// The line at the start of a mission.
pub(crate) fn start(scenario: &Scenario, count: usize) -> String {
    let Scenario { name, seed, slots, slot_s, .. } = scenario;
    let strategy = &scenario.planner.strategy;
    format!(
        "start of mission {name}\nstrategy {strategy}, seed {seed}, {count} sensor nodes, {slots} slots of {slot_s} s"
    )
}

/// The line at the end of a mission; without totals if there was no slot.
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
