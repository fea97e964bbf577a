//! `uts`, the strategy of the UTS letter (arXiv 2103.00753): sP1 by Algorithm 1, then the waypoint by sP2.

use super::algorithm_1::{Reach, Search};
use crate::serving::Serving;
use crate::strategy::{Decision, Registered, Setup, Strategy, rule};

/// The schedule is the best of five circles around each pair of sensor nodes within `V τ − d_c` (Algorithm 1), the
/// waypoint the point in range of all of them with the highest rate, to first order (sP2).
pub const STRATEGY: Registered =
    Registered::new("uts", "the paper's strategy: sP1 by Algorithm 1, then the waypoint by sP2", |setup| {
        uts(Reach::Letter, setup)
    });

/// Algorithm 1 with anchors and circles in `reach`, and sP2. No decision if there is no anchor in reach, or no point
/// from which its set can be served.
pub(crate) fn uts(reach: Reach, setup: &Setup) -> Box<dyn Strategy> {
    let mut search = Search::with_room_for(setup.table.sensors.count());
    let mut serving = Serving::new(setup);
    let mut ids = Vec::with_capacity(setup.table.limits.blocks());
    let mut room = Vec::new();
    rule(move |view| {
        let winner = search.best_set(reach, view.table, &view.ground(), view.told(view.values(&mut room)), &mut ids)?;
        let waypoint = serving.waypoint(view, &ids)?;
        Some(Decision { winner: Some(winner), ..Decision::serve(view, &waypoint, &ids) })
    })
}
