//! Whom to serve and where to fly: the strategies and their waypoint solvers.
//!
//! [`Planner::step`] turns the UAV's position and the queues into a [`Plan`](skysink_common::message::Plan). It reads
//! no clock and moves nothing: flying, drawing the channel and keeping the queues are left to the other nodes of the
//! ring.
//!
//! | module | job |
//! |---|---|
//! | [`planner`] | one slot: schedule, then waypoint |
//! | [`field`] | what stays the same in every slot |
//! | [`estimate`] | what the UAV can know of the queues |
//! | [`grid`] | who is near a point |
//! | `nearby` | the candidates of both searches, fullest first |
//! | [`search`], [`circles`] | sP1 by Algorithm 1 |
//! | [`exact`] | sP1 solved exactly |
//! | [`strategy`] | the baselines' waypoints, transit, and serving the fullest queues |
//! | [`waypoint`] | sP2 as a value, and its expansion sP2* |
//! | [`geometric`], [`conic`] | two solvers of sP2* |
//! | [`spatial`] | the waypoint in three dimensions, where the link is in line of sight by chance, as a value |
//! | [`ascent`], [`sca`] | two solvers of it |
//! | [`spatial_solver`] | which of them contributed what |

pub mod ascent;
mod carried;
pub mod circles;
pub mod conic;
pub mod estimate;
pub mod exact;
pub mod field;
pub mod geometric;
pub mod grid;
pub mod horizon;
pub mod memory;
mod nearby;
pub mod node;
pub mod planner;
pub mod recollection;
pub mod rounds;
pub mod sca;
pub mod search;
pub mod spatial;
pub mod spatial_solver;
pub mod strategy;
pub mod tour;
pub mod waypoint;

pub use planner::Planner;
