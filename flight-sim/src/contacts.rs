//! The contacts of a UAV: new ones are set up in the time of a slot, which the sensor nodes that it serves share
//! (decision D39).

use skysink_common::channel::{LinkBudget, carried_bits};
use skysink_common::message::FlightReport;

/// The sensor nodes that a UAV has served in the last slot.
#[derive(Debug, Clone, Default)]
pub(crate) struct SlotContacts(Vec<u32>);

impl SlotContacts {
    /// Lets the sensor nodes that `report` serves share the time of the slot, and new contacts be set up in it.
    pub(crate) fn share_time(&mut self, link: &LinkBudget, report: &mut FlightReport) {
        if link.setup_s.is_none() && link.sharing.is_none() {
            return;
        }
        let served = report.served as usize;
        for served_link in &mut report.links[..served] {
            let is_new = !self.0.contains(&served_link.sensor);
            served_link.capacity_bits = carried_bits(served_link.rate_bps, link.contact_s(served, is_new));
        }
        self.restore(report);
    }

    /// Takes in the contacts of the last slot, as `report` says them.
    pub(crate) fn restore(&mut self, report: &FlightReport) {
        self.0.clear();
        self.0.extend(report.served_links().iter().map(|link| link.sensor));
    }
}
