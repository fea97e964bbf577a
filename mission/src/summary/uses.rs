//! What UAVs, fleets and searches did in a mission, as in `summary.json`.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};
use skysink_common::base::Base;
use skysink_common::figure::{FigureValue, ReportRow};
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan};
use skysink_common::slot_record::{SlotRecord, UavSlot};
use skysink_planner::operator_counts::OperatorCounts;

use crate::numbers::grouped;

/// What became of the changes that an operator of a search proposed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OperatorUse {
    /// The operator.
    pub operator: Cow<'static, str>,
    /// How often it proposed, how many proposals were void, accepted, and lowered the cost.
    #[serde(flatten)]
    pub counts: OperatorCounts,
}

impl<T: Into<Cow<'static, str>>> From<(T, OperatorCounts)> for OperatorUse {
    fn from((operator, counts): (T, OperatorCounts)) -> Self {
        Self { operator: operator.into(), counts }
    }
}

/// What several UAVs did together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct FleetUse {
    /// Number of UAVs.
    pub uavs: usize,
    /// Scheduled SNs that a UAV of lower number served in that slot (decision D19); since the last resumption.
    pub contended: u64,
    /// Least distance between two UAVs at the end of a slot, neither of them in the base [m] (decision D23); `None` if
    /// all pairs always were.
    pub min_separation_m: Option<f64>,
}

impl FigureValue for FleetUse {
    /// Which requests were contended only the run knows.
    fn recompute(&mut self, again: Self) {
        *self = Self { contended: self.contended, ..again };
    }
}

impl FleetUse {
    /// Its rows of the printed report.
    pub(crate) fn report(fleet: Option<&Self>) -> Vec<ReportRow> {
        let Some(Self { uavs, contended, min_separation_m }) = fleet else { return Vec::new() };
        let row = |heading, value| ReportRow { heading, value };
        let mut rows = vec![row("UAVs", uavs.to_string()), row("requests contended", grouped(*contended))];
        rows.extend(min_separation_m.map(|least_m| row("least distance of two UAVs", format!("{least_m:.2} m"))));
        rows
    }

    /// Adds a slot.
    pub(crate) fn add(&mut self, record: &SlotRecord, base: Option<&Base>) {
        let is_in_base = |flight: &FlightReport| base.is_some_and(|base| base.contains(&flight.position().xy()));
        for UavSlot { uav, plan, flight, .. } in record.uavs() {
            let lower = &record.flights()[..uav];
            let scheduled = plan.filter(|_| !is_late(flight)).into_iter().flat_map(Plan::scheduled);
            let is_contended = |id: &&u32| lower.iter().any(|other| other.serves(**id));
            self.contended += scheduled.filter(is_contended).count() as u64;
            for other in lower.iter().filter(|other| !is_in_base(other) && !is_in_base(flight)) {
                let away_m = (flight.position() - other.position()).norm();
                self.min_separation_m = Some(self.min_separation_m.map_or(away_m, |least_m| least_m.min(away_m)));
            }
        }
    }
}

/// What the battery of a UAV gave and took in a mission.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergyUse {
    /// Taken by flying [J].
    pub used_j: f64,
    /// Charged in the base [J].
    pub charged_j: f64,
    /// Left at the end [J].
    pub left_j: f64,
    /// Time in the base in mode `charge` [s].
    pub charged_s: f64,
    /// Time in a site of the base in which all its pads were taken [s] (decision D34); `None` without `[[base.site]]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pad_wait_s: Option<f64>,
    /// Slots of the way home (decision D13).
    pub return_slots: u64,
    /// The slot in which the energy ended; `None` if it did not.
    pub down_slot: Option<u64>,
}

impl FigureValue for EnergyUse {}

impl EnergyUse {
    /// The rows of the printed report that are not of a column.
    pub(crate) fn report(energy: Option<&Self>) -> Vec<ReportRow> {
        let Some(energy) = energy else { return Vec::new() };
        let Self { used_j, charged_j, return_slots, down_slot, .. } = energy;
        let row = |heading, value| ReportRow { heading, value };
        let mut rows = vec![row("energy used / charged", format!("{used_j:.0} J / {charged_j:.0} J"))];
        rows.push(row("slots of the way home", grouped(*return_slots)));
        rows.extend(down_slot.map(|slot| row("down in slot", slot.to_string())));
        rows
    }

    /// The sum of that of several UAVs; the first slot in which one went down.
    pub(crate) fn sum(uses: &[Self]) -> Self {
        uses.iter().skip(1).fold(uses[0], |sum, one| Self {
            used_j: sum.used_j + one.used_j,
            charged_j: sum.charged_j + one.charged_j,
            left_j: sum.left_j + one.left_j,
            charged_s: sum.charged_s + one.charged_s,
            pad_wait_s: sum.pad_wait_s.zip(one.pad_wait_s).map(|(sum_s, one_s)| sum_s + one_s),
            return_slots: sum.return_slots + one.return_slots,
            down_slot: sum.down_slot.into_iter().chain(one.down_slot).min(),
        })
    }

    /// Adds a flight of `slot_s` [s].
    pub(crate) fn add(&mut self, slot: u64, slot_s: f64, flight: &FlightReport) {
        let gained_j = flight.energy_j - self.left_j;
        self.left_j = flight.energy_j;
        match flight.flown_mode() {
            Mode::Charge if flight.awaits_pad() => *self.pad_wait_s.get_or_insert_default() += slot_s,
            Mode::Charge => {
                self.charged_j += gained_j;
                self.charged_s += slot_s;
            }
            Mode::Down => {
                self.used_j -= gained_j;
                self.down_slot.get_or_insert(slot);
            }
            mode => {
                self.used_j -= gained_j;
                self.return_slots += u64::from(mode == Mode::Return);
            }
        }
    }
}

/// Whether the plan of this flight was not there when the slot began.
pub(crate) fn is_late(flight: &FlightReport) -> bool {
    flight.hold == HoldReason::NoPlan as u32
}

/// The score of a mission that delivers a fraction of its initial data, and has `left_s` [s] left when all is
/// delivered.
#[must_use]
pub fn score(left_s: f64, delivered: f64) -> f64 {
    left_s.max(0.0) + 100.0 * delivered
}
