//! The look-ahead for plans that serve in passing.

use super::{Flown, LookAhead, PlannedNext};
use crate::plan::in_passing::InPassing;
use crate::plan::keys::HorizonKeys;
use crate::plan::long_search::{SearchOutcome, Watch};
use crate::plan::objective::Objective;
use crate::plan::planned::PlannedSlot;
use crate::strategy::View;

impl<O: Objective<Style = Self>> Flown<O> for InPassing {
    const IS_OPEN_LOOP: bool = true;

    fn first_steps(_: &HorizonKeys, offline_steps: Option<u64>) -> u64 {
        offline_steps.unwrap_or(0)
    }

    fn prepare(look_ahead: &mut LookAhead<O>, view: &View, watch: &mut Watch<'_>) -> Option<SearchOutcome> {
        let mut forecast = look_ahead.ahead.forecast(view)?;
        look_ahead.ahead.prepare(view, &mut forecast, look_ahead.first_steps, watch)
    }

    /// Nothing after the last stop.
    fn next(_: &View, planned: Option<PlannedSlot>) -> PlannedNext {
        match planned {
            None => PlannedNext::Nothing,
            Some(planned) if planned.is_charging => PlannedNext::Charge,
            Some(planned) => PlannedNext::ServePlanned(planned),
        }
    }
}
