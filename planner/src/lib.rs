//! Schedule and waypoint of each slot: the strategies and their waypoint solvers.
//!
//! [`Planner::step`] turns the UAV's position and the queues into a [`Plan`](skysink_common::message::Plan). It reads
//! no clock and moves nothing: flying, drawing the channel and keeping the queues are left to the other nodes of the
//! ring.
//!
//! | module | job |
//! |---|---|
//! | [`settings`], [`keys`] | `[planner]` of the scenario file |
//! | [`planner`] | one slot: schedule, then waypoint |
//! | [`sensor_table`] | what stays the same in every slot |
//! | [`strategies`] | schedule and waypoint by each strategy |
//! | [`waypoint`] | sP2, from where to serve them: in the plane and in three dimensions |
//! | [`horizon`] | the look-ahead over many slots |
//! | [`bound`] | the loss that no flight of a mission avoids |
//! | [`geometry`] | disks, grids and tours, which all of these use |
//! | [`node`] | the planner as a process of the ring |

pub mod bound;
pub mod geometry;
pub mod horizon;
pub mod keys;
#[cfg(feature = "node")]
pub mod node;
pub mod planner;
pub mod sensor_table;
pub mod settings;
pub mod strategies;
pub mod waypoint;

pub use planner::Planner;
