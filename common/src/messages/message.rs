//! The messages of the ring, with their layout in shared memory.
//!
//! Plain `repr(C)` numbers without implicit padding, so that any language can read them. An unknown number is read as
//! the default of its enum. The version of a layout is part of its type name.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "node")]
use iceoryx2::prelude::ZeroCopySend;
use nalgebra::Point3;
use strum::{Display, EnumString, FromRepr, IntoStaticStr};

use crate::battery::BatteryState;
use crate::channel::MAX_RESOURCE_BLOCKS;
pub use crate::ledger::Totals;
pub use crate::limits::Limits;

/// Most sensor nodes in one plan.
pub const MAX_SERVED: usize = MAX_RESOURCE_BLOCKS;

/// Most points of a path.
pub const MAX_PATH_POINTS: usize = 64;

/// Id of no sensor node.
pub const NOBODY: u32 = u32::MAX;

/// [`SlotHeader::flags`]: the last slot of the mission; nothing follows.
pub const FLAG_END: u32 = 1;

/// [`SlotHeader::flags`]: sent before, because a link between hosts may have lost it. Readers drop a slot that they
/// have.
pub const FLAG_REPEAT: u32 = 2;

/// User header of every sample; those of `sensors`, `belief` and `queues` begin with it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.SlotHeader.v1"))]
pub struct SlotHeader {
    /// The run that the sample belongs to.
    pub mission: u64,
    /// The slot, from 1; 0 is the state before the first.
    pub slot: u64,
    /// Restart count of the writer.
    pub epoch: u32,
    /// [`FLAG_END`], [`FLAG_REPEAT`].
    pub flags: u32,
    /// When it was sent, on the monotonic clock [ns].
    pub sent_ns: u64,
}

/// User header of `queues`, and of `belief`, there without totals.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.QueuesHeader.v1"))]
pub struct QueuesHeader {
    /// Mission and slot.
    pub head: SlotHeader,
    /// Every bit since the mission's start, after this slot.
    pub totals: Totals,
    /// Bits uploaded in this slot.
    pub delivered_bits: u64,
    /// Bits lost in this slot.
    pub lost_bits: u64,
}

/// User header of `sensors`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.SensorsHeader.v2"))]
pub struct SensorsHeader {
    /// Mission and slot.
    pub head: SlotHeader,
    /// The constraints on every plan.
    pub limits: Limits,
}

/// Payload element of `sensors`: one sensor node.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.SensorNode.v2"))]
pub struct SensorNode {
    /// Position, east [m].
    pub x_m: f64,
    /// Position, north [m].
    pub y_m: f64,
    /// Reference channel gain at 1 m, `α_i`, as a linear ratio.
    pub gain: f64,
    /// Sampling rate `s_i` [bit/s].
    pub sampling_bps: f64,
    /// Buffer `B` [bit].
    pub capacity_bits: u32,
    /// Zero.
    pub reserved: u32,
    /// Weight `w_i` of its bits (decision D25), above 0; 1 if the list has no weights.
    pub weight: f64,
}

impl Default for SensorNode {
    /// All 0, with the weight 1.
    fn default() -> Self {
        Self { weight: 1.0, ..Self::zeroed() }
    }
}

/// Payload element of `answers`: what a sensor node does when it is served in the next slot (decision D33), as a
/// number: 0 sends its queue, 1 is silent, and sends later, 2 is dead.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.NodeAnswer.v1"))]
pub struct NodeAnswer {
    /// What it does.
    pub answer: u8,
    /// That as the UAVs know it: where queues are estimated, only a contact shows a death.
    pub known: u8,
}

/// Mode of the UAV in a slot, by its number in messages and its name in `slots.csv`; an unknown number is a hold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Display, EnumString, FromRepr, IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
#[repr(u32)]
pub enum Mode {
    /// Flies to the strategy's own waypoint and serves there. A plan may say so whether it serves or not.
    Serve,
    /// Flies straight toward the fullest queue, because the strategy finds no sensor node in reach.
    Transit,
    /// Holds its position and serves no sensor node.
    #[default]
    Hold,
    /// Flies to the strategy's own waypoint and serves no sensor node there.
    Fly,
    /// Stays in the base, serves no sensor node, and charges (decision D11).
    Charge,
    /// Flies toward the base, because of the energy or the time that is left (decision D13), and serves on the way.
    Return,
    /// Is down where its energy ended, for the rest of the mission (decision D12).
    Down,
    /// Has not reached the waypoint by the end of the slot: the next plan begins where the vehicle is. Only vehicles
    /// from outside report it.
    #[strum(serialize = "en-route")]
    EnRoute,
}

