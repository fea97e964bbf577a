//! The changes of a plan that a search proposes: operators, drawn by their weights, with counts of what became of their
//! proposals.

use std::ops::Range;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use skysink_common::geometry::Position;
use skysink_common::random::below;

use super::decoder::Leg;
use super::forecast::FRESH;
use super::groups::PlannedStop;
use super::model::PlanModel;
use super::points::MOST_HOVERS;

/// Longest part of a plan that moves as one.
const LONGEST_MOVED: usize = 40;

/// Most slots that a plan with few stops stays longer at one of them by a change.
const MOST_STAYS: usize = 4;

/// An operator.
#[derive(Debug)]
pub struct Operator {
    /// Its name in summaries.
    pub name: &'static str,
    /// How often it is drawn, of 100.
    weight: usize,
    /// Proposes a change at a leg: fills the stops of the draft, and returns the legs that they replace. `None` where
    /// it finds none.
    propose: fn(&mut Draft<'_>, usize) -> Option<Range<usize>>,
}

/// The operators of plans that stop in disks.
pub const OF_DISKS: &[Operator] = &[
    Operator { name: "insert", weight: 20, propose: |draft, leg| Some(draft.insert_near(leg)) },
    Operator { name: "remove", weight: 15, propose: |_, leg| Some(leg..leg + 1) },
    Operator { name: "replace", weight: 15, propose: |draft, leg| Some(draft.replace_by_near(leg)) },
    Operator { name: "move", weight: 35, propose: |draft, leg| Some(draft.move_from(leg)) },
    Operator { name: "swap", weight: 15, propose: |draft, leg| Some(draft.swap(leg)) },
];

/// The operators of plans that hover at points.
pub const OF_POINTS: &[Operator] = &[
    Operator { name: "insert", weight: 25, propose: |draft, _| draft.insert_point() },
    Operator { name: "remove", weight: 15, propose: |_, leg| Some(leg..leg + 1) },
    Operator { name: "move", weight: 15, propose: |draft, leg| draft.move_one(leg) },
    Operator { name: "reverse", weight: 10, propose: |draft, leg| draft.reverse_from(leg) },
    Operator { name: "shift", weight: 20, propose: |draft, leg| draft.shift_point(leg) },
    Operator { name: "hover", weight: 15, propose: |draft, leg| draft.hover(leg) },
];

/// A proposed change of a plan.
pub struct Draft<'a> {
    /// Points may be added to it.
    pub model: &'a mut PlanModel,
    /// The plan.
    pub legs: &'a [Leg],
    /// Where it begins [m].
    pub start: Position,
    /// The sensors that have, or will have, data, and their queues at the beginning [bit], for operators that need
    /// them.
    pub open: &'a [(u32, f64)],
    /// Its random numbers.
    pub random: &'a mut ChaCha8Rng,
    /// The new stops, each with its index in the old plan, or [`FRESH`].
    pub inserted: &'a mut Vec<(PlannedStop, u32)>,
}

