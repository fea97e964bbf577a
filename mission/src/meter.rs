//! The sums of a mission that need its field, for the metrics.

use std::time::Duration;

use nalgebra::Point3;
use skysink_common::battery::Battery;
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord, uploads};
use skysink_planner::settings::Settings;

use crate::ages::{Ages, Delivered, DeliveredData};
use crate::bounds::MissionBounds;
use crate::drive::{Observer, SlotSink as _};
use crate::metrics::{Metric, MetricValues};
use crate::origin::RunMode;
use crate::summary::RunTiming;
use crate::sums::{FieldSums, MissionSums};
use crate::tally::Tally;
use crate::trapped::Stay;
use crate::{MissionError, Plant};

/// A UAV after the last slot.
#[derive(Debug)]
struct MeteredUav {
    battery: Battery,
    position: Point3<f64>,
    is_down: bool,
    /// The SNs that it has served in the last slot.
    contacts: Vec<u32>,
}

/// Computes the metrics of a mission, slot by slot.
#[derive(Debug)]
pub struct MissionMeter {
    tally: Tally,
    slot_s: f64,
    uavs: ByUav<MeteredUav>,
    flown_m: f64,
    energy_j: f64,
    slot: u64,
    service_ages: Ages,
    /// Contacts that were set up, and the time of each [s]; NaN if they take none.
    setups: u64,
    setup_s: f64,
    has_deadline: bool,
    /// Whether what is delivered counts.
    is_collected: bool,
    data: DeliveredData,
    stay: Stay,
}

impl MissionMeter {
    /// The meter before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self {
            tally: Tally::new(scenario, list, &RunMode::default()),
            slot_s: scenario.slot_s,
            uavs: scenario
                .starts()
                .zip(scenario.by_uav(Battery::of))
                .map(|(position, battery)| MeteredUav { battery, position, is_down: false, contacts: Vec::new() })
                .collect(),
            flown_m: 0.0,
            energy_j: 0.0,
            slot: 0,
            service_ages: Ages::new(list.sensors().len()),
            setups: 0,
            setup_s: scenario.link.setup_s.unwrap_or(f64::NAN),
            has_deadline: scenario.sensors.deadline_s.is_some(),
            is_collected: Settings::of(scenario).is_ok_and(|settings| settings.objective.is_collect()),
            data: DeliveredData::new(scenario, list),
            stay: Stay::new(scenario, list),
        }
    }

    /// The figures of the summary so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The metrics so far, with the plant after the last slot; `timing` instead of the planning times of the slots.
    pub fn values(&self, plant: &Plant, timing: Option<&RunTiming>, bounds: Option<MissionBounds>) -> MetricValues {
        let field = plant.field();
        let left_bits = field.lost_bits().zip(field.queues_bits()).map(|(lost, queue)| lost as f64 + f64::from(*queue));
        let cost_of_bits = match self.is_collected {
            true => self.tally.sums.gaps().weigh(left_bits),
            false => self.tally.sums.lost_bits(),
        };
        let timing = timing.cloned().unwrap_or_else(|| self.tally.sums.timing(Duration::ZERO));
        self.values_of(field.delivered_bits(), cost_of_bits, timing, bounds)
    }

    /// The metrics of a mission with these bits delivered, by sensor node, and these times.
    fn values_of(
        &self,
        delivered_bits: &[u64],
        cost_of_bits: f64,
        timing: RunTiming,
        bounds: Option<MissionBounds>,
    ) -> MetricValues {
        let field = FieldSums {
            slot_s: self.slot_s,
            flown_m: self.flown_m,
            energy_j: self.energy_j,
            setup_s: self.setups as f64 * self.setup_s,
            is_trapped: self.stay.is_trapped(),
            has_deadline: self.has_deadline,
            service_ages: self.service_ages.counts(self.slot, |_| true),
            data_ages: self.data.counts(self.slot),
            gaps: self.tally.sums.gaps().sums(self.slot),
            delivered_bits,
            cost_of_bits,
            bounds,
        };
        let sums = MissionSums { run: &self.tally.sums, field: Some(field), timing, trace_hash: 0 };
        Metric::values(&sums, &self.tally.counts)
    }

    /// Adds the flights of the next slot, after which served sensor nodes have delivered what `delivered` says,
    /// `None` if they did not answer.
    ///
    /// # Panics
    /// If the slot serves an unknown sensor node.
    fn add(&mut self, flights: &[FlightReport], delivered: impl Fn(u32) -> Option<Delivered>) {
        self.slot += 1;
        self.stay.add(self.slot, flights.iter().map(|flight| flight.position().xy()));
        for (uav, flight) in self.uavs.iter_mut().zip(flights) {
            let step = flight.position() - uav.position;
            uav.position = flight.position();
            self.flown_m += step.norm();
            let links = flight.served_links();
            self.setups += links.iter().filter(|link| !uav.contacts.contains(&link.sensor)).count() as u64;
            uav.contacts.clear();
            uav.contacts.extend(links.iter().map(|link| link.sensor));
            // A UAV that goes down has flown in that slot.
            let was_down = std::mem::replace(&mut uav.is_down, flight.flown_mode() == Mode::Down);
            if flight.flown_mode() != Mode::Charge && !was_down {
                self.energy_j += uav.battery.flight_j(&step);
            }
        }
        for link in uploads(flights) {
            let sensor = link.sensor as usize;
            if let Some(delivered) = delivered(link.sensor) {
                self.service_ages.refresh(sensor, self.slot, self.slot);
                self.data.add(sensor, self.slot, delivered);
            }
        }
    }
}

impl Observer for MissionMeter {
    fn begin(&mut self, plant: &Plant) -> Result<(), MissionError> {
        self.tally.begin(plant)
    }

    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        self.tally.add(record)?;
        let field = plant.field();
        self.add(record.flights(), |id| field.has_answered(id).then(|| Delivered::of(field, id as usize)));
        Ok(())
    }
}

#[cfg(test)]
mod tests;
