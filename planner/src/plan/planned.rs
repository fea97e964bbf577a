//! A slot of a plan, and its path.

use skysink_common::geometry::Position;
use skysink_common::message::MAX_PATH_POINTS;

use super::decoder::{BaseVisit, Leg};
use super::forecast::{Forecast, ForecastStyle};
use super::model::PlanModel;
use super::objective::Objective;

/// What a style says of the path of a plan.
pub trait PathStyle {
    /// The way [m] from the last stop, at `last` [m], to the end of a plan that begins after `flown_slots` slots.
    fn way_after(_model: &PlanModel, _flown_slots: u64, _last: &Position) -> Vec<Position> {
        Vec::new()
    }
}

/// A slot of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSlot {
    /// Waypoint at the end of the slot.
    pub waypoint: Position,
    /// The served sensor nodes, ascending.
    pub ids: Vec<u32>,
    /// The waypoint of the next stop, and the slots to it.
    pub next_stop: Option<(Position, i32)>,
    /// Whether the UAV charges, and serves nobody.
    pub is_charging: bool,
}

/// Slot `slot`, from 1, of a plan, with the UAV at `from` at its beginning; `None` after the last stop.
#[must_use]
pub fn planned_slot<O: Objective<Style: ForecastStyle<O>>>(
    model: &PlanModel,
    forecast: &Forecast<O>,
    slot: i32,
    from: &Position,
) -> Option<PlannedSlot> {
    let legs = &forecast.trace.legs;
    let visits = &forecast.trace.visits;
    let index = legs.partition_point(|leg| leg.end < slot);
    let leg = legs.get(index)?;
    let begin = index.checked_sub(1).map_or(0, |before| legs[before].end);
    // Where the leg leads, and when it is there: to the base first, if it is due.
    let arrives = |leg: &Leg| leg.end - leg.hovered;
    let mut end = (leg.at, arrives(leg));
    let mut next = legs.get(legs.partition_point(|leg| leg.end <= slot)).map(|leg| (leg.at, arrives(leg)));
    if let Some(BaseVisit { slots: way, charged, at, .. }) = leg.via {
        if slot > begin + way && slot <= begin + way + charged {
            return Some(PlannedSlot { waypoint: *from, ids: Vec::new(), next_stop: None, is_charging: true });
        }
        if slot <= begin + way {
            end = (at, begin + way);
            next = Some(end);
        }
    }
    // A leg of several slots is flown in equal steps, after the slots around zones.
    let airspace = &model.table.airspace;
    let waypoint = if airspace.is_free(from, &end.0) {
        from + (end.0 - from) / f64::from((end.1 - slot + 1).max(1))
    } else {
        model.table.motion.toward(from, &end.0)
    };
    let visits = visits[visits.partition_point(|visit| visit.slot < slot)..].iter();
    let visits = visits.take_while(|visit| visit.slot == slot);
    let mut ids: Vec<u32> = visits.map(|visit| model.ids[visit.sensor as usize]).collect();
    ids.sort_unstable();
    let next_stop = next.map(|(at, end)| (at, end - slot));
    Some(PlannedSlot { waypoint, ids, next_stop, is_charging: false })
}

/// The stops [m] of a plan after its first slot, and the bends around zones between them, at most 63 points; with
/// the way after the last stop.
#[must_use]
pub fn planned_path<O: Objective<Style: ForecastStyle<O> + PathStyle>>(
    model: &PlanModel,
    forecast: &Forecast<O>,
) -> Vec<Position> {
    let airspace = &model.table.airspace;
    let mut path: Vec<Position> = Vec::new();
    for leg in forecast.trace.legs.iter().filter(|leg| leg.end > 1) {
        match path.last().copied() {
            Some(_) if !airspace.is_open() && path.len() >= MAX_PATH_POINTS => break,
            Some(before) if !airspace.is_open() => path.extend(airspace.way(&before, &leg.at)),
            _ => path.push(leg.at),
        }
    }
    let last = path.last().copied().unwrap_or(forecast.window.start);
    path.extend(O::Style::way_after(model, forecast.window.flown_slots, &last));
    path.dedup();
    path.truncate(MAX_PATH_POINTS - 1);
    path
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::message::SensorNode;
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::stop::Stop;

    use super::*;
    use crate::gap_costs::GapCosts;
    use crate::mission_table::MissionTable;
    use crate::plan::groups::PlannedStop;
    use crate::plan::loss::Loss;
    use crate::plan::tests::window_of;

    #[test]
    fn a_path_goes_around_zones_between_the_stops() {
        let path = |zones: &str| {
            let text = format!("name = 'x'\narea.side_m = 400.0\n{zones}");
            let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
            let node = |x_m: f64| SensorNode {
                x_m,
                y_m: 200.0,
                gain: 10f64.powf(-5.2),
                sampling_bps: 500.0,
                capacity_bits: 30_000,
                ..SensorNode::default()
            };
            let table = MissionTable::of(&scenario, &[260.0, 330.0].map(node));
            let model = PlanModel::new::<Loss>(&scenario, &table, &GapCosts::LOSS, true, &Stop::default());
            let mut forecast = Forecast::new(&model, window_of(&model, 30));
            forecast.load(&model, [0, 1].map(PlannedStop::at));
            let path = planned_path(&model, &forecast);
            assert!(path.windows(2).all(|way| model.table.airspace.is_free(&way[0], &way[1])), "{path:?}");
            path.len()
        };
        assert_eq!(path(""), 2);
        assert_eq!(path("area.no_fly = [{ polygon_m = [[285, 150], [295, 150], [295, 240], [285, 240]] }]\n"), 4);
    }
}
