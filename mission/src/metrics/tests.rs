use super::*;
use nalgebra::Vector3;
use skysink_common::message::LinkReport;
use skysink_common::propulsion::power_w;
use skysink_common::scenario::Overrides;
use std::path::Path;

/// A flight to x [m] on the line y = 50 m that serves these SNs.
fn flight(x_m: f64, served: &[u32]) -> FlightReport {
    let mut report = FlightReport::at([x_m, 50.0, 20.0], Mode::Serve);
    for (link, &sensor) in report.links.iter_mut().zip(served) {
        *link = LinkReport { sensor, ..LinkReport::default() };
    }
    report.served = u32::try_from(served.len()).unwrap();
    report
}

fn values<const N: usize>(meter: &MissionMeter, metrics: [Metric; N]) -> [f64; N] {
    let values = meter.values_of(&Summary::default(), &[], 0.0, None);
    metrics.map(|metric| values[metric as usize])
}

#[test]
fn an_empty_service_does_not_refresh_data() {
    let text = "name = \"a\"\nslots = 4\n";
    let scenario = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap();
    let list = "x_m,y_m,queue_bits,sampling_bps\n10,10,100,100\n";
    let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
    let mut metrics = MissionMeter::new(&scenario, &list);
    // 200, 300, 400, 500 bits are there in slots 1 to 4; in slot 2 no bit is delivered, in slot 3 the initial 100
    // and the first 150 of those sampled, the last of them in slot 2.
    for (served, queue_bits, bits) in [(&[][..], 200, 0), (&[0], 300, 0), (&[0], 150, 250), (&[], 250, 250)] {
        metrics.add(&[flight(50.0, served)], |_| Some(Delivered { bits, queue_bits, freshest_slot: None }));
    }
    let ages = [Metric::AoiMeanS, Metric::AoiP99S, Metric::DataAgeMeanS, Metric::DataAgeP99S];
    // Since the service 1, 0, 0, 1; of the data 1, 2, 1, 2.
    assert_eq!(values(&metrics, ages), [0.5, 1.0, 1.5, 2.0]);
}

#[test]
fn hovering_takes_energy_but_no_distance() {
    let scenario = Scenario::letter(Overrides::default()).unwrap();
    let mut metrics = MissionMeter::new(&scenario, &SensorList::of(&scenario).unwrap());
    metrics.add(&[flight(50.0, &[])], |_| unreachable!());
    let [hover_m, hover_j] = values(&metrics, [Metric::FlownM, Metric::EnergyJ]);
    assert!((hover_j - 168.49).abs() < 1e-9);
    metrics.add(&[flight(60.0, &[])], |_| unreachable!());
    let [flown_m, flown_j] = values(&metrics, [Metric::FlownM, Metric::EnergyJ]);
    assert_eq!((hover_m, flown_m), (0.0, 10.0));
    assert!((flown_j - hover_j - power_w(&scenario.uav.propulsion, 10.0)).abs() < 1e-9);
}

#[test]
fn the_energy_is_what_the_battery_has_given() {
    let text = "name = 'a'\nslots = 9\n[base]\ncharge_w = 200.0\n[uav.battery]\ncapacity_j = 5e4\nweight_n = 30.0\n";
    let scenario = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap();
    let mut metrics = MissionMeter::new(&scenario, &SensorList::of(&scenario).unwrap());
    let battery = Battery::of(&scenario);
    let mut at = metrics.uavs[0].position;
    let mut left_j = battery.initial_j;
    // A climb, a descent and a flight; what is charged after that is no flight.
    for step in [Vector3::new(3.0, 4.0, 6.0), Vector3::new(0.0, 8.0, -6.0), Vector3::new(9.0, 0.0, 0.0)] {
        let to = at + step;
        left_j = battery.flown_j(left_j, &at, &to);
        at = to;
        metrics.add(&[FlightReport::at(at, Mode::Fly)], |_| unreachable!());
    }
    metrics.add(&[FlightReport::at(at, Mode::Charge)], |_| unreachable!());
    let [flown_j] = values(&metrics, [Metric::EnergyJ]);
    assert!((flown_j - (battery.initial_j - left_j)).abs() < 1e-9, "{flown_j}");
}

#[test]
fn fairness_is_1_for_equal_values_and_1_over_n_for_a_single_one() {
    assert_eq!(jain(&[5, 5, 5, 5]), 1.0);
    assert_eq!(jain(&[8, 0, 0, 0]), 0.25);
    assert_eq!(jain(&[1, 2, 3]), 36.0 / 42.0);
}
