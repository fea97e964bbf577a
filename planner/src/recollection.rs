//! What a planner process remembers across its own death: what its strategy carried after each of its last slots.

use skysink_common::journal::{Journal, JournalError};
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::{Scenario, Strategy};

use crate::planner::Planner;

/// Slots that are kept: the three that a planner may be asked for again, and room for one that is cut.
const SLOTS: u64 = 4;

/// Most that a strategy carries, beside four bytes for each sensor node.
const ROOM: usize = 1 << 22;

/// The journal of a planner, and the slot that it planned last.
#[derive(Debug)]
pub struct Recollection {
    /// None for the strategies that carry nothing.
    journal: Option<Journal>,
    planned: u64,
}

impl Recollection {
    /// The journal in the ring's folder of a planner over `count` sensor nodes that has planned nothing yet.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(folder: &RingFolder, scenario: &Scenario, count: usize) -> Result<Self, JournalError> {
        let carries = !Strategy::MEMORYLESS.contains(&scenario.planner.strategy);
        let open = || Journal::open(&folder.journal("plans"), SLOTS, ROOM + 4 * count);
        Ok(Self { journal: carries.then(open).transpose()?, planned: 0 })
    }

    /// Brings `planner` to where it was before it planned `slot`, if it is not there and that is remembered. In paced
    /// runs slots may be skipped; it then goes on with what it has.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn before(&mut self, slot: u64, planner: &mut Planner) -> Result<(), JournalError> {
        let last = slot.saturating_sub(1);
        let Some(journal) = self.journal.as_ref().filter(|_| self.planned != last) else { return Ok(()) };
        if let Some(record) = journal.read()?.into_iter().find(|record| record.slot == last)
            && planner.recall(last, &record.bytes).is_ok()
        {
            self.planned = last;
        }
        Ok(())
    }

    /// Remembers what `planner` carries after `slot`; to be done before the plan is published.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn after(&mut self, slot: u64, planner: &Planner) -> Result<(), JournalError> {
        self.planned = slot;
        self.journal.as_ref().map_or(Ok(()), |journal| journal.write(slot, &[planner.memory()]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::SensorNode;
    use skysink_common::pace::Pace;
    use skysink_common::scenario::Overrides;
    use skysink_common::waiting::Waiting;

    #[test]
    fn a_planner_that_comes_back_plans_the_last_slots_as_before() {
        for strategy in [Strategy::Horizon, Strategy::Tour, Strategy::RoundRobin, Strategy::MaxAgeFirst] {
            let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
            let mut scenario = Scenario::letter(overrides).unwrap();
            scenario.planner.horizon_iterations = 200;
            let nodes: Vec<SensorNode> = (0..12)
                .map(|i| SensorNode {
                    x_m: 8.0 * f64::from(i),
                    y_m: 90.0 - 7.0 * f64::from(i),
                    gain: 1e-5,
                    sampling_bps: 100.0,
                    capacity_bits: 30_000,
                    ..SensorNode::default()
                })
                .collect();
            let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false).unwrap();
            let queues = |slot: u64| (0..12).map(|i| (i * 977 + slot as u32 * 331) % 30_000).collect::<Vec<_>>();
            let mut planner = Planner::new(&scenario, &nodes);
            let mut recollection = Recollection::open(&folder, &scenario, 12).unwrap();
            let (mut position, mut flown) = (scenario.uav.start, Vec::new());
            for slot in 1..=9 {
                recollection.before(slot, &mut planner).unwrap();
                let plan = planner.step(slot, &position, 20.0, &queues(slot));
                recollection.after(slot, &planner).unwrap();
                flown.push((position, plan));
                position = [plan.x_m, plan.y_m].into();
            }
            for from in [7, 8, 9] {
                let mut planner = Planner::new(&scenario, &nodes);
                let mut recollection = Recollection::open(&folder, &scenario, 12).unwrap();
                for slot in from..=9 {
                    let (position, plan) = &flown[slot as usize - 1];
                    recollection.before(slot, &mut planner).unwrap();
                    let again = planner.step(slot, position, 20.0, &queues(slot));
                    let parts = |plan: &skysink_common::message::Plan| (plan.x_m, plan.y_m, plan.z_m, plan.ids);
                    assert_eq!(parts(&again), parts(plan), "{strategy:?}, slot {slot} from {from}");
                    recollection.after(slot, &planner).unwrap();
                }
            }
        }
    }
}
