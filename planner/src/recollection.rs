//! What a planner process remembers across its own death: what it carried and believed after each of its last slots.

use skysink_ring::error::JournalError;
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::Journal;

use crate::estimate::BYTES_EACH;
use crate::planner::Planner;

/// Slots that are kept: the three that a planner may be asked for again, and room for one that is cut.
const SLOTS: u64 = 4;

/// Most that a planner remembers, beside [`BYTES_EACH`] and four bytes of its strategy for each sensor node.
const ROOM: usize = 1 << 23;

/// The journal of a planner, and the slot that it planned last, or whose memory it has recalled.
#[derive(Debug)]
pub struct Recollection {
    /// None for planners that remember nothing.
    journal: Option<Journal>,
    planned: u64,
}

impl Recollection {
    /// The journal in the ring's folder of `planner`, which is over `count` sensor nodes and has planned nothing yet.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(folder: &RingFolder, planner: &Planner, count: usize) -> Result<Self, JournalError> {
        let open = || Journal::open(&folder.journal("plans"), SLOTS, ROOM + (BYTES_EACH + 4) * count);
        Ok(Self { journal: planner.remembers().then(open).transpose()?, planned: 0 })
    }

    /// Brings a planner that is new to where it was before it planned `slot`, or to the last slot before that which is
    /// remembered; to be done before it observes or plans anything. In paced runs slots may be skipped; it then goes on
    /// with what it has.
    ///
    /// # Errors
    /// If the journal cannot be read.
    pub fn before(&mut self, slot: u64, planner: &mut Planner) -> Result<(), JournalError> {
        let Some(journal) = self.journal.as_ref().filter(|_| self.planned == 0) else { return Ok(()) };
        let records = journal.read()?;
        let mut before = records.iter().rev().filter(|record| record.slot < slot);
        let recalled = before.find(|record| planner.recall(record.slot, &record.bytes).is_ok());
        self.planned = recalled.map_or(0, |record| record.slot);
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
    use crate::settings::{Knowledge, Rates, Settings, Strategy, change};
    use std::path::Path;

    use skysink_common::geometry::Position;
    use skysink_common::message::{FlightReport, LinkReport, Mode, Plan, SensorNode};
    use skysink_common::pace::Pace;
    use skysink_common::scenario::{Count, Overrides, Scenario};
    use skysink_ring::wait::Waiting;

    fn nodes() -> Vec<SensorNode> {
        let node = |i: u32| SensorNode {
            x_m: 8.0 * f64::from(i),
            y_m: 90.0 - 7.0 * f64::from(i),
            gain: 1e-5,
            sampling_bps: 100.0,
            capacity_bits: 30_000,
            ..SensorNode::default()
        };
        (0..12).map(node).collect()
    }

    /// The queues before `slot` [bit].
    fn queues(slot: u64) -> Vec<u32> {
        (0..12).map(|i| (i * 977 + slot as u32 * 331) % 30_000).collect()
    }

    /// The flight that does what a plan says.
    fn flown(plan: &Plan) -> FlightReport {
        let mut report = FlightReport::at(plan.x_m, plan.y_m, plan.z_m, Mode::Serve);
        for (link, &sensor) in report.links.iter_mut().zip(plan.scheduled()) {
            *link = LinkReport { sensor, ..LinkReport::default() };
        }
        report.served = plan.served;
        report
    }

    /// A planner process: the slot after that of `flight` is planned as the node does it.
    fn answer(slot: u64, flight: &FlightReport, planner: &mut Planner, recollection: &mut Recollection) -> Plan {
        recollection.before(slot, planner).unwrap();
        planner.observe(slot - 1, flight, &queues(slot));
        let plan = planner.step(slot, &flight.position(), 20.0, &queues(slot));
        recollection.after(slot, planner).unwrap();
        plan
    }

    /// Every planner that remembers something.
    fn scenarios() -> impl Iterator<Item = Scenario> {
        let seen = [
            (Knowledge::Oracle, Rates::Known),
            (Knowledge::Estimated, Rates::Known),
            (Knowledge::Estimated, Rates::Learnt),
        ];
        let all = Strategy::ALL.into_iter().flat_map(move |strategy| seen.map(|knowledge| (strategy, knowledge)));
        let scenario = |(strategy, (knowledge, rates)): (Strategy, _)| {
            let scenario =
                Scenario::letter(Overrides { strategy: Some(strategy.name()), ..Overrides::default() }).unwrap();
            change(scenario, |settings| {
                settings.horizon.iterations = Count::clamped(200);
                (settings.knowledge, settings.rates) = (knowledge, rates);
            })
            .unwrap()
        };
        all.map(scenario).filter(|scenario| Settings::of(scenario).unwrap().remembers())
    }

    #[test]
    fn a_planner_that_comes_back_plans_the_last_slots_as_before() {
        for scenario in scenarios() {
            let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false).unwrap();
            let start: Position = scenario.uav.start;
            let mut flights = vec![FlightReport::at(start.x, start.y, 20.0, Mode::Hold)];
            let mut planner = Planner::new(&scenario, &nodes()).unwrap();
            let mut recollection = Recollection::open(&folder, &planner, 12).unwrap();
            for slot in 1..=9 {
                let plan = answer(slot, &flights[slot as usize - 1], &mut planner, &mut recollection);
                flights.push(flown(&plan));
            }
            for from in [7, 8, 9] {
                let mut again = Planner::new(&scenario, &nodes()).unwrap();
                let mut recollection = Recollection::open(&folder, &again, 12).unwrap();
                for slot in from..=9 {
                    let plan = answer(slot, &flights[slot as usize - 1], &mut again, &mut recollection);
                    assert_eq!(flown(&plan), flights[slot as usize], "{:?}, slot {slot} from {from}", scenario.planner);
                }
                assert_eq!(again.memory(), planner.memory(), "{:?}, from {from}", scenario.planner);
            }
        }
    }

    #[test]
    fn a_planner_that_comes_back_late_believes_what_it_believed_last() {
        let text = "name = 'x'\n[planner]\nknowledge = 'estimated'\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let folder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false).unwrap();
        let mut planner = Planner::new(&scenario, &nodes()).unwrap();
        let mut recollection = Recollection::open(&folder, &planner, 12).unwrap();
        let mut flight = FlightReport::at(50.0, 50.0, 20.0, Mode::Hold);
        for slot in 1..=9 {
            flight = flown(&answer(slot, &flight, &mut planner, &mut recollection));
        }
        let mut late = Planner::new(&scenario, &nodes()).unwrap();
        let mut recollection = Recollection::open(&folder, &late, 12).unwrap();
        let hold = FlightReport::at(50.0, 50.0, 20.0, Mode::Hold);
        let _ = answer(15, &hold, &mut late, &mut recollection);
        let contacts =
            |planner: &Planner| (0..12).map(|id| planner.estimate().unwrap().contact(id)).collect::<Vec<_>>();
        assert!(contacts(&planner).iter().any(Option::is_some));
        assert_eq!(contacts(&late), contacts(&planner));
    }
}
