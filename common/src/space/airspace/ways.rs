//! What the kinds of ways have in common: straight ones, ways around corners, and ways along a grid.

use enum_dispatch::enum_dispatch;

use super::ground::ClosedGround;
use super::polygon::{Bends, nearest_between};
use crate::geometry::{Position, within};

/// The ways of a UAV over a ground. A kind that has nothing to do with slots or grids leaves their parts as they are.
#[enum_dispatch]
pub(super) trait Ways {
    /// Whether the straight way is one.
    #[inline]
    fn is_free(&self, ground: &ClosedGround, from: &Position, to: &Position) -> bool {
        ground.is_clear(from, to)
    }

    /// Whether a straight way may be one, whatever the ground.
    fn is_move(&self, _from: &Position, _to: &Position) -> bool {
        true
    }

    /// The point that a UAV which comes from the start can fly to, nearest to `point` [m].
    fn nearest(&self, ground: &ClosedGround, point: &Position) -> Position;

    /// Whether `point` [m] is free, and a way leads there from the start.
    fn is_reachable(&self, ground: &ClosedGround, point: &Position) -> bool;

    /// The shortest way: its bends, and its end. Empty if there is none.
    fn way(&self, ground: &ClosedGround, from: &Position, to: &Position) -> Bends;

    /// Its length [m]; infinite if there is none.
    fn distance_m(&self, ground: &ClosedGround, from: &Position, to: &Position) -> f64;

    /// The same between two points that are reachable.
    fn between_m(&self, ground: &ClosedGround, from: &Position, to: &Position) -> f64 {
        self.distance_m(ground, from, to)
    }

    /// The shortest way up to where it comes within `radius_m` [m] of `centre`; empty if it does not.
    fn way_into(
        &self,
        ground: &ClosedGround,
        from: &Position,
        to: &Position,
        centre: &Position,
        radius_m: f64,
    ) -> Bends {
        let mut way = self.way(ground, from, to);
        let begins = std::iter::once(*from).chain(way.clone());
        let entered =
            begins.zip(&way).position(|(begin, end)| within(&nearest_between(centre, &begin, end), centre, radius_m));
        let Some(piece) = entered else { return Bends::new() };
        let begin = piece.checked_sub(1).map_or(*from, |before| way[before]);
        way.truncate(piece + 1);
        let along = way[piece] - begin;
        let away = begin - centre;
        // |away + t along| = radius, the first time; 0 if it begins within.
        let a = along.norm_squared();
        let half_b = along.dot(&away);
        let c = away.norm_squared() - radius_m * radius_m;
        if c <= 0.0 {
            way[piece] = begin;
        } else {
            let root = (half_b * half_b - a * c).max(0.0).sqrt();
            let fraction = c / (root - half_b);
            way[piece] = if fraction < 1.0 { begin + along * fraction } else { way[piece] };
        }
        way
    }

    /// The end of `slot` of a UAV at `from` that is told to fly to `to` [m], up to `reach_m` [m].
    #[inline]
    fn slot_end(&self, ground: &ClosedGround, _slot: u64, from: &Position, to: &Position, reach_m: f64) -> Position {
        if ground.is_clear(from, to) { *to } else { self.toward(ground, from, to, reach_m) }
    }

    /// The end of a slot that flies up to `reach_m` [m] along the shortest way.
    fn toward(&self, ground: &ClosedGround, from: &Position, to: &Position, reach_m: f64) -> Position {
        let way = self.way(ground, from, to);
        if way.is_empty() { *from } else { self.step(ground, from, &way, reach_m).0 }
    }

    /// The end of a slot along `way`, which is not empty, and how many bends it has passed. Beyond a bend it flies
    /// straight on where that brings it nearer to the next one.
    fn step(&self, ground: &ClosedGround, from: &Position, way: &[Position], reach_m: f64) -> (Position, usize) {
        let bend = way[0];
        let along = bend - from;
        let away_m = along.norm();
        if away_m > reach_m {
            return (from + along * (reach_m / away_m), 0);
        }
        let Some(next) = way.get(1) else { return (bend, 1) };
        if away_m > 0.0 {
            let along = along / away_m;
            let on_m = along.dot(&(next - from)).min(reach_m);
            let beyond = from + along * on_m;
            let is_flown = ground.contains(&beyond) && ground.is_clear(from, &beyond);
            if on_m > away_m && is_flown && ground.is_clear(&beyond, next) {
                return (beyond, 1);
            }
        }
        (bend, 1)
    }

    /// The middles of the cells that a way leads to from the start [m].
    fn reached(&self) -> Vec<Position> {
        Vec::new()
    }

    /// The middles of the cells that a move leads to from the middle of one, at `at` [m].
    fn neighbouring(&self, _at: &Position) -> Vec<Position> {
        Vec::new()
    }

    /// Slots of a move to a neighbouring cell.
    fn move_slots(&self) -> u64 {
        1
    }

    /// The end of `slot` of a UAV at `from` that is under way [m]; `None` where it may be told a waypoint.
    fn under_way(&self, _slot: u64, _from: &Position) -> Option<Position> {
        None
    }

    /// The slots from `slot` on that are decided with a flight from `from` to `to` [m], and where the UAV is after
    /// them.
    fn committed(&self, _slot: u64, _from: &Position, to: &Position) -> (u64, Position) {
        (1, *to)
    }
}
