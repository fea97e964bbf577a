//! Bounds for all flights of a mission, without a search: the length of a round, and whether loss is avoidable.

use std::fmt;

use serde::Serialize;
use skysink_common::channel::{Channel, ChannelModel};
use skysink_planner::bound::field_bits::FieldBits;
use skysink_planner::bound::links::BestLinks;
use skysink_planner::bound::paths::PathBound;
use skysink_planner::bound::throughput::by_throughput;
use skysink_planner::bound::visits::by_visits;
use skysink_planner::mission_table::MissionTable;

use super::flights::TrialFlight;
use super::links::LinkFigures;

/// Bounds on slots are not computed beyond this one, up to which numbers are exact.
const MOST_SLOTS: u64 = 1 << 53;

/// Whether the mission can be flown without loss, as far as fast bounds and simulations tell.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "answer", rename_all = "kebab-case")]
pub enum LossFree {
    /// No buffer overflows and no bits expire, even if no SN is served.
    Unserved,
    /// A simulated strategy loses nothing.
    Flown {
        /// The strategy.
        strategy: &'static str,
    },
    /// Every flight loses data.
    Impossible {
        /// Lower bound of the loss [bit].
        lost_bits: u64,
    },
    /// All simulated strategies lose data.
    Open {
        /// The strategy with the least loss.
        strategy: &'static str,
        /// Its loss as a fraction of the bits sampled.
        loss_rate: f64,
    },
    /// The field is too large for a fast simulation.
    NotFlown,
}

/// Slots from the start of the mission until every SN has been served once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Round {
    /// Lower bound for all flights; `None` if zones hide an SN, so that no flight serves all.
    pub least_slots: Option<u64>,
    /// The reason for this bound, one of three.
    pub because: RoundBound,
    /// Slots that the first round of `tour` takes, if it was simulated and the mission is long enough.
    pub tour_slots: Option<u64>,
}

/// The reason for the lower bound of a round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RoundBound {
    /// At most n SNs are served in a slot: `⌈N / n⌉`.
    Blocks,
    /// Flight from the start to the farthest SN.
    Farthest,
    /// Flight between the SNs, by a minimum spanning tree of the distances between up to 1 000 disks: [`PathBound`].
    Paths,
}

impl fmt::Display for Round {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason = match self.because {
            RoundBound::Blocks => "N / n",
            RoundBound::Farthest => "farthest SN",
            RoundBound::Paths => "path length",
        };
        let Some(least_slots) = self.least_slots else { return formatter.write_str("none: zones hide an SN") };
        write!(formatter, "at least {least_slots} ({reason})")?;
        self.tour_slots.map_or(Ok(()), |slots| write!(formatter, "; tour takes {slots}"))
    }
}

/// Inputs of the bounds of a mission with its sensor nodes (SNs).
pub struct Bounds<'a> {
    /// All SNs.
    pub table: &'a MissionTable,
    pub uavs: usize,
    /// The sampling SNs.
    pub field: &'a FieldBits,
    /// The links of the sampling SNs.
    pub links: BestLinks,
    /// The links with the UAV directly above.
    pub above: LinkFigures,
    /// The bound on paths between all SNs.
    pub paths: PathBound,
}

