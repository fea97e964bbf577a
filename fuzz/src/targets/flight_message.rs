//! Flights as the field gets them.

use skysink_common::message::{FlightReport, LinkReport, Mode};
use skysink_field_sim::Field;

use super::world::WORLDS;
use crate::cursor::Cursor;

/// A report of any numbers, with at most `links` links other than zero.
pub(super) fn report(input: &mut Cursor, links: usize) -> FlightReport {
    let (x_m, y_m, z_m) = (input.f64(), input.f64(), input.f64());
    let mut report = FlightReport::at([x_m, y_m, z_m], Mode::Serve);
    (report.mode, report.hold, report.refused, report.served) = (input.u32(), input.u32(), input.u32(), input.u32());
    for link in report.links.iter_mut().take(links) {
        *link = LinkReport {
            sensor: input.u32(),
            line_of_sight: input.u32(),
            distance_m: input.f64(),
            elevation_deg: input.f64(),
            rate_bps: input.f64(),
            capacity_bits: input.u64(),
        };
    }
    report
}

/// A flight of any numbers is refused and changes nothing, or takes from the queues that it serves what its links
/// carry, and no bit is unaccounted for.
///
/// # Panics
/// If not.
pub fn flight_message(bytes: &[u8]) {
    let mut input = Cursor::new(bytes);
    let [world, ..] = &*WORLDS;
    let mut field = Field::new(&world.scenario, &world.list);
    for _ in 1..=4 {
        let flight = report(&mut input, 6);
        step(&mut field, &flight, world.scenario.sensors.capacity_bits);
    }
}

/// Advances by a slot with `flight`, and with none, and compares.
pub(super) fn step(field: &mut Field, flight: &FlightReport, capacity_bits: u32) {
    let slot = field.slot() + 1;
    let before = field.clone();
    let mut unserved = field.clone();
    let nobody = FlightReport::at([0.0, 0.0, 0.0], Mode::Hold);
    unserved.step(slot, &nobody).expect("nobody is served");
    let links = flight.served_links();
    let known = links.iter().all(|link| (link.sensor as usize) < field.queues_bits().len());
    let Ok(bits) = field.step(slot, flight) else {
        assert!(!known, "a flight to known sensor nodes is refused");
        assert_eq!((field.queues_bits(), field.totals()), (before.queues_bits(), before.totals()));
        return;
    };
    assert!(known, "a link to nobody is accepted");
    balanced(field, capacity_bits);
    let (now, then, idle) = (field.totals(), before.totals(), unserved.totals());
    assert_eq!(
        (now.sampled_bits, now.lost_bits),
        (idle.sampled_bits, idle.lost_bits),
        "samples do not depend on flights"
    );
    assert_eq!(now.delivered_bits - then.delivered_bits, bits.delivered_bits);
    assert_eq!(now.lost_bits - then.lost_bits, bits.lost_bits);
    for (sensor, (&queue, &unserved)) in field.queues_bits().iter().zip(unserved.queues_bits()).enumerate() {
        let own = links.iter().filter(|link| link.sensor as usize == sensor);
        let carried: u128 = own.map(|link| u128::from(link.capacity_bits)).sum();
        assert_eq!(u128::from(queue), u128::from(unserved).saturating_sub(carried), "SN {sensor}");
    }
}

/// Fails unless the ledger of a field balances.
pub(super) fn balanced(field: &Field, capacity_bits: u32) {
    let (queues, totals) = (field.queues_bits(), field.totals());
    assert!(totals.is_balanced(), "{totals:?}");
    assert!(queues.iter().all(|&queue| queue <= capacity_bits), "{queues:?}");
    assert_eq!(queues.iter().copied().map(u64::from).sum::<u64>(), totals.queued_bits);
}
