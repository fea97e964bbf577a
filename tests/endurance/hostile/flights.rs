//! Flights that no vehicle can have flown, from a vehicle of the test.

use iceoryx2::prelude::ipc;
use skysink_common::message::{FlightReport, HeardLink, LinkReport, Mode, Plan, SlotHeader};
use skysink_common::scenario::Overrides;
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_flight_sim::{Fleet, Flight};
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::topics::Ring;
use skysink_ring::wait::WaitContext;
use skysink_ring::writer::Writer;

use super::audit::{audit, said};
use super::rogue::{LONG_S, SHORT_S, open_folder};
use crate::support::flight::{FlightBuilder, RunningFlight};
use crate::support::{Place, scenarios, until};

const NUMBERS: &str = "expected finite numbers, and links by ascending SN, none in a hold";

/// A flight-sim of the test.
struct Vehicle {
    ring: Ring<ipc::Service>,
    wait: WaitContext,
    slots: u64,
    flight: Flight,
    fleet: Fleet,
    plans: Reader<ipc::Service, [Plan], SlotHeader>,
    flights: Writer<ipc::Service, [FlightReport], SlotHeader>,
}

impl Vehicle {
    /// Starts a flight, and joins it as its vehicle.
    fn start<'a>(flight: &FlightBuilder<'a>, timeout_s: &str) -> (RunningFlight<'a>, Self) {
        let run = flight.external("flight-sim").timeout(timeout_s).start();
        let folder = open_folder(&run);
        let scenario = scenarios::read(&run.path("scenario.toml"), Overrides::default());
        let join = || Ring::<ipc::Service>::join(&folder, &scenario, Role::FlightSim, &Stop::default()).ok();
        let (ring, mut wait) = until("topics", join);
        let flights = ring.flight.list_writer(1).unwrap();
        let plans = ring.plan.reader().unwrap();
        let mut nodes = ring.sensors.reader().unwrap();
        let nodes = nodes.wait_for_next(&mut wait, 0).unwrap();
        let flight = Flight::new(&scenario, nodes.payload());
        let fleet = Fleet::new(&scenario, nodes.payload());
        (run, Self { ring, wait, slots: scenario.slots, flight, fleet, plans, flights })
    }

    fn send(&self, slot: u64, report: FlightReport) {
        self.flights.send_list(self.ring.header(slot, 0), &[report]).unwrap();
    }

    /// Flies `slot` as planned.
    fn fly(&mut self, slot: u64) -> FlightReport {
        if slot == 0 {
            return self.flight.start();
        }
        let plan = self.plans.wait_for_slot(&mut self.wait, slot).unwrap().unwrap();
        self.flight.step(slot, Some(&plan[UAV]))
    }
}

/// A flight to another position.
fn at(mut flight: FlightReport, x_m: f64, y_m: f64, z_m: f64) -> FlightReport {
    flight.x_m = x_m;
    flight.y_m = y_m;
    flight.z_m = z_m;
    flight
}

/// Impossible variants of a flight.
fn spoilt(good: FlightReport) -> [FlightReport; 6] {
    let mut link = FlightReport { served: 1, mode: Mode::Serve as u32, ..good };
    link.links[0] = LinkReport { sensor: 1, rate_bps: f64::NAN, ..LinkReport::default() };
    [
        at(good, f64::NAN, good.y_m, good.z_m),
        at(good, good.x_m, f64::INFINITY, good.z_m),
        at(good, good.x_m, good.y_m, -1e300),
        link,
        FlightReport { served: 65, mode: Mode::Serve as u32, ..good },
        FlightReport { served: 1, mode: Mode::Hold as u32, ..good },
    ]
}

