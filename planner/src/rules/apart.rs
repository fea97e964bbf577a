//! Distances between UAVs (decision D23): a slot that would end too near to another UAV ends elsewhere.

use skysink_common::geometry::{Position, above};

use crate::neighbours::{Reservations, Reserved};
use crate::route::way_home::Returning;
use crate::strategy::View;

impl Reservations<'_> {
    /// Where to fly in the slot of `view` instead of `proposed` [m]; `None` if that is far enough away, or nothing else
    /// is better.
    pub(crate) fn end_instead_of(&self, view: &View<'_>, proposed: &Position) -> Option<Position> {
        let airspace = &view.table.airspace;
        let motion = &view.table.motion;
        let ground = view.ground();
        let end_of = |to: &Position| motion.committed(view.slot, &ground, to).1;
        let is_near = |gives_way: bool, to: &Position| self.is_near(view, gives_way, &end_of(to));
        if self.separation_m == 0.0 || motion.under_way(view.slot, &ground).is_some() || !is_near(true, proposed) {
            return None;
        }
        let mut others = motion.alternatives(view.slot, &ground, proposed);
        let area = view.table.limits.area();
        others.retain(|to| area.contains(to, 0.0) && airspace.contains(to) && airspace.is_free(&ground, to));
        let away_m = |to: &Position| (end_of(to) - end_of(proposed)).norm();
        others.sort_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        let home = &view.table.home;
        // A UAV in the base may stay there.
        let is_in_base = |at: &Position| self.base.is_some_and(|base| base.contains(at));
        let stays = self.has_right_of_way && !is_in_base(proposed);
        others.insert(if stays { 0 } else { others.len() }, ground);
        let comes_home = |to: &Position| {
            let way = [&view.position, &above(to, view.position.z)];
            home.rule(view.slot, &view.battery, way, false) == Returning::Not
        };
        let clear: Vec<Position> = others.iter().filter(|to| !is_near(true, to)).copied().collect();
        if let Some(in_time) = clear.iter().find(|to| comes_home(to)) {
            return Some(*in_time);
        }
        // UAVs that have yet to plan give way to this one.
        if !is_near(false, proposed) && (clear.is_empty() || !motion.is_by_cells()) {
            return None;
        }
        let free = |place: &&Position| !self.is_near(view, true, place);
        let places: Vec<Position> = home.places().iter().filter(free).copied().collect();
        let others =
            if clear.is_empty() { others.into_iter().filter(|to| !is_near(false, to)).collect() } else { clear };
        // Home as soon as possible, where nobody is.
        let home_m = |to: &Position| {
            let away_m = places.iter().map(|place| airspace.distance_m(&end_of(to), place));
            away_m.fold(f64::INFINITY, f64::min)
        };
        let soonest = others.into_iter().min_by(|a, b| home_m(a).total_cmp(&home_m(b)));
        // In the base it may be near to others, before it comes home too late.
        let is_in_time = |to: &Position| {
            let slots = motion.move_slots() as f64 + (home_m(to) / motion.reach_m()).round();
            home.way().is_some_and(|way| way.battery.is_endless()) && (view.slot - 1) as f64 + slots <= self.last as f64
        };
        soonest.filter(|to| !is_in_base(&end_of(proposed)) || is_in_time(to))
    }

    /// Whether `end` [m] is too near to a place that is reserved, and neither is in the base; those of UAVs that have
    /// yet to plan count if it `gives_way`. On a grid a UAV also comes near to none in the base to which it is not near
    /// already, and where a move takes several slots, which end outside of the base, to none at all.
    fn is_near(&self, view: &View<'_>, gives_way: bool, end: &Position) -> bool {
        let is_in_base = |at: &Position| self.base.is_some_and(|base| base.contains(at));
        let is_near = |from: &Position, place: &Position| (from - place).norm() < self.separation_m;
        let motion = &view.table.motion;
        let ground = view.ground();
        let counts = |place: &Position| match is_in_base(end) {
            _ if motion.move_slots() > 1 => true,
            false => !is_in_base(place),
            true => motion.is_by_cells() && !is_near(&ground, place),
        };
        let reserved = self.reserved.iter().filter(|reserved| gives_way || reserved.kind != Reserved::MayStay);
        reserved.map(|reserved| &reserved.at).any(|place| is_near(end, place) && counts(place))
    }
}