impl Bounds<'_> {
    /// Whether loss is avoidable, given the results of these flights.
    pub fn loss_free(&self, flights: &[TrialFlight]) -> LossFree {
        let field = self.field;
        let beyond_bits = field.beyond_buffers_bits;
        let sensors = &self.table.sensors;
        let expires = sensors.may_refuse || sensors.ids().any(|id| sensors.sampler(id).lasting_slots.is_finite());
        let overflows = || field.sensors.iter().any(|sensor| sensor.overflow_bits(None, field.slots) > 0);
        if beyond_bits == 0 && !expires && !overflows() {
            return LossFree::Unserved;
        }
        let Some(best) = flights.iter().min_by_key(|flight| flight.lost_bits) else {
            let lost_bits = beyond_bits + self.load_bound_bits();
            return if lost_bits > 0 { LossFree::Impossible { lost_bits } } else { LossFree::NotFlown };
        };
        let TrialFlight { strategy, loss_rate, .. } = *best;
        if best.lost_bits == 0 {
            return LossFree::Flown { strategy };
        }
        let by_throughput = by_throughput(field, |slot, sensor| self.links.best_bits(slot, sensor));
        let lost_bits = beyond_bits + by_throughput.max(by_visits(field, |slots| self.paths.most(slots)));
        if lost_bits > 0 { LossFree::Impossible { lost_bits } } else { LossFree::Open { strategy, loss_rate } }
    }

    /// A cheap lower bound on the loss of every flight [bit]: the overflow if no SN is served, minus n uploads over the
    /// strongest link in every slot but the last, where the overflow precedes the upload (decision D1). 0 where more
    /// than gains is drawn, because a drawn rate may exceed the expected rate, and with a table, whose rates may rise
    /// with the distance.
    fn load_bound_bits(&self) -> u64 {
        let field = self.field;
        let channel = &self.table.channel;
        let is_table = matches!(channel, Channel::Table(_) | Channel::Map(_));
        if is_table || channel.fading().is_some() || channel.is_random() && channel.drawn_gains().is_none() {
            return 0;
        }
        let excess_bits: u64 = field.sensors.iter().map(|sensor| sensor.overflow_bits(None, field.slots)).sum();
        let visit_bits = self.above.visit_bits[1].saturating_add(1).min(field.capacity_bits()); // 1: rounding
        let visits = (field.slots - 1).saturating_mul(field.blocks as u64);
        excess_bits.saturating_sub(visits.saturating_mul(visit_bits))
    }

    /// The lower bound of a round, combined with the result of `tour`.
    pub fn round(&self, tour_slots: Option<u64>) -> Round {
        let sensors = self.table.sensors.positions.len().div_ceil(self.uavs);
        let blocks = sensors.div_ceil(self.table.limits.blocks()) as u64;
        let farthest = self.field.sensors.iter().filter_map(|sensor| sensor.first_slot).max();
        let farthest = farthest.map_or(1, |slot| slot.min(MOST_SLOTS));
        let paths = least_slots(&self.paths, sensors);
        let bounds = [(blocks, RoundBound::Blocks), (farthest, RoundBound::Farthest), (paths, RoundBound::Paths)];
        let best = bounds.into_iter().reduce(|best, next| if next.0 > best.0 { next } else { best });
        let (least_slots, because) = best.expect("three bounds");
        let is_possible = self.field.sensors.iter().all(|sensor| sensor.first_slot.is_some());
        Round { least_slots: is_possible.then_some(least_slots), because, tour_slots }
    }
}

