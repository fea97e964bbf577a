//! Plans over many slots: the plan of least predicted cost, improved in every slot and flown a slot at a time.
//!
//! A plan is a sequence of stops. What it costs is the objective's. Decisions for slots are left to the strategies
//! `horizon` and `offline`, lower bounds on the loss to [`crate::bound`].
//!
//! | module | contents |
//! |---|---|
//! | [`objective`] | what a plan costs: the loss, or the data that is not delivered |
//! | [`gaps`] | ages of service, and sums of costs |
//! | [`sensor`], [`model`] | the sensor nodes of a plan, in slots instead of bits, and the constants of a mission |
//! | `capacities`, [`other_visits`] | what visits carry, and the visits of other UAVs |
//! | [`window`] | what a plan begins with |
//! | [`style`] | what differs between styles of plans: [`in_passing`], [`hovering`] |
//! | `service_disks`, [`groups`], [`points`] | the stops of a plan: disks, and points to hover at |
//! | [`decoder`] | the flight to a stop, and the sensor nodes served on the way |
//! | [`forecast`], [`timelines`], [`states`] | the predicted cost of a plan, or of a change |
//! | [`start`] | initial plans |
//! | [`operators`], [`anneal`], `improve` | the changes that are proposed, and the search |
//! | [`long_search`] | the search before the mission |
//! | [`carried_plan`], [`planned`] | the plan that is carried from slot to slot, and its first slot |
//! | [`visits`] | a plan without a mission around it |
//! | [`keys`] | the keys of `horizon` |

pub mod anneal;
mod capacities;
pub mod carried_plan;
pub mod decoder;
pub mod forecast;
pub mod gaps;
pub mod groups;
pub mod hovering;
mod improve;
pub mod in_passing;
pub mod keys;
pub mod long_search;
pub mod model;
pub mod objective;
pub mod operators;
pub mod other_visits;
pub mod planned;
pub mod points;
pub mod sensor;
mod service_disks;
pub mod start;
pub mod states;
pub mod style;
#[cfg(test)]
mod tests;
pub mod timelines;
pub mod visits;
pub mod window;
