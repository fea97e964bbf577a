//! `horizon`: receding-horizon planning. In every slot it improves a plan for the rest of the mission, or its next
//! 2 400 slots, and flies the first slot of the plan.
//!
//! Where links, arrivals, queues or rates are by chance, a plan may be worth less than a simple rule. There it is one
//! of the strategies that are compared by simulation ([`super::best_of`]).

use super::best_of::best_of;
use super::look_ahead;
use skysink_common::channel::ChannelModel;

use crate::plan::keys::{HorizonKeys, LookAheadPart};
use crate::strategy::{Registered, Setup};

/// In every slot it improves a plan of least predicted loss over the rest of the mission, or its next 2 400 slots, and
/// flies the first slot of the plan: within range of the current stop, as near to the next one as possible; sP2 if the
/// link is the bottleneck.
pub const STRATEGY: Registered =
    Registered::new("horizon", "receding horizon: a plan over many slots, improved in every slot", |setup| {
        let keys: HorizonKeys = setup.scenario.planner_keys("planner.horizon").expect("they were checked");
        if is_certain(setup) || keys.without == Some(LookAheadPart::Choice) {
            look_ahead::horizon(setup, keys)
        } else {
            best_of(setup, keys, setup.scenario.planner_keys("planner.best-of").expect("they were checked"))
        }
    })
    .with_state()
    .with_path()
    .with_keys::<HorizonKeys>();

/// Whether links, arrivals, queues and rates are known: then a forecast is what comes.
fn is_certain(setup: &Setup<'_>) -> bool {
    !setup.belief.is_estimated() && !setup.table.channel.is_random() && !setup.table.arrivals.is_random()
}
