//! Straight ways: all of an open field, and single ones between zones.

use super::ground::ClosedGround;
use super::polygon::Bends;
use super::ways::Ways;
use crate::geometry::Position;

/// Ways without bends. Where zones are in the way there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Straight;

impl Ways for Straight {
    fn nearest(&self, _ground: &ClosedGround, point: &Position) -> Position {
        *point
    }

    fn is_reachable(&self, ground: &ClosedGround, point: &Position) -> bool {
        ground.is_open() || ground.contains(point)
    }

    fn way(&self, ground: &ClosedGround, from: &Position, to: &Position) -> Bends {
        if ground.is_clear(from, to) { Bends::from_slice(&[*to]) } else { Bends::new() }
    }

    fn distance_m(&self, ground: &ClosedGround, from: &Position, to: &Position) -> f64 {
        if ground.is_clear(from, to) { (to - from).norm() } else { f64::INFINITY }
    }
}