/// How the waypoint was found, by its number in messages; an unknown one, from an external planner, is its own rule.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, FromRepr)]
#[repr(u32)]
pub enum SolverOutcome {
    /// By the strategy's own rule; no problem was solved.
    #[default]
    Rule,
    /// By the chosen solver.
    Solved,
    /// The chosen solver gave no usable point: by the geometric solver, or the centre that `exact` found.
    Fallback,
    /// The end of a recorded flight, which is flown again without a position error (decision D29).
    Recorded,
}

/// Payload element of `plan`: the schedule and the waypoint of a UAV in the slot.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.Plan.v1"))]
pub struct Plan {
    /// Waypoint at the end of the slot, east [m].
    pub x_m: f64,
    /// Waypoint, north [m].
    pub y_m: f64,
    /// Waypoint, up [m].
    pub z_m: f64,
    /// Bits that the planner expects to collect in the slot.
    pub expected_bits: u64,
    /// Time that planning took [ns]; 0 if not measured.
    pub plan_ns: u64,
    /// Centres [m] of the five candidate circles of the winning anchor, C1 to C5; NaN where there are none.
    pub circles_m: [[f64; 2]; 5],
    /// Anchor SN i of the winning set, or [`NOBODY`].
    pub anchor: u32,
    /// Its partner SN k, or [`NOBODY`].
    pub partner: u32,
    /// Index of the winning circle, from 0; 5 or more: none.
    pub chosen: u32,
    /// [`Mode`], as a number.
    pub mode: u32,
    /// [`SolverOutcome`], as a number.
    pub solver: u32,
    /// Number of valid `ids`.
    pub served: u32,
    /// Scheduled sensor nodes, ascending.
    pub ids: [u32; MAX_SERVED],
}

impl Plan {
    /// A plan that flies to `waypoint` [m] and serves no sensor node.
    #[must_use]
    pub fn fly_to(waypoint: impl Into<Point3<f64>>, mode: Mode) -> Self {
        let waypoint = waypoint.into();
        Self {
            x_m: waypoint.x,
            y_m: waypoint.y,
            z_m: waypoint.z,
            expected_bits: 0,
            plan_ns: 0,
            circles_m: [[f64::NAN; 2]; 5],
            anchor: NOBODY,
            partner: NOBODY,
            chosen: NOBODY,
            mode: mode as u32,
            solver: SolverOutcome::Rule as u32,
            served: 0,
            ids: [NOBODY; MAX_SERVED],
        }
    }

    /// Waypoint at the end of the slot [m].
    pub fn waypoint(&self) -> Point3<f64> {
        Point3::new(self.x_m, self.y_m, self.z_m)
    }

    /// Replaces the schedule, in the order given.
    ///
    /// # Panics
    /// If there are more than [`MAX_SERVED`] ids; a scenario has at most as many resource blocks.
    pub fn schedule(&mut self, ids: &[u32]) {
        self.ids = [NOBODY; MAX_SERVED];
        self.ids[..ids.len()].copy_from_slice(ids);
        self.served = u32::try_from(ids.len()).expect("at most MAX_SERVED");
    }

    /// Replaces all sensor nodes by those that `ids` names at their numbers.
    ///
    /// # Panics
    /// If `ids` names one not.
    pub fn renumber(&mut self, ids: &[u32]) {
        let served = self.scheduled().len();
        for id in self.ids[..served].iter_mut().chain([&mut self.anchor, &mut self.partner]) {
            if *id != NOBODY {
                *id = ids[*id as usize];
            }
        }
    }

    /// The scheduled sensor nodes, at most [`MAX_SERVED`] for any `served`.
    pub fn scheduled(&self) -> &[u32] {
        &self.ids[..(self.served as usize).min(MAX_SERVED)]
    }
}

/// One served link of a slot.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.LinkReport.v1"))]
pub struct LinkReport {
    /// The sensor node.
    pub sensor: u32,
    /// 1 in line of sight, 0 not.
    pub line_of_sight: u32,
    /// Horizontal distance `d` [m].
    pub distance_m: f64,
    /// Elevation angle of the UAV, seen from the sensor node [deg].
    pub elevation_deg: f64,
    /// Rate `r_i` [bit/s].
    pub rate_bps: f64,
    /// Whole bits that the link can carry in the slot, `floor(r_i τ_c)`.
    pub capacity_bits: u64,
}