#[test]
fn impossible_flights_are_refused_by_every_process_and_change_nothing() {
    let place = Place::new();
    let (run, mut vehicle) = Vehicle::start(&place.flight("smoke"), LONG_S);
    let mut refused = 0;
    for slot in 0..=vehicle.slots {
        let good = vehicle.fly(slot);
        for bad in spoilt(good) {
            vehicle.send(slot, bad);
            refused += 1;
        }
        vehicle.send(slot, good);
    }
    let ended = run.wait_for_success();
    audit(&place);
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["refused_messages"], refused);
    let lines = said(&ended.stderr, NUMBERS);
    for reader in ["field-sim", "planner"] {
        let first = lines.iter().find(|line| line.starts_with(&format!("{reader}: ")));
        assert_eq!(first, Some(&format!("{reader}: flight(0) refused: {NUMBERS}")), "{lines:?}");
    }
    drop(vehicle);
    place.assert_clean();
}

/// Impossible variants of what is heard.
fn spoilt_links(good: &[HeardLink]) -> [Vec<HeardLink>; 3] {
    let link = HeardLink { uav: 0, sensor: 39, snr_db: 5.0 };
    let with = |more: &[HeardLink]| good.iter().chain(more).copied().collect();
    [
        with(&[HeardLink { snr_db: f32::NAN, ..link }]),
        with(&[link, link]),
        with(&[link, HeardLink { sensor: 0, ..link }]),
    ]
}

#[test]
fn impossible_links_are_refused_and_links_of_strangers_ignored() {
    const STRANGERS: &str = "expected links of the UAVs and SNs of the mission";
    let place = Place::new();
    let stays =
        place.flight("smoke").set("link.model", "probabilistic-los").set("link.los_correlation_m", 30.0).force();
    let hearing = stays.set("link.bandwidth_hz", 5e3).set("link.beacon_radius_m", 30.0);
    for (strategy, has_strangers) in [("uts", false), ("gfs", true)] {
        let (run, mut vehicle) = Vehicle::start(&hearing.strategy(strategy), LONG_S);
        let writer = vehicle.ring.links.as_ref().unwrap().list_writer(100).unwrap();
        for slot in 0..=vehicle.slots {
            let flown = vehicle.fly(slot);
            let good = vehicle.fleet.hear(slot, &[flown]);
            let send = |links: &[HeardLink]| writer.send_list(vehicle.ring.header(slot, 0), links).unwrap();
            spoilt_links(&good).iter().for_each(|links| send(links));
            let stranger = |uav, sensor| vec![HeardLink { uav, sensor, snr_db: 1.0 }];
            // `gfs` knows nothing of links: without what it hears it flies the same.
            let strangers = [stranger(1, 0), stranger(0, 40), stranger(u32::MAX, u32::MAX)];
            send(if has_strangers { &strangers[slot as usize % 3] } else { &good });
            vehicle.send(slot, flown);
        }
        let ended = run.wait_for_success();
        place.assert_trace_as_simulated("run");
        assert!(said(&ended.stderr, NUMBERS)[0].starts_with("planner: links(0) refused"), "{ended:?}");
        assert_eq!(!said(&ended.stderr, STRANGERS).is_empty(), has_strangers, "{ended:?}");
        drop((writer, vehicle));
    }
    place.assert_clean();
}

#[test]
fn a_vehicle_with_only_invalid_flights_is_named_when_the_run_times_out() {
    let place = Place::new();
    let (run, mut vehicle) = Vehicle::start(&place.flight("smoke").without_viewer(), SHORT_S);
    for slot in 0..5 {
        let good = vehicle.fly(slot);
        vehicle.send(slot, if slot < 4 { good } else { spoilt(good)[0] });
    }
    let ended = run.wait().assert_code(1);
    assert!(ended.stderr.contains(&format!("field-sim: flight(4) refused: {NUMBERS}")), "{ended:?}");
    assert!(ended.stderr.contains("skysink: flight-sim has not sent flight(4)"), "{ended:?}");
    assert_eq!(audit(&place).len(), 3);
    drop(vehicle);
    place.assert_clean();
}
