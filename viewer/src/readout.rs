//! What is written at a UAV: altitude, speed and battery, and the mission's clock if it is the only one.

use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;

/// Writes the labels of the UAVs of a mission.
#[derive(Debug)]
pub(crate) struct Readout {
    slot_s: f64,
    /// By UAV: energy of a full battery [J]; `None` without one.
    capacities_j: Vec<Option<f64>>,
}

impl Readout {
    /// The readout of a scenario.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        Self { slot_s: scenario.slot_s, capacities_j: capacities_j(scenario) }
    }

    /// The label of a UAV after a slot in which it flew `flown_m` [m]; `None` if that is unknown. The speed is the mean
    /// over the slot.
    pub(crate) fn label(&self, uav: usize, slot: u64, flight: &FlightReport, flown_m: Option<f64>) -> String {
        let first = if self.capacities_j.len() == 1 { self.clock(slot) } else { format!("UAV {uav}") };
        let speed = flown_m.map(|flown_m| format!("{:.1} m/s", flown_m / self.slot_s));
        // That of a UAV that is down is negative.
        let filled = |capacity_j| format!("{:.0} %", 100.0 * flight.energy_j.max(0.0) / capacity_j);
        let battery = self.capacities_j[uav].map(filled);
        let altitude = format!("{:.0} m", flight.z_m);
        [Some(first), Some(altitude), speed, battery].into_iter().flatten().collect::<Vec<_>>().join(" · ")
    }

    /// The time since the start of the mission at the end of a slot, in minutes and seconds.
    pub(crate) fn clock(&self, slot: u64) -> String {
        let time_s = (slot as f64 * self.slot_s).floor() as u64;
        format!("{:02}:{:02}", time_s / 60, time_s % 60)
    }
}

/// By UAV: energy of its full battery [J]; `None` without one.
pub(crate) fn capacities_j(scenario: &Scenario) -> Vec<Option<f64>> {
    let capacity_j = |uav: usize| scenario.uav_of(uav).battery.map(|battery| battery.capacity_j);
    (0..scenario.uav.uavs()).map(capacity_j).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::Mode;

    fn flight(energy_j: f64) -> FlightReport {
        FlightReport { energy_j, ..FlightReport::at([3.0, 4.0, 40.0], Mode::Serve) }
    }

    #[test]
    fn a_single_uav_shows_the_clock_and_a_fleet_its_numbers() {
        let single = Readout { slot_s: 6.0, capacities_j: vec![Some(5e5)] };
        assert_eq!(single.label(0, 51, &flight(4e5), Some(43.2)), "05:06 · 40 m · 7.2 m/s · 80 %");
        let fleet = Readout { capacities_j: vec![None, Some(8e5), Some(5e5)], ..single };
        let labels = [0, 1, 2].map(|uav| fleet.label(uav, 51, &flight(4e5), Some(0.0)));
        let batteries = ["", " · 50 %", " · 80 %"].into_iter().enumerate();
        let expected = batteries.map(|(uav, battery)| format!("UAV {uav} · 40 m · 0.0 m/s{battery}"));
        assert!(labels.iter().eq(&expected.collect::<Vec<_>>()), "{labels:?}");
    }

    #[test]
    fn the_battery_of_a_uav_that_is_down_is_empty() {
        let readout = Readout { slot_s: 1.0, capacities_j: vec![Some(5e5)] };
        let labels = [0.0, -1.0, -2e4].map(|energy_j| readout.label(0, 0, &flight(energy_j), None));
        assert_eq!(labels, ["00:00 · 40 m · 0 %"; 3]);
    }

    #[test]
    fn unknown_values_are_omitted() {
        let readout = Readout { slot_s: 1.0, capacities_j: vec![None] };
        assert_eq!(readout.label(0, 0, &flight(f64::INFINITY), None), "00:00 · 40 m");
    }

    #[test]
    fn the_clock_counts_minutes_beyond_an_hour() {
        let readout = Readout { slot_s: 59.9, capacities_j: vec![None] };
        assert_eq!(
            [0, 1, 2, 100, 10_000].map(|slot| readout.clock(slot)),
            ["00:00", "00:59", "01:59", "99:50", "9983:20"]
        );
    }
}
