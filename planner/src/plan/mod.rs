//! Plans over many slots: the plan of least predicted cost, improved in every slot and flown a slot at a time.
//!
//! A plan is a sequence of stops. What it costs is the objective's. Decisions for slots are left to the strategies
//! `horizon` and `offline`, lower bounds on the loss to [`crate::bound`].
//!
//! | module | contents |
//! |---|---|
//! | [`objective`] | what a plan costs |
//! | [`sensor`], [`model`] | the sensor nodes of a plan, in slots instead of bits, and the constants of a mission |
//! | `capacities`, [`other_visits`] | what visits carry, and the visits of other UAVs |
//! | [`window`] | what a plan begins with |
//! | `service_disks`, [`groups`], [`points`] | the stops of a plan: disks, and points to hover at |
//! | [`decoder`] | the flight to a stop, and the sensor nodes served on the way |
//! | [`forecast`], [`timelines`], [`states`] | the predicted cost of a plan, or of a change |
//! | [`start`] | initial plans |
//! | [`operators`], [`anneal`], `improve` | the changes that are proposed, and the search |
//! | [`long_search`] | the search before the mission |
//! | [`carried_plan`], [`planned`] | the plan that is carried from slot to slot, and its first slot |
//! | [`in_passing`], [`hovering`] | the styles of plans |
//! | [`loss`], [`gaps`], [`collect`] | the objectives: the loss, ages of service and sums of costs, the data that is delivered |
//! | [`visits`] | a plan without a mission around it |
//! | [`keys`] | the keys of `horizon` |
//!
//! # Styles
//!
//! A style is what differs between plans that serve in passing and plans that hover. It is chosen by the objective, at
//! compile time. Each file that asks it where styles differ has a trait of what it asks:
//!
//! | trait | asks |
//! |---|---|
//! | [`ModelStyle`](model::ModelStyle) | which sensor nodes and stops there are |
//! | [`DecoderStyle`](decoder::DecoderStyle) | how a stop is flown to, and who is served |
//! | [`ForecastStyle`](forecast::ForecastStyle) | what a change leaves as it was, and how a plan ends |
//! | [`SearchStyle`](anneal::SearchStyle) | which changes are proposed |
//! | [`PlanStyle`](carried_plan::PlanStyle) | how a plan is begun, searched for and carried |
//! | [`PathStyle`](planned::PathStyle) | how it goes on after its last stop |
//!
//! | style | plans |
//! |---|---|
//! | [`in_passing`] | stop anywhere in a disk, for a slot, and end with the last stop |
//! | [`hovering`] | stop at points, hover there until nothing is left, and end at home |
//!
//! What only one style has is bound to its buffers, so that the wrong call does not compile:
//!
//! ```
//! use skysink_planner::plan::{forecast::Forecast, loss::Loss, model::PlanModel, start};
//! fn extend(model: &PlanModel, forecast: &mut Forecast<Loss>) {
//!     start::extend(model, forecast);
//! }
//! ```
//!
//! ```compile_fail,E0271
//! use skysink_planner::plan::{collect::Collect, forecast::Forecast, model::PlanModel, start};
//! fn extend(model: &PlanModel, forecast: &mut Forecast<Collect>) {
//!     start::extend(model, forecast); // a plan that hovers has no disks
//! }
//! ```

pub mod anneal;
mod capacities;
pub mod carried_plan;
pub mod collect;
pub mod decoder;
pub mod forecast;
pub mod gaps;
pub mod groups;
pub mod hovering;
mod improve;
pub mod in_passing;
pub mod keys;
pub mod long_search;
pub mod loss;
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
#[cfg(test)]
mod tests;
pub mod timelines;
pub mod visits;
pub mod window;
