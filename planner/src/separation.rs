//! Distances between UAVs (decision D23): a slot that would end too near to another UAV ends elsewhere.

use nalgebra::Rotation2;
use skysink_common::geometry::{Position, above};

use crate::home::Returning;
use crate::strategy::View;

/// Turns [°] away from the decided direction in which a free flight may give way, the smallest first.
const TURNS_DEG: [f64; 7] = [0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0];

/// Parts of the decided way that it may fly there.
const PARTS: [f64; 2] = [1.0, 0.5];

/// Where the other UAVs are taken to be in a slot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Apart<'a> {
    /// Least distance to them [m]; 0 for any.
    pub separation_m: f64,
    /// Where those end that have planned, and where the others are, which may stay there.
    pub places: &'a [Position],
    /// Whether the UAV rather stays than gives way. Of two that are in each other's way, one does.
    pub stays: bool,
}

impl Apart<'_> {
    /// Where to fly in the slot of `view` instead of `told` [m]; `None` if that is far enough away, or nothing else is better.
    pub fn end_instead_of(&self, view: &View, told: &Position) -> Option<Position> {
        let airspace = &view.table.airspace;
        let ground = view.ground();
        let end_of = |to: &Position| airspace.committed(view.slot, &ground, to).1;
        if self.separation_m == 0.0
            || airspace.under_way(view.slot, &ground).is_some()
            || !self.is_near(view, &end_of(told))
        {
            return None;
        }
        let mut others = if airspace.has_grid() {
            let flown = |cell: Position| airspace.slot_end(view.slot, &ground, &cell, view.table.limits.reach_m);
            airspace.neighbours(&ground).into_iter().map(flown).collect()
        } else {
            beside(&ground, told)
        };
        let area = view.table.limits.area();
        others.retain(|to| area.contains(to, 0.0) && airspace.contains(to) && airspace.is_free(&ground, to));
        let away_m = |to: &Position| (end_of(to) - end_of(told)).norm();
        others.sort_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        let home = view.table.home.as_ref();
        // Whoever is in the way in the base may be there to stay.
        let stays = self.stays && !home.is_some_and(|home| home.base.contains(told));
        others.insert(if stays { 0 } else { others.len() }, ground);
        let comes_home = |to: &Position| {
            let way = [&view.position, &above(to, view.position.z)];
            home.is_none_or(|home| home.rule(view.slot, &view.battery, way, false) == Returning::Not)
        };
        others.retain(|to| !self.is_near(view, &end_of(to)));
        if let Some(in_time) = others.iter().position(comes_home) {
            return Some(others[in_time]);
        }
        // Home as soon as possible, where nobody is.
        let places: Vec<Position> =
            home.iter().flat_map(|home| home.places()).filter(|place| !self.is_near(view, place)).copied().collect();
        let way_m = |to: &Position| {
            let ways_m = places.iter().map(|place| airspace.distance_m(&end_of(to), place));
            ways_m.fold(f64::INFINITY, f64::min)
        };
        others.into_iter().min_by(|a, b| way_m(a).total_cmp(&way_m(b)))
    }

    /// Whether `end` [m] is too near to another UAV, and neither is in the base. On a grid the base has a cell for each.
    fn is_near(&self, view: &View, end: &Position) -> bool {
        let home = view.table.home.as_ref().filter(|_| !view.table.airspace.has_grid());
        let is_in_base = |at: &Position| home.is_some_and(|home| home.base.contains(at));
        let is_near = |place: &&Position| (end - **place).norm() < self.separation_m && !is_in_base(place);
        self.places.iter().any(|place| is_near(&place)) && !is_in_base(end)
    }
}

/// Places to give way to [m], on the way from `from` to `told` and beside it.
fn beside(from: &Position, told: &Position) -> Vec<Position> {
    let along = told - from;
    let turned = |turn_deg: f64| {
        let direction = Rotation2::new(turn_deg.to_radians()) * along;
        PARTS.map(|part| from + direction * part)
    };
    TURNS_DEG.into_iter().flat_map(turned).skip(1).collect()
}