impl Draft<'_> {
    /// Draws a change: the index of its operator, and the legs that are replaced; `None` if there is none.
    pub fn draw(&mut self, operators: &[Operator]) -> (usize, Option<Range<usize>>) {
        if self.legs.is_empty() {
            return (0, (operators[0].propose)(self, 0)); // it inserts
        }
        let leg = below(self.random, self.legs.len());
        let drawn = below(self.random, 100);
        let mut until = 0;
        let index = operators.iter().position(|operator| {
            until += operator.weight;
            drawn < until
        });
        let index = index.expect("the weights add up to 100");
        (index, (operators[index].propose)(self, leg))
    }

    fn any(&mut self) -> PlannedStop {
        PlannedStop::at(self.model.stops[below(self.random, self.model.stops.len())])
    }

    /// A stop of the model near that of leg `leg`, or any.
    fn other(&mut self, leg: usize) -> PlannedStop {
        let near = &self.model.neighbours[self.legs[leg].stop.disk as usize];
        if near.is_empty() || below(self.random, 16) == 0 {
            self.any()
        } else {
            PlannedStop::at(near[below(self.random, near.len())])
        }
    }

    /// The nearest leg with this stop, in one direction from leg `leg`, or in the other if there is none.
    fn nearest(&mut self, leg: usize, stop: PlannedStop) -> Option<usize> {
        let after = || self.legs[leg + 1..].iter().position(|other| other.stop == stop).map(|away| leg + 1 + away);
        let before = || self.legs[..leg].iter().rposition(|other| other.stop == stop);
        if self.random.next_u32() & 1 == 0 { after().or_else(before) } else { before().or_else(after) }
    }

    fn keep(&mut self, legs: Range<usize>) {
        self.inserted.extend(legs.map(|leg| (self.legs[leg].stop, leg as u32)));
    }

    fn reverse(&mut self, legs: Range<usize>) {
        self.inserted.extend(legs.rev().map(|leg| (self.legs[leg].stop, FRESH)));
    }

    fn insert_any(&mut self) -> Range<usize> {
        let stop = self.any();
        self.inserted.push((stop, FRESH));
        0..0
    }

    /// Inserts `stop` before or after leg `leg`.
    fn insert(&mut self, leg: usize, stop: PlannedStop) -> Range<usize> {
        let copies = if self.is_stay(leg, stop) { 1 + below(self.random, MOST_STAYS) } else { 1 };
        self.inserted.extend(std::iter::repeat_n((stop, FRESH), copies));
        let at = leg + below(self.random, 2);
        at..at
    }

    /// Whether `stop` is that of leg `leg` again, as a change of plans with few stops.
    fn is_stay(&self, leg: usize, stop: PlannedStop) -> bool {
        let last = self.legs[leg].stop;
        last == stop && self.model.neighbours[stop.disk as usize].last() == Some(&stop.disk)
    }

    /// Inserts a stop before or after leg `leg`, near it; any stop into an empty plan.
    fn insert_near(&mut self, leg: usize) -> Range<usize> {
        if self.legs.is_empty() {
            return self.insert_any();
        }
        let stop = self.other(leg);
        self.insert(leg, stop)
    }

    fn replace(&mut self, leg: usize, stop: PlannedStop) -> Range<usize> {
        self.inserted.push((stop, FRESH));
        leg..leg + 1
    }

    fn replace_by_near(&mut self, leg: usize) -> Range<usize> {
        let stop = self.other(leg);
        self.replace(leg, stop)
    }

    /// Moves a few stops, from leg `leg` on, to after the nearest one at a stop near the first of them; inserts that
    /// stop where the plan has none.
    fn move_from(&mut self, leg: usize) -> Range<usize> {
        let longest = LONGEST_MOVED.min(self.legs.len() - leg);
        let longest = if below(self.random, 2) == 0 { longest.min(3) } else { longest };
        let end = leg + 1 + below(self.random, longest);
        let stop = self.other(leg);
        let Some(target) =
            self.nearest(leg, stop).map(|near| near + 1).filter(|target| !(leg + 1..=end).contains(target))
        else {
            return self.insert(leg, stop);
        };
        let is_reversed = below(self.random, 2) == 0;
        let carry = |draft: &mut Self| {
            if is_reversed { draft.reverse(leg..end) } else { draft.keep(leg..end) }
        };
        if target > end {
            self.keep(end..target);
            carry(self);
            leg..target
        } else {
            carry(self);
            self.keep(target..leg);
            target..end
        }
    }

    /// Exchanges a stop and the nearest one at a stop near it; replaces it by that where the plan has none.
    fn swap(&mut self, leg: usize) -> Range<usize> {
        let stop = self.other(leg);
        let Some(other) = self.nearest(leg, stop) else { return self.replace(leg, stop) };
        let first = leg.min(other);
        let second = leg.max(other);
        self.keep(second..second + 1);
        self.keep(first + 1..second);
        self.keep(first..first + 1);
        first..second + 1
    }

    /// Inserts a stop at a point, anywhere or where it adds least length.
    fn insert_point(&mut self) -> Option<Range<usize>> {
        let (sensor, queue_bits) = *self.open.get(below(self.random, self.open.len().max(1)))?;
        let point = self.model.draw_point(sensor, self.random)?;
        let most = self.model.hovers(sensor, queue_bits, &point);
        let hovers = if below(self.random, 2) == 0 { most } else { below(self.random, usize::from(most) + 1) as u16 };
        let index = match below(self.random, 2) {
            0 => {
                let detours = detours_m(self.model, self.legs, &self.start, &point).enumerate();
                detours.min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(index, _)| index)
            }
            _ => below(self.random, self.legs.len() + 1),
        };
        let stop = self.model.add_point(sensor, point, hovers);
        self.inserted.push((stop, FRESH));
        Some(index..index)
    }

    fn move_one(&mut self, leg: usize) -> Option<Range<usize>> {
        let to = below(self.random, self.legs.len());
        if to > leg {
            self.keep(leg + 1..to + 1);
        }
        self.keep(leg..leg + 1);
        if to < leg {
            self.keep(to..leg);
        }
        (to != leg).then(|| leg.min(to)..leg.max(to) + 1)
    }

    fn reverse_from(&mut self, leg: usize) -> Option<Range<usize>> {
        let end = leg + 1 + below(self.random, self.legs.len() - leg);
        self.reverse(leg..end);
        (end > leg + 1).then_some(leg..end)
    }

    /// Serves the same sensor from another point.
    fn shift_point(&mut self, leg: usize) -> Option<Range<usize>> {
        let stop = self.legs[leg].stop;
        let sensor = self.model.disks[stop.disk as usize].members[0];
        let point = match below(self.random, 2) {
            0 => self.model.draw_point(sensor, self.random)?,
            _ => self.model.point_beside(&self.model.disk(stop.disk).centre, self.random),
        };
        let stop = self.model.add_point(sensor, point, stop.hovers);
        self.inserted.push((stop, FRESH));
        Some(leg..leg + 1)
    }

    /// Hovers more or less often.
    fn hover(&mut self, leg: usize) -> Option<Range<usize>> {
        let stop = self.legs[leg].stop;
        let hovers = match below(self.random, 3) {
            0 => stop.hovers.saturating_sub(1),
            1 => (stop.hovers + 1).min(MOST_HOVERS),
            _ => below(self.random, usize::from(MOST_HOVERS) + 1) as u16,
        };
        self.inserted.push((PlannedStop { hovers, ..stop }, FRESH));
        (hovers != stop.hovers).then_some(leg..leg + 1)
    }
}

/// The length that a stop at `point` [m] before each leg, and after the last, adds to a plan from `start` [m].
pub fn detours_m(model: &PlanModel, legs: &[Leg], start: &Position, point: &Position) -> impl Iterator<Item = f64> {
    let at = |index: usize| model.disk(legs[index].stop.disk).centre;
    (0..=legs.len()).map(move |index| {
        let before = index.checked_sub(1).map_or(*start, at);
        let to_m = (point - before).norm();
        let next = legs.get(index).map(|_| at(index));
        next.map_or(to_m, |next| to_m + (next - point).norm() - (next - before).norm())
    })
}
