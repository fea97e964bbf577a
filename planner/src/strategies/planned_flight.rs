//! The first slot of a plan of the look-ahead.

use skysink_common::channel::ChannelModel;
use skysink_common::geometry::Position;
use skysink_common::message::SolverOutcome;

use super::nearby::fullest_first;
use super::serving::Serving;
use crate::horizon::forecast::Forecast;
use crate::horizon::model::PlanningModel;
use crate::horizon::{PlannedSlot, planned_slot};
use crate::strategy::{Decision, View};

/// The first slot of the plan of `forecast`, that of `view`. No decision after the last stop.
pub(crate) fn fly_slot(
    model: &PlanningModel,
    forecast: &Forecast,
    serving: &mut Serving,
    view: &View,
) -> Option<Decision> {
    let next = planned_slot(model, forecast, 1, &view.ground())?;
    if next.is_charging {
        return Some(Decision::stay(view));
    }
    let (waypoint, outcome) = between_stops(serving, view, &next);
    let key = |id: u32| (!next.ids.contains(&id), fullest_first(view.value(id), id));
    Some(Decision { outcome, ..serving.serve_by(view, &waypoint, key) })
}

/// The waypoint of a planned slot. If links limit the collected bits, or depend on the elevation, it is moved
/// toward the solution of sP2*, as far as the next stop stays in reach.
fn between_stops(serving: &mut Serving, view: &View, next: &PlannedSlot) -> (Position, SolverOutcome) {
    let above = serving.above(view, &next.waypoint, &next.ids);
    let queued_bits: u64 = next.ids.iter().map(|&id| u64::from(view.belief.queues_bits[id as usize])).sum();
    let expected_bits = view.table.expected_bits(&above, &next.ids, view.belief.queues_bits);
    if expected_bits == queued_bits && !view.table.channel.depends_on_elevation() {
        return (next.waypoint, SolverOutcome::Rule);
    }
    let Some(best) = serving.waypoint(view, &next.ids) else {
        return (next.waypoint, SolverOutcome::Rule);
    };
    let best_ground = best.point.xy();
    let Some((next_stop, slots)) = next.next_stop else {
        return (best_ground, best.outcome);
    };
    let reach_m = view.table.limits.reach_m * f64::from(slots);
    let fraction = fraction_within(&next.waypoint, &best_ground, &next_stop, reach_m);
    let moved = next.waypoint + (best_ground - next.waypoint) * fraction;
    // Behind a zone it would not be flown.
    if view.table.airspace.is_free(&view.ground(), &moved) {
        (moved, best.outcome)
    } else {
        (next.waypoint, SolverOutcome::Rule)
    }
}

/// The largest fraction of the path from `from` to `to` that stays within `radius_m` [m] of `centre`; 0 if `from` does
/// not.
fn fraction_within(from: &Position, to: &Position, centre: &Position, radius_m: f64) -> f64 {
    let path = to - from;
    let away = from - centre;
    let a = path.norm_squared();
    let b = path.dot(&away);
    let c = away.norm_squared() - radius_m * radius_m;
    if c > 0.0 {
        return 0.0;
    }
    // The larger root of a t² + 2 b t + c = 0, c ≤ 0.
    let root = (b * b - a * c).max(0.0).sqrt();
    let fraction = if b > 0.0 { -c / (b + root) } else { (root - b) / a };
    if fraction.is_finite() { fraction.clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_clipped_to_a_circle_ends_on_it() {
        let at = Position::new;
        // From 4 m west of the centre of a circle of 10 m eastward: 14 m of 28 m.
        let fraction = fraction_within(&at(46.0, 50.0), &at(74.0, 50.0), &at(50.0, 50.0), 10.0);
        assert!((fraction - 0.5).abs() < 1e-12, "{fraction}");
        let fraction = fraction_within(&at(54.0, 50.0), &at(26.0, 50.0), &at(50.0, 50.0), 10.0);
        assert!((fraction - 0.5).abs() < 1e-12, "{fraction}");
        assert_eq!(fraction_within(&at(46.0, 50.0), &at(48.0, 50.0), &at(50.0, 50.0), 10.0), 1.0, "never leaves it");
        assert_eq!(fraction_within(&at(30.0, 50.0), &at(50.0, 50.0), &at(50.0, 50.0), 10.0), 0.0, "starts outside");
        assert_eq!(fraction_within(&at(46.0, 50.0), &at(46.0, 50.0), &at(50.0, 50.0), 10.0), 0.0, "nowhere to go");
    }
}
