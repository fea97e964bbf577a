//! The airtime of sensor nodes (SNs), and those that have used up what a duty cycle grants them (decision D33).
//!
//! An SN is on air for at most `duty_cycle` of any `duty_window_s`, counted in whole slots.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::keys::NodeKeys;
use super::model::{Answer, NodeModel, NodeService, SlotEnd};
use super::row::{Declared, NodeSetup, NodeTraits};
use crate::channel::MAX_RESOURCE_BLOCKS;
use crate::checkpoint::{CheckpointError, decode_first, encode};
use crate::error::InputError;
use crate::keys::Rule;

/// The window of a duty cycle if a scenario does not say [s].
const WINDOW_S: f64 = 3600.0;

/// The airtime of all SNs within the window that ends with the next slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Airtime {
    /// Slots of the window, and airtime of an SN within it [ns].
    window: u64,
    granted_ns: u64,
    /// By id [ns].
    used_ns: Vec<u64>,
    /// What `used_ns` consists of, by slot.
    sent: VecDeque<Sent>,
    /// Most items of `sent`.
    most: usize,
    /// Services that were refused so far.
    refused: u64,
}

/// The airtime of an SN in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Sent {
    slot: u64,
    sensor: u32,
    airtime_ns: u64,
}

impl Airtime {
    /// The airtime before slot 1 of `count` SNs; `None` without a duty cycle.
    fn new(keys: &NodeKeys<'_>, count: usize) -> Option<Self> {
        let duty_cycle = keys.link.duty_cycle?;
        let window = keys.whole_slots(keys.link.duty_window_s.unwrap_or(WINDOW_S)).max(1);
        let served = keys.uavs * MAX_RESOURCE_BLOCKS; // by vehicles that report what they serve
        Some(Self {
            window,
            granted_ns: (duty_cycle * window as f64 * keys.slot_s * 1e9) as u64, // saturates
            used_ns: vec![0; count],
            sent: VecDeque::new(),
            most: usize::try_from(window.min(keys.slots)).unwrap_or(usize::MAX).saturating_mul(served),
            refused: 0,
        })
    }

    /// Whether SN `sensor` has no airtime in the next slot.
    pub fn is_silent(&self, sensor: usize) -> bool {
        self.used_ns[sensor] >= self.granted_ns
    }

    /// Services that were refused so far.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

impl NodeModel for Airtime {
    fn answer(&self, sensor: usize) -> Answer {
        if self.is_silent(sensor) { Answer::Silent } else { Answer::Queue }
    }

    fn may_refuse(&self) -> bool {
        true
    }

    fn refuse(&mut self, _sensor: usize) {
        self.refused += 1;
    }

    fn most_bits(&self, sensor: usize, rate_bps: f64) -> u64 {
        let left_ns = self.granted_ns.saturating_sub(self.used_ns[sensor]);
        (left_ns as f64 / 1e9 * rate_bps) as u64 // saturates
    }

    /// If the bits are all that the SN may send, it has used up its airtime; over a link without a rate it sends
    /// nothing.
    fn serve(&mut self, service: &NodeService) {
        let NodeService { slot, sensor, bits, rate_bps } = *service;
        let left_ns = self.granted_ns.saturating_sub(self.used_ns[sensor]);
        let is_all = rate_bps > 0.0 && bits == self.most_bits(sensor, rate_bps);
        let sent_s = if bits > 0 { bits as f64 / rate_bps } else { 0.0 };
        let airtime_ns = if is_all { left_ns } else { ((sent_s * 1e9).ceil() as u64).min(left_ns) };
        if airtime_ns > 0 {
            self.used_ns[sensor] += airtime_ns;
            self.sent.push_back(Sent { slot, sensor: sensor as u32, airtime_ns });
        }
    }

    /// What was sent before the window of the next slot no longer counts.
    fn end_slot(&mut self, end: &SlotEnd<'_>, _died: &mut Vec<u32>) {
        while let Some(&Sent { slot: sent, sensor, airtime_ns }) = self.sent.front()
            && sent.saturating_add(self.window) <= end.slot + 1
        {
            self.used_ns[sensor as usize] -= airtime_ns;
            self.sent.pop_front();
        }
    }

    fn most_bytes(&self) -> usize {
        self.most.saturating_mul(25).saturating_add(20)
    }

    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&(&self.sent, self.refused), bytes);
    }

    fn restore(&mut self, slot: u64, _queues_bits: &[u32], bytes: &mut &[u8]) -> Result<(), CheckpointError> {
        let ((sent, refused), left): ((VecDeque<Sent>, u64), _) = decode_first(bytes)?;
        let mut used_ns = vec![0u64; self.used_ns.len()];
        let mut is_possible = sent.len() <= self.most && sent.iter().is_sorted_by_key(|sent| sent.slot);
        for Sent { slot: sent, sensor, airtime_ns } in &sent {
            let in_window = (1..=slot).contains(sent) && sent.saturating_add(self.window) > slot + 1;
            let used_ns = used_ns.get_mut(*sensor as usize).filter(|_| in_window && *airtime_ns > 0);
            is_possible &= used_ns.is_some_and(|used_ns| {
                *used_ns = used_ns.saturating_add(*airtime_ns);
                *used_ns <= self.granted_ns
            });
        }
        CheckpointError::ensure(is_possible, "possible airtimes of this field")?;
        *self = Self { used_ns, sent, refused, ..self.clone() };
        *bytes = left;
        Ok(())
    }
}

