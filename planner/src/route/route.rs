//! A flight in whole slots.

use skysink_common::battery::Battery;
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;
use smallvec::SmallVec;

/// A straight part of a route, flown in equal steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoutePart {
    /// Where it ends [m].
    pub end: Position,
    /// Its slots; 0 for one that rounding has left.
    pub slots: u32,
}

/// A flight in whole slots: straight parts, one after another.
///
/// ```
/// use skysink_planner::route::route::{RoutePart, Route};
/// let parts = [RoutePart { end: [30.0, 0.0].into(), slots: 1 }, RoutePart { end: [30.0, 50.0].into(), slots: 2 }];
/// let route = Route::new([0.0, 0.0].into(), parts, None);
/// assert_eq!((route.slots(), route.at(2), route.end()), (3, [30.0, 25.0].into(), [30.0, 50.0].into()));
/// assert_eq!((route.first(), route.length_m()), ([30.0, 0.0].into(), 80.0));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    from: Position,
    /// At least one.
    pub(super) parts: SmallVec<[RoutePart; 2]>,
    slots: u32,
    energy_j: f64,
}

impl Route {
    /// The route from `from` [m] over `parts`, of which there is at least one, and what it takes from `battery`.
    #[inline]
    #[must_use]
    pub fn new(from: Position, parts: impl IntoIterator<Item = RoutePart>, battery: Option<&Battery>) -> Self {
        let mut route = Self { from, parts: parts.into_iter().collect(), slots: 0, energy_j: 0.0 };
        let mut begin = from;
        let battery = battery.filter(|battery| !battery.is_endless()); // an open field computes no lengths of parts
        for part in &route.parts {
            route.slots = route.slots.saturating_add(part.slots);
            if let Some(battery) = battery.filter(|_| part.slots > 0) {
                let slots = f64::from(part.slots);
                route.energy_j += slots * battery.slot_j((part.end - begin).norm() / slots);
            }
            begin = part.end;
        }
        route
    }

    /// Its slots.
    #[inline]
    pub fn slots(&self) -> u32 {
        self.slots
    }

    /// What it takes [J]; 0 without a battery.
    #[inline]
    pub fn energy_j(&self) -> f64 {
        self.energy_j
    }

    /// Where it ends [m].
    #[inline]
    pub fn end(&self) -> Position {
        self.parts.last().map_or(self.from, |part| part.end)
    }

    /// Where its slot number `slot` ends [m]; where it begins for 0.
    #[inline]
    pub fn at(&self, slot: u32) -> Position {
        let mut from = &self.from;
        let mut left = slot;
        for part in &self.parts {
            if left < part.slots {
                return interpolate(*from, part.end, f64::from(left) / f64::from(part.slots));
            }
            left -= part.slots;
            from = &part.end;
        }
        *from
    }

    /// The waypoint of its first slot [m]: of a part of n slots it is found from 1/n of the part, which differs from
    /// [`Self::at`] in the last bit.
    pub fn first(&self) -> Position {
        match self.parts.iter().find(|part| part.slots > 0) {
            Some(part) if part.slots > 1 => self.from + (part.end - self.from) / f64::from(part.slots),
            Some(part) => part.end,
            None => self.end(),
        }
    }

    /// Its length [m].
    pub fn length_m(&self) -> f64 {
        let begins = std::iter::once(&self.from).chain(self.parts.iter().map(|part| &part.end));
        begins.zip(&self.parts).map(|(begin, part)| (part.end - begin).norm()).sum()
    }
}
