//! `uts`, the strategy of the UTS letter (arXiv 2103.00753): sP1 by Algorithm 1, then the waypoint by sP2.

use skysink_common::checkpoint::Checkpoint;

use super::algorithm_1::{Reach, Search};
use super::serving::Serving;
use crate::strategy::{Decision, Registered, Setup, Strategy, View};

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "uts",
    about: "the paper's strategy: sP1 by Algorithm 1, then the waypoint by sP2",
    is_stateless: true,
    has_path: false,
    keys: None,
    make: |setup| Box::new(Uts::new(Reach::Letter, setup)),
};

/// Algorithm 1 with anchors and circles in `reach`, and sP2.
pub(crate) struct Uts {
    reach: Reach,
    search: Search,
    serving: Serving,
    /// The schedule, working memory.
    ids: Vec<u32>,
}

impl Uts {
    pub fn new(reach: Reach, setup: &Setup) -> Self {
        let search = Search::with_room_for(setup.table.sensors.count());
        Self { reach, search, serving: Serving::new(setup), ids: Vec::with_capacity(setup.table.limits.blocks()) }
    }
}

impl Checkpoint for Uts {}

impl Strategy for Uts {
    /// `None` if there is no anchor in reach, or no point from which its set can be served.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let Self { reach, search, serving, ids } = self;
        let winner = search.best_set(*reach, view.table, &view.ground(), view.belief.queues_bits, ids)?;
        let waypoint = serving.waypoint(view, ids)?;
        Some(Decision { winner: Some(winner), ..Decision::serve(view, &waypoint, ids) })
    }
}