impl Declared for Airtime {
    const KEY: &'static str = "link.duty_cycle";

    const UNPLANNED: Option<&'static str> = Some("duty cycles: who is silent, but not what airtime is left");

    fn traits(keys: &NodeKeys<'_>) -> Option<NodeTraits> {
        let _ = keys.link.duty_cycle?;
        Some(NodeTraits { may_refuse: true, ..NodeTraits::default() })
    }

    fn check(keys: &NodeKeys<'_>, rule: Rule<'_>) -> Result<(), InputError> {
        rule(keys.link.duty_cycle.is_some(), "link.duty_window_s", "none without link.duty_cycle")?;
        let is_window = keys.link.duty_window_s.is_none_or(|window_s| window_s >= keys.slot_s);
        rule(is_window, "link.duty_window_s", &format!("at least the slot's {} s", keys.slot_s))
    }

    fn make(setup: &NodeSetup<'_>) -> Option<Self> {
        Self::new(&setup.keys, setup.queues_bits.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::Ledger;
    use crate::sampling::Sampling;
    use crate::scenario::{Overrides, Scenario};
    use std::path::Path;

    /// Airtime of two SNs in slots of 2 s.
    fn airtime(keys: &str) -> Airtime {
        let text = format!("name = 'a'\nslots = 100\nslot_s = 2.0\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        Airtime::new(&scenario.node_keys(), 2).unwrap()
    }

    #[test]
    fn an_sn_sends_for_its_fraction_of_every_window_and_is_silent_until_that_moves_on() {
        // 10 % of 10 s, five slots: 1 s on air. 100 bit a slot; 250 bit/s in slot 1, of which it has 200 bit; 0.2 s are
        // left in slot 2, 50 bit; slot 1 leaves the window of slot 6, slot 2 that of slot 7.
        let airtime = airtime("link.duty_cycle = 0.1\nlink.duty_window_s = 10.0\n");
        let sampling = Sampling::new(vec![100.0; 2], vec![10_000; 2]);
        let mut ledger = Ledger::new(sampling, vec![100, 0]).with_features([airtime.into()].into_iter().collect());
        let sent_bits: Vec<u64> = (1..=8)
            .map(|slot| {
                ledger.sample(slot);
                let bits = ledger.serve(slot, 0, 9_999, 250.0);
                assert_eq!(ledger.has_answered(0), bits > 0);
                ledger.end_slot(slot, &[]);
                let is_silent = ledger.features().answer(0) == Answer::Silent;
                assert_eq!(is_silent, [2, 3, 4, 7, 8].contains(&slot), "slot {slot}");
                bits
            })
            .collect();
        assert_eq!(sent_bits, [200, 50, 0, 0, 0, 200, 50, 0]);
        assert_eq!(ledger.features().find::<Airtime>().unwrap().refused(), 4);
        assert_eq!((ledger.queues_bits()[1], ledger.features().answer(1)), (800, Answer::Queue), "never served");
    }

    #[test]
    fn a_link_without_a_rate_takes_no_airtime_and_a_rest_of_less_than_a_bit_all() {
        let mut airtime = airtime("link.duty_cycle = 1.0\nlink.duty_window_s = 4.0\n");
        airtime.serve(&NodeService { slot: 1, sensor: 0, bits: 0, rate_bps: 0.0 });
        assert!(!airtime.is_silent(0));
        airtime.serve(&NodeService { slot: 1, sensor: 0, bits: 399, rate_bps: 100.0 });
        airtime.serve(&NodeService { slot: 1, sensor: 0, bits: 0, rate_bps: 99.0 });
        assert!(airtime.is_silent(0), "0.01 s at 99 bit/s");
        airtime.serve(&NodeService { slot: 1, sensor: 1, bits: 0, rate_bps: 100.0 });
        assert!(!airtime.is_silent(1), "its queue was empty");
    }

    #[test]
    fn a_window_of_one_slot_limits_each_slot_and_impossible_states_are_refused() {
        let fresh = airtime("link.duty_cycle = 0.5\nlink.duty_window_s = 2.0\n");
        assert_eq!((fresh.window, fresh.most_bits(0, 250.0)), (1, 250));
        let sampling = Sampling::new(vec![100.0; 2], vec![10_000; 2]);
        let mut used = airtime("link.duty_cycle = 0.001\n");
        assert_eq!((used.window, used.granted_ns), (1_800, 3_600_000_000));
        used.serve(&NodeService { slot: 4, sensor: 1, bits: 250, rate_bps: 100.0 });
        used.end_slot(&SlotEnd { slot: 4, sampling: &sampling, queues_bits: &[], uavs: &[] }, &mut Vec::new());
        let mut bytes = Vec::new();
        used.save(&mut bytes);
        let restored = |mut airtime: Airtime, slot: u64| {
            let mut left = &bytes[..];
            airtime.restore(slot, &[], &mut left).map(|()| (airtime, left.len()))
        };
        assert_eq!(restored(airtime("link.duty_cycle = 0.001\n"), 4).unwrap(), (used.clone(), 0));
        assert!(restored(airtime("link.duty_cycle = 0.0005\n"), 4).is_err(), "more than is granted");
        assert!(restored(fresh, 4).is_err(), "before the window");
        assert!(restored(used, 3).is_err(), "to come");
    }
}
