//! What is written at a UAV: altitude, speed and battery, and the mission's clock if it is the only one.

use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;

/// Writes the labels of the UAVs of a mission.
#[derive(Debug)]
pub(crate) struct Readout {
    slot_s: f64,
    /// Energy of a full battery [J]; `None` without one.
    capacity_j: Option<f64>,
    uavs: usize,
}

impl Readout {
    /// That of a scenario.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        let capacity_j = scenario.uav.battery.map(|battery| battery.capacity_j);
        Self { slot_s: scenario.slot_s, capacity_j, uavs: scenario.uav.uavs() }
    }

    /// The label of a UAV after a slot in which it flew `flown_m` [m]; `None` if that is unknown. The speed is the mean
    /// over the slot.
    pub(crate) fn label(&self, uav: usize, slot: u64, flight: &FlightReport, flown_m: Option<f64>) -> String {
        let first = if self.uavs == 1 { clock(slot as f64 * self.slot_s) } else { format!("UAV {uav}") };
        let speed = flown_m.map(|flown_m| format!("{:.1} m/s", flown_m / self.slot_s));
        let battery = self.capacity_j.map(|capacity_j| format!("{:.0} %", 100.0 * flight.energy_j / capacity_j));
        let altitude = format!("{:.0} m", flight.z_m);
        [Some(first), Some(altitude), speed, battery].into_iter().flatten().collect::<Vec<_>>().join(" · ")
    }
}

/// A time since the start of the mission in minutes and seconds.
pub(crate) fn clock(time_s: f64) -> String {
    let time_s = time_s.floor() as u64;
    format!("{:02}:{:02}", time_s / 60, time_s % 60)
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::Mode;

    fn flight(energy_j: f64) -> FlightReport {
        FlightReport { energy_j, ..FlightReport::at([3.0, 4.0, 40.0], Mode::Serve) }
    }

    #[test]
    fn a_single_uav_shows_the_clock_and_one_of_a_fleet_its_number() {
        let single = Readout { slot_s: 6.0, capacity_j: Some(5e5), uavs: 1 };
        assert_eq!(single.label(0, 51, &flight(4e5), Some(43.2)), "05:06 · 40 m · 7.2 m/s · 80 %");
        let fleet = Readout { uavs: 3, ..single };
        assert_eq!(fleet.label(2, 51, &flight(4e5), Some(0.0)), "UAV 2 · 40 m · 0.0 m/s · 80 %");
    }

    #[test]
    fn what_is_unknown_is_left_out() {
        let readout = Readout { slot_s: 1.0, capacity_j: None, uavs: 1 };
        assert_eq!(readout.label(0, 0, &flight(f64::INFINITY), None), "00:00 · 40 m");
    }

    #[test]
    fn the_clock_counts_minutes_beyond_an_hour() {
        assert_eq!([0.0, 59.9, 60.0, 5_400.0, 360_000.0].map(clock), ["00:00", "00:59", "01:00", "90:00", "6000:00"]);
    }
}