/// The smallest number of slots in which [`PathBound`] allows `sensors` SNs to be served, by bisection.
fn least_slots(paths: &PathBound, sensors: usize) -> u64 {
    let mut high = 1u64;
    while paths.most(high) < sensors && high < MOST_SLOTS {
        high *= 2;
    }
    let mut low = high / 2; // too few
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if paths.most(middle) < sensors { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::check::figures::Figures;
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;

    /// Round and verdict of a scenario with these keys and the SNs of `list`.
    fn known(keys: &str, list: &str) -> (Round, LossFree) {
        let path = Path::new("a.toml");
        let text = format!("name = 'a'\n{keys}");
        let scenario = Scenario::parse(&text, path, Overrides::default()).unwrap();
        let scenario = skysink_planner::settings::resolve(scenario).unwrap();
        let figures = Figures::of(&scenario, &SensorList::parse(list, path, &scenario).unwrap()).unwrap();
        (figures.round, figures.loss_free)
    }

    #[test]
    fn a_round_is_bounded_by_blocks_paths_and_the_farthest_sensor_node() {
        // Five SNs in one spot below the UAV, n = 4: two slots, and `tour` takes as many.
        let (round, _) = known("", &format!("x_m,y_m\n{}", "50,50\n".repeat(5)));
        assert_eq!((round.least_slots, round.because, round.tour_slots), (Some(2), RoundBound::Blocks, Some(2)));
        // 200 m from the start: 190 m to within d_c, 6.33 slots of 30 m, so 7.
        let (round, _) = known("[area]\nside_m = 400.0\n", "x_m,y_m\n200,400\n");
        assert_eq!((round.least_slots, round.because, round.tour_slots), (Some(7), RoundBound::Farthest, Some(7)));
        // Two SNs 200 m apart, the UAV between them: 90 m to within d_c of the first, 3 slots; then 180 m, 6 slots. The
        // path alone takes 1 + 6.
        let (round, _) = known("[area]\nside_m = 200.0\n", "x_m,y_m\n0,100\n200,100\n");
        assert_eq!((round.least_slots, round.because, round.tour_slots), (Some(7), RoundBound::Paths, Some(9)));
    }

    #[test]
    fn a_round_has_no_more_slots_than_numbers_are_exact_to() {
        let (round, _) = known("slots = 5\n[uav]\nmax_speed_mps = 1e-18\n", "x_m,y_m\n1,1\n99,99\n");
        assert_eq!(round.least_slots, Some(MOST_SLOTS));
    }

    #[test]
    fn the_verdict_combines_bounds_and_flights() {
        let near = "x_m,y_m,queue_bits\n50,50,0\n";
        assert_eq!(known("slots = 300\n", near).1, LossFree::Unserved, "300 slots of 100 bit fit into 30 000 bit");
        assert_eq!(known("slots = 400\n", near).1, LossFree::Flown { strategy: "tour" });
        let expires = "slots = 300\nsensors.expiry_s = 90.0\n";
        assert_eq!(known(expires, near).1, LossFree::Flown { strategy: "tour" }, "unserved they expire");
        // 100 bit a slot, 10 bit a visit: W τ_c log2(1 + γ/400), about 13 W/10 bit with W = 8 Hz. 400 slots overflow by
        // 10 000 bit; 399 visits of 10 or 11 bit save less than 4 800.
        let (_, verdict) = known("slots = 400\n[link]\nbandwidth_hz = 8.0\n", near);
        assert!(matches!(verdict, LossFree::Impossible { lost_bits: 5_200..10_000 }), "{verdict:?}");
    }

    #[test]
    fn packets_larger_than_the_buffers_are_always_lost() {
        let keys = "slots = 400\n[sensors.arrivals]\nmodel = 'poisson'\npacket_bits = 40000\n";
        let list = "x_m,y_m,queue_bits,sampling_bps\n50,50,0,10000\n";
        let (_, verdict) = known(keys, list);
        // About 100 packets, each 10 000 bit beyond the buffer; two in a slot lose 50 000.
        assert!(matches!(verdict, LossFree::Impossible { lost_bits: 800_000..1_500_000 }), "{verdict:?}");
        let scenario =
            Scenario::parse(&format!("name = 'a'\n{keys}"), Path::new("a.toml"), Overrides::default()).unwrap();
        let list = SensorList::parse(list, Path::new("a.csv"), &scenario).unwrap();
        let field = FieldBits::new(&scenario, &list.sensors_of(&scenario), &list.queues_bits());
        let beyond_bits: u64 =
            (1..=400).map(|slot| list.sampling(&scenario).bits(0, slot).saturating_sub(30_000)).sum();
        assert_eq!(field.beyond_buffers_bits, beyond_bits);
        let held_bits = field.sensors[0].drawn_bits.as_ref().unwrap();
        assert!(held_bits.windows(2).all(|pair| pair[1] - pair[0] <= 30_000));
    }

    #[test]
    fn a_sensor_node_enclosed_by_zones_loses_its_overflow() {
        let keys = "slots = 400\n[uav]\nstart_m = [5, 5]\n[[area.no_fly]]\npolygon_m = [[10, 10], [90, 10], [90, 90], [10, 90]]\n";
        let list = |x_m: f64| format!("x_m,y_m,queue_bits,sampling_bps\n{x_m},50,0,100\n95,95,0,100\n");
        // In 400 slots come 40 000 bit for each; a buffer holds 30 000.
        let (round, verdict) = known(keys, &list(50.0));
        assert!(matches!(verdict, LossFree::Impossible { lost_bits: 10_000 }), "{verdict:?}");
        assert_eq!((round.least_slots, round.to_string()), (None, "none: zones hide an SN".to_owned()));
        let (_, verdict) = known(keys, &list(19.0));
        assert!(matches!(verdict, LossFree::Flown { .. }), "in range from beside the zone: {verdict:?}");
    }

    #[test]
    fn a_field_that_is_too_large_is_not_flown() {
        let list = "x_m,y_m,queue_bits\n".to_owned() + &"50,50,0\n".repeat(super::super::flights::MAX_SENSORS + 1);
        let (round, verdict) = known("slots = 301\n", &list);
        // 5 001 SNs that sample 100 bit overflow by 100 bit each in slot 301; 300 · 4 visits can carry more than that.
        assert_eq!((round.least_slots, round.tour_slots, verdict), (Some(1_251), None, LossFree::NotFlown));
    }
}
