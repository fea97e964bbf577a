//! Distances between UAVs (decision D23): a slot that would end too near to another UAV ends elsewhere.

use nalgebra::{Rotation2, Vector2};
use skysink_common::base::Base;
use skysink_common::geometry::{Position, above};

use crate::home::Returning;
use crate::strategy::View;

/// Turns [°] away from the decided direction in which a free flight may give way.
const TURNS_DEG: [f64; 8] = [0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0];

/// Parts of the decided way that it may fly there.
const PARTS: [f64; 2] = [1.0, 0.5];

/// Where the other UAVs are taken to be in a slot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Apart<'a> {
    /// Least distance to them [m]; 0 for any.
    pub separation_m: f64,
    /// Where those of lower number end, or begin, and then where those of higher number are, which may stay there.
    pub places: &'a [Position],
    /// How many are of those of lower number.
    pub lower: usize,
    /// Whether the UAV rather stays where it is than flies beside the way.
    pub stays: bool,
    /// The base, in which they may be near to each other.
    pub base: Option<&'a Base>,
    /// The last slot of the UAV, before which it plans to be home.
    pub last: u64,
}

impl Apart<'_> {
    /// Where to fly in the slot of `view` instead of `told` [m]; `None` if that is far enough away, or nothing else is
    /// better.
    pub fn end_instead_of(&self, view: &View, told: &Position) -> Option<Position> {
        let airspace = &view.table.airspace;
        let ground = view.ground();
        let end_of = |to: &Position| airspace.committed(view.slot, &ground, to).1;
        let is_near = |places: &[Position], to: &Position| self.is_near(view, places, &end_of(to));
        if self.separation_m == 0.0 || airspace.under_way(view.slot, &ground).is_some() || !is_near(self.places, told) {
            return None;
        }
        let mut others = if airspace.has_grid() {
            let flown = |cell: Position| airspace.slot_end(view.slot, &ground, &cell, view.table.limits.reach_m);
            airspace.neighbours(&ground).into_iter().map(flown).collect()
        } else {
            beside(&ground, told, view.table.limits.reach_m)
        };
        let area = view.table.limits.area();
        others.retain(|to| area.contains(to, 0.0) && airspace.contains(to) && airspace.is_free(&ground, to));
        let away_m = |to: &Position| (end_of(to) - end_of(told)).norm();
        others.sort_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        let home = view.table.home.as_ref();
        // A UAV in the base may stay there.
        let is_in_base = |at: &Position| self.base.is_some_and(|base| base.contains(at));
        let stays = self.stays && !is_in_base(told);
        others.insert(if stays { 0 } else { others.len() }, ground);
        let comes_home = |to: &Position| {
            let way = [&view.position, &above(to, view.position.z)];
            home.is_none_or(|home| home.rule(view.slot, &view.battery, way, false) == Returning::Not)
        };
        let lower = &self.places[..self.lower];
        let clear: Vec<Position> = others.iter().filter(|to| !is_near(self.places, to)).copied().collect();
        if let Some(in_time) = clear.iter().find(|to| comes_home(to)) {
            return Some(*in_time);
        }
        // UAVs of higher number have to plan for this one.
        if !is_near(lower, told) && (clear.is_empty() || !airspace.has_grid()) {
            return None;
        }
        let free = |place: &&Position| !self.is_near(view, self.places, place);
        let places: Vec<Position> = home.iter().flat_map(|home| home.places()).filter(free).copied().collect();
        let others =
            if clear.is_empty() { others.into_iter().filter(|to| !is_near(lower, to)).collect() } else { clear };
        // Home as soon as possible, where nobody is.
        let way_m = |to: &Position| {
            let ways_m = places.iter().map(|place| airspace.distance_m(&end_of(to), place));
            ways_m.fold(f64::INFINITY, f64::min)
        };
        let soonest = others.into_iter().min_by(|a, b| way_m(a).total_cmp(&way_m(b)));
        // In the base it may be near to others, before it comes home too late.
        let is_in_time = |to: &Position| {
            let slots = airspace.move_slots() as f64 + (way_m(to) / view.table.limits.reach_m).round();
            home.is_some_and(|home| home.battery.is_none()) && (view.slot - 1) as f64 + slots <= self.last as f64
        };
        soonest.filter(|to| !is_in_base(&end_of(told)) || is_in_time(to))
    }

    /// Whether `end` [m] is too near to one of the `places` of other UAVs, and neither is in the base. On a grid a UAV
    /// also comes near to none in the base to which it is not near already, and where a move takes several slots, which
    /// end outside of the base, to none at all.
    fn is_near(&self, view: &View, places: &[Position], end: &Position) -> bool {
        let is_in_base = |at: &Position| self.base.is_some_and(|base| base.contains(at));
        let is_near = |from: &Position, place: &Position| (from - place).norm() < self.separation_m;
        let (airspace, ground) = (&view.table.airspace, view.ground());
        let counts = |place: &Position| match is_in_base(end) {
            _ if airspace.move_slots() > 1 => true,
            false => !is_in_base(place),
            true => airspace.has_grid() && !is_near(&ground, place),
        };
        places.iter().any(|place| is_near(end, place) && counts(place))
    }
}

/// Places to give way to [m], on the way from `from` to `told`, beside it and behind it, and in reach of a slot around.
fn beside(from: &Position, told: &Position, reach_m: f64) -> Vec<Position> {
    let along = told - from;
    let ahead = along.try_normalize(0.0).unwrap_or_else(Vector2::x) * reach_m;
    let turned = |turn_deg: f64| {
        let turn = Rotation2::new(turn_deg.to_radians());
        let [whole, half] = PARTS.map(|part| from + turn * along * part);
        [whole, half, from + turn * ahead]
    };
    TURNS_DEG.into_iter().flat_map(turned).skip(1).collect()
}