/// Why the UAV held its position, by its number in messages; an unknown number is read as `None`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, FromRepr)]
#[repr(u32)]
pub enum HoldReason {
    /// It did not hold.
    #[default]
    None,
    /// No plan had arrived when the slot began.
    NoPlan,
    /// The waypoint was not finite, out of reach or outside the area.
    Waypoint,
    /// It was to charge, and is not in the base.
    Base,
    /// The way to the waypoint led through a no-fly zone or a building.
    Zone,
    /// The slot would have ended too near to a UAV of lower number (decision D23).
    Separation,
    /// There was a plan, but the vehicle was not heard, or not believed to be where it said.
    Unknown,
    /// It has landed to charge, and all pads of its site are taken: it waits, in mode `charge` (decision D34).
    Pad,
}

/// Payload element of `flight`: the position of a UAV after the slot, and the capacity of each of its links.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.FlightReport.v4"))]
pub struct FlightReport {
    /// Position, east [m].
    pub x_m: f64,
    /// Position, north [m].
    pub y_m: f64,
    /// Position, up [m].
    pub z_m: f64,
    /// Energy in the battery after the slot, `E(t)` [J]; infinite without a battery.
    pub energy_j: f64,
    /// When the vehicle was there [s], from the start of slot 1, by its own clock; the end of the slot if it is
    /// simulated.
    pub time_s: f64,
    /// Velocity there, east, north, up [m/s].
    pub velocity_mps: [f64; 3],
    /// Heading, clockwise from north [deg]; infinite if it is not known.
    pub heading_deg: f64,
    /// Covariance of the position [m²]: xx, xy, xz, yy, yz, zz; 0 if the position is exact.
    pub covariance_m2: [f64; 6],
    /// [`Mode`] flown, as a number.
    pub mode: u32,
    /// [`HoldReason`], as a number.
    pub hold: u32,
    /// Requests of the plan that were refused: sensor nodes, or the waypoint.
    pub refused: u32,
    /// How many of `links` count.
    pub served: u32,
    /// Slots that a swap of the battery has taken so far (decision D34); 0 outside of one.
    pub swapped_slots: u32,
    /// 0.
    pub reserved: u32,
    /// The served links, by ascending sensor node.
    pub links: [LinkReport; MAX_SERVED],
}

impl From<&FlightReport> for BatteryState {
    /// That after the flight.
    fn from(flight: &FlightReport) -> Self {
        Self { energy_j: flight.energy_j, is_charging: flight.flown_mode() == Mode::Charge }
    }
}

impl FlightReport {
    /// Whether it has waited for a pad.
    pub fn awaits_pad(&self) -> bool {
        self.hold == HoldReason::Pad as u32
    }

    /// A report from `position` [m] that serves no sensor node.
    #[must_use]
    pub fn at(position: impl Into<Point3<f64>>, mode: Mode) -> Self {
        let position = position.into();
        Self {
            x_m: position.x,
            y_m: position.y,
            z_m: position.z,
            energy_j: f64::INFINITY,
            heading_deg: f64::INFINITY,
            mode: mode as u32,
            ..Self::zeroed()
        }
    }

    /// The served links, at most [`MAX_SERVED`] for any `served`.
    pub fn served_links(&self) -> &[LinkReport] {
        &self.links[..(self.served as usize).min(MAX_SERVED)]
    }

    /// Whether it serves SN `sensor`.
    pub fn serves(&self, sensor: u32) -> bool {
        self.served_links().iter().any(|link| link.sensor == sensor)
    }

    /// The mode flown. [`Mode::Serve`] and [`Mode::Fly`] follow from what was served, whichever of the two a foreign
    /// flight-sim has reported.
    pub fn flown_mode(&self) -> Mode {
        match Mode::from_repr(self.mode).unwrap_or_default() {
            Mode::Serve | Mode::Fly if self.served > 0 => Mode::Serve,
            Mode::Serve | Mode::Fly => Mode::Fly,
            other => other,
        }
    }

    /// Position of the UAV at the end of the slot, `L_u(t)` [m].
    pub fn position(&self) -> Point3<f64> {
        Point3::new(self.x_m, self.y_m, self.z_m)
    }
}

/// Payload element of `links`: what a UAV hears of a sensor node within `link.beacon_radius_m` at the end of the slot,
/// scheduled or not (decision D32). They ascend by UAV, and then by sensor node.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.HeardLink.v1"))]
pub struct HeardLink {
    /// Number of the UAV, from 0.
    pub uav: u32,
    /// The sensor node.
    pub sensor: u32,
    /// Signal-to-noise ratio [dB].
    pub snr_db: f32,
}

