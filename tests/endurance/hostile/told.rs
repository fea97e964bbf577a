//! What an external planner receives: the limits, and the known part of estimated queues and rates.

use skysink_common::belief::Belief;
use skysink_common::estimate::Rates;
use skysink_common::message::Limits;
use skysink_common::reported::ReportedQueues;
use skysink_common::sensors::{SensorList, Sensors};
use skysink_planner::Planner;
use skysink_ring::reader::SlotSample;

use super::rogue::{LONG_S, start_with_rogue};
use crate::support::{Place, scenarios};

#[test]
fn the_limits_of_plans_are_sent_with_the_sensor_nodes() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), LONG_S);
    assert_eq!(rogue.limits, Limits::of(&rogue.scenario));
    assert!(rogue.limits.reach_m > 0.0 && rogue.limits.resource_blocks > 0, "{:?}", rogue.limits);
    while let Some(turn) = rogue.next() {
        rogue.send(rogue.header(turn.slot), turn.good);
    }
    run.wait_for_success();
    place.assert_clean();
}

#[test]
fn an_external_planner_receives_what_the_uav_knows_and_the_recorder_the_true_queues() {
    for (name, rates) in [("known", Rates::Known), ("learnt", Rates::Learnt)] {
        assert_told(name, rates);
    }
}

/// Fails unless the topics for an external planner have what a UAV with these `rates` believes.
fn assert_told(name: &str, rates: Rates) {
    let place = Place::new();
    let flight = place.flight("smoke").set("planner.knowledge", "estimated").set("planner.rates", name);
    let flight = flight.set("sensors.sampling_bps", "[50.0, 300.0]");
    let (run, mut rogue) = start_with_rogue(&flight, LONG_S);
    assert_eq!(rogue.ring.terms.belief, Some(rates));
    let nodes = SensorList::of(&rogue.scenario).unwrap().nodes();
    let has_mean = rogue.sensors.iter().all(|node| node.sampling_bps == 175.0);
    assert_eq!((has_mean, rogue.sensors == nodes), (rates == Rates::Learnt, rates == Rates::Known));
    let mut truth = rogue.ring.queues.reader().unwrap();
    let mut learnt = rogue.ring.rates.as_ref().map(|rates| rates.reader().unwrap());
    assert_eq!(learnt.is_some(), rates == Rates::Learnt);
    let sensors = Sensors::of(&rogue.scenario, &nodes);
    // The UAV comes to most SNs more than once only if its planner knows of its contacts.
    let mut knowing = Planner::new(&scenarios::smoke("uts"), &nodes).unwrap();
    let mut known = Belief::new(&rogue.scenario, &sensors, Some(rates));
    let mut reported = ReportedQueues::default();
    let mut differing = 0;
    while let Some(turn) = rogue.next() {
        let slot = turn.slot - 1;
        let true_queues = loop {
            if let SlotSample::Available(sample) = truth.poll_slot(slot).unwrap() {
                break sample.payload().to_vec();
            }
            std::thread::yield_now();
        };
        known.advance(slot, &[turn.flight], &reported, &true_queues);
        reported = known.reported(slot + 1, sensors.ids(), &true_queues);
        assert_eq!(turn.queues_bits, known.at(slot, &sensors, &true_queues).queues_bits, "slot {slot}");
        for link in turn.flight.served_links() {
            let sensor = link.sensor as usize;
            assert_eq!(turn.queues_bits[sensor], true_queues[sensor], "slot {slot}: it was served, and has told");
        }
        if let Some(learnt) = &mut learnt {
            let told_bps = loop {
                match learnt.poll_slot(slot).unwrap() {
                    SlotSample::Available(sample) => break sample,
                    _ if slot == 0 => std::thread::yield_now(), // sent before the reader was there, and repeated
                    _ => panic!("the rates of slot {slot} come before the belief"),
                }
            };
            let learnt_bps: Vec<f64> = known.learnt_bps(rogue.scenario.slot_s).unwrap().collect();
            assert_eq!(told_bps.payload(), learnt_bps, "slot {slot}");
            assert!(slot > 0 || learnt_bps.iter().all(|&bps| bps == 175.0));
        }
        differing += usize::from(turn.queues_bits != true_queues);
        rogue.send(rogue.header(turn.slot), knowing.step(turn.slot, turn.flight.position(), &true_queues));
    }
    if let Some(learnt_bps) = known.learnt_bps(rogue.scenario.slot_s) {
        let learnt = learnt_bps.filter(|&bps| bps != 175.0).count();
        assert!(learnt > 3, "{learnt} rates are learnt from contacts");
    }
    assert!(differing > 30, "in {differing} slots the truth was something else");
    run.wait_for_success();
    let summary = place.summary("run");
    assert!(summary["sampled_bits"].as_u64().unwrap() > 0, "the record has the truth");
    place.assert_clean();
}
