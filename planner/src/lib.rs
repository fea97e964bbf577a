//! Schedule and waypoint of each slot: the strategies and their waypoint solvers.
//!
//! [`Planner::step`] computes a [`Plan`](skysink_common::message::Plan) from the UAV's position and the queues. Flight,
//! channel draws and queues are left to the other nodes of the ring.
//!
//! | module | contents |
//! |---|---|
//! | [`settings`], [`keys`] | `[planner]` of the scenario file |
//! | [`assumed_link`] | what plans take the link for |
//! | [`planner`] | one slot: schedule, then waypoint |
//! | [`fleet`] | the planners of all UAVs, and how they share the field |
//! | [`neighbours`] | what the UAVs of a fleet tell each other |
//! | [`rules`] | the rules between what a strategy proposes and what is flown |
//! | [`route`] | how a UAV gets somewhere, and home |
//! | [`mission_table`] | the constant data of a mission |
//! | [`strategy`] | what a strategy is: its trait, input and output |
//! | [`strategies`] | schedule and waypoint by each strategy |
//! | [`simulation`] | a mission as it may go on, flown by a planner |
//! | [`serving`] | the waypoint of a schedule, and the schedule of a waypoint |
//! | [`waypoint`] | sP2, the waypoint of a schedule, in the plane and in three dimensions |
//! | [`plan`] | plans over many slots |
//! | [`gap_costs`] | what the time between two visits of a sensor costs |
//! | [`operator_counts`] | what became of the changes that a search proposed |
//! | [`bound`] | lower bounds on the loss of a mission |
//! | [`geometry`] | disks and tours |
//! | [`node`] | the planner as a process of the ring |

pub mod assumed_link;
pub mod bound;
mod cone_program;
mod construction;
pub mod fleet;
pub mod gap_costs;
pub mod geometry;
pub mod keys;
pub mod mission_table;
pub mod neighbours;
#[cfg(feature = "node")]
pub mod node;
pub mod operator_counts;
pub mod plan;
pub mod planner;
pub mod route;
pub mod rules;
pub mod serving;
pub mod settings;
pub mod simulation;
pub mod strategies;
pub mod strategy;
pub mod waypoint;

pub use fleet::FleetPlanner;
pub use planner::Planner;
