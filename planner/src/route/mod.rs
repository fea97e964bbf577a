//! How a UAV gets somewhere: the only code that counts slots and joules.
//!
//! | module | contents |
//! |---|---|
//! | [`route`] | a flight in whole slots |
//! | [`motion`] | the routes of a UAV: straight, around zones, or along the lines of a grid |
//! | [`way_home`] | the route to the base, what it leaves, and charging |
//! | [`home`] | the same of any UAV, which may not have to come back |

pub mod home;
pub mod motion;
#[allow(clippy::module_inception)] // the room is named for what it makes
pub mod route;
pub mod way_home;