/// Payload element of `path`: a planned waypoint. The first of each UAV is that of the slot's own plan.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.PathPoint.v2"))]
pub struct PathPoint {
    /// East [m].
    pub x_m: f64,
    /// North [m].
    pub y_m: f64,
    /// Up [m].
    pub z_m: f64,
    /// Number of the UAV, from 0. All points of a UAV follow one another, and UAVs ascend.
    pub uav: u32,
    /// 0.
    pub reserved: u32,
}

impl PathPoint {
    /// A planned waypoint of the UAV number `uav`.
    #[must_use]
    pub fn of(uav: usize, point: &Point3<f64>) -> Self {
        Self { x_m: point.x, y_m: point.y, z_m: point.z, uav: uav as u32, reserved: 0 }
    }
}

/// Payload of `commit`: the slot in the sample's header is in `slots.csv`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.Commit.v1"))]
pub struct Commit {
    /// Chained hash of the slot records up to this one.
    pub hash: u64,
}

/// Payload of `tick`, in paced runs: the slot in the sample's header begins now.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.Tick.v1"))]
pub struct Tick {
    /// Wall time from one slot to the next [ns].
    pub period_ns: u64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};

    /// External programs declare the same structs: a new layout needs a new version in the type name.
    #[test]
    fn message_layouts_are_stable() {
        assert_eq!(size_of::<SlotHeader>(), 32);
        assert_eq!(size_of::<QueuesHeader>(), 96);
        assert_eq!(size_of::<Limits>(), 136);
        assert_eq!(offset_of!(Limits, slots), 72);
        assert_eq!(size_of::<SensorsHeader>(), 168);
        assert_eq!(offset_of!(SensorsHeader, limits), 32);
        assert_eq!(size_of::<SensorNode>(), 48);
        assert_eq!(size_of::<NodeAnswer>(), 2);
        assert_eq!(size_of::<Plan>(), 400);
        assert_eq!(size_of::<LinkReport>(), 40);
        assert_eq!(size_of::<FlightReport>(), 2704);
        assert_eq!(size_of::<HeardLink>(), 12);
        assert_eq!(size_of::<PathPoint>(), 32);
        assert_eq!(size_of::<Commit>(), 8);
        assert_eq!(size_of::<Tick>(), 8);
    }

    #[test]
    fn an_excessive_count_does_not_read_beyond_the_message() {
        let mut plan = Plan::fly_to([0.0, 0.0, 20.0], Mode::Serve);
        plan.served = 1_000_000;
        assert_eq!(plan.scheduled().len(), MAX_SERVED);
    }

    #[test]
    fn modes_have_numbers_and_names() {
        assert_eq!(Mode::from_repr(77), None);
        for (code, name, mode) in [
            (0, "serve", Mode::Serve),
            (1, "transit", Mode::Transit),
            (2, "hold", Mode::Hold),
            (3, "fly", Mode::Fly),
            (4, "charge", Mode::Charge),
            (5, "return", Mode::Return),
            (6, "down", Mode::Down),
            (7, "en-route", Mode::EnRoute),
        ] {
            assert_eq!((Mode::from_repr(code), mode as u32), (Some(mode), code));
            assert_eq!((name.parse(), mode.to_string()), (Ok(mode), name.to_owned()));
        }
        assert_eq!(Mode::default(), Mode::Hold, "for an unknown number");
    }

    #[test]
    fn a_flight_with_links_serves_regardless_of_its_mode() {
        let flown = |mode: u32, served| FlightReport { mode, served, ..FlightReport::zeroed() }.flown_mode();
        let modes = [Mode::Serve, Mode::Transit, Mode::Hold, Mode::Fly].map(|mode| mode as u32);
        assert_eq!(modes.map(|mode| flown(mode, 0)), [Mode::Fly, Mode::Transit, Mode::Hold, Mode::Fly]);
        assert_eq!(modes.map(|mode| flown(mode, 2)), [Mode::Serve, Mode::Transit, Mode::Hold, Mode::Serve]);
        assert_eq!(flown(77, 0), Mode::Hold);
    }

    #[test]
    fn a_point_of_a_path_has_the_coordinates_of_its_position() {
        let point = PathPoint::of(4, &Point3::new(1.0, 2.0, 3.0));
        assert_eq!((point.x_m, point.y_m, point.z_m, point.uav), (1.0, 2.0, 3.0, 4));
    }
}
